//! Running another program to its end: what it prints, how long it may take, and how it is stopped.

use super::group::{Group, LOOK};
use crate::watch::{Event, Watch};
use gaitfit_model::escaped;
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

/// Lines of standard error that are kept for a message.
const LAST_LINES: usize = 20;
/// Max number of bytes that a program may print, and of a line of its standard error.
const MAX_BYTES: usize = 64 << 20;
const MAX_LINE: u64 = 1 << 16;
/// Bytes that are read at once.
const CHUNK: usize = 1 << 16;
/// Time that a program has to end once it is asked to: a robot may have to lie down.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time to wait for a program's output once it has ended: a process that it left may hold the pipe for ever.
const GRACE: Duration = Duration::from_secs(1);

/// Result of a program.
#[derive(Debug)]
pub struct Output {
    /// Its exit status.
    pub status: ExitStatus,
    /// Its standard output.
    pub out: Vec<u8>,
    /// The last lines of its standard error.
    pub last: String,
}

/// Why a program did not come to an end of its own.
#[derive(Debug, thiserror::Error)]
pub enum ProcessError {
    /// There are no words.
    #[error("no program")]
    Empty,
    /// It cannot be started.
    #[error("cannot be started: {0}; is it installed and on the path?")]
    Start(std::io::Error),
    /// It cannot be waited for.
    #[error("{0}")]
    Wait(std::io::Error),
    /// It took too long.
    #[error(
        "it ran for more than {seconds} s and was stopped; `target.timeout_seconds` allows longer. {said}"
    )]
    Timeout {
        /// How long it may take, s.
        seconds: f64,
        /// Its last lines of standard error.
        said: String,
    },
    /// It printed too much.
    #[error("it printed more than {} MiB", MAX_BYTES >> 20)]
    TooMuch,
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}

impl ProcessError {
    /// Whether there is no such program.
    pub fn is_missing(&self) -> bool {
        matches!(self, Self::Start(error) if error.kind() == std::io::ErrorKind::NotFound)
    }
}

/// A piece of what a program says.
enum Piece {
    Out(Vec<u8>),
    Line(String),
}

/// A program to be run.
pub struct Program<'a> {
    /// Its name or path, and its arguments.
    pub words: &'a [String],
    /// How long it may take, s.
    pub timeout_seconds: f64,
    /// Whether lines of its standard error are passed on.
    pub heard: bool,
}

