//! The configuration of `gaitfit fit`: its settings and their defaults, and how any configuration is read.
//! `gaitfit config` prints them.

pub mod check;
mod controls;
mod finetune;
pub mod groups;
mod load;
mod loop_;
mod messages;
mod per_joint;
mod preset;
mod target;
mod task;
mod text;
mod train;
mod walking;

pub use check::MAX_SEED;
pub use controls::{ControlsConfig, TruthConfig};
pub use finetune::{FINETUNE_DEFAULTS, FinetuneConfig, changed};
pub use load::{Configuration, load};
pub use loop_::{FREE as LOOP_FREE, LOOP_DEFAULTS, LoopConfig, MAX_DRIFT};
pub use messages::OF_LOOPS;
pub use messages::tamed;
pub use target::{PATIENCE, TargetConfig, TargetKind, check_torque_noise};
pub use task::{Task, TaskName, load_task};
pub use text::{DEFAULTS, train_defaults};
pub use train::TrainConfig;
pub use walking::walk_defaults;

use gaitfit_adapt::cmaes::{BoundHandling, CovarianceKind};
use gaitfit_adapt::cost::CostKind;
use gaitfit_adapt::fit::{Method, RandomNumbers};
use gaitfit_adapt::{
    JointParameter, NetworkRule, ParameterRule, Prior, RobotRule, Rules, Sharing, ThetaError,
};
use gaitfit_log::{FindingKind, PerJoint};
use gaitfit_model::{Model, SelfContact};
pub use gaitfit_physics::Preset;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use toml::de::DeTable;

/// All settings of one adaptation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AdaptConfig {
    /// Name of the run and of its folder; the configuration file's stem when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Robot file (MJCF or URDF); for walking logs the built-in Go2 when empty.
    pub robot: String,
    /// Drop what the engine cannot simulate in the robot file instead of refusing it.
    pub lenient: bool,
    /// How the robot's base was held while recording.
    pub base: Base,
    /// Walking logs: the policy that walked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub policy: Option<String>,
    /// File of parameters that are known already, a theta.toml. The fit's own parameters are added to them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub known: Option<String>,
    /// Logs to fit.
    pub logs: Vec<String>,
    /// Logs to validate on, not used in the fit.
    pub validate: Vec<String>,
    /// Findings of `gaitfit inspect` that do not forbid using a log.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub allow: Vec<FindingKind>,
    /// Costs to fit, one independent fit each.
    pub costs: Vec<CostKind>,
    /// Whether to look for joints that differ from the same joint of other legs, and to fit a spring on those.
    pub odd_joints: bool,
    /// Whether what legs in the air show of friction, damping, armature and delay becomes a prior of a walk's fit; by default
    /// only where the settings name no parameters.
    pub swings: bool,
    /// Whether a fit of walks gets further parameters for effects that its logs show without a simulation. Examples are play,
    /// soft ground and a tilted IMU. By default only where the settings name no parameters.
    pub effects: bool,
    /// Folder that holds the run folders.
    pub runs: String,
    /// Seconds between checkpoints.
    pub checkpoint_seconds: f64,
    /// Joint names of the logs → joint names of the robot, where they differ.
    pub joint_names: BTreeMap<String, String>,
    /// PD gains of logs that do not state their own.
    pub gains: GainsConfig,
    /// PD gains of single validation logs; they replace those that the log states.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub validate_gains: Vec<FileGains>,
    /// Joint groups by name: patterns over the robot's joint names. By default `hip` (`*_hip*`), `thigh` and `calf`; if these do
    /// not have all joints, joints whose names differ only in the leg are a group with the common part of their names.
    pub groups: BTreeMap<String, Vec<String>>,
    /// What to fit.
    pub parameter: Vec<ParameterRule>,
    /// Networks to fit.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub network: Vec<NetworkRule>,
    /// Numbers of the whole robot to fit.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub number: Vec<RobotRule>,
    /// Estimates of entries from before the fit, by their names. The search begins there and pays for the distance.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub prior: BTreeMap<String, Prior>,
    /// How logs are replayed.
    pub simulation: SimulationConfig,
    /// Walking logs: how falls count.
    pub falls: FallsConfig,
    /// The optimiser.
    pub optimizer: OptimizerConfig,
    /// Checks on the result; a failed one ends the program with exit code 3.
    pub check: CheckConfig,
    /// True values by parameter name, where they are known (simulated robots): shown beside the fit.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub truth: BTreeMap<String, f64>,
    /// Published values by parameter name, as [smallest, largest]: shown beside the fit.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub published: BTreeMap<String, [f64; 2]>,
}

