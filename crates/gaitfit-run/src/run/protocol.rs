//! The protocol of a run folder, the same for fits, trainings and loops.
//!
//! 1. A folder that was begun with other settings or inputs is refused, and what differs is named.
//! 2. A folder that has `result.json` is finished: this is its result, unless more is asked for now.
//! 3. Otherwise `config.toml` and `manifest.json` are written, and the work begins or continues.
//! 4. `result.json` is written last: a folder that has it has everything.

use super::changes::{bound, difference};
pub use super::names::{CONFIG, RESULT};
use super::{Inputs, RunFolder, manifest};
use crate::Error;
use crate::machine::now;
use crate::watch::Watch;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use toml::Table;

/// A run in its folder.
pub struct Protocol<'a, A = Whole> {
    /// The folder.
    pub folder: &'a RunFolder,
    /// All settings, as `config.toml` keeps them.
    pub settings: Table,
    /// Settings that may differ when the run resumes, by dotted names such as `train.iterations`.
    pub free: &'a [&'a str],
    /// Files, robot and settings on which the result depends.
    pub inputs: Inputs,
    /// Whether input files must be the same files; otherwise only the robot and the settings they make count.
    pub same_files: bool,
    /// Seeds, for the manifest.
    pub seeds: Vec<u64>,
    /// Devices, for the manifest, such as `cuda:0,1`: a run may resume on another device.
    pub devices: String,
    /// How much is asked for. If a run has finished with another extent, it continues.
    pub asked: A,
}

/// The extent of a run that cannot grow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Whole {}

/// `result.json`.
#[derive(Serialize, Deserialize)]
struct ResultFile<A, R> {
    inputs: Inputs,
    #[serde(flatten)]
    asked: A,
    results: R,
}

impl<A: Clone + PartialEq + Serialize + DeserializeOwned> Protocol<'_, A> {
    /// Gives the folder's result if it is finished, or else has `work` make it, and keeps it.
    ///
    /// # Errors
    /// A folder of other settings or inputs, files that are damaged or cannot be written, and those of `work`.
    pub fn run<R: Serialize + DeserializeOwned, E: From<Error>>(
        &self,
        watch: &Watch<'_>,
        work: impl FnOnce() -> Result<R, E>,
    ) -> Result<R, E> {
        self.check()?;
        if let Some(results) = self.finished()? {
            watch.note(&format!("{} is finished; this is its result", self.folder.path().display()));
            return Ok(results);
        }
        // Before the work, so that a run that is killed can be resumed with its own settings.
        let begun = self.begin()?;
        let results = work()?;
        Ok(self.finish(&begun, results)?)
    }

    /// The settings that the folder was begun with, if it was.
    ///
    /// # Errors
    /// A file that is damaged.
    pub fn saved(&self) -> Result<Option<Table>, Error> {
        let Some(text) = self.folder.read(CONFIG)? else { return Ok(None) };
        toml::from_str(&text).map(Some).map_err(|_| {
            let problem = format!(
                "not a configuration ({} bytes). Restore it, or start afresh without --resume.",
                text.len()
            );
            Error::content(&self.folder.path().join(CONFIG), problem)
        })
    }

    /// A setting or input that the folder was begun with and that is not so now, in words.
    ///
    /// # Errors
    /// Files that are damaged.
    pub fn difference(&self) -> Result<Option<String>, Error> {
        if let Some(saved) = self.saved()? {
            let difference = difference(&bound(saved, self.free), &bound(self.settings.clone(), self.free));
            if difference.is_some() {
                return Ok(difference);
            }
        }
        Ok(manifest::inputs(self.folder)?.and_then(|saved| self.changed(&saved)))
    }

    /// Returns the first difference from `saved`, in words.
    fn changed(&self, saved: &Inputs) -> Option<String> {
        if self.same_files {
            return self.inputs.difference(saved);
        }
        // Files may have moved: the robot and the settings that were made of them are compared instead.
        let without = |inputs: &Inputs| Inputs { files: Default::default(), ..inputs.clone() };
        without(&self.inputs).difference(&without(saved))
    }

    /// Refuses settings that are no numbers, and to resume with other settings or inputs, naming what differs.
    ///
    /// # Errors
    /// As it says, or files that are damaged.
    pub fn check(&self) -> Result<(), Error> {
        if let Some(name) = no_number("", &self.settings) {
            return Err(Error::settings(format!("`{name}` is not a number; give one, or leave it out")));
        }
        match self.difference()? {
            None => Ok(()),
            Some(difference) => Err(self.refusal(&difference)),
        }
    }

    /// Makes the error of a folder whose run cannot resume: `difference` in words.
    pub fn refusal(&self, difference: &str) -> Error {
        Error::Changed { folder: self.folder.path().to_owned(), difference: difference.to_owned() }
    }

    /// The result, if the run is finished as it is asked for now.
    ///
    /// # Errors
    /// A damaged file, or a result of other inputs.
    pub fn finished<R: Serialize + DeserializeOwned>(&self) -> Result<Option<R>, Error> {
        let Some(text) = self.folder.read(RESULT)? else { return Ok(None) };
        let file: ResultFile<A, R> = serde_json::from_str(&text).map_err(|error| {
            let problem = format!("not a result of this version: {error}. Start afresh without --resume.");
            Error::content(&self.folder.path().join(RESULT), problem)
        })?;
        // With another extent the run continues from its checkpoint, and this result is replaced.
        if file.asked != self.asked {
            return Ok(None);
        }
        match self.changed(&file.inputs) {
            None => Ok(Some(file.results)),
            Some(difference) => Err(Error::Outdated { folder: self.folder.path().to_owned(), difference }),
        }
    }

    /// Writes what is known before the work; gives the time.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn begin(&self) -> Result<String, Error> {
        let begun = now();
        // A run that resumes writes its settings again, because free ones may have changed.
        let text = toml::to_string_pretty(&self.settings)
            .map_err(|error| Error::failed(format!("cannot write {CONFIG}: {error}")))?;
        self.folder.write(CONFIG, text.as_bytes())?;
        manifest::write(self.folder, &self.seeds, &self.devices, &self.inputs, &begun, None)?;
        Ok(begun)
    }

    /// Writes the result.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn finish<R: Serialize>(&self, begun: &str, results: R) -> Result<R, Error> {
        // The manifest first: a folder with a result has everything.
        manifest::write(self.folder, &self.seeds, &self.devices, &self.inputs, begun, Some(now()))?;
        let file = ResultFile { inputs: self.inputs.clone(), asked: self.asked.clone(), results };
        self.folder.write_json(RESULT, &file)?;
        Ok(file.results)
    }
}

