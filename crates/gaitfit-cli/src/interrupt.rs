//! Ctrl-C and termination: the first asks the fit to save and stop, the second stops at once.

use crate::exit::{Exit, Failure};
use crate::output::note;
use std::sync::atomic::{AtomicBool, Ordering};

static ASKED: AtomicBool = AtomicBool::new(false);

static LISTENING: AtomicBool = AtomicBool::new(false);

/// Listens from now on; asked again, it changes nothing.
pub fn listen() -> Result<(), Failure> {
    // ctrlc refuses a second handler in the same process.
    if LISTENING.swap(true, Ordering::SeqCst) {
        return Ok(());
    }
    let handler = || {
        // The second time: the person does not want to wait for the checkpoint.
        if ASKED.swap(true, Ordering::SeqCst) {
            std::process::exit(Exit::Interrupted as i32);
        }
        note("stopping after the current step; Ctrl-C again stops at once");
    };
    ctrlc::set_handler(handler).map_err(|error| Failure::failed(format!("cannot listen for Ctrl-C: {error}")))
}

/// Whether the program was asked to stop.
pub fn asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}