/// How the robot's base was held while recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Base {
    /// Clamped, legs in the air: the logs' targets are replayed.
    Fixed,
    /// Free, walking: the policy is run under the logs' commands.
    Free,
}

/// PD gains: one number for all joints, or numbers by joint name or pattern.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GainsConfig {
    /// Position gain, N·m/rad.
    #[serde(with = "per_joint", skip_serializing_if = "Option::is_none")]
    pub kp: Option<PerJoint>,
    /// Velocity gain, N·m·s/rad.
    #[serde(with = "per_joint", skip_serializing_if = "Option::is_none")]
    pub kd: Option<PerJoint>,
}

/// PD gains of some validation logs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileGains {
    /// Patterns over file names or paths, for example `run_9.csv` or `*stiff*`.
    pub files: Vec<String>,
    /// Position gain, N·m/rad.
    #[serde(with = "per_joint")]
    pub kp: Option<PerJoint>,
    /// Velocity gain, N·m·s/rad.
    #[serde(with = "per_joint")]
    pub kd: Option<PerJoint>,
}

/// Counted data that a stretch of a walking log needs to be of use, s.
pub const MIN_STRETCH_S: f64 = 1.0;
/// The same where every sample is predicted from the ones before, s.
const MIN_SENSED_S: f64 = 0.5;
/// Time that is cut from a log before a fall, s: the walks of log and simulation differ already before they end.
const FALL_MARGIN_S: f64 = 0.5;

/// How logs are replayed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimulationConfig {
    /// Largest physics step, s; each log sample is split into the fewest equal steps not above it.
    pub timestep: f64,
    /// Walking logs: physics step of the simulated robot that made them, or period of the real one's motor boards, s.
    /// Absent: the fit's own step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot_timestep: Option<f64>,
    /// Which parts of the robot may touch each other; absent: those of the policy's task, and none of a clamped robot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub self_contact: Option<SelfContact>,
    /// Solver effort.
    #[serde(with = "preset")]
    pub preset: Preset,
    /// Seconds at the start of each log that do not count in costs and errors; see [`AdaptConfig::skip_seconds`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skip_seconds: Option<f64>,
    /// Walking logs compared by distributions (`wass`) alone: how often a candidate walks each log, from the start that the
    /// sensors show and from starts near it.
    pub starts: usize,
    /// Seconds of each walking log, after the skipped ones, that count; 0 counts all of it.
    pub horizon_seconds: f64,
    /// Threads; 0 takes one for each core.
    pub threads: usize,
}

/// What falls mean in fits of walking logs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FallsConfig {
    /// Time that is cut from a log before a fall, s; see [`AdaptConfig::fall_margin`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub margin_seconds: Option<f64>,
    /// Price of a fall in every log: a candidate pays it times the share of the logs in which it falls. By default, if the robot
    /// never fell, a candidate that falls never beats one that stands; else it pays only for more falls than the robot's, beyond
    /// chance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub penalty: Option<f64>,
}

