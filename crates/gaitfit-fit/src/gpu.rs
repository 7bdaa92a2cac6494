//! The simulators of a fit on GPUs: the CPU's stand beside for what a GPU does not do.

use crate::walk::simulator::WalkSimulator;
use gaitfit_adapt::cost::{Cost, Pieces, Reference, Signal};
use gaitfit_adapt::fit::{Evaluation, FitError, Job, accumulate};
use gaitfit_adapt::{
    Cancel, Consume, Identity, ReplaySimulator, Resets, Rollout, Signals, Simulator, SimulatorError, Theta,
};
use gaitfit_cuda::fit::{Compared, FitError as GpuError, Measured, MultiGpu, Parts, Subject, Tables, Tracks};
use gaitfit_cuda::runtime::Device;
use gaitfit_policy::follow;
use gaitfit_sim::Candidate;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A simulator of the CPU that a GPU can stand in for.
pub trait OnGpu: Simulator {
    /// The robot, and the way in which it is simulated.
    fn subject(&self) -> Subject<'_>;

    /// The robot with these values of θ.
    fn robot(&self, theta: &Theta, values: &[f64]) -> Candidate;

    /// The numbers that the recordings give to the simulated robots.
    ///
    /// # Errors
    /// A robot that cannot be stepped.
    fn tables(&self) -> Result<Tables, GpuError>;

    /// Whether a rollout with these resets can be had on a GPU.
    fn resets(&self, resets: Resets) -> bool;
}

impl OnGpu for WalkSimulator {
    fn subject(&self) -> Subject<'_> {
        let walking = self.walking();
        Subject::Walk(&walking.task.walker, &walking.policy)
    }

    fn robot(&self, theta: &Theta, values: &[f64]) -> Candidate {
        self.candidate(theta, values)
    }

    fn tables(&self) -> Result<Tables, GpuError> {
        let walking = self.walking();
        Tables::walk(&walking.task.walker, &walking.policy, self.scripts())
    }

    fn resets(&self, resets: Resets) -> bool {
        match resets {
            Resets::Never => true,
            // What a policy with a history saw before a reset follows from the log on the CPU.
            Resets::State(_) => !self.walking().task.walker.sees_past(),
            Resets::Sensors(_) => false,
        }
    }
}

impl OnGpu for ReplaySimulator {
    fn subject(&self) -> Subject<'_> {
        Subject::Replay(self.replay())
    }

    fn robot(&self, theta: &Theta, values: &[f64]) -> Candidate {
        self.candidate(theta, values)
    }

    fn tables(&self) -> Result<Tables, GpuError> {
        Tables::replay(self.replay())
    }

    fn resets(&self, resets: Resets) -> bool {
        resets == Resets::Never
    }
}

/// A simulator on a GPU. The host simulates short predictions; it may use a GPU too.
pub struct GpuSimulator<S> {
    host: S,
    gpu: Mutex<Gpu>,
}

struct Gpu {
    candidates: MultiGpu,
    /// The measured side that candidates are compared with, once something was.
    reference: Option<Arc<Reference>>,
}

impl<S: OnGpu + Send + Sync> GpuSimulator<S> {
    /// `host` on `devices`, which share the candidates; the host prepares them on `threads` threads.
    ///
    /// # Errors
    /// A failure of a GPU.
    pub fn new(host: S, devices: &[Device], threads: usize) -> Result<Self, GpuError> {
        let candidates = MultiGpu::new(devices, host.tables()?, threads)?;
        Ok(Self { host, gpu: Mutex::new(Gpu { candidates, reference: None }) })
    }

    fn gpu(&self) -> MutexGuard<'_, Gpu> {
        self.gpu.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn job(&self, theta: &Theta, rollout: &Rollout) -> Result<follow::Job, SimulatorError> {
        let candidate = self.host.robot(theta, &rollout.values);
        let clamped = matches!(self.host.subject(), Subject::Replay(_));
        if clamped && !(candidate.networks.is_empty() && candidate.torque_noise == 0.0) {
            return Err(SimulatorError::failed(
                "a replay of a clamped robot has neither networks nor torque noise: fit them to logs of a walking \
                 robot, or remove them from what is fitted",
            ));
        }
        let reset_every = match rollout.resets {
            Resets::State(every) => Some(every),
            Resets::Never | Resets::Sensors(_) => None,
        };
        Ok(follow::Job { candidate, reset_every, seed: rollout.draw })
    }

