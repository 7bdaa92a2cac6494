//! A Unitree Go2, which `gaitfit collect --robot` walks in a process of its own: its loops need the system's priority and
//! the signals for themselves, and training must have neither.

use super::PolicyFiles;
use super::process::{ProcessError, Program};
use crate::Error;
use crate::files;
use crate::log_folder::write_whole;
use crate::settings::{TargetConfig, TargetKind};
use crate::watch::Watch;
use gaitfit_log::csv_files;
use std::fs;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

/// The robot.
pub struct Robot {
    /// This program, and the words that say which robot.
    program: String,
    link: Vec<String>,
    description: String,
    /// Whether nobody is asked.
    yes: bool,
    trajectories: usize,
    seconds: f64,
}

/// A shorter log shows nothing of a walk: its walk is made again, s.
const SHORTEST: f64 = 1.0;
/// Exit codes of `gaitfit collect`: nobody typed the word, and interrupted (128 + SIGINT, as shells have it).
const NOT_ARMED: i32 = 3;
const INTERRUPTED: i32 = 130;
/// Folder of what was walked, a folder a session, beside the folder of the logs.
const SESSIONS: &str = "sessions";

impl Robot {
    /// The robot of a target; `program` is gaitfit's own.
    pub fn new(target: &TargetConfig, program: &Path) -> Self {
        let words = |words: &[&str]| words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>();
        let (mut link, description) = match target.kind {
            TargetKind::Robot => {
                let domain = target.domain.to_string();
                let of_domain = if target.domain == 0 { String::new() } else { format!(", domain {domain}") };
                (
                    words(&["--robot", &target.robot, "--interface", &target.interface, "--domain", &domain]),
                    format!("{} on {}{of_domain}", target.robot, target.interface),
                )
            }
            _ => (words(&["--robot", "simulated"]), "a simulated Go2, on the clock".to_owned()),
        };
        let (pause, patience) = (target.pause.to_string(), target.patience.to_string());
        link.extend(words(&["--pause", &pause, "--patience", &patience]));
        if target.yes {
            link.push("--yes".to_owned());
        }
        Self {
            program: program.display().to_string(),
            link,
            description,
            yes: target.yes,
            trajectories: target.trajectories,
            seconds: target.seconds,
        }
    }

    /// Refuses to begin where nobody can type the word that arms the robot.
    ///
    /// # Errors
    /// As it says.
    pub fn check_person(&self) -> Result<(), Error> {
        if self.yes || std::io::stdin().is_terminal() {
            return Ok(());
        }
        Err(Error::settings(
            "before each walk of [target] a person types a word, and standard input is no terminal; start the loop in a \
             terminal (in `tmux` it outlives the connection). A simulator, in another domain than 0, may have `target.yes`",
        ))
    }

    /// Has the robot walk; its logs are then in `into`. What earlier sessions have walked is not walked again: each leaves
    /// its walks beside `into`.
    ///
    /// # Errors
    /// Walks that did not come to their end. What was walked is kept.
    pub fn collect(
        &self,
        policy: &PolicyFiles,
        seed: u64,
        into: &Path,
        watch: &Watch<'_>,
    ) -> Result<(), Error> {
        let sessions = into.with_file_name(SESSIONS);
        let mut made = made(&sessions)?;
        if made.len() < self.trajectories {
            let before = made.len();
            if before > 0 {
                watch.note(&format!("{before} of {} walks are made already", self.trajectories));
            }
            let ended = self.walk(policy, seed, before, &next(&sessions)?, watch);
            // Counted anew whatever the outcome: a session that ended in an error may have made walks.
            made = self::made(&sessions)?;
            if made.len() < self.trajectories {
                let error = ended
                    .err()
                    .unwrap_or_else(|| Error::failed("the robot made fewer walks than asked for."));
                // Walks of a real robot are not thrown away: the next session makes the missing ones.
                return Err(match made.len() {
                    0 => error,
                    count => error.advised(format!(
                        "{count} of {} walks are in {}; --resume asks for the others.",
                        self.trajectories,
                        sessions.display()
                    )),
                });
            }
            // It made all walks and did not lie down as it should.
            if let Err(error) = ended {
                watch.note(&format!("all walks are made, and then: {error}"));
            }
        }
        write_whole(into, |folder| {
            // Names of equal length, so that the order of names is that of the walks.
            let digits = self.trajectories.saturating_sub(1).to_string().len().max(2);
            for (number, log) in made.iter().take(self.trajectories).enumerate() {
                let to = folder.join(format!("trajectory_{number:0digits$}.csv"));
                fs::copy(log, &to).map_err(|error| Error::unwritable(&to, error))?;
            }
            Ok(())
        })
    }