/// The optimiser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OptimizerConfig {
    /// How seeds search: `least-squares` for costs that compare single samples, `cma-es` for any, or `auto`.
    pub method: Method,
    /// Candidates a generation; 0 takes 4 + ⌊3 ln n⌋.
    pub population: usize,
    /// Generations of every start.
    pub generations: usize,
    /// Starts after the first, each with twice the population of the one before.
    pub restarts: u32,
    /// Independent fits; the spread of a parameter is its standard deviation over them. With 0
    /// [`OptimizerConfig::seed_count`] chooses their number for the device.
    pub seeds: usize,
    /// First seed; the others follow it.
    pub seed: u64,
    /// Covariance model.
    pub covariance: CovarianceKind,
    /// What happens to draws outside the bounds.
    pub bounds: BoundHandling,
    /// Which candidates see the same random numbers (torque noise).
    pub random_numbers: RandomNumbers,
    /// Sets of simulated logs a round, which correct fits of walking logs by least squares, and a twentieth of the simulated
    /// robots a round, which correct those by distributions; 0: no correction.
    pub replicates: u32,
    /// A seed of CMA-ES stops once the smallest costs of this many generations hardly change: the means of
    /// their halves differ by less than a fiftieth, standard error included; 0 never, 1 to 3 count as 4.
    pub patience: usize,
    /// Cost of a distance of one standard error from a `[prior]`.
    pub prior_weight: f64,
    /// A seed stops once its search distribution is this small: largest standard deviation of any
    /// parameter, relative to its initial deviation. 0 never stops early.
    pub tolerance: f64,
    /// Wall time after which the search stops with what it has, s; 0 has no limit. Intervals are measured after it, which takes
    /// as long again or longer. Estimates of a search that was cut off are not corrected by simulated logs, and have no
    /// intervals where such a correction belongs to the fit.
    pub max_seconds: f64,
}

/// Checks on the result.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CheckConfig {
    /// Whether the search must have converged.
    pub converged: bool,
    /// Whether the fitted robot must be closer to the logs than the robot before the fit.
    pub better_than_nominal: bool,
    /// Whether the fit must be without any doubt.
    pub sound: bool,
    /// Largest cost on the fitted logs, of the first cost.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    /// The same on the validation logs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub validation_cost: Option<f64>,
    /// Largest free-running position RMSE over the validation logs, rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rmse_rad: Option<f64>,
}

impl OptimizerConfig {
    /// Number of independent fits: [`OptimizerConfig::seeds`], or if that is 0, three on a GPU and one on the CPU. A GPU runs
    /// three fits of walks in about a third more time than one. Of a real Go2's walks, none of ten such fits fell in a walk
    /// that was kept out; of ten fits with one search, three did.
    pub fn seed_count(&self, on_gpu: bool) -> usize {
        match self.seeds {
            0 if on_gpu => 3,
            0 => 1,
            stated => stated,
        }
    }
}

impl AdaptConfig {
    /// What is fitted.
    pub fn rules(&self) -> Rules {
        Rules { parameter: self.parameter.clone(), network: self.network.clone(), robot: self.number.clone() }
    }

    /// The settings for the hinges and slides of `model`: a rule that covers both becomes two. A default of
    /// walking robots that states numbers states them for hinges; slides get the corresponding ones ([`gaitfit_model::JointKind::like`]).
    ///
    /// # Errors
    /// As [`Rules::by_kind`].
    pub fn by_kind(&self, model: &Model) -> Result<Self, ThetaError> {
        let mut config = self.clone();
        if !model.has_slides() {
            // Without slides all joints have the same units.
            return Ok(config);
        }
        self.rules().check_networks(model)?;
        // Only a default states its numbers for hinges alone. A user's rule with numbers must not cover both
        // kinds.
        let usual = walk_defaults().parameter;
        let parts = self.parameter.iter().map(|rule| rule.by_kind(model, usual.contains(rule)));
        config.parameter = parts.collect::<Result<Vec<_>, _>>()?.concat();
        Ok(config)
    }

    /// How often a candidate walks each log, see [`SimulationConfig::starts`]; 1 where a cost compares samples.
    pub fn starts(&self) -> usize {
        let distributions = self.base == Base::Free && self.costs.iter().all(|&cost| cost == CostKind::Wass);
        if distributions { self.simulation.starts } else { 1 }
    }

    /// Seconds at the start of each log that do not count. How a walking robot's base moved when the log began no log of
    /// joints says; the simulated one begins at rest and needs about a second to walk as the robot does. What the sensors
    /// read shows it sooner.
    pub fn skip_seconds(&self) -> f64 {
        let chosen = match self.base {
            Base::Fixed => 0.0,
            Base::Free if self.sensed() => 0.5,
            Base::Free => 1.0,
        };
        self.simulation.skip_seconds.unwrap_or(chosen)
    }

