//! Both sides of a fit that several processes share: the crew, a Python object that has tasks done, and the helper that
//! does them.

use crate::errors::{failed, to_py_err, value};
use crate::own_policy::Source;
use crate::watch::{Caller, watched_acting};
use gaitfit::Error;
use gaitfit::adapt::{self, Crew, Done, Setup};
use gaitfit::device::Devices;
use gaitfit_adapt::fit::FitError;
use gaitfit_adapt::{Cancel, SimulatorError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyIterator};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// A crew in Python. It has `open(parcel, mark)`, `places()`, `alike` and `work(tasks)`, an iterator of `(number, answer)`,
/// or of `None` where nothing happened for a while.
pub struct OwnCrew {
    object: Py<PyAny>,
    raised: Mutex<Option<PyErr>>,
}

/// An answer and its task's number; `None` where nothing happened for a while.
type Answer = Option<(usize, Vec<u8>)>;

impl OwnCrew {
    pub fn new(object: Py<PyAny>) -> Self {
        Self { object, raised: Mutex::new(None) }
    }

    /// Hands the crew what its helpers need.
    pub fn open(&self, setup: &Setup) -> Result<(), Error> {
        let (parcel, mark) = (setup.parcel()?, setup.mark()?);
        let open = |py: Python<'_>| self.object.call_method1(py, "open", (PyBytes::new(py, &parcel), mark));
        Python::attach(open).map(|_| ()).map_err(|error| Error::failed(self.keep(error)))
    }

    /// The exception that it raised, if it did.
    pub fn raised(&self) -> Option<PyErr> {
        self.raised.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Keeps an exception; its text.
    fn keep(&self, error: PyErr) -> String {
        let text = error.to_string();
        self.raised.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        text
    }

    fn failed(&self, error: PyErr) -> SimulatorError {
        SimulatorError::failed(self.keep(error))
    }

    /// The next answer; `None` at the end.
    fn next(answers: &Py<PyIterator>) -> PyResult<Option<Answer>> {
        Python::attach(|py| answers.bind(py).clone().next().map(|item| item?.extract()).transpose())
    }
}

impl Crew for OwnCrew {
    fn places(&self) -> usize {
        let places = |py: Python<'_>| self.object.call_method0(py, "places")?.extract(py);
        Python::attach(places).map_err(|error| self.keep(error)).unwrap_or(1).max(1)
    }

    fn alike(&self) -> bool {
        let alike = |py: Python<'_>| self.object.getattr(py, "alike")?.extract(py);
        Python::attach(alike).map_err(|error| self.keep(error)).unwrap_or(false)
    }

    fn work(
        &self,
        tasks: &[Vec<u8>],
        done: &mut Done<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        let begin = |py: Python<'_>| -> PyResult<Py<PyIterator>> {
            let tasks: Vec<Bound<'_, PyBytes>> = tasks.iter().map(|task| PyBytes::new(py, task)).collect();
            Ok(self.object.bind(py).call_method1("work", (tasks,))?.try_iter()?.unbind())
        };
        let answers = Python::attach(begin).map_err(|error| self.failed(error))?;
        // A generator that is closed gives its tasks up.
        let close = || {
            Python::attach(|py| {
                answers.call_method0(py, "close").map(|_| ()).map_err(|error| self.failed(error))
            })
        };
        let mut missing: Vec<bool> = vec![true; tasks.len()];
        loop {
            let next = Self::next(&answers).map_err(|error| self.failed(error))?;
            if cancel() {
                close()?;
                return Err(SimulatorError::Cancelled);
            }
            let Some(answer) = next else { break };
            let Some((number, bytes)) = answer else { continue };
            // A task that was done twice has the same answer.
            if missing.get_mut(number).is_some_and(|missing| std::mem::replace(missing, false))
                && let Err(error) = done(number, &bytes)
            {
                close()?;
                return Err(error);
            }
        }
        if missing.contains(&true) { Err(SimulatorError::failed("tasks were left undone")) } else { Ok(()) }
    }
}

/// A task, where its answer goes, and whether it is to be given up.
type Asked = (Vec<u8>, Sender<Result<Vec<u8>, FitError>>, Arc<AtomicBool>);

/// Who calls the policy's function while a task is done.
type Calling = Arc<Mutex<Option<Caller>>>;

/// A process that simulates for a fit elsewhere. What it needs stays on a thread of its own.
#[pyclass(module = "gaitfit._gaitfit", frozen)]
pub struct Helper {
    mark: String,
    tasks: Mutex<Option<Sender<Asked>>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    policy: Option<Source>,
    calling: Calling,
}