    /// A session: all walks but the first `made`.
    fn walk(
        &self,
        policy: &PolicyFiles,
        seed: u64,
        made: usize,
        out: &Path,
        watch: &Watch<'_>,
    ) -> Result<(), Error> {
        let named = |name: &str, value: String| [name.to_owned(), value];
        let mut words =
            vec![self.program.clone(), "collect".to_owned(), policy.safetensors.display().to_string()];
        words.extend(self.link.iter().cloned());
        words.extend(named("--trajectories", (self.trajectories - made).to_string()));
        words.extend(named("--seconds", self.seconds.to_string()));
        // A later session draws other commands than those that are walked already.
        words.extend(named("--seed", seed.wrapping_add(made as u64).to_string()));
        words.extend(named("--out", out.display().to_string()));
        // A person may take any time to type the word.
        let program = Program { words: &words, timeout_seconds: f64::INFINITY, heard: true };
        let ended = match self.yes {
            true => program.run(watch).map(|output| (output.status, output.last)),
            false => program.attended(watch).map(|status| (status, String::new())),
        };
        let interrupted = || Error::interrupted_with_nothing("interrupted while the robot walked.");
        let (status, said) = match ended {
            Ok(ended) => ended,
            Err(ProcessError::Interrupted) => return Err(interrupted()),
            Err(error) if error.is_missing() => {
                return Err(Error::Missing(format!("{}: {error}", self.program)));
            }
            Err(error) => return Err(Error::failed(format!("`{}`: {error}", words.join(" ")))),
        };
        // The last line is the program's error; lines before it are its progress.
        let said = said.lines().last().map_or_else(String::new, |line| format!(": {line}"));
        match status.code() {
            Some(0) => Ok(()),
            Some(INTERRUPTED) => Err(interrupted()),
            Some(NOT_ARMED) => {
                Err(Error::failed("the walk was not begun: nobody typed the word. --resume asks again."))
            }
            _ => Err(Error::failed(format!("the robot's walk ended early ({status}){said}."))),
        }
    }

    /// The robot, in a few words.
    pub fn description(&self) -> String {
        self.description.clone()
    }
}

/// The walks of all sessions, the first one first. A log too short for anything, the last of a session that was stopped,
/// is none.
fn made(sessions: &Path) -> Result<Vec<PathBuf>, Error> {
    let mut logs = Vec::new();
    for number in 1.. {
        let session = sessions.join(number.to_string());
        if !session.is_dir() {
            // Sessions are numbered without gaps, so the first missing number is the end.
            break;
        }
        for log in csv_files(&session)? {
            if seconds(&log)? >= SHORTEST {
                logs.push(log);
            }
        }
    }
    Ok(logs)
}

/// A folder for the next session.
fn next(sessions: &Path) -> Result<PathBuf, Error> {
    fs::create_dir_all(sessions).map_err(|error| Error::unwritable(sessions, error))?;
    let mut numbers = 1..;
    let free = numbers.find(|number: &u32| !sessions.join(number.to_string()).exists());
    Ok(sessions.join(free.unwrap_or_default().to_string()))
}

/// The last time of a log, s; 0 without a row.
fn seconds(log: &Path) -> Result<f64, Error> {
    let text = files::read_text(log, files::MAX_BYTES).map_err(|error| Error::unreadable(log, error))?;
    let last = text.lines().last().and_then(|line| line.split(',').next());
    Ok(last.and_then(|cell| cell.parse().ok()).unwrap_or(0.0))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn walks_of_all_sessions_count_but_those_that_hardly_began() {
        let folder = tempfile::tempdir().unwrap();
        let sessions = folder.path().join(SESSIONS);
        assert!(made(&sessions).unwrap().is_empty());
        for (session, name, last) in [
            (1, "trajectory_00.csv", "3.98,1"),
            (1, "trajectory_01.csv", "0.4,1"),
            (2, "trajectory_00.csv", "3.98,1"),
            (10, "trajectory_00.csv", "3.98,1"),
        ] {
            let log = sessions.join(session.to_string()).join(name);
            fs::create_dir_all(log.parent().unwrap()).unwrap();
            fs::write(log, format!("time,q_a\n0,1\n{last}\n")).unwrap();
        }
        fs::create_dir_all(sessions.join("1/run")).unwrap();
        fs::write(sessions.join("1/run/whole.csv"), "time\n9\n").unwrap();
        let walks = |made: Vec<PathBuf>| -> Vec<String> {
            made.iter().map(|log| log.strip_prefix(&sessions).unwrap().display().to_string()).collect()
        };
        assert_eq!(walks(made(&sessions).unwrap()), ["1/trajectory_00.csv", "2/trajectory_00.csv"]);
        assert_eq!(next(&sessions).unwrap(), sessions.join("3"));
        fs::write(sessions.join("2/trajectory_01.csv"), "time,q_a\n").unwrap();
        assert_eq!(made(&sessions).unwrap().len(), 2);
    }
}
