//! What a helper needs: the settings and every file that they name, as one archive. Files keep their places towards each
//! other, so that what lies beside a log, or is included by a robot, is found.

use crate::adapt::setup::Setup;
use crate::settings::AdaptConfig;
use crate::{Error, files, paths, robot};
use gaitfit_policy_files::weights;
use std::collections::BTreeMap;
use std::io::{Cursor, Read, Write};
use std::path::{Component, Path};
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

/// The settings in the archive; paths in them are places in it.
const CONFIG: &str = "config.toml";
const POLICY: &str = "policy.safetensors";
/// The folder of the files, under the names that they have from the root on.
const FILES: &str = "files";
/// Most bytes of an unpacked parcel.
const MAX_BYTES: u64 = 16 << 30;

impl Setup {
    /// Everything that a [`super::Helper`] needs to simulate as this fit does.
    ///
    /// # Errors
    /// Files that cannot be read any more, and names of files that are not UTF-8.
    pub fn parcel(&self) -> Result<Vec<u8>, Error> {
        let mut parcel = Parcel::default();
        let mut config = self.config.clone();
        // Only what is fitted is simulated elsewhere, and nothing is judged there.
        config.validate.clear();
        config.validate_gains.clear();
        config.check = Default::default();
        // Without a name the robot is the built-in one, which helpers have.
        if !config.robot.is_empty() {
            let path = paths::find(&config.robot, "robot", &self.config_path)?;
            config.robot = parcel.file(&path)?;
            for part in robot::parts(&path) {
                parcel.file(&part)?;
            }
        }
        // A policy that the caller gave every helper is given too.
        if let (Some(named), Some(walking), false) =
            (&mut config.policy, self.method.walking(), self.own_policy)
        {
            // The policy is written as it was read, so the format of its file does not matter.
            *named = POLICY.to_owned();
            parcel.0.insert(POLICY.to_owned(), weights::write(&walking.policy)?);
        }
        if let Some(named) = &mut config.known {
            *named = parcel.file(&paths::find(named, "known", &self.config_path)?)?;
        }
        config.logs.clear();
        for log in &self.fit.logs {
            // Files beside a log hold its gains and units, without which a helper reads it otherwise.
            for beside in &log.sidecars {
                parcel.file(beside)?;
            }
            let place = parcel.file(&log.path)?;
            // A log that was cut is several.
            if !config.logs.contains(&place) {
                config.logs.push(place);
            }
        }
        let text = toml::to_string(&config)
            .map_err(|error| Error::failed(format!("the settings cannot be written: {error}")))?;
        parcel.0.insert(CONFIG.to_owned(), text.into_bytes());
        parcel.archive()
    }
}

/// Unpacks a parcel into an empty folder; its settings, with paths that lead there.
///
/// # Errors
/// Bytes that are no parcel, a folder that cannot be written.
pub(super) fn unpack(bytes: &[u8], folder: &Path) -> Result<AdaptConfig, Error> {
    let broken =
        |error: &dyn std::fmt::Display| Error::failed(format!("a parcel cannot be unpacked: {error}"));
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| broken(&error))?;
    // The sum of all files is limited, because an archive of few bytes can unpack to any size.
    let mut left = MAX_BYTES;
    for number in 0..archive.len() {
        let file = archive.by_index(number).map_err(|error| broken(&error))?;
        // Names with `..` or a root would write outside the folder.
        let name = file.enclosed_name().ok_or_else(|| broken(&"a name in it leads out of it"))?;
        let path = folder.join(name);
        let mut content = Vec::new();
        // A byte more than is left shows that the file is too large, without reading all of it.
        file.take(left + 1).read_to_end(&mut content).map_err(|error| broken(&error))?;
        left = left.checked_sub(content.len() as u64).ok_or_else(|| broken(&"it is too large"))?;
        let parent = path.parent().unwrap_or(folder);
        std::fs::create_dir_all(parent).map_err(|error| Error::unwritable(parent, error))?;
        std::fs::write(&path, content).map_err(|error| Error::unwritable(&path, error))?;
    }
    let text = files::read_text(&folder.join(CONFIG), files::MAX_BYTES).map_err(|error| broken(&error))?;
    let mut config: AdaptConfig = toml::from_str(&text).map_err(|error| broken(&error))?;
    // Paths inside the parcel become paths of this machine.
    let named = config.logs.iter_mut().chain(&mut config.policy).chain(&mut config.known);
    let robot = Some(&mut config.robot).filter(|robot| !robot.is_empty());
    for place in named.chain(robot) {
        *place = folder.join(&*place).display().to_string();
    }
    Ok(config)
}

/// Files by their places in the archive.
#[derive(Default)]
struct Parcel(BTreeMap<String, Vec<u8>>);

impl Parcel {
    /// Takes a file; its place.
    fn file(&mut self, path: &Path) -> Result<String, Error> {
        let place = place(path)?;
        if !self.0.contains_key(&place) {
            let bytes =
                files::read(path, files::MAX_BYTES).map_err(|error| Error::unreadable(path, error))?;
            self.0.insert(place.clone(), bytes);
        }
        Ok(place)
    }

    fn archive(self) -> Result<Vec<u8>, Error> {
        let failed =
            |error: &dyn std::fmt::Display| Error::failed(format!("a parcel cannot be made: {error}"));
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in self.0 {
            // Without a time: the same fit makes the same bytes.
            // Level 1 is the fastest: logs are text, which even this level makes much smaller.
            let options = SimpleFileOptions::default().compression_level(Some(1)).large_file(true);
            archive.start_file(name, options).map_err(|error| failed(&error))?;
            archive.write_all(&bytes).map_err(|error| failed(&error))?;
        }
        Ok(archive.finish().map_err(|error| failed(&error))?.into_inner())
    }
}

/// The place of a file in a parcel.
fn place(path: &Path) -> Result<String, Error> {
    let whole = std::path::absolute(path).map_err(|error| Error::unreadable(path, error))?;
    let mut place = vec![FILES];
    for part in whole.components() {
        match part {
            Component::Normal(name) => place.push(name.to_str().ok_or_else(|| {
                Error::settings(format!("{}: its name is not UTF-8; rename it", path.display()))
            })?),
            Component::ParentDir if place.len() > 1 => {
                place.pop();
            }
            _ => {}
        }
    }
    Ok(place.join("/"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn places_lead_nowhere_else() {
        assert_eq!(place(Path::new("/a/b/../c.csv")).unwrap(), "files/a/c.csv");
        assert_eq!(place(Path::new("/../../c.csv")).unwrap(), "files/c.csv");
    }

    #[test]
    fn what_is_no_parcel_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        archive.start_file("../out", SimpleFileOptions::default()).unwrap();
        let bytes = archive.finish().unwrap().into_inner();
        for (bytes, part) in [(&b"PK"[..], "cannot be unpacked"), (&bytes, "leads out of it")] {
            let error = unpack(bytes, folder.path()).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
