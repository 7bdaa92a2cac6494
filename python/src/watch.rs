//! Runs a stage without the interpreter's lock: events go to a Python function, and Ctrl-C stops the stage.
//!
//! A stage of the library runs on a thread of its own ([`watched`]), so that the calling thread can look for signals all the
//! time. Functions of the user are called on the calling thread, so that Ctrl-C reaches them as it would anywhere else,
//! and libraries that want one thread have one: a policy is asked through a [`Caller`]; with a simulator the whole stage
//! runs there ([`in_place`]).

use crate::errors::{Stopped, in_python};
use crate::forked::Home;
use crate::terms;
use gaitfit::Error;
use gaitfit::watch::{Event, Watch};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyBool};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender, SyncSender};
use std::time::{Duration, Instant};

/// How often signals are looked for, also while nothing happens.
const PATIENCE: Duration = Duration::from_millis(50);

/// What a panic is to users.
const BROKEN: &str = "gaitfit stopped where it never should; please report it with what was printed above";

/// An event that owns its texts: its kind, a text, two counts, numbers by name, and the seed of the work that begins.
type Report = (&'static str, String, usize, usize, Vec<(String, f64)>, Option<u64>);

fn report(event: Event<'_>) -> Option<Report> {
    let plain = |kind, text: String| Some((kind, text, 0, 0, Vec::new(), None));
    match event {
        Event::Note(text) => plain("note", in_python(text)),
        Event::Stage(text) => plain("stage", text.to_owned()),
        Event::Output(text) => plain("output", text.to_owned()),
        Event::Begin(work) => {
            Some(("begin", work.what.to_owned(), work.first, work.total, Vec::new(), work.seed))
        }
        Event::Step(step) => Some(("step", step.state.to_owned(), step.done, 0, Vec::new(), None)),
        Event::Metrics(metrics) => {
            let owned = metrics.iter().map(|(name, value)| ((*name).to_owned(), *value));
            Some(("metrics", String::new(), 0, 0, owned.collect(), None))
        }
        Event::End => plain("end", String::new()),
        _ => None,
    }
}

/// Calls the user's `progress`; an answer of `False` stops the stage.
fn reported(py: Python<'_>, progress: &Py<PyAny>, report: &Report) -> PyResult<()> {
    let (kind, text, done, total, metrics, seed) = report;
    let metrics = metrics.iter().map(|(name, value)| (name.as_str(), *value)).into_py_dict(py)?;
    let answer = progress.bind(py).call1((*kind, text.as_str(), *done, *total, metrics, *seed))?;
    match answer.cast::<PyBool>() {
        Ok(answer) if !answer.is_true() => Err(Stopped::new_err(
            "stopped, because the progress function returned False. A fit, a training or a loop keeps what is done in its \
             run_folder: resume=True continues it",
        )),
        _ => Ok(()),
    }
}

/// What the stage's threads have for the calling one.
enum Message {
    /// It happened. Who reports a step waits for what `progress` answers, so that nothing is done after a step at which it
    /// stops.
    Reported(Report, Option<SyncSender<()>>),
    /// A policy is to act.
    Asked(Asked),
    /// Terms of a training are to be computed, and where they go.
    Terms(Option<terms::Step>, SyncSender<terms::Answer>),
    /// The stage has ended.
    Done,
}

/// Observations, `rows × width`, and where their actions go.
struct Asked {
    rows: usize,
    observation: Vec<f32>,
    reply: SyncSender<Vec<f32>>,
}

/// Has the calling thread call the user's policy. It may outlive the stage; nobody answers then.
#[derive(Clone)]
pub struct Caller(Sender<Message>);

impl Caller {
    /// As a policy's function has it.
    pub fn asked(self) -> impl Fn(usize, &[f32], &mut [f32]) -> bool + Send + Sync + 'static {
        move |rows, observation, actions| self.act(rows, observation, actions)
    }

    /// Fills `actions` with those for `observation`, `rows × width`; false if the function raised, now or before.
    pub fn act(&self, rows: usize, observation: &[f32], actions: &mut [f32]) -> bool {
        let (reply, answer) = mpsc::sync_channel(1);
        let asked = Asked { rows, observation: of_robots(rows, observation), reply };
        let answer = self.0.send(Message::Asked(asked)).ok().and_then(|()| answer.recv().ok());
        match answer {
            Some(found) if found.len() == actions.len() => {
                actions.copy_from_slice(&found);
                true
            }
            _ => false,
        }
    }
}

