//! A task on a robot: names resolved to indices once, shared by all environments.

use gaitfit_model::{Model, patterns};
use gaitfit_physics::{Params, Preset, Robot};
use gaitfit_policy::Interface;
use gaitfit_policy::walker::{Walker, WalkerOptions};
use gaitfit_sim::Candidate;

use super::check::{check, check_terms};
use super::error::refuse;
use super::randomise::randomised;
use super::{JointTable, Moment, TaskError, TaskSettings, reward};

/// Value of a reward term at a robot's moment.
pub(super) type Value = Box<dyn Fn(&Moment<'_>) -> f32 + Send + Sync>;

/// A reward term of a task.
pub(super) struct WeightedTerm {
    pub(super) name: String,
    /// Weight times the control step.
    pub(super) weight: f32,
    pub(super) value: Value,
}

/// A task on a robot: commands, rewards, randomisation, noise and episodes. Joint vectors are in the model's order.
pub struct Task {
    /// The task's settings.
    pub settings: TaskSettings,
    /// The policy's side and the simulator.
    pub walker: Walker,
    /// Pose an episode starts in, rad.
    pub start_pose: Vec<f32>,
    /// Gait group of each foot; `None` for feet that stay out of the gait.
    pub gait_group: Vec<Option<usize>>,
    /// Place of each foot in `Motion::normal_force`.
    pub(super) foot_geoms: Vec<usize>,
    /// Places of geoms that are neither feet nor end an episode by touching the ground.
    pub(super) body_geoms: Vec<usize>,
    /// Terms of non-zero weight.
    pub(super) rewards: Vec<WeightedTerm>,
}

/// Values of a table by joint, where a pattern matches.
fn by_joint(model: &Model, table: &JointTable, setting: &str) -> Result<Vec<Option<f64>>, TaskError> {
    let joints: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
    patterns::table(table, &model.name, &joints)
        .or_else(|error| refuse(setting, format!("is wrong: {error}")))
}

impl Task {
    /// The task on `model` with a new policy's interface.
    ///
    /// # Errors
    /// Whatever does not fit, by setting.
    pub fn new(model: &Model, settings: &TaskSettings, preset: Preset) -> Result<Self, TaskError> {
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
        check(settings)?;
        check_terms(&interface)?;
        interface.check().map_err(TaskError::Policy)?;
        Self::with_interface(model, settings, interface, preset, 0.0)
    }

    /// The task on `model` for a policy that exists. `max_delay`: largest actuation delay of any robot, s, without what
    /// randomisation adds.
    ///
    /// # Errors
    /// Whatever does not fit, by setting; a policy for another robot.
    pub fn with_interface(
        model: &Model,
        settings: &TaskSettings,
        interface: Interface,
        preset: Preset,
        max_delay: f64,
    ) -> Result<Self, TaskError> {
        check(settings)?;
        check_terms(&interface)?;
        let control_dt = interface.control_dt;
        let options = WalkerOptions {
            substeps: settings.substeps,
            preset,
            emulated_step: settings.robot_timestep,
            max_delay: max_delay + settings.randomisation.delay[1],
            tracked: settings.feet.clone(),
            posture: settings.posture,
            start_pitch: settings.start.pitch,
            fall: settings.fall.clone(),
        };
        let walker = Walker::new(model, interface, options)?;
        let contacts = walker.batch.contact_geoms();
        let name = |place: usize| model.geoms[contacts[place]].name.as_str();
        let places = || 0..contacts.len();
        let mut foot_geoms = Vec::with_capacity(settings.feet.len());
        for foot in &settings.feet {
            foot_geoms.extend(places().find(|&place| name(place) == foot));
        }
        let fall_geoms = walker.fall_geoms();
        let rest = |place: &usize| !foot_geoms.contains(place) && !fall_geoms.contains(place);
        let body_geoms = places().filter(rest).collect();
        let start = by_joint(model, &settings.start.pose, "start.pose")?;
        let start_pose = start
            .iter()
            .zip(&walker.default_pose)
            .map(|(angle, &home)| angle.map_or(home, |a| a as f32))
            .collect();
        Ok(Self {
            settings: settings.clone(),
            walker,
            start_pose,
            gait_group: gait_groups(settings)?,
            foot_geoms,
            body_geoms,
            rewards: rewards(settings, control_dt)?,
        })
    }

    /// The task with one more reward term: a step pays `weight · value(moment) · control_dt`. It stands after the
    /// terms of the settings, which it does not change: a policy file's task does not name it.
    ///
    /// # Errors
    /// A name that is taken, a weight that is not finite.
    pub fn with_term(
        mut self,
        name: &str,
        weight: f64,
        value: impl Fn(&Moment<'_>) -> f32 + Send + Sync + 'static,
    ) -> Result<Self, TaskError> {
        let known = reward::TERMS.iter().map(|term| term.name);
        if known.chain(self.rewards.iter().map(|term| term.name.as_str())).any(|other| other == name) {
            return refuse("rewards", format!("has a term `{name}` already; give the new one another name"));
        }
        if !weight.is_finite() {
            return refuse("rewards", format!("gives `{name}` the weight {weight}"));
        }
        let weight = (weight * self.walker.interface.control_dt) as f32;
        self.rewards.push(WeightedTerm { name: name.to_owned(), weight, value: Box::new(value) });
        Ok(self)
    }

    /// Reward terms of non-zero weight, by name; own terms after those of the settings.
    pub fn reward_names(&self) -> Vec<&str> {
        self.rewards.iter().map(|term| term.name.as_str()).collect()
    }

    /// Reward terms of non-zero weight with what a step of value 1 pays, in [`Task::reward_names`] order.
    pub fn reward_weights(&self) -> impl Iterator<Item = (&str, f32)> {
        self.rewards.iter().map(|term| (term.name.as_str(), term.weight))
    }

    /// Place of each foot in `Motion::normal_force`.
    pub fn foot_geoms(&self) -> &[usize] {
        &self.foot_geoms
    }

    /// Places of geoms that are neither feet nor end an episode by touching the ground.
    pub fn body_geoms(&self) -> &[usize] {
        &self.body_geoms
    }

    /// The robots of environments `first..first + count` with the policy's gains: environment number `e` is candidate
    /// number `e` modulo their count, varied.
    ///
    /// # Errors
    /// A randomisation that leaves no robot.
    pub fn robots(
        &self,
        candidates: &[Candidate],
        seed: u64,
        first: u32,
        count: usize,
    ) -> Result<Vec<Params<f64>>, TaskError> {
        let bases: Vec<Robot> = candidates.iter().map(|candidate| self.walker.robot(candidate)).collect();
        (first..first + count as u32)
            .map(|environment| {
                let Some(base) = bases.get(environment as usize % bases.len().max(1)) else {
                    return refuse("robots", "are none".to_owned());
                };
                let (model, ranges) = (self.walker.model(), &self.settings.randomisation);
                Ok(randomised(model, base, ranges, seed, environment)?)
            })
            .collect()
    }

    /// Control periods in an episode.
    pub fn episode_steps(&self) -> u32 {
        (self.settings.episode_seconds / self.walker.interface.control_dt).round().max(1.0) as u32
    }

    /// Control periods between commands.
    pub fn command_steps(&self) -> u32 {
        (self.settings.command.seconds / self.walker.interface.control_dt).round().max(1.0) as u32
    }
}

/// Gait group of each foot.
fn gait_groups(settings: &TaskSettings) -> Result<Vec<Option<usize>>, TaskError> {
    let mut groups = vec![None; settings.feet.len()];
    for (group, names) in settings.gait.iter().enumerate() {
        for wanted in names {
            match settings.feet.iter().position(|foot| foot == wanted) {
                Some(foot) => groups[foot] = Some(group),
                None => return refuse("gait", format!("names `{wanted}`, which is not in task.feet")),
            }
        }
    }
    Ok(groups)
}

/// The settings' reward terms of non-zero weight.
fn rewards(settings: &TaskSettings, control_dt: f64) -> Result<Vec<WeightedTerm>, TaskError> {
    let mut rewards = Vec::new();
    for (name, &weight) in &settings.rewards {
        let Some(term) = reward::TERMS.iter().find(|term| term.name == name) else {
            let known: Vec<_> = reward::TERMS.iter().map(|term| term.name).collect();
            return refuse("rewards", format!("has `{name}`; known terms: {}", known.join(", ")));
        };
        if !weight.is_finite() {
            return refuse("rewards", format!("gives `{name}` the weight {weight}"));
        }
        if weight != 0.0 {
            let weight = (weight * control_dt) as f32;
            rewards.push(WeightedTerm { name: name.clone(), weight, value: Box::new(term.value) });
        }
    }
    Ok(rewards)
}
