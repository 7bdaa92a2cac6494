//! Jobs shared among the GPUs of one host.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{Candidates, FitError};

/// Asked now and then from any thread; true to give up.
pub(super) type Cancel<'a> = dyn Fn() -> bool + Sync + 'a;

/// One that does a share of the jobs.
pub(super) trait Worker: Send {
    /// The number of its GPU, for messages.
    fn ordinal(&self) -> usize;
}

impl Worker for Candidates {
    fn ordinal(&self) -> usize {
        Candidates::ordinal(self)
    }
}

/// The share of `jobs` that worker `number` of `workers` does: contiguous, and at most one larger than another's.
fn share(jobs: usize, workers: usize, number: usize) -> Range<usize> {
    // The first `jobs % workers` workers do one job more.
    let from = |number: usize| number * (jobs / workers) + number.min(jobs % workers);
    from(number)..from(number + 1)
}

/// Has every worker do `work(worker, share, cancel)` of a contiguous share of the jobs, each on a thread of its own, and
/// gives what came out in the order of the shares; workers without a job have none. After a failure the others are asked
/// to stop.
///
/// # Errors
/// The first failure that is not [`FitError::Cancelled`], with the worker's GPU, where there are several; else the first.
pub(super) fn shared<W: Worker, T: Send>(
    workers: &mut [W],
    jobs: usize,
    cancel: &Cancel<'_>,
    work: impl Fn(&mut W, Range<usize>, &Cancel<'_>) -> Result<T, FitError> + Sync,
) -> Result<Vec<T>, FitError> {
    // One GPU needs no thread, and its errors need not name it.
    if let [worker] = workers {
        return Ok(vec![work(worker, 0..jobs, cancel)?]);
    }
    let (count, failed) = (workers.len(), AtomicBool::new(false));
    // A failure of one asks the others to stop.
    let cancel = || failed.load(Ordering::Relaxed) || cancel();
    let one = |number: usize, worker: &mut W| {
        let result = work(worker, share(jobs, count, number), &cancel);
        failed.fetch_or(result.is_err(), Ordering::Relaxed);
        result.map_err(|error| error.on(worker.ordinal()))
    };
    let results: Vec<Result<T, FitError>> = std::thread::scope(|scope| {
        let one = &one;
        let busy =
            workers.iter_mut().enumerate().filter(|(number, _)| !share(jobs, count, *number).is_empty());
        let threads: Vec<_> = busy.map(|(number, worker)| scope.spawn(move || one(number, worker))).collect();
        let join = |thread: std::thread::ScopedJoinHandle<'_, _>| {
            thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        // All are joined before any failure is returned, because they borrow the workers.
        threads.into_iter().map(join).collect()
    });
    let (mut values, mut failures) = (Vec::with_capacity(results.len()), Vec::new());
    for result in results {
        match result {
            Ok(one) => values.push(one),
            Err(error) => failures.push(error),
        }
    }
    // Workers that were asked to stop report `Cancelled`, which hides the reason.
    let graver = |first, next| if matches!(first, FitError::Cancelled) { next } else { first };
    failures.into_iter().reduce(graver).map_or(Ok(values), Err)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::runtime::CudaError;
    use std::sync::Barrier;

    /// A GPU that does nothing but remember what it was given.
    struct Toy {
        ordinal: usize,
        did: Vec<usize>,
    }

    impl Worker for Toy {
        fn ordinal(&self) -> usize {
            self.ordinal
        }
    }

    fn toys(count: usize) -> Vec<Toy> {
        // Numbers as of `--device cuda:4,3,2`.
        (0..count).map(|number| Toy { ordinal: 4 - number, did: Vec::new() }).collect()
    }

    fn broken() -> FitError {
        CudaError::Call { doing: "copying".to_owned(), reason: "the bus is cut".to_owned() }.into()
    }

    #[test]
    fn results_are_in_the_jobs_order_whatever_the_number_of_gpus() {
        for workers in 1..=4 {
            for jobs in [0, 1, 3, 7, 24] {
                let mut toys = toys(workers);
                let results = shared(&mut toys, jobs, &|| false, |toy, share, _| {
                    toy.did.extend(share.clone());
                    Ok(share.map(|job| 10 * job).collect::<Vec<_>>())
                });
                let values: Vec<usize> = results.unwrap().into_iter().flatten().collect();
                assert_eq!(values, (0..jobs).map(|job| 10 * job).collect::<Vec<_>>());
                let each: Vec<usize> = toys.iter().map(|toy| toy.did.len()).collect();
                assert_eq!(each.iter().sum::<usize>(), jobs);
                let (min, max) = (each.iter().min().unwrap(), each.iter().max().unwrap());
                assert!(max - min <= 1, "{jobs} jobs were shared as {each:?}");
                assert!(toys.iter().all(|toy| toy.did.is_sorted_by(|a, b| a + 1 == *b)));
            }
        }
    }

    #[test]
    fn all_gpus_are_at_work_at_once() {
        let all = Barrier::new(3);
        let counts = shared(&mut toys(3), 5, &|| false, |_, share, _| {
            // Nobody passes alone.
            all.wait();
            Ok(share.len())
        });
        assert_eq!(counts.unwrap(), [2, 2, 1]);
    }

    #[test]
    fn the_gpu_that_failed_is_named_and_the_others_stop() {
        let both = Barrier::new(2);
        let error = shared(&mut toys(2), 9, &|| false, |toy, _, cancel| -> Result<(), _> {
            both.wait();
            if toy.ordinal == 3 {
                return Err(broken());
            }
            while !cancel() {
                std::thread::yield_now();
            }
            Err(FitError::Cancelled)
        });
        let error = error.unwrap_err();
        assert!(matches!(error.cause(), FitError::Cuda(_)));
        let text = error.to_string();
        assert!(text.starts_with("cuda:3: ") && text.contains("the bus is cut"), "{text}");
        // The message of a single GPU does not name it.
        let alone = shared(&mut toys(1), 9, &|| false, |_, _, _| -> Result<(), _> { Err(broken()) });
        assert_eq!(alone.unwrap_err().to_string(), broken().to_string());
    }

    #[test]
    fn what_is_wrong_with_a_candidate_is_not_the_gpus() {
        let wrong = || FitError::Unsupported("wings".to_owned());
        let error = shared(&mut toys(2), 2, &|| false, |_, _, _| -> Result<(), _> { Err(wrong()) });
        assert_eq!(error.unwrap_err().to_string(), wrong().to_string());
    }

    #[test]
    fn a_cancelled_fit_stops_on_all_gpus() {
        let both = Barrier::new(2);
        let (asked, work) = (AtomicBool::new(false), AtomicBool::new(false));
        let cancel = || asked.swap(true, Ordering::Relaxed);
        let error = shared(&mut toys(2), 4, &cancel, |_, _, cancel| -> Result<(), _> {
            both.wait();
            while !cancel() {
                std::thread::yield_now();
            }
            work.store(true, Ordering::Relaxed);
            Err(FitError::Cancelled)
        });
        assert!(matches!(error, Err(FitError::Cancelled)) && work.into_inner());
    }
}