#[pymethods]
impl Helper {
    /// `policy`: the function that walked, if it was one; it is called on the thread that asks for work.
    #[new]
    #[pyo3(signature = (parcel, threads, device, policy=None))]
    fn new(
        py: Python<'_>,
        parcel: Vec<u8>,
        threads: usize,
        device: &str,
        policy: Option<Source>,
    ) -> PyResult<Self> {
        let devices: Devices = device.parse().map_err(|wrong: String| value(format!("device: {wrong}")))?;
        if threads == 0 {
            return Err(value("threads must be at least 1"));
        }
        let (tasks, asked) = mpsc::channel::<Asked>();
        let (opened, open) = mpsc::channel();
        let calling = Calling::default();
        let own = match &policy {
            Some(policy) => policy.policy(asked_of(&calling)).map_err(|error| to_py_err(&error))?,
            None => None,
        };
        let body = move || match adapt::Helper::open(&parcel, threads, &devices, own.as_ref())
            .and_then(|one| Ok((one.mark()?, one)))
        {
            Ok((mark, helper)) => {
                // Nobody waits any more: there will be no tasks either.
                let _ = opened.send(Ok(mark));
                serve(&helper, &asked);
            }
            Err(error) => {
                let _ = opened.send(Err(error));
            }
        };
        let act = policy.as_ref().and_then(Source::act);
        let whose = &calling;
        let opened = watched_acting(py, None, None, act, move |_, caller| {
            set(whose, Some(caller));
            let thread = std::thread::Builder::new().name("gaitfit-helper".to_owned()).spawn(body);
            let found = open.recv();
            set(whose, None);
            Ok((thread, found))
        })?;
        let (thread, found) = opened.map_err(|error| to_py_err(&error))?;
        let thread = thread.map_err(failed)?;
        let mark = found
            .map_err(|_| failed("the fit's files could not be opened"))?
            .map_err(|error| to_py_err(&error))?;
        Ok(Self { mark, tasks: Mutex::new(Some(tasks)), thread: Mutex::new(Some(thread)), policy, calling })
    }

    /// What the robot costs where the search begins, bit by bit.
    #[getter]
    fn mark(&self) -> &str {
        &self.mark
    }

    /// Does a task.
    fn work(&self, py: Python<'_>, task: Vec<u8>) -> PyResult<Vec<u8>> {
        let (sender, answer) = mpsc::channel();
        let stop = Arc::new(AtomicBool::new(false));
        let ended = || failed("the helper has ended; make another one");
        let tasks = self.tasks.lock().unwrap_or_else(PoisonError::into_inner).clone().ok_or_else(ended)?;
        let act = self.policy.as_ref().and_then(Source::act);
        let answer = watched_acting(py, None, None, act, move |watch, caller| {
            set(&self.calling, Some(caller));
            // One that cannot be sent any more drops its sender: there is no answer.
            let _ = tasks.send((task, sender, Arc::clone(&stop)));
            let answer = loop {
                match answer.recv_timeout(std::time::Duration::from_millis(20)) {
                    Err(mpsc::RecvTimeoutError::Timeout) => {
                        stop.store(watch.stop(), Ordering::Relaxed);
                    }
                    Err(mpsc::RecvTimeoutError::Disconnected) => break None,
                    Ok(answer) => break Some(answer),
                }
            };
            set(&self.calling, None);
            Ok(answer)
        })?;
        let answer = answer.map_err(|error| to_py_err(&error))?;
        answer.ok_or_else(ended)?.map_err(failed)
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(pyo3::exceptions::PyTypeError::new_err(
            "a helper cannot be pickled: send the parcel, and open it in each process",
        ))
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        drop(self.tasks.get_mut().unwrap_or_else(PoisonError::into_inner).take());
        if let Some(thread) = self.thread.get_mut().unwrap_or_else(PoisonError::into_inner).take() {
            let _ = thread.join();
        }
    }
}

/// A policy's function that whoever waits for a task calls.
fn asked_of(calling: &Calling) -> impl Fn(usize, &[f32], &mut [f32]) -> bool + Send + Sync + 'static {
    let calling = Arc::clone(calling);
    move |rows, observation, actions| {
        let caller = calling.lock().unwrap_or_else(PoisonError::into_inner).clone();
        caller.is_some_and(|caller| caller.act(rows, observation, actions))
    }
}

fn set(calling: &Calling, caller: Option<Caller>) {
    *calling.lock().unwrap_or_else(PoisonError::into_inner) = caller;
}

/// Does tasks until there are no more.
fn serve(helper: &adapt::Helper, asked: &Receiver<Asked>) {
    for (task, answer, stop) in asked {
        let cancel = || stop.load(Ordering::Relaxed);
        // Who does not wait any more has given the task up.
        let _ = answer.send(helper.work(&task, &cancel));
    }
}
