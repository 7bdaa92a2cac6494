//! Shows the events of a stage as lines and progress bars on standard error. Ctrl-C stops the stage.

use crate::interrupt;
use crate::output::note;
use crate::progress::{Lines, Progress};
use gaitfit::watch::{Event, Watch};
use std::ops::ControlFlow;
use std::sync::{Mutex, PoisonError};

/// Runs a stage with the program's watch.
pub fn watched<T>(lines: Lines, stage: impl FnOnce(&Watch<'_>) -> T) -> T {
    let progress: Mutex<Option<Progress>> = Mutex::new(None);
    let callback = |event: Event<'_>| {
        // Events come from several threads. A panic in one of them must not silence the others.
        let shown = || progress.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            Event::Note(text) => note(&format!("note: {text}")),
            Event::Stage(text) => note(text),
            Event::Output(line) => note(&format!("  {line}")),
            Event::Begin(work) => *shown() = Some(Progress::new(work, lines)),
            Event::Step(step) => {
                if let Some(progress) = shown().as_mut() {
                    progress.update(step.done, step.parts, step.state);
                }
            }
            Event::End => {
                if let Some(progress) = shown().take() {
                    progress.finish();
                }
            }
            // Events of later versions of the library, which this program cannot show.
            _ => {}
        }
        if interrupt::asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    stage(&Watch::new(&callback))
}
