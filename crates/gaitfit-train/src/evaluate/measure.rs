//! Measures of how well a policy walks, as `gaitfit evaluate --json` prints them and other programs may.

use super::{GroundResult, motion};
use crate::Error;
use crate::device::{self, Device};
use crate::watch::{Amount, Watch};
use crate::world::World;
use gaitfit_learn::evaluate::{
    GaitRecord, GaitSummary, Subject, Trial, drift, drift_periods, record_gait, run_trials, summarise,
    trial_steps,
};
use gaitfit_learn::task::TaskSettings;
use gaitfit_view::{Drift, Estimate};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Errors of one trajectory: linear velocity, m/s, angular velocity, rad/s, and 1 after a fall, else 0. Absent if its
/// state stopped being a number, which counts as a fall.
pub type TrajectoryErrors = Option<[f64; 3]>;

/// Settings of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Trajectories with random commands.
    pub trajectories: usize,
    /// Length of each, s.
    pub seconds: f64,
    /// Robots in each constant-command trial; 0 leaves them out.
    pub drift: usize,
    /// Speeds of these, m/s, m/s and rad/s; half of the task's greatest commands without them.
    pub drift_speeds: Option<[f64; 3]>,
    /// Seed of commands, starts and noise.
    pub seed: u64,
    /// Threads.
    pub threads: usize,
    /// What simulates trajectories, constant commands and crossings; the CPU records the gait of one robot.
    pub device: Device,
}

/// Results of a measurement. Of a program's document only the errors and falls are needed; a number it lacks
/// is NaN.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// The policy, by file or name.
    #[serde(default)]
    pub policy: String,
    /// Where it walked, in a few words.
    #[serde(default)]
    pub simulator: String,
    /// Length of a trajectory, s.
    #[serde(default)]
    pub seconds: f64,
    /// Seed of commands, starts and noise.
    #[serde(default)]
    pub seed: u64,
    /// Trajectories.
    pub trajectories: usize,
    /// Summed reward.
    #[serde(default)]
    pub reward: Estimate,
    /// |v − c|, horizontal, m/s.
    pub linear_velocity_error: Estimate,
    /// |ω − c|, rad/s.
    pub angular_velocity_error: Estimate,
    /// Root-mean-square distance of the joints from the motion that the policy follows, rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion_error: Option<Estimate>,
    /// Distance of a robot that stays in the motion's first pose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion_error_at_rest: Option<f64>,
    /// Length of the motion, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion_seconds: Option<f64>,
    /// Share of falls.
    pub fall_rate: Estimate,
    /// Root-mean-square change of an action a step, per joint.
    #[serde(default)]
    pub action_rate: Estimate,
    /// Trajectories whose state stopped being a number; they count as falls, and in no other mean.
    #[serde(default)]
    pub diverged: usize,
    /// Constant commands.
    #[serde(default)]
    pub drift: Vec<DriftResult>,
    /// The gait ahead, where it walks.
    #[serde(default)]
    pub gait: Option<GaitSummary>,
    /// Crossings of uneven ground, kind by kind, level by level.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ground: Vec<GroundResult>,
    /// Hash of what the trajectories are: their commands, and the settings that draw starts, noise and ground. Only policies with
    /// the same one walked the same trajectories.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drawn: Option<String>,
    /// One a trajectory, in their order, so that policies can be compared on the same ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<TrajectoryErrors>,
    /// The distance from the motion of each trajectory, rad, of a policy that follows one; absent if its state stopped being a number.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub motion_errors: Vec<Option<f64>>,
}

impl Evaluation {
    /// States how many robots diverged, in a sentence; `None` if none did.
    pub fn divergence(&self) -> Option<String> {
        let drift: usize = self.drift.iter().map(|trial| trial.diverged).sum();
        if self.diverged + drift == 0 {
            return None;
        }
        let others =
            if drift > 0 { format!(" and {drift} robots of the drift trials") } else { String::new() };
        Some(format!(
            "{} of {} trajectories{others} diverged: their state stopped being a number. They count as falls and are in \
             no other mean. Use smaller gains or more physics steps an action",
            self.diverged, self.trajectories
        ))
    }