impl Program<'_> {
    /// Runs it to its end. It has no input. All processes that it leaves in its group end with it.
    ///
    /// # Errors
    /// A program that cannot be run, takes too long or prints too much, or an interruption.
    pub fn run(&self, watch: &Watch<'_>) -> Result<Output, ProcessError> {
        let (program, arguments) = self.words.split_first().ok_or(ProcessError::Empty)?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut group = Group::start(&mut command).map_err(ProcessError::Start)?;
        // Bounded, so that a program that prints faster than this reads waits instead of filling the memory.
        let (sender, receiver) = sync_channel(64);
        // These threads end with their pipes. A process that outlives its group may hold one: it is not waited for.
        if let Some(out) = group.child.stdout.take() {
            let sender = sender.clone();
            std::thread::spawn(move || read_out(out, &sender));
        }
        if let Some(err) = group.child.stderr.take() {
            std::thread::spawn(move || read_lines(err, &sender));
        }
        let mut said = Said { receiver, out: Vec::new(), last: VecDeque::new(), heard: self.heard, watch };
        let status = self.wait(&mut group, &mut said)?;
        // What the program printed last may still be in its pipes.
        let ended = Instant::now();
        while ended.elapsed() < GRACE && said.listen(LOOK) {}
        // While it ends, its pipes are read: a program that cannot print does not end.
        group.end(PATIENCE, || said.take());
        // A process outside the group may hold a pipe open: each look waits, so that the loop does not spin.
        while said.listen(LOOK) && ended.elapsed() < GRACE + PATIENCE {}
        // Again: the last pieces came after the loop that waits.
        if said.out.len() > MAX_BYTES {
            return Err(ProcessError::TooMuch);
        }
        Ok(Output { status, last: said.last(), out: said.out })
    }

    /// Runs it to its end at this program's own terminal, where a person answers it: what it reads and says there is not
    /// seen here. What it prints is let go, and it may take as long as it wants.
    ///
    /// # Errors
    /// A program that cannot be run, or an interruption.
    pub fn attended(&self, watch: &Watch<'_>) -> Result<ExitStatus, ProcessError> {
        let (program, arguments) = self.words.split_first().ok_or(ProcessError::Empty)?;
        let mut command = Command::new(program);
        command.args(arguments).stdout(Stdio::null());
        let mut group = Group::start_at_terminal(&mut command).map_err(ProcessError::Start)?;
        loop {
            std::thread::sleep(LOOK);
            if watch.stop() {
                group.end(PATIENCE, || ());
                return Err(ProcessError::Interrupted);
            }
            if let Some(status) = group.ended().map_err(ProcessError::Wait)? {
                return Ok(status);
            }
        }
    }

    /// Waits for the program itself, or stops it with all it started.
    fn wait(&self, group: &mut Group, said: &mut Said<'_>) -> Result<ExitStatus, ProcessError> {
        let begun = Instant::now();
        // An infinite time does not fit into a `Duration`.
        let allowed = Duration::try_from_secs_f64(self.timeout_seconds).unwrap_or(Duration::MAX);
        let why = loop {
            // Without its pipes the program may still run; then `listen` returns at once and must not spin.
            if !said.listen(LOOK) {
                std::thread::sleep(LOOK);
            }
            if said.watch.stop() {
                break ProcessError::Interrupted;
            }
            // Before the limits: a program that is done just in time counts as done.
            if let Some(status) = group.ended().map_err(ProcessError::Wait)? {
                return Ok(status);
            }
            if said.out.len() > MAX_BYTES {
                break ProcessError::TooMuch;
            }
            if begun.elapsed() > allowed {
                break ProcessError::Timeout { seconds: self.timeout_seconds, said: String::new() };
            }
        };
        group.end(PATIENCE, || said.take());
        // The last lines are known only now, after the program has ended.
        Err(match why {
            ProcessError::Timeout { seconds, .. } => ProcessError::Timeout { seconds, said: said.last() },
            why => why,
        })
    }
}

/// Output of a program so far.
struct Said<'a> {
    receiver: Receiver<Piece>,
    out: Vec<u8>,
    last: VecDeque<String>,
    heard: bool,
    watch: &'a Watch<'a>,
}

impl Said<'_> {
    /// Takes a piece and all that are there, waiting at most so long for the first. False once both pipes have ended.
    fn listen(&mut self, wait: Duration) -> bool {
        match self.receiver.recv_timeout(wait) {
            Ok(piece) => self.keep(piece),
            Err(RecvTimeoutError::Timeout) => return true,
            Err(RecvTimeoutError::Disconnected) => return false,
        }
        self.take();
        true
    }

    /// Takes all pieces that are there.
    fn take(&mut self) {
        // Not for ever: a program may talk faster than this reads.
        for _ in 0..64 {
            let Ok(piece) = self.receiver.try_recv() else { break };
            self.keep(piece);
        }
    }

    fn keep(&mut self, piece: Piece) {
        match piece {
            Piece::Out(bytes) if self.out.len() <= MAX_BYTES => self.out.extend(bytes),
            // Beyond the limit bytes are read and dropped, so that the program does not wait for its pipe.
            Piece::Out(_) => {}
            Piece::Line(line) => {
                // What a program says of an interruption is of no use to who asked for it.
                if self.heard && !self.watch.stop() {
                    self.watch.tell(Event::Output(&line));
                }
                self.last.push_back(line);
                if self.last.len() > LAST_LINES {
                    self.last.pop_front();
                }
            }
        }
    }

    fn last(&mut self) -> String {
        self.last.make_contiguous().join("\n")
    }
}