impl Caller {
    /// What the user's terms make of a step; nothing if they raised, now or before.
    pub fn terms(&self, step: terms::Step) -> Option<terms::Answer> {
        let (reply, answer) = mpsc::sync_channel(1);
        self.0.send(Message::Terms(Some(step), reply)).ok().and_then(|()| answer.recv().ok())
    }
}

/// An observation with a number beyond this is from a robot whose simulation is about to diverge.
const ABSURD: f32 = 1e6;

/// Observations, `rows × width`, as the user's policy gets them: a robot whose simulation has diverged observes zeros. Its walk is
/// over, and the policy would be blamed for its answer to NaN.
fn of_robots(rows: usize, observation: &[f32]) -> Vec<f32> {
    let mut observation = observation.to_vec();
    let width = observation.len() / rows.max(1);
    for row in observation.chunks_exact_mut(width.max(1)) {
        if row.iter().any(|value| value.is_nan() || value.abs() > ABSURD) {
            row.fill(0.0);
        }
    }
    observation
}

/// Says that the stage has ended, however it does.
struct Ending(Sender<Message>);

impl Drop for Ending {
    fn drop(&mut self) {
        // Nobody listens any more only after an error, which is what the caller gets.
        let _ = self.0.send(Message::Done);
    }
}

/// Calls the user's policy.
fn acted(py: Python<'_>, act: &Py<PyAny>, asked: &mut Asked) -> PyResult<Vec<f32>> {
    let observation = std::mem::take(&mut asked.observation);
    let width = observation.len() / asked.rows.max(1);
    let observation = PyArray1::from_vec(py, observation).reshape([asked.rows, width])?;
    let actions: PyReadonlyArray2<'_, f32> = act.call1(py, (observation,))?.extract(py)?;
    Ok(actions.as_array().iter().copied().collect())
}

/// How long a stage may take.
struct Limit {
    begun: Instant,
    seconds: Option<f64>,
}

impl Limit {
    fn new(seconds: Option<f64>) -> Self {
        Self { begun: Instant::now(), seconds }
    }

    /// Stops the stage when the time is over.
    fn check(&self) -> PyResult<()> {
        match self.seconds.filter(|seconds| self.begun.elapsed().as_secs_f64() >= *seconds) {
            None => Ok(()),
            Some(seconds) => Err(Stopped::new_err(format!(
                "stopped after {seconds} s (max_seconds). A training or a loop keeps what is done in its run_folder: \
                 resume=True continues it"
            ))),
        }
    }
}

/// Runs `stage` on a thread of its own. `progress(kind, text, done, total, metrics, seed)` is called on the calling thread. When it
/// raises or returns `False`, a signal asks to, or `max_seconds` are over, the stage stops, and that exception comes back.
pub fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    max_seconds: Option<f64>,
    stage: impl FnOnce(&Watch<'_>) -> Result<T, Error> + Send,
) -> PyResult<Result<T, Error>> {
    watched_acting(py, progress, max_seconds, None, |watch, _| stage(watch))
}

