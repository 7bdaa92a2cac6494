//! A task on a robot: names resolved to indices once, shared by all environments.

use gaitfit_model::Model;
use gaitfit_physics::{PhysicsError, Preset, Robot};
use gaitfit_sim::{Batch, BatchOptions, Candidate, SimError};
use globset::Glob;

use super::{JointTable, TaskSettings, reward};
use gaitfit_policy::{Interface, InterfaceError, Quantity, Term};

/// Why a task does not fit a robot or contradicts itself.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// A setting.
    #[error("task.{setting} {what}")]
    Setting {
        /// Which setting.
        setting: String,
        /// What is wrong with it, and what to do.
        what: String,
    },
    /// The policy's interface.
    #[error(transparent)]
    Interface(#[from] InterfaceError),
    /// The simulator.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The robot's parameters.
    #[error(transparent)]
    Physics(#[from] PhysicsError),
}

/// A task on a robot. Joint vectors are in the model's order unless they say otherwise.
pub struct Scene {
    /// The task.
    pub settings: TaskSettings,
    /// The policy's side.
    pub interface: Interface,
    /// The simulator.
    pub batch: Batch,
    /// For each of the policy's joints, its index in the model.
    pub joints: Vec<usize>,
    /// Pose at action zero, rad.
    pub default_pose: Vec<f32>,
    /// Target change per unit action, rad.
    pub action_scale: Vec<f32>,
    /// Pose an episode starts in, rad.
    pub start_pose: Vec<f32>,
    /// Gait group of each foot; `None` for feet that stay out of the gait.
    pub gait_group: Vec<Option<usize>>,
    /// Place of each foot in `Motion::normal_force`.
    pub(super) foot_geoms: Vec<usize>,
    /// Places of geoms that end an episode by touching the ground.
    pub(super) fall_geoms: Vec<usize>,
    /// Places of all other geoms that are not feet.
    pub(super) body_geoms: Vec<usize>,
    /// Terms of non-zero weight: index in `reward::TERMS`, and weight times the control step.
    pub(super) rewards: Vec<(usize, f32)>,
}

/// Most feet of a robot.
pub(super) const MAX_FEET: usize = 8;

fn refuse<T>(setting: &str, what: String) -> Result<T, SceneError> {
    Err(SceneError::Setting { setting: setting.to_owned(), what })
}

/// Values of a table by joint, where a pattern matches.
fn by_joint(model: &Model, table: &JointTable, setting: &str) -> Result<Vec<Option<f64>>, SceneError> {
    let mut values = vec![None; model.joints.len()];
    for (pattern, &value) in table {
        let Ok(glob) = Glob::new(pattern) else {
            return refuse(setting, format!("has `{pattern}`, which is no pattern"));
        };
        let matcher = glob.compile_matcher();
        let mut found = false;
        for (slot, joint) in values.iter_mut().zip(&model.joints) {
            if matcher.is_match(&joint.name) {
                *slot = Some(value);
                found = true;
            }
        }
        if !found {
            return refuse(setting, format!("has `{pattern}`, which matches no joint of {}", model.name));
        }
    }
    Ok(values)
}

impl Scene {
    /// The task on `model` with a new policy's interface.
    ///
    /// # Errors
    /// Whatever does not fit, by setting.
    pub fn new(model: &Model, settings: &TaskSettings, preset: Preset) -> Result<Self, SceneError> {
        let policy = &settings.policy;
        let pose = by_joint(model, &policy.default_pose, "policy.default_pose")?;
        let joints = model.joints.len();
        let interface = Interface {
            robot: model.name.clone(),
            joints: model.joints.iter().map(|joint| joint.name.clone()).collect(),
            default_pose: pose.iter().map(|angle| angle.unwrap_or(0.0)).collect(),
            action_scale: vec![policy.action_scale; joints],
            action_clip: None,
            kp: vec![policy.kp; joints],
            kd: vec![policy.kd; joints],
            control_dt: settings.control_dt,
            gait_frequency: policy.gait_frequency,
            observation: policy.observation.clone(),
            critic_observation: policy.critic_observation.clone(),
        };
        Self::with_interface(model, settings, interface, preset, 0.0)
    }

    /// Physics step, s.
    pub fn physics_step(&self) -> f64 {
        self.interface.control_dt / self.settings.substeps as f64
    }

    /// The task on `model` for a policy that exists. `max_delay`: largest actuation delay of any robot, s.
    ///
    /// # Errors
    /// Whatever does not fit, by setting; a policy for another robot.
    pub fn with_interface(
        model: &Model,
        settings: &TaskSettings,
        interface: Interface,
        preset: Preset,
        max_delay: f64,
    ) -> Result<Self, SceneError> {
        check(settings)?;
        if model.root != gaitfit_model::Root::Floating {
            return refuse(
                "robot",
                format!("{} is clamped; a walking task needs a floating base", model.name),
            );
        }
        let joints = interface.resolve(model)?;
        for terms in [&interface.observation, &interface.critic_observation] {
            check_terms(terms, interface.joints.len(), interface.gait_frequency)?;
        }
        let batch = Batch::new(
            model,
            BatchOptions {
                control_dt: interface.control_dt,
                substeps: settings.substeps,
                preset,
                max_delay,
                tracked: settings.feet.clone(),
                isa: None,
            },
        )?;
        let name = |place: usize| model.geoms[batch.contact_geoms()[place]].name.as_str();
        let places = || 0..batch.contact_geoms().len();
        let mut foot_geoms = Vec::with_capacity(settings.feet.len());
        for foot in &settings.feet {
            foot_geoms.extend(places().find(|&place| name(place) == foot));
        }
        let mut fall_geoms = Vec::new();
        for pattern in &settings.fall.contacts {
            let Ok(glob) = Glob::new(pattern) else {
                return refuse("fall.contacts", format!("has `{pattern}`, which is no pattern"));
            };
            let matcher = glob.compile_matcher();
            let before = fall_geoms.len();
            fall_geoms.extend(places().filter(|&place| matcher.is_match(name(place))));
            if fall_geoms.len() == before {
                return refuse(
                    "fall.contacts",
                    format!("has `{pattern}`, which matches no geom of {}", model.name),
                );
            }
        }
        let rest = |place: &usize| !foot_geoms.contains(place) && !fall_geoms.contains(place);
        let body_geoms = places().filter(rest).collect();
        let mut gait_group = vec![None; settings.feet.len()];
        for (group, names) in settings.gait.iter().enumerate() {
            for wanted in names {
                match settings.feet.iter().position(|foot| foot == wanted) {
                    Some(foot) => gait_group[foot] = Some(group),
                    None => return refuse("gait", format!("names `{wanted}`, which is not in task.feet")),
                }
            }
        }
        let mut rewards = Vec::new();
        for (wanted, &weight) in &settings.rewards {
            let Some(term) = reward::TERMS.iter().position(|term| term.name == wanted) else {
                let known: Vec<_> = reward::TERMS.iter().map(|term| term.name).collect();
                return refuse("rewards", format!("has `{wanted}`; known terms: {}", known.join(", ")));
            };
            if !weight.is_finite() {
                return refuse("rewards", format!("gives `{wanted}` the weight {weight}"));
            }
            if weight != 0.0 {
                rewards.push((term, (weight * interface.control_dt) as f32));
            }
        }
        let mut default_pose = vec![0.0; model.joints.len()];
        let mut action_scale = vec![0.0; model.joints.len()];
        for (index, &joint) in joints.iter().enumerate() {
            default_pose[joint] = interface.default_pose[index] as f32;
            action_scale[joint] = interface.action_scale[index] as f32;
        }
        let start = by_joint(model, &settings.start.pose, "start.pose")?;
        let start_pose =
            start.iter().zip(&default_pose).map(|(angle, &home)| angle.map_or(home, |a| a as f32)).collect();
        Ok(Self {
            settings: settings.clone(),
            interface,
            joints,
            default_pose,
            action_scale,
            start_pose,
            gait_group,
            foot_geoms,
            fall_geoms,
            body_geoms,
            rewards,
            batch,
        })
    }

    /// The robot of a candidate with the policy's gains.
    pub fn robot(&self, candidate: &Candidate) -> Robot {
        let joints = self.start_pose.len();
        let (mut kp, mut kd) = (vec![0.0; joints], vec![0.0; joints]);
        for (index, &joint) in self.joints.iter().enumerate() {
            kp[joint] = self.interface.kp[index];
            kd[joint] = self.interface.kd[index];
        }
        candidate.robot(self.batch.model(), &kp, &kd)
    }

    /// Position targets (rad, model order) of `actions` (policy order); one row an environment in both.
    pub fn targets(&self, actions: &[f32], targets: &mut [f32]) {
        let clip = self.interface.action_clip.map_or(f32::MAX, |clip| clip as f32);
        let rows = targets.chunks_exact_mut(self.start_pose.len());
        for (row, actions) in rows.zip(actions.chunks_exact(self.joints.len())) {
            for (&joint, &action) in self.joints.iter().zip(actions) {
                row[joint] = self.default_pose[joint] + self.action_scale[joint] * action.clamp(-clip, clip);
            }
        }
    }

    /// Phase of the gait clock, 0 to 1, `steps` control periods after an episode's start; 0 without a clock.
    pub fn clock(&self, steps: u32) -> f32 {
        let Some(frequency) = self.interface.gait_frequency else { return 0.0 };
        (f64::from(steps) * self.interface.control_dt * frequency).fract() as f32
    }

    /// Reward terms of non-zero weight, by name.
    pub fn reward_names(&self) -> Vec<&'static str> {
        self.rewards.iter().map(|&(term, _)| reward::TERMS[term].name).collect()
    }

    /// Control periods in an episode.
    pub fn episode_steps(&self) -> u32 {
        (self.settings.episode_seconds / self.interface.control_dt).round().max(1.0) as u32
    }

    /// Control periods between commands.
    pub fn command_steps(&self) -> u32 {
        (self.settings.command.seconds / self.interface.control_dt).round().max(1.0) as u32
    }
}