fn read_out(mut stream: impl Read, sender: &SyncSender<Piece>) {
    let mut buffer = vec![0; CHUNK];
    loop {
        match stream.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => {
                if sender.send(Piece::Out(buffer[..count].to_vec())).is_err() {
                    break;
                }
            }
            // A signal came while it waited; nothing was read or lost.
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(_) => break,
        }
    }
}

fn read_lines(stream: impl Read, sender: &SyncSender<Piece>) {
    let mut stream = BufReader::new(stream);
    loop {
        let mut line = Vec::new();
        // A longer line comes in parts.
        match stream.by_ref().take(MAX_LINE).read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => break,
            Ok(_) => {}
        }
        // A program's line may hold characters that steer the terminal.
        let line = escaped(String::from_utf8_lossy(&line).trim_end(), MAX_LINE as usize);
        if sender.send(Piece::Line(line)).is_err() {
            break;
        }
    }
}

#[cfg(all(test, unix))]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use std::ops::ControlFlow;
    use std::path::Path;

    fn sh(script: &str, timeout_seconds: f64, watch: &Watch<'_>) -> Result<Output, ProcessError> {
        let words = ["sh", "-c", script].map(str::to_owned);
        Program { words: &words, timeout_seconds, heard: true }.run(watch)
    }

    fn there(file: &Path) -> bool {
        let pid: i32 = std::fs::read_to_string(file).unwrap().trim().parse().unwrap();
        // A zombie that nobody waits for is not there.
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        !stat.is_empty() && !stat.contains(") Z ")
    }

    #[test]
    fn what_a_program_prints_and_says_is_kept() {
        let output =
            sh("echo 1; echo a >&2; printf '\\033[2Jb' >&2; exit 3", 60.0, &Watch::silent()).unwrap();
        assert_eq!((output.status.code(), output.out.as_slice()), (Some(3), &b"1\n"[..]));
        assert_eq!(output.last, "a\n\\u{1b}[2Jb");
        let much = sh("head -c 300000 /dev/zero", 60.0, &Watch::silent()).unwrap();
        assert_eq!(much.out.len(), 300_000);
    }

    #[test]
    fn a_program_that_prints_without_end_is_stopped() {
        let error = sh("yes", 60.0, &Watch::silent()).unwrap_err();
        assert!(matches!(error, ProcessError::TooMuch), "{error}");
    }

    #[test]
    fn a_program_that_takes_too_long_is_stopped_with_what_it_started() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("pid");
        // It does not listen to SIGTERM, and neither does its child.
        let script = format!(
            "echo slow >&2; trap '' TERM; sh -c 'trap \"\" TERM; echo $$ > {0}; while :; do sleep 0.1; done' & wait",
            file.display()
        );
        let begun = Instant::now();
        let error = sh(&script, 0.5, &Watch::silent()).unwrap_err();
        assert!(error.to_string().contains("0.5 s") && error.to_string().contains("slow"), "{error}");
        assert!(begun.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(200));
        assert!(!there(&file));
    }

    #[test]
    fn an_interruption_is_passed_on_as_sigterm() {
        let folder = tempfile::tempdir().unwrap();
        let (ready, lain) = (folder.path().join("ready"), folder.path().join("lain"));
        let callback = |_: Event<'_>| {
            if ready.exists() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let script = format!(
            "trap 'touch {}; exit 0' TERM; touch {}; while :; do sleep 0.05; done",
            lain.display(),
            ready.display()
        );
        let error = sh(&script, 60.0, &Watch::new(&callback)).unwrap_err();
        assert!(matches!(error, ProcessError::Interrupted), "{error}");
        assert!(lain.exists(), "the program could end as it wants to");
    }

    #[test]
    fn what_a_program_leaves_holds_nothing_up_and_ends_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("pid");
        let script = format!("sleep 600 & echo $! > {}; echo out", file.display());
        let begun = Instant::now();
        let output = sh(&script, 60.0, &Watch::silent()).unwrap();
        assert_eq!(output.out, b"out\n");
        assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
        std::thread::sleep(Duration::from_millis(200));
        assert!(!there(&file));
    }
}
