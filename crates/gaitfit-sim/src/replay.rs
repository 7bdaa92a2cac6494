//! Replaying logged position targets on candidate robots: the in-air identification experiment.

use gaitfit_isa::selected;
use gaitfit_model::{Cone, Model};
use gaitfit_physics::{
    Damping, Drive, Isa, Lanes, Params, Period, Preset, Robot, Settings, State, Tree, WIDEST, Work, compile,
    delay_taps, with_lanes,
};

use crate::{SimError, pool};

/// One log to replay, in the MODEL's joint order.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Control period, s: target `i` is sent at sample `i` and held until sample `i + 1`.
    pub dt: f64,
    /// Joint positions at sample 0 as the encoders report them, rad; one a joint.
    pub q0: Vec<f64>,
    /// Joint velocities at sample 0, rad/s; one a joint.
    pub dq0: Vec<f64>,
    /// Position targets, rad; `samples × joints`, row-major.
    pub target: Vec<f64>,
    /// Position gain while recording, N·m/rad; one a joint.
    pub kp: Vec<f64>,
    /// Velocity gain while recording, N·m·s/rad; one a joint.
    pub kd: Vec<f64>,
}

/// How a replay integrates.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayOptions {
    /// Physics steps per control period.
    pub substeps: usize,
    /// Solver effort.
    pub preset: Preset,
    /// Largest actuation delay any candidate may have, s (sizes the target history).
    pub max_delay: f64,
    /// Instruction set; `None` takes the program's (see [`gaitfit_isa`]).
    pub isa: Option<Isa>,
}

impl Default for ReplayOptions {
    fn default() -> Self {
        Self { substeps: 1, preset: Preset::Fast, max_delay: 0.0, isa: None }
    }
}

/// Simulated joint signals of one candidate on one recording; `samples × joints`, row-major, model joint order.
/// Row 0 is the initial state. A simulation that diverged holds values that are not finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointSignals {
    /// Encoder positions (true position plus encoder bias), rad.
    pub position: Vec<f32>,
    /// Joint velocities, rad/s.
    pub velocity: Vec<f32>,
}

/// Most samples of one recording.
const MAX_SAMPLES: usize = 10_000_000;
/// Samples between questions whether to give up.
const ASK: usize = 64;
/// Longest actuation delay, s.
const MAX_DELAY: f64 = 1.0;

/// A robot and the recordings to replay on its candidates.
///
/// The PD controller and joint damping are integrated centred in time and implicitly: light joints with high
/// gains stay stable at the logs' own rate, and fitted inertias and dampings do not absorb the step's length.
pub struct Replay {
    model: Model,
    recordings: Vec<Recording>,
    options: ReplayOptions,
    tree: Tree<f32>,
    isa: Isa,
    taps: usize,
}

impl Replay {
    /// Checks the recordings against the model and compiles it.
    ///
    /// # Errors
    /// [`SimError::Recording`] names the recording and what is wrong with it.
    pub fn new(model: &Model, recordings: Vec<Recording>, options: ReplayOptions) -> Result<Self, SimError> {
        if options.substeps == 0 || options.substeps > 1000 {
            let value = options.substeps.to_string();
            return Err(SimError::Option { option: "substeps", value, must: "from 1 to 1000" });
        }
        if !(0.0..=MAX_DELAY).contains(&options.max_delay) {
            let value = options.max_delay.to_string();
            return Err(SimError::Option { option: "max_delay", value, must: "from 0 to 1 s" });
        }
        let isa = options.isa.map_or_else(selected, Isa::checked)?;
        let first = recordings.first().ok_or(SimError::Recording {
            index: 0,
            what: "there are no recordings; give at least one log".to_owned(),
        })?;
        let dt = first.dt;
        for (index, recording) in recordings.iter().enumerate() {
            check(recording, model.joints.len(), dt).map_err(|what| SimError::Recording { index, what })?;
        }
        let settings = Settings {
            timestep: dt / options.substeps as f64,
            cone: Cone::Pyramidal,
            damping: Damping::Folded,
            centred: true,
            implicit_actuators: true,
            ..Settings::new(&model.options, options.preset)
        };
        let tree = compile::<f32>(model, &settings)?;
        let taps = delay_taps(options.max_delay, dt, true);
        Ok(Self { model: model.clone(), recordings, options, tree, isa, taps })
    }