    fn jobs(&self, theta: &Theta, rollouts: &[Rollout]) -> Result<Vec<follow::Job>, SimulatorError> {
        rollouts.iter().map(|rollout| self.job(theta, rollout)).collect()
    }

    /// Whether candidates can be compared with `reference`: it is the first that was asked for, and of these recordings.
    fn compares(&self, reference: &Arc<Reference>) -> Result<bool, SimulatorError> {
        let mut gpu = self.gpu();
        // The GPU keeps the measured side of one reference. Costs with another reference are compared on the
        // CPU.
        if let Some(known) = &gpu.reference {
            return Ok(Arc::ptr_eq(known, reference));
        }
        let lengths = gpu.candidates.tables().lengths.iter().enumerate();
        let alike = lengths
            .fold(reference.recordings() == self.host.recordings(), |alike, (number, &length)| {
                alike && reference.samples(number) == length as usize
            });
        if alike {
            let dimensions = self.host.subject().dimensions();
            let measured = measured(reference, gpu.candidates.tables().samples, dimensions);
            gpu.candidates.measure(measured, dimensions).map_err(failed)?;
            gpu.reference = Some(Arc::clone(reference));
        }
        Ok(alike)
    }
}

/// First dimension of a signal among those of the GPU.
fn place(signal: Signal, joints: usize) -> usize {
    match signal {
        Signal::Position => 0,
        Signal::Velocity => joints,
        Signal::Action => 2 * joints,
        // The joints' signals come first, with one dimension a joint. The base has three a signal.
        Signal::BasePosition => 3 * joints,
        Signal::BaseVelocity => 3 * joints + 3,
    }
}

/// The robot's side as the GPU keeps it.
fn measured(reference: &Reference, samples: usize, dimensions: usize) -> Measured {
    let (joints, recordings) = (reference.joints().len(), reference.recordings());
    let counted = reference.counted();
    // Two layouts of the same numbers: sorted by dimension for distances, in time for squared differences.
    let mut sorted = vec![0.0; dimensions * counted];
    let mut recorded = vec![0.0; recordings * samples * dimensions];
    for signal in Signal::ALL {
        let (first, width) = (place(signal, joints), signal.width(joints));
        // The GPU keeps only the signals that its simulator makes.
        if first + width > dimensions {
            continue;
        }
        for (column, dimension) in reference.dimensions(signal).unwrap_or_default().iter().enumerate() {
            sorted[(first + column) * counted..][..counted].copy_from_slice(dimension.sorted());
        }
        for recording in 0..recordings {
            let rows = reference.recorded(signal, recording).unwrap_or_default().chunks_exact(width);
            for (row, values) in rows.enumerate() {
                // Rows of the pre-roll stay 0: they do not count.
                let at = (recording * samples + reference.skip() + row) * dimensions + first;
                recorded[at..at + width].copy_from_slice(values);
            }
        }
    }
    Measured { skip: reference.skip(), sorted, samples: recorded }
}

/// Why a GPU could not simulate.
fn failed(error: GpuError) -> SimulatorError {
    match error {
        GpuError::Cancelled => SimulatorError::Cancelled,
        error => SimulatorError::failed(error),
    }
}

/// The cost of a candidate from its parts.
fn evaluation(pieces: &Pieces<'_>, parts: &Parts) -> Evaluation {
    let reference = pieces.compared().reference;
    let (joints, skip) = (reference.joints().len(), reference.skip());
    let (mut lost, mut falls) = (0, 0);
    for (recording, &end) in parts.ends.iter().enumerate() {
        let (length, end) = (reference.samples(recording), end as usize);
        falls += usize::from(end < length);
        // Samples from a fall on are lost. Samples of the pre-roll never count, so a fall within it does not
        // lose them.
        lost += length - end.max(skip).min(length);
    }
    let total = pieces.total(lost, |signal, column| parts.pieces[place(signal, joints) + column]);
    // A simulation that diverged has no cost: the search ranks it last.
    Evaluation { cost: total.is_finite().then_some(total), falls }
}

