//! Cells that are run at the same time, each told apart in what is said of it.

use crate::watch::{Event, Watch};
use crate::{Error, ErrorKind};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Min time between two lines about the progress of a cell: several cells print at the same time.
const SAID_EVERY: Duration = Duration::from_secs(20);

/// Does `work(number, worker, watch)` for every name, `jobs` at a time, and gives the results in their order. After a
/// failure the others are asked to stop, and keep what is done.
///
/// # Errors
/// The first failure that is no interruption, else the first one.
pub fn together<T: Send>(
    names: &[&str],
    jobs: usize,
    watch: &Watch<'_>,
    work: &(dyn Fn(usize, usize, &Watch<'_>) -> Result<T, Error> + Sync),
) -> Result<Vec<T>, Error> {
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let results = Mutex::new(Vec::new());
    let worker = |worker: usize| {
        // Workers fetch the next name when they are free, so a short work does not wait for a long one.
        // Relaxed is enough: the flag only asks to stop, and results are read after all threads have ended.
        while !failed.load(Ordering::Relaxed) {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(name) = names.get(number) else { break };
            let speaker = Speaker { name, counted: Mutex::new(None) };
            let callback = |event: Event<'_>| speaker.pass(event, watch, &failed);
            let result = work(number, worker, &Watch::new(&callback));
            failed.fetch_or(result.is_err(), Ordering::Relaxed);
            results.lock().unwrap_or_else(PoisonError::into_inner).push((number, result));
        }
    };
    std::thread::scope(|scope| {
        // At least one worker: with 0 jobs nothing would ever be done.
        for number in 0..jobs.min(names.len()).max(1) {
            let worker = &worker;
            scope.spawn(move || worker(number));
        }
    });
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    // They came in the order in which they ended.
    results.sort_by_key(|(number, _)| *number);
    let (mut outputs, mut failure) = (Vec::with_capacity(results.len()), None::<Error>);
    for (_, result) in results {
        match result {
            Ok(one) => outputs.push(one),
            Err(error) => {
                // After a failure the others end as interrupted: these say nothing of the cause.
                let graver = failure.as_ref().is_none_or(|known| {
                    known.kind() == ErrorKind::Interrupted && error.kind() != ErrorKind::Interrupted
                });
                if graver {
                    failure = Some(error);
                }
            }
        }
    }
    failure.map_or(Ok(outputs), Err)
}

/// Passes on the events of a cell, with the cell's name.
struct Speaker<'a> {
    name: &'a str,
    /// Name of the counted items, their number, and the time of the last line about them.
    counted: Mutex<Option<(String, usize, Instant)>>,
}

impl Speaker<'_> {
    /// Tells `watch` an event of this cell: lines with its name, and now and then how far it is.
    fn pass(&self, event: Event<'_>, watch: &Watch<'_>, failed: &AtomicBool) -> ControlFlow<()> {
        let name = self.name;
        let counted = || self.counted.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            // Several speak at once, so each line begins with its name; the progress bar is nobody's.
            Event::Note(text) => watch.note(&format!("{name}: {text}")),
            Event::Stage(text) => watch.tell(Event::Stage(&format!("{name}: {text}"))),
            Event::Output(line) => watch.tell(Event::Output(&format!("{name}: {line}"))),
            Event::Begin(work) => *counted() = Some((work.what.to_owned(), work.total, Instant::now())),
            Event::Step(step) => {
                if let Some((what, total, said)) = counted().as_mut()
                    && said.elapsed() >= SAID_EVERY
                {
                    *said = Instant::now();
                    let line = format!("{name}: {what} {}/{total}  {}", step.done, step.state);
                    watch.tell(Event::Stage(&line));
                }
            }
            Event::End => *counted() = None,
            // Metrics and polls are not of a cell; the enum may grow.
            _ => {}
        }
        // Asked at every event, as a work that only computes would not notice the failure of another.
        if failed.load(Ordering::Relaxed) || watch.stop() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use std::path::Path;
    use std::sync::Barrier;

    #[test]
    fn several_are_at_work_and_results_keep_their_order() {
        let (both, said) = (Barrier::new(2), Mutex::new(Vec::new()));
        let callback = |event: Event<'_>| {
            if let Event::Stage(text) | Event::Note(text) = event {
                said.lock().unwrap().push(text.to_owned());
            }
            ControlFlow::Continue(())
        };
        let watch = Watch::new(&callback);
        let outputs = together(&["a", "b", "c", "d"], 2, &watch, &|number, worker, watch| {
            // Nobody passes alone.
            both.wait();
            watch.note("here");
            Ok((number, worker < 2))
        });
        assert_eq!(outputs.unwrap(), [(0, true), (1, true), (2, true), (3, true)]);
        let mut said = said.into_inner().unwrap();
        said.sort();
        assert_eq!(said, ["a: here", "b: here", "c: here", "d: here"]);
    }

    #[test]
    fn a_failure_stops_the_others_and_is_the_one_that_is_told() {
        let both = Barrier::new(2);
        let result: Result<Vec<()>, Error> =
            together(&["a", "b", "c"], 2, &Watch::silent(), &|number, _, watch| match number {
                0 => {
                    both.wait();
                    while !watch.stop() {
                        std::thread::yield_now();
                    }
                    Err(Error::interrupted("stopped", Path::new("runs")))
                }
                1 => {
                    both.wait();
                    Err(Error::failed("broken"))
                }
                _ => panic!("it must not begin"),
            });
        assert_eq!(result.unwrap_err().to_string(), "broken");
    }
}
