//! Runs a stage without the interpreter's lock: events go to a Python function, and Ctrl-C stops the stage.
//!
//! A stage of the library runs on a thread of its own ([`watched`]), so that the calling thread can look for signals all the
//! time. One that calls a function of the user runs on the calling thread ([`in_place`]): Ctrl-C reaches that function as
//! it would anywhere else, and libraries that want one thread have one.

use gaitfit::watch::{Event, Watch};
use pyo3::prelude::*;
use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

/// How often signals are looked for, also while nothing happens.
const PATIENCE: Duration = Duration::from_millis(50);

/// An event that outlives its texts: what it is, a text, and two counts.
type Told = (&'static str, String, usize, usize);

fn told(event: Event<'_>) -> Option<Told> {
    Some(match event {
        Event::Note(text) => ("note", text.to_owned(), 0, 0),
        Event::Stage(text) => ("stage", text.to_owned(), 0, 0),
        Event::Output(text) => ("output", text.to_owned(), 0, 0),
        Event::Begin(work) => ("begin", work.what.to_owned(), work.first, work.total),
        Event::Step(step) => ("step", step.state.to_owned(), step.done, 0),
        Event::End => ("end", String::new(), 0, 0),
        _ => return None,
    })
}

/// Runs `stage` on a thread of its own. `progress(kind, text, done, total)` is called on the calling thread. When it raises, or
/// a signal asks to, the stage stops, and that exception comes back.
pub fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    stage: impl FnOnce(&Watch<'_>) -> T + Send,
) -> PyResult<T> {
    let stop = AtomicBool::new(false);
    let (sender, events) = mpsc::channel::<Told>();
    let (result, raised) = py.detach(move || {
        std::thread::scope(|scope| {
            let stop = &stop;
            let worker = scope.spawn(move || {
                let sender = Mutex::new(sender);
                let callback = |event: Event<'_>| {
                    if let Some(told) = told(event) {
                        // Nobody listens any more only after an error, which is what the caller gets.
                        let _ = sender.lock().unwrap_or_else(PoisonError::into_inner).send(told);
                    }
                    if stop.load(Ordering::Relaxed) {
                        ControlFlow::Break(())
                    } else {
                        ControlFlow::Continue(())
                    }
                };
                stage(&Watch::new(&callback))
            });
            let mut raised: Option<PyErr> = None;
            loop {
                let event = match events.recv_timeout(PATIENCE) {
                    Ok(event) => Some(event),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                if raised.is_some() {
                    continue;
                }
                let called = Python::attach(|py| {
                    py.check_signals()?;
                    if let (Some(progress), Some((kind, text, done, total))) = (progress, event) {
                        progress.call1(py, (kind, text, done, total))?;
                    }
                    Ok(())
                });
                if let Err(error) = called {
                    stop.store(true, Ordering::Relaxed);
                    raised = Some(error);
                }
            }
            (worker.join(), raised)
        })
    });
    match (result, raised) {
        (_, Some(raised)) => Err(raised),
        (Ok(result), None) => Ok(result),
        (Err(_), None) => Err(crate::errors::failed(
            "gaitfit stopped where it never should; please report it with what was printed above",
        )),
    }
}

/// Runs `stage` on the calling thread, for stages that call Python themselves. Otherwise as [`watched`].
pub fn in_place<T: Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    stage: impl FnOnce(&Watch<'_>) -> T + Send,
) -> PyResult<T> {
    let raised: Mutex<Option<PyErr>> = Mutex::new(None);
    let callback = |event: Event<'_>| {
        let mut raised = raised.lock().unwrap_or_else(PoisonError::into_inner);
        if raised.is_none() {
            *raised = Python::attach(|py| {
                py.check_signals()?;
                if let (Some(progress), Some((kind, text, done, total))) = (progress, told(event)) {
                    progress.call1(py, (kind, text, done, total))?;
                }
                Ok(())
            })
            .err();
        }
        if raised.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let result = py.detach(|| stage(&Watch::new(&callback)));
    match raised.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(raised) => Err(raised),
        None => Ok(result),
    }
}