    /// Names a number that cannot have been measured, in words. An interval may be missing.
    pub fn wrong(&self) -> Option<String> {
        let errors = [
            ("linear_velocity_error", self.linear_velocity_error, f64::INFINITY),
            ("angular_velocity_error", self.angular_velocity_error, f64::INFINITY),
            ("fall_rate", self.fall_rate, 1.0),
        ];
        if self.trajectories == 0 {
            return Some("`trajectories` is 0".to_owned());
        }
        // Results of older files have no entries for each trajectory.
        if !(self.errors.is_empty() || self.errors.len() == self.trajectories) {
            let count = self.errors.len();
            return Some(format!("`errors` has {count} entries for {} trajectories", self.trajectories));
        }
        // Negated, so that NaN counts as impossible.
        let impossible =
            |row: &[f64; 3]| row.iter().any(|value| !(value.is_finite() && *value >= 0.0)) || row[2] > 1.0;
        if let Some(row) = self.errors.iter().flatten().find(|row| impossible(row)) {
            return Some(format!("`errors` has the entry {row:?}"));
        }
        errors.into_iter().find_map(|(name, estimate, max)| {
            let impossible =
                !(0.0..=max).contains(&estimate.mean) || estimate.mean.is_infinite() || estimate.ci95 < 0.0;
            impossible.then(|| format!("`{name}` is {} ± {}", estimate.mean, estimate.ci95))
        })
    }
}

/// The result of one constant command, over several robots; see [`gaitfit_learn::evaluate::DriftTrial`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DriftResult {
    /// Name of the command, for example `+x`.
    pub name: String,
    /// Command: forward, left (m/s), yaw rate (rad/s).
    pub command: [f64; 3],
    /// Final position along the start's heading minus the wanted one, m.
    pub x: Estimate,
    /// To the left of the start's heading, m.
    pub y: Estimate,
    /// Final heading minus the wanted one, rad.
    pub yaw: Estimate,
    /// Share of falls.
    pub fall_rate: Estimate,
    /// Robots whose state stopped being a number; they count as falls.
    #[serde(default)]
    pub diverged: usize,
    /// Path of the first robot: x, y, m, and heading, rad.
    #[serde(default)]
    pub path: Vec<[f64; 3]>,
}

/// Results of a measurement, and the rows behind them.
pub struct Measured {
    /// The means.
    pub evaluation: Evaluation,
    /// One a trajectory.
    pub trials: Vec<Trial>,
    /// The walk ahead, if the robot did not fall.
    pub gait: Option<GaitRecord>,
}

/// Measures a policy in its world.
///
/// # Errors
/// A robot that cannot be, or an interruption.
pub fn measure(world: &World, policy: &str, plan: &Plan, watch: &Watch<'_>) -> Result<Measured, Error> {
    let cancel = || watch.stop();
    let subject = Subject { cancel: Some(&cancel), ..world.subject(plan.seed) };
    let period = world.scene.walker.interface.control_dt;
    let periods = plan.trajectories * trial_steps(&subject, plan.seconds) as usize;
    let trials =
        watch.shared(Amount::simulated("random commands: simulated second", periods, period), |moved| {
            let subject = Subject { moved: Some(moved), ..subject };
            let Plan { trajectories, seconds, threads, .. } = *plan;
            plan.device.for_trajectories(trajectories).run(
                watch,
                |gpu| device::trials(gpu, &subject, trajectories, seconds, &cancel),
                || Ok(run_trials(&subject, trajectories, seconds, threads)?),
            )
        });
    // Before the result is looked at: an interrupted measurement ends in an error of its own.
    super::go_on(watch)?;
    let trials = trials?;
    // A policy that follows a motion has no commands.
    let follows = world.scene.walker.interface.reference.is_some();
    let trials_of_drift = match plan.drift {
        _ if follows => Ok(Vec::new()),
        0 => Ok(Vec::new()),
        robots => {
            let periods = drift_periods(&world.scene, robots);
            watch.shared(Amount::simulated("constant commands: simulated second", periods, period), |moved| {
                let (subject, speeds) = (Subject { moved: Some(moved), ..subject }, plan.drift_speeds);
                plan.device.for_trajectories(robots).run(
                    watch,
                    |gpu| device::drift(gpu, &subject, robots, speeds, &cancel),
                    || Ok(drift(&subject, robots, speeds, plan.threads)?),
                )
            })
        }
    };
    super::go_on(watch)?;
    let trials_of_drift = trials_of_drift?;
    let limits = &world.scene.settings.command;
    let ahead = [0.5 * limits.x[1], 0.0, 0.0];
    // The robot settles for a second, then walks ahead at half of its greatest command.
    let record = record_gait(&subject, &[(1.0, [0.0; 3]), (4.0, ahead)])?;
    // A gait ahead has no meaning for a robot that is not asked to go ahead, that fell, or that follows a
    // motion.
    let walked = limits.x[1] > 0.0 && !record.fell && !follows;
    let summary = summarise(&trials);
    let estimate = |of: Option<gaitfit_sim::stats::Estimate>| {
        of.map_or_else(Estimate::default, |of| Estimate { mean: of.mean, ci95: of.ci95.unwrap_or(f64::NAN) })
    };
    let evaluation = Evaluation {
        policy: policy.to_owned(),
        simulator: world.description(),
        seconds: plan.seconds,
        seed: plan.seed,
        trajectories: summary.trajectories,
        reward: estimate(summary.reward),
        linear_velocity_error: estimate(summary.linear_velocity_error),
        angular_velocity_error: estimate(summary.angular_velocity_error),
        motion_error: follows.then(|| estimate(summary.motion_error)),
        motion_error_at_rest: motion::at_rest(&world.scene.walker, plan.seconds),
        motion_seconds: motion::seconds(&world.scene.walker.interface),
        fall_rate: estimate(summary.fall_rate),
        action_rate: estimate(summary.action_rate),
        diverged: summary.diverged,
        drift: trials_of_drift
            .into_iter()
            .map(|trial| DriftResult {
                name: trial.name.to_owned(),
                command: trial.command,
                x: estimate(trial.x),
                y: estimate(trial.y),
                yaw: estimate(trial.yaw),
                fall_rate: estimate(trial.fall_rate),
                diverged: trial.diverged,
                path: trial.path,
            })
            .collect(),
        gait: walked.then(|| record.summary(&world.scene.gait_group)),
        ground: Vec::new(),
        drawn: Some(drawn(world, &trials)),
        errors: trials.iter().map(errors).collect(),
        // Entry by entry as many as trajectories; one that diverged has none.
        motion_errors: match follows {
            true => trials.iter().map(|trial| trial.motion_error.filter(|_| !trial.diverged)).collect(),
            false => Vec::new(),
        },
    };
    Ok(Measured { evaluation, trials, gait: walked.then_some(record) })
}