    /// The recordings.
    pub fn recordings(&self) -> &[Recording] {
        &self.recordings
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Physics steps that one candidate costs.
    pub fn steps_per_candidate(&self) -> usize {
        let joints = self.model.joints.len();
        self.recordings.iter().map(|r| (r.target.len() / joints - 1) * self.options.substeps).sum()
    }

    /// Simulates every candidate on every recording and hands each result to `consume(candidate, recording,
    /// signals)`, from any thread, in any order. Results do not depend on `threads` or on the other candidates. Once
    /// `cancel` says so it returns soon, without the results that are missing; `cancel` must keep saying so.
    ///
    /// # Errors
    /// A candidate whose parameters are not a robot (negative inertia, wrong lengths).
    pub fn run(
        &self,
        candidates: &[Robot],
        threads: usize,
        consume: &(dyn Fn(usize, usize, &JointSignals) + Sync),
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<(), SimError> {
        with_lanes!(self.isa, T => self.run_lanes::<T>(candidates, threads, consume, cancel))
    }

    fn run_lanes<T: Lanes>(
        &self,
        candidates: &[Robot],
        threads: usize,
        consume: &(dyn Fn(usize, usize, &JointSignals) + Sync),
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<(), SimError> {
        let mut params = Vec::with_capacity(candidates.len());
        for candidate in candidates {
            let most = candidate.delay.iter().fold(0.0f64, |a, &b| a.max(b));
            if most > self.options.max_delay {
                return Err(SimError::Option {
                    option: "a candidate's delay",
                    value: most.to_string(),
                    must: "at most the replay's max_delay",
                });
            }
            params.push(candidate.params(&self.model)?);
        }
        // Lanes of one block should end together: jobs by recording length, then in order.
        let mut jobs: Vec<(usize, usize)> =
            (0..self.recordings.len()).flat_map(|r| (0..candidates.len()).map(move |c| (c, r))).collect();
        jobs.sort_by_key(|&(_, r)| std::cmp::Reverse(self.recordings[r].target.len()));
        let blocks: Vec<&[(usize, usize)]> = jobs.chunks(T::LANES).collect();
        pool::for_each(
            blocks.len(),
            threads,
            || Block::<T>::new(&self.tree, self.taps),
            |block, index| {
                if !block.run(self, blocks[index], candidates, &params, cancel) {
                    return;
                }
                for (lane, &(candidate, recording)) in blocks[index].iter().enumerate() {
                    consume(candidate, recording, &block.signals[lane]);
                }
            },
        );
        Ok(())
    }
}

fn check(recording: &Recording, joints: usize, dt: f64) -> Result<(), String> {
    let samples = recording.target.len() / joints.max(1);
    if joints == 0 || !recording.target.len().is_multiple_of(joints) {
        return Err(format!("{} target values are not rows of {joints} joints", recording.target.len()));
    }
    if samples < 2 {
        return Err("fewer than two samples; nothing can be compared".to_owned());
    }
    if samples > MAX_SAMPLES {
        return Err(format!("{samples} samples are more than {MAX_SAMPLES}; cut the log"));
    }
    for (name, values) in
        [("q0", &recording.q0), ("dq0", &recording.dq0), ("kp", &recording.kp), ("kd", &recording.kd)]
    {
        if values.len() != joints {
            return Err(format!("{name} has {} entries for {joints} joints", values.len()));
        }
    }
    let numbers = [&recording.q0, &recording.dq0, &recording.kp, &recording.kd, &recording.target];
    if numbers.into_iter().flatten().any(|x| !x.is_finite()) {
        return Err("a value is not finite; cut the samples or fill the gap".to_owned());
    }
    if !(recording.dt.is_finite() && recording.dt > 0.0) {
        return Err(format!("sample period {} s is not positive", recording.dt));
    }
    if (recording.dt / dt - 1.0).abs() > 0.01 {
        return Err(format!(
            "sample period {} s differs from the first recording's {dt} s; resample the log",
            recording.dt
        ));
    }
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
        cancel: &(dyn Fn() -> bool + Sync),
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
