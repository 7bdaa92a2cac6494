//! A replay in blocks of lanes over threads.

use gaitfit_physics::{Drive, Lanes, Params, Parts, Period, Robot, State, Tree, WIDEST, Work, memory_of};

use crate::engine::Cancel;
use crate::replay::{JointSignals, Replay};
use crate::{SimError, pool};

/// Samples between two checks for cancellation.
const ASK: usize = 64;

/// Simulates every candidate on every recording; see [`crate::engine::Engine::replay`].
pub(super) fn run<T: Lanes>(
    replay: &Replay,
    candidates: &[Robot],
    threads: usize,
    consume: &(dyn Fn(usize, usize, &JointSignals) + Sync),
    cancel: &Cancel<'_>,
) -> Result<(), SimError> {
    let params = params(replay, candidates)?;
    let jobs = jobs(replay, candidates.len());
    // One job a lane; a block is as long as the longest of its recordings.
    let blocks: Vec<&[(usize, usize)]> = jobs.chunks(T::LANES).collect();
    pool::for_each(
        blocks.len(),
        threads,
        || (Block::<T>::new(&replay.tree, replay.taps), Recorder::new(replay, T::LANES)),
        |(block, recorder), index| {
            let lane = |&(c, r): &(usize, usize)| Lane::new(replay, r, &candidates[c], &params[c]);
            let lanes: Vec<Lane> = blocks[index].iter().map(lane).collect();
            recorder.begin(replay, &lanes);
            let packed = Params::<T>::in_lanes(&full(&lanes, T::LANES));
            let record = |sample: usize, state: &State<T>, beyond: &[T]| {
                recorder.record(sample, beyond, |j| [state.qpos[j], state.qvel[j], state.qacc[j]]);
            };
            let parts = Parts::from_params(lanes.iter().map(|lane| &lane.params));
            if !block.run(replay, &lanes, (&packed, parts), |_| {}, record, cancel) {
                return;
            }
            for (signals, &(candidate, recording)) in recorder.signals.iter().zip(blocks[index]) {
                consume(candidate, recording, signals);
            }
        },
    );
    Ok(())
}

/// The candidates' parameters.
///
/// # Errors
/// Those that are not a robot, or whose delay is beyond the replay's.
pub(super) fn params(replay: &Replay, candidates: &[Robot]) -> Result<Vec<Params<f64>>, SimError> {
    let checked = |candidate: &Robot| {
        let max = candidate.delay.iter().fold(0.0f64, |a, &b| a.max(b));
        if max > replay.options.max_delay {
            return Err(SimError::Option {
                option: "a candidate's delay",
                value: max.to_string(),
                must: "at most the replay's max_delay",
            });
        }
        Ok(candidate.params(&replay.model)?)
    };
    candidates.iter().map(checked).collect()
}

/// Every one of `count` candidates on every recording. Lanes of one block should end together: by recording length,
/// then in order.
pub(super) fn jobs(replay: &Replay, count: usize) -> Vec<(usize, usize)> {
    let mut jobs: Vec<(usize, usize)> =
        (0..replay.recordings.len()).flat_map(|r| (0..count).map(move |c| (c, r))).collect();
    // The longest come first, so that no thread begins a long block when the others are done.
    jobs.sort_by_key(|&(_, r)| std::cmp::Reverse(replay.recordings[r].target.len()));
    jobs
}

/// Robot and recording that one lane simulates.
pub(super) struct Lane {
    recording: usize,
    /// The robot, with the recording's gains.
    pub params: Params<f64>,
}

impl Lane {
    /// Recording number `recording` on the robot `candidate`, whose parameters are `params`.
    pub fn new(replay: &Replay, recording: usize, candidate: &Robot, params: &Params<f64>) -> Self {
        let mut params = params.clone();
        let from = &replay.recordings[recording];
        for (j, joint) in params.joints.iter_mut().enumerate() {
            // The gains are the recording's; a candidate has factors on them.
            joint.kp = candidate.kp_scale[j] * from.kp[j];
            joint.kd = candidate.kd_scale[j] * from.kd[j];
        }
        Self { recording, params }
    }

    /// The rate at which its numbers change from `behind` to `self`, which are `distance` apart.
    pub fn rate(mut self, behind: &Self, distance: f64) -> Self {
        let mut numbers = Vec::new();
        behind.params.visit(|_, &number| numbers.push(number));
        let mut numbers = numbers.into_iter();
        self.params.visit_mut(|_, number| {
            *number = numbers.next().map_or(0.0, |behind| (*number - behind) / distance);
        });
        self
    }
}

/// One robot for each of `width` lanes; missing ones repeat the last.
pub(super) fn full(lanes: &[Lane], width: usize) -> Vec<&Params<f64>> {
    (0..width).map(|lane| &lanes[lane.min(lanes.len() - 1)].params).collect()
}

/// One block of lanes and everything it needs, reused from block to block of a thread.
pub(super) struct Block<T: Lanes> {
    state: State<T>,
    work: Work<T>,
    drives: Vec<Drive<T>>,
    history: Vec<T>,
    /// Memory of the gears and of the velocity filter.
    memory: Vec<T>,
}

impl<T: Lanes> Block<T> {
    pub fn new(tree: &Tree<f32>, taps: usize) -> Self {
        let n = tree.joints();
        Self {
            state: State::new(tree),
            work: Work::new(tree),
            drives: vec![Drive::zero(); n],
            history: vec![T::zero(); n * taps],
            memory: Vec::new(),
        }
    }

