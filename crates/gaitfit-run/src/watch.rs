//! Progress and cancelling: the one callback that every stage takes.

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Least time between two steps of work that many threads do.
const STEP_EVERY: Duration = Duration::from_millis(100);

/// Message of a stage to its caller.
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
    /// Unit of the count, in the singular, for example `generation`.
    pub what: &'a str,
    /// How many there are.
    pub total: usize,
    /// How many were done before this session.
    pub first: usize,
    /// Parts of the work, in the plural, for the speed, for example `evaluations`.
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
    /// Quality so far, in a few words.
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
            // Relaxed: the flag is all that threads share here, and a turn later is soon enough.
            self.stopped.store(true, Ordering::Relaxed);
        }
    }

    /// Something worth knowing.
    pub fn note(&self, text: &str) {
        self.tell(Event::Note(text));
    }

    /// Whether the caller wants the stage to stop. Once it does, it stays so.
    pub fn stop(&self) -> bool {
        // After a `Break` the callback is not asked again, so it need not remember its answer.
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
            // Work that never counts shows no progress bar.
            let counting =
                counting.get_or_insert_with(|| self.begin(Work { what, total, first: 0, parts, seed: None }));
            // A caller may count the same number twice to ask whether to stop.
            if done > last {
                counting.step(done, done - last, "");
                last = done;
            }
            if self.stop() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
    }

    /// Does `work`, which many threads may share, and reports its progress at most ten times a second. `work` calls its argument
    /// with the number of pieces that were done since the last call. If it succeeds, the last step has all that `amount` counts.
    ///
    /// # Errors
    /// The error that `work` returns.
    pub fn shared<T, E>(
        &self,
        amount: Amount<'_>,
        work: impl FnOnce(&(dyn Fn(usize) + Sync)) -> Result<T, E>,
    ) -> Result<T, E> {
        let Amount { what, parts, total, pieces } = amount;
        let counting = self.begin(Work { what, total, first: 0, parts, seed: None });
        // The count is apart from the report, so that threads do not wait for one another.
        let pieces_done = AtomicUsize::new(0);
        // When the last step was reported, and how many parts were done then.
        let reported = Mutex::new((Instant::now(), 0));
        let result = work(&|more| {
            pieces_done.fetch_add(more, Ordering::Relaxed);
            // If it is locked, another thread is reporting: this one goes on.
            let Ok(mut reported) = reported.try_lock() else { return };
            // Pieces and steps have different units: steps are what the user sees.
            let share = pieces_done.load(Ordering::Relaxed) as f64 / pieces.max(1) as f64;
            // Pieces are announced as an estimate, so there may be more of them.
            let done = (total as f64 * share.min(1.0)) as usize;
            if done > reported.1 && reported.0.elapsed() >= STEP_EVERY {
                counting.step(done, done - reported.1, "");
                *reported = (Instant::now(), done);
            }
        });
        // The last step brings the count to its end, however seldom steps were reported.
        let before = reported.into_inner().map_or(0, |reported| reported.1);
        if result.is_ok() && before < total && !self.stop() {
            counting.step(total, total - before, "");
        }
        result
    }
}

/// How much work there is that many threads share.
#[derive(Clone, Copy, Debug)]
pub struct Amount<'a> {
    /// Unit of the count, in the singular, for example `simulated second`.
    pub what: &'a str,
    /// The unit in the plural, for the speed.
    pub parts: &'a str,
    /// How many there are.
    pub total: usize,
    /// Number of pieces in which the work counts itself, for the whole work. They may be smaller than what `total` counts.
    pub pieces: usize,
}

impl<'a> Amount<'a> {
    /// Simulated seconds of all robots together. `what` ends in `simulated second`; `periods`: control periods, summed over all
    /// robots; `period`: the control period, s.
    pub fn simulated(what: &'a str, periods: usize, period: f64) -> Self {
        let seconds = (periods as f64 * period).round().max(1.0) as usize;
        Self { what, parts: "simulated seconds", total: seconds, pieces: periods }
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

    #[test]
    fn work_of_many_threads_has_steps_in_order_and_a_last_one() {
        let seen = Mutex::new(Vec::new());
        let callback = |event: Event<'_>| {
            if let Event::Step(step) = event {
                seen.lock().unwrap().push((step.done, step.parts));
            }
            ControlFlow::Continue(())
        };
        let watch = Watch::new(&callback);
        let amount = Amount { what: "second", parts: "seconds", total: 10, pieces: 400 };
        let threads = |done: &(dyn Fn(usize) + Sync)| {
            std::thread::scope(|scope| {
                for _ in 0..2 {
                    scope.spawn(|| {
                        for _ in 0..4 {
                            std::thread::sleep(STEP_EVERY);
                            done(50);
                        }
                    });
                }
            });
            Ok::<(), ()>(())
        };
        watch.shared(amount, threads).unwrap();
        let steps = std::mem::take(&mut *seen.lock().unwrap());
        assert!((3..=9).contains(&steps.len()), "{steps:?}");
        assert!(steps.is_sorted_by(|before, after| before.0 < after.0), "{steps:?}");
        assert_eq!(steps.iter().map(|step| step.1).sum::<usize>(), 10);
        assert_eq!(steps.last().unwrap().0, 10);
        // More pieces than were announced do not count. Work that failed has no last step.
        let too_many = |done: &(dyn Fn(usize) + Sync)| {
            done(900);
            Ok::<(), ()>(())
        };
        watch.shared(amount, too_many).unwrap();
        assert_eq!(std::mem::take(&mut *seen.lock().unwrap()), [(10, 10)]);
        assert_eq!(watch.shared(amount, |_| Err::<(), _>("failed")), Err("failed"));
        assert!(seen.lock().unwrap().is_empty());
    }

    #[test]
    fn who_stops_work_of_many_threads_gets_no_further_step() {
        let steps = AtomicUsize::new(0);
        let callback = |event: Event<'_>| {
            if let Event::Step(_) = event {
                steps.fetch_add(1, Ordering::Relaxed);
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        };
        let watch = Watch::new(&callback);
        let amount = Amount { what: "second", parts: "seconds", total: 10, pieces: 100 };
        let work = |done: &(dyn Fn(usize) + Sync)| {
            std::thread::sleep(STEP_EVERY);
            done(50);
            Ok::<bool, ()>(watch.stop())
        };
        assert_eq!(watch.shared(amount, work), Ok(true));
        assert_eq!(steps.into_inner(), 1);
    }
}
