//! Progress and cancelling: the one callback that every stage takes.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

/// What a stage tells its caller.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Event<'a> {
    /// Something worth knowing that is not part of the result, one line.
    Note(&'a str),
    /// A stage begins, one line.
    Stage(&'a str),
    /// A line of another program that a stage runs.
    Output(&'a str),
    /// Countable work begins.
    Begin(Work<'a>),
    /// Countable work continues.
    Step(Step<'a>),
    /// Numbers of the step that follows, by name.
    Metrics(&'a [(&'a str, f64)]),
    /// The countable work that began last has ended.
    End,
    /// Nothing happened; a stage asks whether to continue. It comes often, and from any thread.
    Poll,
}

/// Countable work that begins.
#[derive(Clone, Copy, Debug)]
pub struct Work<'a> {
    /// What is counted, in the singular, for example `generation`.
    pub what: &'a str,
    /// How many there are.
    pub total: usize,
    /// How many were done before this session.
    pub first: usize,
    /// What the work is made of, in the plural, for the speed, for example `evaluations`.
    pub parts: &'a str,
    /// The seed of a training; absent for other work.
    pub seed: Option<u64>,
}

/// Work goes on.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// How many are done.
    pub done: usize,
    /// How many parts the last one had.
    pub parts: usize,
    /// How good it is so far, in a few words.
    pub state: &'a str,
}

/// The caller's callback. `ControlFlow::Break` asks the stage to stop; it keeps what is done and ends with
/// [`crate::Error::Interrupted`].
pub type Callback<'a> = dyn Fn(Event<'_>) -> ControlFlow<()> + Sync + 'a;

/// The callback, and whether it has asked to stop.
pub struct Watch<'a> {
    callback: &'a Callback<'a>,
    stopped: AtomicBool,
}

impl<'a> Watch<'a> {
    /// Watches by a callback.
    pub fn new(callback: &'a Callback<'a>) -> Self {
        Self { callback, stopped: AtomicBool::new(false) }
    }

    /// Listens to nothing and never stops.
    pub fn silent() -> Watch<'static> {
        Watch::new(&|_| ControlFlow::Continue(()))
    }

    /// Passes an event on.
    pub fn tell(&self, event: Event<'_>) {
        if (self.callback)(event).is_break() {
            self.stopped.store(true, Ordering::Relaxed);
        }
    }

    /// Something worth knowing.
    pub fn note(&self, text: &str) {
        self.tell(Event::Note(text));
    }

    /// Whether the caller wants the stage to stop. Once it does, it stays so.
    pub fn stop(&self) -> bool {
        if !self.stopped.load(Ordering::Relaxed) {
            self.tell(Event::Poll);
        }
        self.stopped.load(Ordering::Relaxed)
    }

    /// Countable work begins; it ends when the returned value is dropped.
    pub fn begin(&self, work: Work<'_>) -> Counting<'_> {
        self.tell(Event::Begin(work));
        Counting { watch: self }
    }

    /// Does `work` and reports its progress. `work` calls its argument with each count; the answer states whether to continue.
    pub fn counted<T>(&self, what: &str, parts: &str, work: impl FnOnce(&mut Count<'_>) -> T) -> T {
        let mut counting = None;
        let mut last = 0;
        work(&mut |done, total| {
            let counting =
                counting.get_or_insert_with(|| self.begin(Work { what, total, first: 0, parts, seed: None }));
            if done > last {
                counting.step(done, done - last, "");
                last = done;
            }
            if self.stop() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
    }
}

/// A function that gets how many parts are done and how many there are. It answers whether to continue.
pub type Count<'a> = dyn FnMut(usize, usize) -> ControlFlow<()> + 'a;

/// Countable work.
pub struct Counting<'a> {
    watch: &'a Watch<'a>,
}

impl Counting<'_> {
    /// Reports numbers of the next step, by name, for programs that draw curves.
    pub fn metrics(&self, metrics: &[(&str, f64)]) {
        self.watch.tell(Event::Metrics(metrics));
    }

    /// `done` are finished, the last one with `parts` parts; `state` says how good it is so far.
    pub fn step(&self, done: usize, parts: usize, state: &str) {
        self.watch.tell(Event::Step(Step { done, parts, state }));
    }
}

impl Drop for Counting<'_> {
    fn drop(&mut self) {
        self.watch.tell(Event::End);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[test]
    fn counted_work_begins_with_its_first_count_and_stops() {
        let seen = Mutex::new(Vec::new());
        let callback = |event: Event<'_>| {
            let mut seen = seen.lock().unwrap();
            match event {
                Event::Begin(work) => seen.push(format!("begin {} of {}", work.what, work.total)),
                Event::Step(step) => seen.push(format!("step {} of {}", step.done, step.parts)),
                Event::End => seen.push("end".to_owned()),
                _ => {}
            }
            if seen.len() < 3 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let watch = Watch::new(&callback);
        watch.counted("log", "logs", |_| ());
        assert!(seen.lock().unwrap().is_empty());
        let answers =
            watch.counted("log", "logs", |count| [count(0, 9), count(2, 9), count(2, 9), count(5, 9)]);
        assert_eq!(answers.map(|answer| answer.is_continue()), [true, true, true, false]);
        assert_eq!(*seen.lock().unwrap(), ["begin log of 9", "step 2 of 2", "step 5 of 3", "end"]);
    }
}
