//! A replay in blocks of lanes over threads.

use gaitfit_physics::{Drive, Lanes, Params, Period, Robot, State, Tree, WIDEST, Work};

use crate::engine::Cancel;
use crate::replay::{JointSignals, Replay};
use crate::{SimError, pool};

/// Samples between questions whether to give up.
const ASK: usize = 64;

/// Simulates every candidate on every recording; see [`crate::engine::Engine::replay`].
pub(super) fn run<T: Lanes>(
    replay: &Replay,
    candidates: &[Robot],
    threads: usize,
    consume: &(dyn Fn(usize, usize, &JointSignals) + Sync),
    cancel: &Cancel<'_>,
) -> Result<(), SimError> {
    let mut params = Vec::with_capacity(candidates.len());
    for candidate in candidates {
        let most = candidate.delay.iter().fold(0.0f64, |a, &b| a.max(b));
        if most > replay.options.max_delay {
            return Err(SimError::Option {
                option: "a candidate's delay",
                value: most.to_string(),
                must: "at most the replay's max_delay",
            });
        }
        params.push(candidate.params(&replay.model)?);
    }
    // Lanes of one block should end together: jobs by recording length, then in order.
    let mut jobs: Vec<(usize, usize)> =
        (0..replay.recordings.len()).flat_map(|r| (0..candidates.len()).map(move |c| (c, r))).collect();
    jobs.sort_by_key(|&(_, r)| std::cmp::Reverse(replay.recordings[r].target.len()));
    let blocks: Vec<&[(usize, usize)]> = jobs.chunks(T::LANES).collect();
    pool::for_each(
        blocks.len(),
        threads,
        || Block::<T>::new(&replay.tree, replay.taps),
        |block, index| {
            if !block.run(replay, blocks[index], candidates, &params, cancel) {
                return;
            }
            for (lane, &(candidate, recording)) in blocks[index].iter().enumerate() {
                consume(candidate, recording, &block.signals[lane]);
            }
        },
    );
    Ok(())
}

/// One block of lanes and everything it needs, reused from block to block of a thread.
struct Block<T: Lanes> {
    state: State<T>,
    work: Work<T>,
    drives: Vec<Drive<T>>,
    history: Vec<T>,
    signals: Vec<JointSignals>,
    /// Half a physics step, s.
    half_step: f32,
}

impl<T: Lanes> Block<T> {
    fn new(tree: &Tree<f32>, taps: usize) -> Self {
        let n = tree.joints();
        Self {
            state: State::new(tree),
            work: Work::new(tree),
            drives: vec![Drive::zero(); n],
            history: vec![T::zero(); n * taps],
            signals: vec![JointSignals::default(); T::LANES],
            half_step: 0.5 * tree.settings().timestep as f32,
        }
    }

    /// Runs the jobs (candidate, recording), one a lane; missing lanes repeat the last job. False if it gave up.
    fn run(
        &mut self,
        replay: &Replay,
        jobs: &[(usize, usize)],
        candidates: &[Robot],
        params: &[Params<f64>],
        cancel: &Cancel<'_>,
    ) -> bool {
        let n = replay.model.joints.len();
        let job = |lane: usize| jobs[lane.min(jobs.len() - 1)];
        let gather = |value: &dyn Fn(usize, usize) -> f64| {
            let mut values = [0.0f32; WIDEST];
            for (lane, slot) in values.iter_mut().enumerate().take(T::LANES) {
                let (candidate, recording) = job(lane);
                *slot = value(candidate, recording) as f32;
            }
            T::load(&values)
        };
        let sets: Vec<&Params<f64>> = (0..T::LANES).map(|lane| &params[job(lane).0]).collect();
        let mut block = Params::<T>::in_lanes(&sets);
        let recordings = &replay.recordings;
        self.state = State::new(&replay.tree);
        for j in 0..n {
            block.joints[j].kp = gather(&|c, r| candidates[c].kp_scale[j] * recordings[r].kp[j]);
            block.joints[j].kd = gather(&|c, r| candidates[c].kd_scale[j] * recordings[r].kd[j]);
            self.state.qpos[j] = gather(&|c, r| recordings[r].q0[j] - candidates[c].encoder_bias[j]);
            self.state.qvel[j] = gather(&|_, r| recordings[r].dq0[j]);
            // Before the log the robot is taken to have held its first target.
            let first = gather(&|_, r| recordings[r].target[j]);
            for row in self.history.chunks_exact_mut(n) {
                row[j] = first;
            }
        }
        let lengths: Vec<usize> =
            (0..jobs.len()).map(|lane| recordings[job(lane).1].target.len() / n).collect();
        for (signals, &length) in self.signals.iter_mut().zip(&lengths) {
            signals.position.resize(length * n, 0.0);
            signals.velocity.resize(length * n, 0.0);
        }
        let biases: Vec<f32> = (0..jobs.len())
            .flat_map(|lane| candidates[job(lane).0].encoder_bias.iter().map(|&bias| bias as f32))
            .collect();
        let longest = lengths.iter().copied().max().unwrap_or(0);
        for sample in 0..longest {
            if sample.is_multiple_of(ASK) && cancel() {
                return false;
            }
            self.record(sample, n, &lengths, &biases);
            if sample + 1 == longest {
                break;
            }
            let kept = self.history.len() - n;
            self.history.copy_within(..kept, n);
            for j in 0..n {
                let mut values = [0.0f32; WIDEST];
                for (lane, slot) in values.iter_mut().enumerate().take(T::LANES) {
                    let target = &recordings[job(lane).1].target;
                    let row = sample.min(target.len() / n - 1);
                    *slot = target[row * n + j] as f32;
                }
                self.history[j] = T::load(&values);
            }
            T::control_period(&mut Period {
                tree: &replay.tree,
                params: &block,
                targets: &mut self.history,
                disturbance: &[],
                modifications: &[],
                memory: &mut [],
                substeps: replay.options.substeps,
                state: &mut self.state,
                work: &mut self.work,
                drives: &mut self.drives,
            });
        }
        true
    }

    /// Writes the lanes' encoder positions and velocities of one sample.
    fn record(&mut self, sample: usize, n: usize, lengths: &[usize], biases: &[f32]) {
        let (mut q, mut qd, mut qacc) = ([0.0f32; WIDEST], [0.0f32; WIDEST], [0.0f32; WIDEST]);
        for j in 0..n {
            self.state.qpos[j].store(&mut q);
            self.state.qvel[j].store(&mut qd);
            self.state.qacc[j].store(&mut qacc);
            for (lane, &length) in lengths.iter().enumerate() {
                if sample < length {
                    let signals = &mut self.signals[lane];
                    signals.position[sample * n + j] = q[lane] + biases[lane * n + j];
                    // The integrator's velocity belongs to half a step before the position.
                    signals.velocity[sample * n + j] = qd[lane] + self.half_step * qacc[lane];
                }
            }
        }
    }
}
