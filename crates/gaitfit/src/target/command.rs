//! A robot that another program runs.

use super::probe::with_python;
use super::{Evaluation, Plan, PolicyFiles, csv_files};
use crate::Error;
use crate::settings::TargetConfig;
use crate::watch::{Event, Watch};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{self, Stdio};

/// Programs that record and measure, as lists of words with places to fill in.
pub struct Command {
    collect: Vec<String>,
    evaluate: Vec<String>,
    trajectories: usize,
    seconds: f64,
}

/// Lines of a failed program's standard error that are repeated.
const LAST_LINES: usize = 20;
/// Most characters of a wrong document that are repeated.
const MOST_SHOWN: usize = 200;
/// Most bytes that a program may print, and that a line of its standard error may have.
const MOST_BYTES: u64 = 64 << 20;
const MOST_LINE: u64 = 1 << 16;

impl Command {
    /// The programs of a target. `python`: what `{python}` is, where that is known already.
    ///
    /// # Errors
    /// In words: a place to fill in that there is not.
    pub fn new(target: &TargetConfig, python: Option<&str>) -> Result<Self, String> {
        let TargetConfig { probe, collect, evaluate, .. } = target;
        for (words, name, known) in [
            (probe, "probe", &["python"][..]),
            (collect, "collect", &COLLECT[..]),
            (evaluate, "evaluate", &EVALUATE[..]),
        ] {
            for word in words {
                if let Some(unknown) = places(word).find(|place| !known.contains(place)) {
                    return Err(format!(
                        "`target.{name}` has {{{unknown}}}; there are {{{}}}",
                        known.join("}, {")
                    ));
                }
            }
        }
        if !collect.iter().any(|word| word.contains("{folder}")) {
            return Err(
                "`target.collect` has no {folder}: the program must be told where its logs go".to_owned()
            );
        }
        let words =
            |words: &[String]| python.map_or_else(|| words.to_vec(), |python| with_python(words, python));
        Ok(Self {
            collect: words(collect),
            evaluate: words(evaluate),
            trajectories: target.trajectories,
            seconds: target.seconds,
        })
    }

    /// Has the program record logs of the policy into `folder`.
    ///
    /// # Errors
    /// A program that cannot be run, fails or writes no log.
    pub fn collect(
        &self,
        policy: &PolicyFiles,
        seed: u64,
        folder: &Path,
        watch: &Watch<'_>,
    ) -> Result<(), Error> {
        let words = fill(
            &self.collect,
            policy,
            &[
                ("folder", folder.display().to_string()),
                ("trajectories", self.trajectories.to_string()),
                ("seconds", self.seconds.to_string()),
                ("seed", seed.to_string()),
            ],
        );
        run(&words, "target.collect", watch)?;
        if csv_files(folder)?.is_empty() {
            return Err(Error::failed(format!(
                "target.collect, `{}`: it ended well and wrote no .csv into {{folder}}",
                words.join(" ")
            )));
        }
        Ok(())
    }

    /// Has the program measure the policy, if there is one that does.
    ///
    /// # Errors
    /// A program that cannot be run, fails or prints something else.
    pub fn evaluate(
        &self,
        policy: &PolicyFiles,
        plan: &Plan,
        watch: &Watch<'_>,
    ) -> Result<Option<Evaluation>, Error> {
        if !self.measures() {
            return Ok(None);
        }
        let words = fill(
            &self.evaluate,
            policy,
            &[
                ("trajectories", plan.trajectories.to_string()),
                ("seconds", plan.seconds.to_string()),
                ("drift", plan.drift.to_string()),
                ("seed", plan.seed.to_string()),
            ],
        );
        let out = run(&words, "target.evaluate", watch)?;
        let mut found: Evaluation = serde_json::from_slice(&out).map_err(|error| {
            let text: String = String::from_utf8_lossy(&out).chars().take(MOST_SHOWN).collect();
            Error::failed(format!(
                "target.evaluate, `{}`: it printed no document such as `gaitfit evaluate --json` does: {error}. It \
                 begins: {}",
                words.join(" "),
                text.trim_end()
            ))
        })?;
        if let Some(wrong) = found.wrong() {
            return Err(Error::failed(format!(
                "target.evaluate, `{}`: {wrong}, which cannot be",
                words.join(" ")
            )));
        }
        found.policy = policy.name.clone();
        Ok(Some(found))
    }