/// As [`watched`]; the stage may have the calling thread call `act`, a policy. When that raises, the stage stops, and that
/// exception comes back. Its `run_folder` is where the stage kept what was done, if it did.
pub fn watched_acting<T: Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    max_seconds: Option<f64>,
    act: Option<&Py<PyAny>>,
    stage: impl FnOnce(&Watch<'_>, Caller) -> Result<T, Error> + Send,
) -> PyResult<Result<T, Error>> {
    let (stop, home) = (AtomicBool::new(false), Home::here());
    let limit = Limit::new(max_seconds);
    let (sender, messages) = mpsc::channel::<Message>();
    let (result, raised) = py.detach(move || {
        std::thread::scope(|scope| {
            let stop = &stop;
            let worker = scope.spawn(move || {
                let ending = Ending(sender);
                let callback = |event: Event<'_>| {
                    if let Some(reported) = report(event) {
                        let (heard, answer) = match reported.0 {
                            "step" => Some(mpsc::sync_channel(1)).unzip(),
                            _ => (None, None),
                        };
                        // As at the end. After an error nobody answers, and `stop` is set.
                        let sent = ending.0.send(Message::Reported(reported, heard));
                        let _ = answer.filter(|_| sent.is_ok()).map(|answer| answer.recv());
                    }
                    if stop.load(Ordering::Acquire) {
                        ControlFlow::Break(())
                    } else {
                        ControlFlow::Continue(())
                    }
                };
                stage(&Watch::new(&callback), Caller(ending.0.clone()))
            });
            let mut raised: Option<PyErr> = None;
            loop {
                let mut message = match messages.recv_timeout(PATIENCE) {
                    Ok(Message::Done) | Err(RecvTimeoutError::Disconnected) => break,
                    Ok(message) => Some(message),
                    Err(RecvTimeoutError::Timeout) => None,
                };
                if raised.is_some() {
                    // Who asks gets no answer, and knows.
                    continue;
                }
                let mut call = |py: Python<'_>| {
                    py.check_signals()?;
                    limit.check()?;
                    match (&mut message, progress, act) {
                        (Some(Message::Reported(report, _)), Some(progress), _) => {
                            reported(py, progress, report)?
                        }
                        (Some(Message::Asked(asked)), _, Some(act)) => {
                            let actions = acted(py, act, asked)?;
                            // Who asked waits.
                            let _ = asked.reply.send(actions);
                        }
                        (Some(Message::Terms(step, reply)), _, Some(act)) => {
                            if let Some(step) = step.take() {
                                // Who asked waits.
                                let _ = reply.send(terms::called(py, act, step)?);
                            }
                        }
                        _ => {}
                    }
                    Ok(())
                };
                let called = Python::attach(|py| {
                    let called = call(py);
                    home.or_end(py, called)
                });
                if let Err(error) = called {
                    // Before who asked knows of the failure: `message` still lives.
                    stop.store(true, Ordering::Release);
                    raised = Some(error);
                }
                if let Some(Message::Reported(_, Some(heard))) = &message {
                    // Who reported waits.
                    let _ = heard.send(());
                }
            }
            (worker.join(), raised)
        })
    });
    match (result, raised) {
        (Ok(Err(Error::Run(gaitfit::RunError::Interrupted { kept: Some(kept), .. }))), Some(raised)) => {
            raised.value(py).setattr("run_folder", kept)?;
            Err(raised)
        }
        (_, Some(raised)) => Err(raised),
        (Ok(result), None) => Ok(result),
        (Err(_), None) => Err(crate::errors::failed(BROKEN)),
    }
}

/// What the working thread sends to the calling thread.
enum FromWorker<T> {
    /// An event of the work.
    Reported(Report),
    /// The work has ended, with this result.
    Done(T),
}

/// Runs `work`, which writes no files, on a thread of its own. If `progress` raises or returns `False`, or a signal asks to stop,
/// this returns the exception at once. The thread ends later, at its next event.
pub fn waited<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Watch<'_>) -> T + Send + 'static,
) -> PyResult<T> {
    let (sender, messages) = mpsc::channel();
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&stop);
    std::thread::spawn(move || {
        let callback = |event: Event<'_>| {
            if let Some(report) = report(event) {
                // Sending fails only after an exception, when nobody listens. `stopped` is set then.
                let _ = sender.send(FromWorker::Reported(report));
            }
            if stopped.load(Ordering::Acquire) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let result = work(&Watch::new(&callback));
        let _ = sender.send(FromWorker::Done(result));
    });
    py.detach(move || {
        loop {
            let message = messages.recv_timeout(PATIENCE);
            let called = Python::attach(|py| {
                py.check_signals()?;
                match (&message, progress) {
                    (Ok(FromWorker::Reported(report)), Some(progress)) => reported(py, progress, report),
                    _ => Ok(()),
                }
            });
            if let Err(raised) = called {
                stop.store(true, Ordering::Release);
                return Err(raised);
            }
            match message {
                Ok(FromWorker::Done(result)) => return Ok(result),
                Err(RecvTimeoutError::Disconnected) => return Err(crate::errors::failed(BROKEN)),
                Ok(FromWorker::Reported(_)) | Err(RecvTimeoutError::Timeout) => {}
            }
        }
    })
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
                if let (Some(progress), Some(report)) = (progress, report(event)) {
                    reported(py, progress, &report)?;
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