fn check_terms(terms: &[Term], joints: usize, clock: Option<f64>) -> Result<(), SceneError> {
    for term in terms {
        let width = term.quantity.width(joints);
        if !matches!(term.scale.len(), 0 | 1) && term.scale.len() != width {
            let what = format!(
                "scales {} by {} numbers; give one or {width}",
                term.quantity.name(),
                term.scale.len()
            );
            return refuse("policy.observation", what);
        }
        if term.quantity == Quantity::GaitPhase && clock.is_none() {
            return refuse(
                "policy.gait_frequency",
                "is missing, and the policy observes gait_phase".to_owned(),
            );
        }
    }
    Ok(())
}

/// Shortest control period, s: replays and gaits take some seconds of them.
const MIN_CONTROL_DT: f64 = 1e-3;

fn check(settings: &TaskSettings) -> Result<(), SceneError> {
    let positive = [
        ("episode_seconds", settings.episode_seconds, 1e4),
        ("control_dt", settings.control_dt, 1.0),
        ("tracking_width", settings.tracking_width, 1e3),
        ("yaw_tracking_width", settings.yaw_tracking_width, 1e3),
        ("swing_height", settings.swing_height, 1e3),
        ("swing_seconds", settings.swing_seconds, 1e3),
        ("command.seconds", settings.command.seconds, 1e4),
        ("policy.action_scale", settings.policy.action_scale, 1e3),
        ("policy.kp", settings.policy.kp, 1e5),
        ("fall.tilt", settings.fall.tilt, 180.0),
    ];
    for (setting, value, most) in positive {
        if !(value > 0.0 && value <= most) {
            return refuse(setting, format!("is {value}; it must be above 0 and at most {most}"));
        }
    }
    if settings.control_dt < MIN_CONTROL_DT {
        return refuse(
            "control_dt",
            format!("is {} s; it must be at least {MIN_CONTROL_DT} s", settings.control_dt),
        );
    }
    let ranges = [
        ("noise.base_angular_velocity", settings.noise.base_angular_velocity),
        ("noise.projected_gravity", settings.noise.projected_gravity),
        ("noise.joint_position", settings.noise.joint_position),
        ("noise.joint_velocity", settings.noise.joint_velocity),
        ("start.joint_position", settings.start.joint_position),
        ("start.joint_velocity", settings.start.joint_velocity),
        ("start.linear_velocity", settings.start.linear_velocity),
        ("start.angular_velocity", settings.start.angular_velocity),
        ("start.tilt", settings.start.tilt),
        ("start.yaw", settings.start.yaw),
        ("height", settings.height),
        ("push.seconds", settings.push.seconds),
        ("push.velocity", settings.push.velocity),
        ("randomisation.base_com", settings.randomisation.base_com),
        ("policy.kd", settings.policy.kd),
    ];
    for (setting, value) in ranges {
        if !(0.0..=1e4).contains(&value) {
            return refuse(setting, format!("is {value}; it must be from 0 to 10000"));
        }
    }
    for (setting, value) in [("start.pitch", settings.start.pitch), ("fall.height", settings.fall.height)] {
        if !(-1e4..=1e4).contains(&value) {
            return refuse(setting, format!("is {value}; it must be from -10000 to 10000"));
        }
    }
    let r = &settings.randomisation;
    let c = &settings.command;
    let intervals = [
        ("command.x", c.x, -100.0),
        ("command.y", c.y, -100.0),
        ("command.yaw", c.yaw, -100.0),
        ("randomisation.base_mass", r.base_mass, -1e4),
        ("randomisation.kp", r.kp, 0.0),
        ("randomisation.kd", r.kd, 0.0),
        ("randomisation.floor_friction", r.floor_friction, 1e-3),
        ("randomisation.frictionloss", r.frictionloss, 0.0),
        ("randomisation.armature", r.armature, 0.0),
    ];
    for (setting, [low, high], least) in intervals {
        if !(low >= least && low <= high && high <= 1e4) {
            return refuse(
                setting,
                format!("is [{low}, {high}]; it must be [smallest, largest], {least} or more"),
            );
        }
    }
    if !(0.0..=1.0).contains(&c.standing) {
        return refuse("command.standing", format!("is {}; it must be from 0 to 1", c.standing));
    }
    let norm = settings.posture.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > 1e-3 || norm.is_nan() {
        return refuse("posture", "is not a direction of length 1".to_owned());
    }
    if settings.feet.is_empty() || settings.feet.len() > MAX_FEET {
        return refuse("feet", format!("has {} names; give 1 to {MAX_FEET}", settings.feet.len()));
    }
    Ok(())
}