/// The dotted name of the first number that is none (NaN): no setting means that, and comparisons with it pass unseen.
fn no_number(path: &str, table: &Table) -> Option<String> {
    fn within(path: String, value: &toml::Value) -> Option<String> {
        match value {
            toml::Value::Table(table) => no_number(&path, table),
            toml::Value::Array(array) => {
                array.iter().enumerate().find_map(|(place, value)| within(format!("{path}.{place}"), value))
            }
            toml::Value::Float(number) => number.is_nan().then_some(path),
            _ => None,
        }
    }
    table.iter().find_map(|(key, value)| {
        within(if path.is_empty() { key.clone() } else { format!("{path}.{key}") }, value)
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[derive(Clone, PartialEq, Serialize, Deserialize)]
    struct Asked {
        rounds: u32,
    }

    fn protocol<'a>(folder: &'a RunFolder, settings: &str, rounds: u32) -> Protocol<'a, Asked> {
        let settings: Table = toml::from_str(settings).unwrap();
        let files = [("log.csv".to_owned(), "1".to_owned())].into();
        let inputs = Inputs { files, model: "robot".to_owned(), settings: String::new() };
        let (seeds, devices, asked) = (vec![1], "cpu".to_owned(), Asked { rounds });
        Protocol { folder, settings, free: &["rounds"], inputs, same_files: true, seeds, devices, asked }
    }

    #[test]
    fn a_run_is_made_once_goes_on_when_more_is_asked_for_and_refuses_other_settings() {
        let runs = tempfile::tempdir().unwrap();
        let folder = RunFolder::fresh(runs.path(), "a").unwrap();
        let silent = Watch::silent();
        let text = "x = 1\nrounds = 1\n";
        let failed = protocol(&folder, text, 1).run::<u32, Error>(&silent, || Err(Error::failed("broken")));
        assert_eq!(failed.unwrap_err().to_string(), "broken");
        assert!(folder.read(RESULT).unwrap().is_none() && folder.read(CONFIG).unwrap().is_some());
        assert_eq!(protocol(&folder, text, 1).run::<_, Error>(&silent, || Ok(7)).unwrap(), 7);
        assert_eq!(
            protocol(&folder, text, 1).run::<_, Error>(&silent, || Ok(8)).unwrap(),
            7,
            "it is finished"
        );
        let more = "x = 1\nrounds = 2\n";
        assert_eq!(protocol(&folder, more, 2).run::<_, Error>(&silent, || Ok(9)).unwrap(), 9);
        let other =
            protocol(&folder, "x = 2\nrounds = 2\n", 2).run::<_, Error>(&silent, || Ok(1)).unwrap_err();
        assert!(other.to_string().contains("`x` was 1, now it is 2"), "{other}");
        assert!(folder.read(CONFIG).unwrap().unwrap().contains("x = 1"), "a refusal writes nothing");
        let none = protocol(&folder, "x = 1\ny = [{ z = nan }]\n", 2)
            .run::<_, Error>(&silent, || Ok(1))
            .unwrap_err();
        assert_eq!((none.key(), none.kind()), (Some("y.0.z"), crate::ErrorKind::Settings), "{none}");
    }

    #[test]
    fn other_inputs_are_refused_before_anything_is_written() {
        let runs = tempfile::tempdir().unwrap();
        let folder = RunFolder::fresh(runs.path(), "a").unwrap();
        protocol(&folder, "x = 1\n", 1).begin().unwrap();
        let mut changed = protocol(&folder, "x = 1\n", 1);
        changed.inputs.model = "another".to_owned();
        let error = changed.run::<_, Error>(&Watch::silent(), || Ok(1)).unwrap_err();
        assert!(error.to_string().contains("the robot"), "{error}");
        let mut moved = protocol(&folder, "x = 1\n", 1);
        moved.inputs.files.clear();
        assert!(moved.check().unwrap_err().to_string().contains("log.csv"));
        moved.same_files = false;
        moved.check().unwrap();
        folder.write("manifest.json", b"{").unwrap();
        let error = changed.check().unwrap_err();
        assert!(error.to_string().contains("manifest.json"), "{error}");
    }
}