    /// Runs `lanes` with their parameters and the optional parts of their steps; missing lanes repeat the last one. `seed` may
    /// change the first state, `record` is called at every sample with the state and what sensors read beyond the joints'
    /// velocities, empty if nothing. False if it gave up.
    pub fn run(
        &mut self,
        replay: &Replay,
        lanes: &[Lane],
        (params, parts): (&Params<T>, Parts),
        seed: impl FnOnce(&mut State<T>),
        mut record: impl FnMut(usize, &State<T>, &[T]),
        cancel: &Cancel<'_>,
    ) -> bool {
        let n = replay.model.joints.len();
        let recordings = &replay.recordings;
        let lane = |lane: usize| &lanes[lane.min(lanes.len() - 1)];
        let gather = |value: &dyn Fn(&Lane) -> f64| {
            let mut values = [0.0f32; WIDEST];
            for (at, slot) in values.iter_mut().enumerate().take(T::LANES) {
                *slot = value(lane(at)) as f32;
            }
            T::load(&values)
        };
        // A thread's blocks share this scratch: a result must not depend on the block before, warm start
        // included.
        self.state = State::new(&replay.tree);
        for j in 0..n {
            // The encoder shows the true angle plus its bias.
            let start = |lane: &Lane| recordings[lane.recording].q0[j] - lane.params.joints[j].encoder_bias;
            self.state.qpos[j] = gather(&start);
            self.state.qvel[j] = gather(&|lane| recordings[lane.recording].dq0[j]);
            // Before the log the robot is taken to have held its first target.
            let first = gather(&|lane| recordings[lane.recording].target[j]);
            for row in self.history.chunks_exact_mut(n) {
                row[j] = first;
            }
        }
        seed(&mut self.state);
        // Clamped robots do not show when their inertial unit is late.
        let modifications = Parts { late_imu: false, ..parts }.modifications(n);
        self.memory.clear();
        self.memory.resize(memory_of(&modifications), T::zero());
        // The velocity filter is the last part, so what it remembers is the end of the memory.
        let beyond = self.memory.len() - if parts.filter { n } else { 0 };
        let longest = lanes.iter().map(|lane| recordings[lane.recording].target.len() / n).max().unwrap_or(0);
        for sample in 0..longest {
            if sample.is_multiple_of(ASK) && cancel() {
                return false;
            }
            record(sample, &self.state, &self.memory[beyond..]);
            // The last target would act after the last sample, which is recorded already.
            if sample + 1 == longest {
                break;
            }
            // The history is newest first, so older targets move back by one row.
            let kept = self.history.len() - n;
            self.history.copy_within(..kept, n);
            for j in 0..n {
                self.history[j] = gather(&|lane| {
                    let target = &recordings[lane.recording].target;
                    // A shorter recording of the block holds its last target until the longest one ends;
                    // nothing of it is recorded then.
                    target[sample.min(target.len() / n - 1) * n + j]
                });
            }
            T::control_period(&mut Period {
                tree: &replay.tree,
                params,
                targets: &mut self.history,
                disturbance: &[],
                modifications: &modifications,
                memory: &mut self.memory,
                substeps: replay.options.substeps,
                state: &mut self.state,
                work: &mut self.work,
                drives: &mut self.drives,
            });
        }
        true
    }
}

/// Writes what lanes' encoders show.
pub(super) struct Recorder {
    /// One a lane.
    pub signals: Vec<JointSignals>,
    joints: usize,
    /// Samples of each lane.
    lengths: Vec<usize>,
    /// Encoder biases, `lanes × joints`.
    biases: Vec<f32>,
    /// Half a physics step, s.
    half_step: f32,
}

impl Recorder {
    /// For blocks of `width` lanes.
    pub fn new(replay: &Replay, width: usize) -> Self {
        Self {
            signals: vec![JointSignals::default(); width],
            joints: replay.model.joints.len(),
            lengths: Vec::with_capacity(width),
            biases: Vec::new(),
            half_step: 0.5 * replay.tree.settings().timestep as f32,
        }
    }

    /// Makes room for `lanes`.
    pub fn begin(&mut self, replay: &Replay, lanes: &[Lane]) {
        let n = self.joints;
        self.lengths.clear();
        self.biases.clear();
        for (lane, signals) in lanes.iter().zip(&mut self.signals) {
            let length = replay.recordings[lane.recording].target.len() / n;
            self.lengths.push(length);
            self.biases.extend(lane.params.joints.iter().map(|joint| joint.encoder_bias as f32));
            // Numbers of the block before may stay: every sample of every lane is written before it is read.
            signals.position.resize(length * n, 0.0);
            signals.velocity.resize(length * n, 0.0);
        }
    }

    /// Writes the encoder positions and velocities of one sample; `of` gives a joint's angle, velocity and acceleration.
    /// `beyond`: what sensors read beyond the velocities, one a joint, or empty.
    pub fn record<T: Lanes>(&mut self, sample: usize, beyond: &[T], of: impl Fn(usize) -> [T; 3]) {
        let n = self.joints;
        let (mut q, mut qd, mut qacc) = ([0.0f32; WIDEST], [0.0f32; WIDEST], [0.0f32; WIDEST]);
        let mut more = [0.0f32; WIDEST];
        for j in 0..n {
            let numbers = of(j);
            numbers[0].store(&mut q);
            numbers[1].store(&mut qd);
            numbers[2].store(&mut qacc);
            let slow = beyond.get(j).map(|number| number.store(&mut more)).is_some();
            for (lane, &length) in self.lengths.iter().enumerate() {
                if sample < length {
                    let signals = &mut self.signals[lane];
                    signals.position[sample * n + j] = q[lane] + self.biases[lane * n + j];
                    // The integrator's velocity belongs to half a step before the position.
                    let velocity = qd[lane] + self.half_step * qacc[lane];
                    signals.velocity[sample * n + j] = if slow { velocity + more[lane] } else { velocity };
                }
            }
        }
    }
}