/// Hash of what was drawn for the trials in this world.
fn drawn(world: &World, trials: &[Trial]) -> String {
    let TaskSettings { start, noise, randomisation, push, terrain, .. } = &world.scene.settings;
    let mut sum = Sha256::new();
    // Commands are hashed as they were drawn: two tasks may draw the same ones from other settings.
    for number in trials.iter().flat_map(|trial| trial.command) {
        sum.update(number.to_bits().to_le_bytes());
    }
    // Settings are plain numbers and texts; what cannot be written is no setting.
    let settings = serde_json::to_string(&(start, noise, randomisation, push, terrain)).unwrap_or_default();
    sum.update(settings);
    // 64 bits tell evaluations apart, and keep documents short.
    sum.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect()
}

/// Numbers of a trajectory that are compared with others.
fn errors(trial: &Trial) -> TrajectoryErrors {
    let fell = f64::from(u8::from(trial.fell));
    (!trial.diverged).then_some([trial.linear_velocity_error, trial.angular_velocity_error, fell])
}

impl DriftResult {
    /// The command in words, for example `+x 0.50`.
    pub fn label(&self) -> String {
        let [x, y, yaw] = self.command;
        if self.name == "stand" {
            "stand".to_owned()
        } else {
            // Only one of the three numbers is not 0.
            format!("{} {:.2}", self.name, (x + y + yaw).abs())
        }
    }

    /// Distance from the wanted place at which the mean robot ends, m; NaN if all fell.
    pub fn distance(&self) -> f64 {
        self.x.mean.hypot(self.y.mean)
    }

    /// As pages draw it; `robots`: how many there were.
    pub fn drawn(&self, robots: usize) -> Drift {
        let [x, y, yaw] = self.command;
        // The share is a quotient of whole numbers, so rounding gives the number of falls back.
        let falls = (self.fall_rate.mean * robots as f64).round();
        let unit = if yaw == 0.0 { "m/s" } else { "rad/s" };
        let name = if self.name == "stand" { self.label() } else { format!("{} {unit}", self.label()) };
        Drift {
            name,
            command: self.command,
            trials: robots as u32,
            falls: falls as u32,
            error: [self.x.mean, self.y.mean, self.yaw.mean],
            ci95: [self.x, self.y, self.yaw].map(|estimate| estimate.ci95),
            path: self.path.iter().map(|[x, y, _]| [*x, *y]).collect(),
            // The command of a trial lasts 4 s.
            intended: vec![[0.0, 0.0], [4.0 * x, 4.0 * y]],
        }
    }
}