    /// Whether every cost predicts single samples from what the sensors read before.
    fn sensed(&self) -> bool {
        // `all` is true of an empty list, which compares nothing.
        !self.costs.is_empty() && self.costs.iter().all(|cost| cost.needs_imu())
    }

    /// Time that is cut from a log before a fall, s. Short predictions learn from a robot that falls as from one that walks,
    /// until its trunk is on the ground.
    pub fn fall_margin(&self) -> f64 {
        self.falls.margin_seconds.unwrap_or(if self.sensed() { 0.0 } else { FALL_MARGIN_S })
    }

    /// Counted data that a stretch of a walking log needs to be of use, s.
    pub fn min_stretch(&self) -> f64 {
        if self.sensed() { MIN_SENSED_S } else { MIN_STRETCH_S }
    }

    /// Names of the joint groups with the patterns of their joints. The configuration states them. If it leaves the default
    /// and that does not cover all `joints`, each group holds the joints of one name on all legs.
    pub fn groups(&self, joints: &[String]) -> Vec<(String, Vec<String>)> {
        // Groups that a user wrote are never replaced.
        let default = self.groups == Self::default().groups;
        if let Some(groups) = default.then(|| groups::by_name(joints)).flatten() {
            return groups;
        }
        self.groups.iter().map(|(name, patterns)| (name.clone(), patterns.clone())).collect()
    }
}

impl Configuration for AdaptConfig {
    const PRINTED_BY: &'static str = "gaitfit config";
    const EXAMPLE: &'static str = "optimizer.seeds=3";

    /// Walking logs have defaults of their own.
    fn complete(table: &mut DeTable<'_>) {
        walking::complete(table);
    }
}

impl Default for AdaptConfig {
    fn default() -> Self {
        let group = |name: &str| (name.to_owned(), vec![format!("*_{name}*")]);
        Self {
            name: None,
            robot: String::new(),
            lenient: false,
            base: Base::Fixed,
            policy: None,
            known: None,
            logs: Vec::new(),
            validate: Vec::new(),
            costs: vec![CostKind::MatchO],
            allow: Vec::new(),
            odd_joints: false,
            swings: false,
            effects: false,
            runs: "runs".to_owned(),
            checkpoint_seconds: 5.0,
            joint_names: BTreeMap::new(),
            gains: GainsConfig::default(),
            validate_gains: Vec::new(),
            groups: ["hip", "thigh", "calf"].map(group).into(),
            parameter: clamped(),
            network: Vec::new(),
            number: Vec::new(),
            prior: BTreeMap::new(),
            simulation: SimulationConfig::default(),
            falls: FallsConfig::default(),
            optimizer: OptimizerConfig::default(),
            check: CheckConfig::default(),
            truth: BTreeMap::new(),
            published: BTreeMap::new(),
        }
    }
}

/// Parameters that are fitted to logs of a clamped robot by default. A delay that is left out comes out as
/// friction.
fn clamped() -> Vec<ParameterRule> {
    let delay = ParameterRule { per: Sharing::All, ..ParameterRule::new(JointParameter::Delay) };
    ParameterRule::fric_arm().into_iter().chain([delay]).collect()
}

/// Cost of one standard error from a prior. On a dozen walks of a real Go2 ten times as much moved hardly anything further
/// towards the prior, and a fifth let the joints go to values that swings exclude.
const PRIOR_WEIGHT: f64 = 0.0005;

impl Default for SimulationConfig {
    fn default() -> Self {
        Self {
            timestep: 0.005,
            robot_timestep: None,
            self_contact: None,
            preset: Preset::Accurate,
            skip_seconds: None,
            starts: 1,
            horizon_seconds: 0.0,
            threads: 0,
        }
    }
}

impl Default for OptimizerConfig {
    fn default() -> Self {
        Self {
            method: Method::Auto,
            population: 0,
            // As in the paper (Dao and Fern).
            generations: 200,
            restarts: 0,
            seeds: 5,
            seed: 1,
            covariance: CovarianceKind::Full,
            bounds: BoundHandling::Reflect,
            random_numbers: RandomNumbers::default(),
            replicates: 4,
            patience: 0,
            prior_weight: PRIOR_WEIGHT,
            tolerance: 1e-4,
            max_seconds: 0.0,
        }
    }
}
