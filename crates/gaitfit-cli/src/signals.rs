//! Signals that end a run on a robot. `ctrlc` handles Ctrl-C, `SIGTERM` and `SIGHUP`; a thread of its own waits for the others.

use crate::exit::{Exit, Failure};
use crate::output::note;
use gaitfit_robot::guard::Reason;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Once a robot may move a signal does not end the program by itself: the robot must be told first. 0: none came; 1: one
/// without a name; from 2 on the place in the list of names.
static ASKED: AtomicUsize = AtomicUsize::new(0);
/// Whether the robot may move.
static CONFIRMED: AtomicBool = AtomicBool::new(false);

/// Why the program was asked to end.
pub fn asked() -> Option<Reason> {
    // 0: none. 1: a signal that ends a program. From 2 on: a place in `STOPPING`.
    match ASKED.load(Ordering::SeqCst) {
        0 => None,
        1 => Some(Reason::Signal),
        place => Some(named(place - 2)),
    }
}

/// The robot may move from now on, or not after all. Whether it may.
pub fn confirm(confirmed: bool) -> bool {
    // Stored before the look at `asked`: a signal in between either ends the program or is seen here.
    CONFIRMED.store(confirmed, Ordering::SeqCst);
    confirmed && asked().is_none()
}

/// Takes note, and ends the program where the robot may not move yet.
fn ask(place: usize) {
    // The first reason stays, because it is the one that is printed.
    let _ = ASKED.compare_exchange(0, place, Ordering::SeqCst, Ordering::SeqCst);
    if !CONFIRMED.load(Ordering::SeqCst) {
        note("interrupted; nothing was sent");
        std::process::exit(Exit::Interrupted as i32);
    }
}

/// Listens from now on. To be called before the program has other threads: they inherit what is blocked.
pub fn listen() -> Result<(), Failure> {
    wait_for_others()?;
    ctrlc::set_handler(|| ask(1))
        .map_err(|error| Failure::failed(format!("cannot listen for Ctrl-C: {error}")))
}

#[cfg(unix)]
use nix::sys::signal::{SigSet, Signal};

/// Signals that stop the robot as Ctrl-C does: each would end or freeze the program.
#[cfg(unix)]
const STOPPING: [Signal; 9] = [
    Signal::SIGQUIT,
    Signal::SIGTSTP,
    Signal::SIGUSR1,
    Signal::SIGUSR2,
    Signal::SIGALRM,
    Signal::SIGVTALRM,
    Signal::SIGPROF,
    Signal::SIGIO,
    Signal::SIGXCPU,
];

#[cfg(unix)]
fn named(place: usize) -> Reason {
    STOPPING.get(place).map_or(Reason::Signal, |signal| Reason::Named(signal.as_str()))
}

#[cfg(not(unix))]
fn named(_: usize) -> Reason {
    Reason::Signal
}

/// From now on a file beyond the limit of file sizes (`ulimit -f`) is an error of the write, as a full disk is, instead of
/// the end of the program (`SIGXFSZ`). To be called before the program has other threads: they inherit what is blocked;
/// programs that this one starts do not.
#[cfg(unix)]
pub fn outlive_file_limit() {
    let mut blocked = SigSet::empty();
    blocked.add(Signal::SIGXFSZ);
    // Without it such a write ends the program, as the system does it.
    let _ = blocked.thread_block();
}

/// There is no such signal.
#[cfg(not(unix))]
pub fn outlive_file_limit() {}

/// Blocks all signals but those of `ctrlc`, of faults in the program, and those that do nothing; a thread takes the ones
/// that stop the robot. The rest has no effect: a file beyond its limit (`SIGXFSZ`) is an error of the write, and a program
/// in the background that reads from its terminal or writes to it (`SIGTTIN`, `SIGTTOU`) is not frozen.
#[cfg(unix)]
fn wait_for_others() -> Result<(), Failure> {
    use Signal::{
        SIGABRT, SIGBUS, SIGCHLD, SIGCONT, SIGFPE, SIGHUP, SIGILL, SIGINT, SIGPIPE, SIGSEGV, SIGSYS, SIGTERM,
        SIGTRAP, SIGURG, SIGWINCH,
    };
    let failed =
        |error: &dyn std::fmt::Display| Failure::failed(format!("cannot listen for signals: {error}"));
    let mut blocked = SigSet::all();
    // ctrlc handles the first three. Faults must end the program, and the others stop nothing.
    for signal in [
        SIGINT, SIGTERM, SIGHUP, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV, SIGSYS, SIGTRAP, SIGCHLD, SIGCONT,
        SIGPIPE, SIGURG, SIGWINCH,
    ] {
        blocked.remove(signal);
    }
    // Threads inherit the mask, so only the thread below receives these signals.
    blocked.thread_block().map_err(|error| failed(&error))?;
    let mut waited = SigSet::empty();
    STOPPING.into_iter().for_each(|signal| waited.add(signal));
    let wait = move || {
        loop {
            match waited.wait() {
                Ok(signal) => ask(STOPPING.iter().position(|one| *one == signal).map_or(1, |at| at + 2)),
                // No signal can be waited for: as if one had come.
                Err(_) => return ask(1),
            }
        }
    };
    std::thread::Builder::new()
        .name("signals".to_owned())
        .spawn(wait)
        .map(|_| ())
        .map_err(|error| failed(&error))
}

#[cfg(not(unix))]
fn wait_for_others() -> Result<(), Failure> {
    Ok(())
}