    /// Whether there is a program that measures.
    pub fn measures(&self) -> bool {
        !self.evaluate.is_empty()
    }

    /// The program.
    pub fn description(&self) -> String {
        let words = self.collect.iter().take(3).take_while(|word| !word.contains('{'));
        format!("the robot of `{}`", words.cloned().collect::<Vec<_>>().join(" "))
    }
}

const COLLECT: [&str; 7] = ["python", "onnx", "policy", "folder", "trajectories", "seconds", "seed"];
const EVALUATE: [&str; 7] = ["python", "onnx", "policy", "trajectories", "seconds", "drift", "seed"];

/// Names in braces; braces around anything else are left alone.
fn places(word: &str) -> impl Iterator<Item = &str> {
    let inner = word.split('{').skip(1).filter_map(|rest| rest.split_once('}')).map(|(name, _)| name);
    inner.filter(|name| {
        !name.is_empty() && name.chars().all(|letter| letter.is_ascii_lowercase() || letter == '_')
    })
}

fn fill(words: &[String], policy: &PolicyFiles, values: &[(&str, String)]) -> Vec<String> {
    let onnx = policy.onnx.display().to_string();
    let safetensors = policy.safetensors.display().to_string();
    let fill = |word: &String| {
        let word = word.replace("{onnx}", &onnx).replace("{policy}", &safetensors);
        values.iter().fold(word, |word, (name, value)| word.replace(&format!("{{{name}}}"), value))
    };
    words.iter().map(fill).collect()
}

/// Runs a program to its end and gives what it printed; its standard error is passed on.
fn run(words: &[String], setting: &str, watch: &Watch<'_>) -> Result<Vec<u8>, Error> {
    let shown = words.join(" ");
    let failed = |what: String| Error::failed(format!("{setting}, `{shown}`: {what}"));
    let Some((program, arguments)) = words.split_first() else {
        return Err(failed("no program".to_owned()));
    };
    let mut child = process::Command::new(program)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| failed(format!("cannot be started: {error}; is it installed and on the path?")))?;
    let (out, err) = (child.stdout.take(), child.stderr.take());
    let (out, last) = std::thread::scope(|scope| {
        let last = scope.spawn(|| err.map(|err| pass_on(err, watch)).unwrap_or_default());
        let mut bytes = Vec::new();
        let read = out.map_or(Ok(0), |out| out.take(MOST_BYTES + 1).read_to_end(&mut bytes));
        if bytes.len() as u64 > MOST_BYTES {
            // Its standard error ends with it.
            let _ = child.kill();
        }
        (read.map(|_| bytes), last.join().unwrap_or_default())
    });
    let status = child.wait().map_err(|error| failed(error.to_string()))?;
    if watch.stop() {
        return Err(Error::Interrupted(format!("interrupted in {setting}; --resume runs it again")));
    }
    if out.as_ref().is_ok_and(|bytes| bytes.len() as u64 > MOST_BYTES) {
        return Err(failed(format!("it printed more than {} MiB", MOST_BYTES >> 20)));
    }
    if !status.success() {
        let said = if last.is_empty() { "it said nothing on standard error".to_owned() } else { last };
        return Err(failed(format!("{status}. {said}")));
    }
    out.map_err(|error| failed(format!("its output cannot be read: {error}")))
}

/// Repeats a program's standard error line by line, and keeps the last ones.
fn pass_on(stream: impl Read, watch: &Watch<'_>) -> String {
    let mut last = VecDeque::new();
    let mut stream = BufReader::new(stream);
    loop {
        let mut line = Vec::new();
        // A longer line comes in parts.
        match stream.by_ref().take(MOST_LINE).read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => break,
            Ok(_) => {}
        }
        let line = String::from_utf8_lossy(&line).trim_end().to_owned();
        // What a program says of an interruption is of no use to who asked for it.
        if !watch.stop() {
            watch.tell(Event::Output(&line));
        }
        last.push_back(line);
        if last.len() > LAST_LINES {
            last.pop_front();
        }
    }
    last.make_contiguous().join("\n")
}