impl<S: OnGpu + Send + Sync + 'static> Simulator for GpuSimulator<S> {
    fn identity(&self) -> &Identity {
        self.host.identity()
    }

    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        // Rollouts that a GPU cannot simulate go to the CPU; `places` leads back to the caller's numbers.
        let numbered = |there: bool| -> (Vec<usize>, Vec<Rollout>) {
            let numbered = candidates.iter().cloned().enumerate();
            numbered.filter(|(_, rollout)| self.host.resets(rollout.resets) == there).unzip()
        };
        let (places, rollouts) = numbered(false);
        if !rollouts.is_empty() {
            let pass = |candidate: usize, recording: usize, signals: Signals<'_>| {
                consume(places[candidate], recording, signals);
            };
            self.host.simulate(theta, &rollouts, &pass, cancel)?;
        }
        let (places, rollouts) = numbered(true);
        let joints = self.joints().len();
        let provided = Signal::ALL.map(|signal| self.provides(signal));
        let pass = |candidate: usize, recording: usize, tracks: Tracks<'_>| {
            let matrix = |signal: Signal| -> Vec<f32> {
                // The GPU keeps all signals in one row a sample; the caller wants a matrix a signal.
                let (first, width) = (place(signal, joints), signal.width(joints));
                let rows = tracks.rows.chunks_exact(tracks.dimensions);
                rows.flat_map(|row| row[first..first + width].iter().copied()).collect()
            };
            let one = |signal: Signal| provided[signal as usize].then(|| matrix(signal));
            // Every simulator makes positions and velocities. The other signals exist in walks alone.
            let (position, velocity) = (matrix(Signal::Position), matrix(Signal::Velocity));
            let (action, base_position) = (one(Signal::Action), one(Signal::BasePosition));
            let base_velocity = one(Signal::BaseVelocity);
            let signals = Signals {
                position: &position,
                velocity: &velocity,
                action: action.as_deref(),
                base_position: base_position.as_deref(),
                base_velocity: base_velocity.as_deref(),
                fell_at: tracks.fell_at,
            };
            consume(places[candidate], recording, signals);
        };
        let jobs = self.jobs(theta, &rollouts)?;
        self.gpu().candidates.tracks(self.host.subject(), &jobs, &pass, cancel).map_err(failed)?;
        if cancel() { Err(SimulatorError::Cancelled) } else { Ok(()) }
    }

    /// The CPU computes derivatives.
    fn inner(&self) -> Option<&dyn Simulator> {
        Some(&self.host)
    }

    fn costs(
        &self,
        theta: &Theta,
        costs: &[Box<dyn Cost>],
        jobs: &[Job],
        cancel: &Cancel<'_>,
    ) -> Result<Vec<Evaluation>, FitError> {
        // For each cost the numbers that the GPU has to compute; `None` if its signals must come back to the CPU.
        let mut there = Vec::with_capacity(costs.len());
        for cost in costs {
            let pieces = cost.pieces().filter(|_| self.host.resets(cost.resets()));
            there.push(match pieces {
                Some(pieces) => self.compares(pieces.compared().reference)?.then_some(pieces),
                None => None,
            });
        }
        let mut evaluations: Vec<Option<Evaluation>> = vec![None; jobs.len()];
        let (on_gpu, others): (Vec<usize>, Vec<usize>) =
            (0..jobs.len()).partition(|&job| there[jobs[job].cost].is_some());
        if !others.is_empty() {
            let rest: Vec<Job> = others.iter().map(|&job| jobs[job].clone()).collect();
            // `accumulate` simulates on the GPU too if it can: only the comparison is the CPU's.
            for (job, evaluation) in others.into_iter().zip(accumulate(self, theta, costs, &rest, cancel)?) {
                evaluations[job] = Some(evaluation);
            }
        }
        let rollout = |&job: &usize| {
            let Job { cost, values, draw } = &jobs[job];
            Rollout { values: values.clone(), resets: costs[*cost].resets(), draw: *draw }
        };
        let rollouts: Vec<Rollout> = on_gpu.iter().map(rollout).collect();
        let compared: Vec<Compared> = on_gpu
            .iter()
            .map(|&job| match there[jobs[job].cost] {
                Some(Pieces::Distances(_)) => Compared::Distances,
                _ => Compared::Squares,
            })
            .collect();
        let robots = self.jobs(theta, &rollouts)?;
        // The lock is held for the whole batch: one GPU does one batch at a time.
        let parts = self.gpu().candidates.parts(self.host.subject(), &robots, &compared, cancel);
        for (&job, parts) in on_gpu.iter().zip(&parts.map_err(failed)?) {
            evaluations[job] = there[jobs[job].cost].as_ref().map(|pieces| evaluation(pieces, parts));
        }
        // A batch that was cancelled may lack evaluations. So cancellation is asked for before they are
        // counted.
        if cancel() {
            return Err(SimulatorError::Cancelled.into());
        }
        evaluations.into_iter().collect::<Option<Vec<_>>>().ok_or(FitError::Incomplete)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_adapt::cost::{Recorded, TimeAligned, Wass, Weights, sort_f32, wasserstein1};

    const LENGTHS: [usize; 2] = [30, 24];
    const JOINTS: usize = 2;
    const DIMENSIONS: usize = 3 * JOINTS + 6;
    const SKIP: usize = 2;

    fn number(side: usize, recording: usize, sample: usize, dimension: usize) -> f64 {
        (side + 7 * recording + 13 * dimension) as f64 * 0.1 + (0.4 * sample as f64 + dimension as f64).sin()
    }

    fn matrix(side: usize, recording: usize, signal: Signal) -> Vec<f64> {
        let (first, width) = (place(signal, JOINTS), signal.width(JOINTS));
        let rows = (0..LENGTHS[recording]).flat_map(|sample| (0..width).map(move |k| (sample, first + k)));
        rows.map(|(sample, dimension)| number(side, recording, sample, dimension)).collect()
    }

    /// The numbers that a GPU computes of a candidate that falls at `ends`: as its kernels do, from what it is
    /// given.
    fn parts(given: &Measured, samples: usize, ends: [usize; 2], distances: bool) -> Parts {
        let counted = given.sorted.len() / DIMENSIONS;
        let piece = |dimension: usize| {
            let counts = |recording: usize| given.skip..ends[recording];
            let simulated = |recording: usize, sample: usize| number(1, recording, sample, dimension) as f32;
            if distances {
                let mut pool: Vec<f32> =
                    (0..2).flat_map(|r| counts(r).map(move |s| simulated(r, s))).collect();
                sort_f32(&mut pool);
                return wasserstein1(&pool, &given.sorted[dimension * counted..(dimension + 1) * counted]);
            }
            let sum = |recording: usize| -> f64 {
                let difference = |sample: usize| {
                    let at = (recording * samples + sample) * DIMENSIONS + dimension;
                    f64::from(simulated(recording, sample)) - given.samples[at]
                };
                counts(recording).map(|sample| difference(sample) * difference(sample)).sum()
            };
            sum(0) + sum(1)
        };
        Parts {
            ends: ends.iter().map(|&end| end as u32).collect(),
            pieces: (0..DIMENSIONS).map(piece).collect(),
        }
    }

    #[test]
    fn costs_of_parts_are_the_cpus() {
        let recorded = |recording: usize| Recorded {
            position: matrix(0, recording, Signal::Position),
            velocity: matrix(0, recording, Signal::Velocity),
            action: Some(matrix(0, recording, Signal::Action)),
            base_position: Some(matrix(0, recording, Signal::BasePosition)),
            base_velocity: Some(matrix(0, recording, Signal::BaseVelocity)),
        };
        let names = vec!["a".to_owned(), "b".to_owned()];
        let reference = Arc::new(Reference::new(names, &[recorded(0), recorded(1)], SKIP).unwrap());
        let given = measured(&reference, LENGTHS[0], DIMENSIONS);
        let weights = Weights::from_reference(&reference);
        let costs: [Box<dyn Cost>; 3] = [
            Box::new(Wass::new(reference.clone(), weights).unwrap()),
            Box::new(TimeAligned::match_o(reference.clone(), weights).unwrap()),
            Box::new(TimeAligned::match_s(reference.clone(), Weights::PRIVILEGED, None).unwrap()),
        ];
        for cost in &costs {
            for (ends, falls) in [(LENGTHS, 0), ([17, 24], 1), ([30, 1], 1)] {
                let mut accumulator = cost.begin();
                for recording in 0..2 {
                    let single = |signal: Signal| -> Vec<f32> {
                        matrix(1, recording, signal).iter().map(|&x| x as f32).collect()
                    };
                    let [position, velocity, action, base_position, base_velocity] = Signal::ALL.map(single);
                    let signals = Signals {
                        position: &position,
                        velocity: &velocity,
                        action: Some(&action),
                        base_position: Some(&base_position),
                        base_velocity: Some(&base_velocity),
                        fell_at: Some(ends[recording]).filter(|&end| end < LENGTHS[recording]),
                    };
                    accumulator.add(recording, signals).unwrap();
                }
                let wanted = accumulator.finish().unwrap().total;
                let pieces = cost.pieces().unwrap();
                let distances = matches!(pieces, Pieces::Distances(_));
                let evaluation = evaluation(&pieces, &parts(&given, LENGTHS[0], ends, distances));
                assert_eq!(evaluation.falls, falls);
                let apart = (evaluation.cost.unwrap() - wanted).abs();
                assert!(apart < 1e-12, "{}, {ends:?}: {evaluation:?}, not {wanted}", cost.name());
            }
        }
    }
}
