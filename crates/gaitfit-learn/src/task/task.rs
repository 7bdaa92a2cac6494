//! A task on a robot: names resolved to indices once, shared by all environments.

use gaitfit_model::{Ground, Model, Shape, patterns, shown, shown_number};
use gaitfit_physics::{Params, PhysicsError, Preset, Robot};
use gaitfit_policy::observation::Sensed;
use gaitfit_policy::walker::{FootGeoms, Walker, WalkerOptions};
use gaitfit_policy::{ActionClip, Held, Interface, Quantity, Term};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::{Candidate, Start, pool};

use super::check::{check, check_gravity, check_pose, check_terms};
use super::error::refuse;
use super::joint_number::by_joint;
use super::randomise::{randomised, varies};
use super::reward::{self, Rewards, Value, WeightedTerm};
use super::{Course, JointNumber, Moment, TaskError, TaskSettings, TerrainSettings, UserTerms};

/// Robots that one thread computes at a time: 2 ms, far more than it takes to start the thread.
const LOT: usize = 64;

/// A task on a robot: commands, rewards, randomisation, noise and episodes. Joint vectors are in the model's order.
pub struct Task {
    /// The task's settings.
    pub settings: TaskSettings,
    /// The policy's side and the simulator.
    pub walker: Walker,
    /// Parts of the settings that the simulation leaves out, in words.
    pub remarks: Vec<String>,
    /// Pose an episode starts in, rad.
    pub start_pose: Vec<f32>,
    /// The cells of generated ground.
    pub course: Option<Course>,
    /// Gait group of each foot; `None` for feet that stay out of the gait.
    pub gait_group: Vec<Option<usize>>,
    /// Places of geoms that are neither feet nor end an episode by touching the ground.
    pub(super) body_geoms: Vec<usize>,
    /// Terms of non-zero weight.
    pub(super) rewards: Rewards,
    /// A function of the caller that changes rewards and ends of episodes, in trainings on the CPU.
    pub user_terms: Option<UserTerms>,
}

impl Task {
    /// The task on `model` with a new policy's interface.
    ///
    /// # Errors
    /// The first setting that does not fit, by name.
    pub fn new(model: &Model, settings: &TaskSettings, preset: Preset) -> Result<Self, TaskError> {
        let policy = &settings.policy;
        check(settings)?;
        let pose = by_joint(model, &policy.default_pose, "policy.default_pose")?;
        // Joints that follow others take their angles from the stated ones.
        let stated: Vec<usize> = (0..pose.len()).filter(|&joint| pose[joint].is_some()).collect();
        let mut pose: Vec<f64> = pose.iter().map(|angle| angle.unwrap_or(0.0)).collect();
        model.couple_others(&mut pose, &stated);
        check_pose(model, &pose)?;
        let name = |&joint: &usize| model.joints[joint].name.clone();
        let moved = moved(model, &policy.joints)?;
        // Gains are read for all joints: those that the policy does not move are held by them.
        let joints: Vec<usize> = (0..model.joints.len()).collect();
        let kp = policy.kp.of_joints(model, &joints, "policy.kp")?;
        let kd = policy.kd.of_joints(model, &joints, "policy.kd")?;
        let clip = match &policy.action_clip {
            None => None,
            Some(JointNumber::All(clip)) => Some(ActionClip::All(*clip)),
            Some(clip) => Some(ActionClip::Each(clip.of_joints(model, &moved, "policy.action_clip")?)),
        };
        let velocities = velocity_joints(model, &policy.velocity_joints, &moved)?;
        // A wheel's angle grows without end, so the policy must not see it.
        let unseen: Vec<bool> = moved.iter().map(|joint| velocities.contains(joint)).collect();
        let seen = |terms: &[Term]| terms.iter().map(|term| without_angles(term, &unseen)).collect();
        // Joints that the policy does not move hold the default pose, except those that a coupling moves.
        let held = joints.iter().filter(|joint| !moved.contains(joint) && !model.only_follows(**joint));
        let held = held.map(|&joint| Held {
            joint: name(&joint),
            position: pose[joint],
            kp: kp[joint],
            kd: kd[joint],
        });
        let interface = Interface {
            robot: model.name.clone(),
            joints: moved.iter().map(name).collect(),
            default_pose: moved.iter().map(|&joint| pose[joint]).collect(),
            action_scale: policy.action_scale.of_joints(model, &moved, "policy.action_scale")?,
            action_clip: clip,
            kp: moved.iter().map(|&joint| kp[joint]).collect(),
            kd: moved.iter().map(|&joint| kd[joint]).collect(),
            velocity_joints: velocities.iter().map(name).collect(),
            held: held.collect(),
            control_dt: settings.control_dt,
            gait_frequency: policy.gait_frequency,
            reference: None,
            history: policy.history,
            observation: seen(&policy.observation),
            critic_observation: seen(&policy.critic_observation),
        };
        check_terms(&interface)?;
        interface.check().map_err(TaskError::Policy)?;
        Self::with_interface(model, settings, interface, preset, 0.0)
    }

    /// The task on `model` for a policy that exists. `max_delay`: largest actuation delay of any robot, s, without what
    /// randomisation adds.
    ///
    /// # Errors
    /// The first setting that does not fit, by name; a policy for another robot.
    pub fn with_interface(
        model: &Model,
        settings: &TaskSettings,
        interface: Interface,
        preset: Preset,
        max_delay: f64,
    ) -> Result<Self, TaskError> {
        check(settings)?;
        check_terms(&interface)?;
        check_gravity(model)?;
        let options = WalkerOptions {
            substeps: settings.substeps,
            preset,
            emulated_step: settings.robot_timestep,
            // Random delays come on top of the robot's own.
            max_delay: max_delay + settings.randomisation.delay[1],
            feet: settings.feet.clone(),
            posture: settings.posture,
            start_pitch: settings.start.pitch,
            fall: settings.fall.clone(),
        };
        // The ground replaces the file's planes before the model is compiled for the simulator.
        let (course, uneven) = match &settings.terrain {
            Some(terrain) => Some(on_terrain(model, settings, terrain)?).unzip(),
            None => (None, None),
        };
        let mut model = uneven.unwrap_or_else(|| model.clone());
        let mut remarks = Vec::new();
        // Contacts between the robot's own parts count only where the settings ask for them.
        if !settings.self_contact.is_off() {
            (model, remarks) = model.touching_itself(&settings.self_contact)?;
        }
        let model = &model;
        let walker = Walker::new(model, interface, options)?;
        let contacts = walker.batch.contact_geoms();
        let fall_geoms = walker.fall_geoms();
        let of_foot = |place: &usize| walker.feet.iter().any(|foot| foot.geoms.contains(place));
        // Rewards count these contacts: feet are meant to touch, and a touch of the others ends the episode.
        let rest = |place: &usize| !of_foot(place) && !fall_geoms.contains(place);
        let body_geoms = (0..contacts.len()).filter(rest).collect();
        let start = by_joint(model, &settings.start.pose, "start.pose")?;
        let start_pose = start.iter().zip(start_angles(&walker));
        let mut start_pose: Vec<f64> =
            start_pose.map(|(angle, home)| angle.unwrap_or(f64::from(home))).collect();
        // Also against a pattern that covers a joint that follows: the start would begin with a pull.
        model.couple(&mut start_pose);
        let start_pose = start_pose.into_iter().map(|angle| angle as f32).collect();
        let mut settings = settings.clone();
        if walker.interface.reference.is_some() && !walker.interface.observes_command() {
            // Nothing would follow them.
            let command = &mut settings.command;
            (command.x, command.y, command.yaw) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        }
        let settings = &settings;
        Ok(Self {
            settings: settings.clone(),
            rewards: Rewards::new(reward::listed(settings, &walker)?),
            walker,
            remarks,
            start_pose,
            course,
            gait_group: gait_groups(settings)?,
            body_geoms,
            user_terms: None,
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
        let known = known.chain(self.settings.terms.keys().map(String::as_str));
        if known.chain(self.rewards.terms().iter().map(|term| term.name.as_str())).any(|other| other == name)
        {
            return refuse("rewards", format!("has a term `{name}` already; give the new one another name"));
        }
        if !weight.is_finite() {
            return refuse("rewards", format!("gives `{name}` the weight {weight}"));
        }
        // A step pays for its time, so that sums do not depend on the control period.
        let weight = (weight * self.walker.interface.control_dt) as f32;
        self.rewards.push(WeightedTerm { name: name.to_owned(), weight, value: Value::Own(Box::new(value)) });
        Ok(self)
    }

    /// Reward terms of non-zero weight, by name; own terms after those of the settings.
    pub fn reward_names(&self) -> Vec<&str> {
        self.rewards.terms().iter().map(|term| term.name.as_str()).collect()
    }

    /// Reward terms of non-zero weight with what a step of value 1 pays, in [`Task::reward_names`] order.
    pub fn reward_weights(&self) -> impl Iterator<Item = (&str, f32)> {
        self.rewards.terms().iter().map(|term| (term.name.as_str(), term.weight))
    }

    /// Reward terms of non-zero weight with what gives them their value, in [`Task::reward_names`] order.
    pub fn reward_values(&self) -> impl Iterator<Item = (&str, &Value)> {
        self.rewards.terms().iter().map(|term| (term.name.as_str(), &term.value))
    }

    /// Places of each foot's geoms in `Motion::normal_force`.
    pub fn foot_geoms(&self) -> &[FootGeoms] {
        &self.walker.feet
    }

    /// Places of geoms that are neither feet nor end an episode by touching the ground.
    pub fn body_geoms(&self) -> &[usize] {
        &self.body_geoms
    }

    /// The robots of environments `first..first + count` with the policy's gains: environment number `e` is candidate
    /// number `e` modulo their count, varied. All cores compute them, unless the calling thread's work is limited to fewer
    /// ([`pool`]).
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
        if bases.is_empty() {
            return refuse("robots", "are none".to_owned());
        }
        let (model, ranges) = (self.walker.model(), &self.settings.randomisation);
        // Without randomisation a few robots are computed and the others are copies: each takes 30 µs.
        let different = if varies(ranges) { count } else { count.min(bases.len()) };
        let robot = |environment: u32| {
            let base = &bases[environment as usize % bases.len()];
            randomised(model, base, ranges, seed, environment)
        };
        let lot = |number: usize| -> Vec<Result<Params<f64>, PhysicsError>> {
            let from = number * LOT;
            (from..different.min(from + LOT)).map(|index| robot(first + index as u32)).collect()
        };
        let lots = pool::map(different.div_ceil(LOT), pool::threads(), lot);
        let robots: Vec<Params<f64>> = lots.into_iter().flatten().collect::<Result<_, _>>()?;
        // The few robots are repeated in the order of the environments, which is modulo their count.
        if different == count {
            return Ok(robots);
        }
        Ok(robots.iter().cycle().take(count).cloned().collect())
    }

    /// Control periods in an episode.
    pub fn episode_steps(&self) -> u32 {
        (self.settings.episode_seconds / self.walker.interface.control_dt).round().max(1.0) as u32
    }

    /// Angle by which a motion that the policy follows is turned for an episode with this start, rad.
    pub(super) fn turned(&self, start: &Start) -> f32 {
        if self.walker.interface.reference.is_none() {
            return 0.0;
        }
        let mut sensed = Sensed::new(self.walker.joints.len());
        self.walker.sense_state(start, &mut sensed);
        self.walker.observation.motion_heading(&sensed) as f32
    }

    /// Age in steps at which the first episode of an environment begins where ages are spread evenly.
    pub fn staggered_age(&self, seed: u64, environment: u32) -> u32 {
        let stream = Stream::new(seed, Purpose::RESET).environment(environment);
        // Draws of starts are far below this number.
        (stream.uniform(1 << 16) * f64::from(self.episode_steps())) as u32
    }

    /// Control periods between commands.
    pub fn command_steps(&self) -> u32 {
        (self.settings.command.seconds / self.walker.interface.control_dt).round().max(1.0) as u32
    }
}

/// The robot on the ground that `terrain` describes, and its cells.
fn on_terrain(
    model: &Model,
    settings: &TaskSettings,
    terrain: &TerrainSettings,
) -> Result<(Course, Model), TaskError> {
    // Cells would overlap the file's own boxes and fields.
    if let Some(obstacle) = model.obstacles.first() {
        let what = format!(
            "makes ground, and the robot file has its own (`{}`); leave out one of them",
            shown(&obstacle.name)
        );
        return refuse("terrain", what);
    }
    let (course, field) = Course::new(terrain)?;
    // Only pairs with a plane: the field takes the planes' place.
    for pair in model.pairs.iter().filter(|pair| matches!(pair.ground, Ground::Plane(_))) {
        let geom = &model.geoms[pair.geom];
        // Settings name a foot by its geom or by its body.
        let of_body = |foot: &String| *foot == geom.name || *foot == model.bodies[geom.body].name;
        if !settings.feet.iter().any(of_body) {
            continue;
        }
        let (foot, shape) = (shown(&geom.name), geom.shape.name());
        match geom.shape {
            Shape::Sphere { radius } | Shape::Capsule { radius, .. } if 2.0 * radius > terrain.cell => {
                let what = format!(
                    "is {} m, and the foot `{foot}` has a radius of {radius} m; it must be at least twice the radius",
                    shown_number(terrain.cell)
                );
                return refuse("terrain.cell", what);
            }
            Shape::Sphere { .. } | Shape::Capsule { .. } => {}
            _ => {
                let what = format!(
                    "makes uneven ground, and the foot `{foot}` is a {shape}: only spheres and the ends of capsules touch \
                     it. Put spheres in the foot's corners in the robot file, or leave [terrain] out"
                );
                return refuse("terrain", what);
            }
        }
    }
    let uneven = model.on_field("terrain", field);
    Ok((course, uneven))
}

/// Joint angles at the beginning of an episode, rad, model order, if the settings do not state them. They are those at the
/// beginning of the motion. A policy without a motion begins in its default pose.
fn start_angles(walker: &Walker) -> Vec<f32> {
    let mut pose = walker.default_pose.clone();
    let in_motion = walker.observation.motion_position(0.0).unwrap_or_default();
    for (&joint, angle) in walker.joints.iter().zip(in_motion) {
        pose[joint] = angle;
    }
    pose
}

/// The joints that the policy moves, by index in the model: those that a pattern covers, or all.
fn moved(model: &Model, wanted: &[String]) -> Result<Vec<usize>, TaskError> {
    if wanted.is_empty() {
        return Ok((0..model.joints.len()).collect());
    }
    let joints: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
    patterns::covered(wanted, &model.name, &joints)
        .or_else(|error| refuse("policy.joints", format!("is wrong: {error}")))
}

/// The joints with velocity targets, by index in the model; `moved`: those that the policy moves.
fn velocity_joints(model: &Model, wanted: &[String], moved: &[usize]) -> Result<Vec<usize>, TaskError> {
    if wanted.is_empty() {
        return Ok(Vec::new());
    }
    let names: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
    let joints = patterns::covered(wanted, &model.name, &names)
        .or_else(|error| refuse("policy.velocity_joints", format!("is wrong: {error}")))?;
    match joints.iter().find(|joint| !moved.contains(joint)) {
        Some(&joint) => {
            let what = format!(
                "covers `{}`, which the policy does not move; add it to policy.joints",
                shown(&model.joints[joint].name)
            );
            refuse("policy.velocity_joints", what)
        }
        None => Ok(joints),
    }
}

/// A term of an observation without the angles of joints that turn without end: their factor is 0.
fn without_angles(term: &Term, unseen: &[bool]) -> Term {
    let mut term = term.clone();
    if term.quantity == Quantity::JointPosition && unseen.contains(&true) {
        let factor = |joint: usize| match term.scale[..] {
            [] => 1.0,
            [one] => one,
            _ => term.scale.get(joint).copied().unwrap_or(1.0),
        };
        let factors =
            unseen.iter().enumerate().map(|(joint, &unseen)| if unseen { 0.0 } else { factor(joint) });
        term.scale = factors.collect();
    }
    term
}

/// Gait group of each foot.
fn gait_groups(settings: &TaskSettings) -> Result<Vec<Option<usize>>, TaskError> {
    let mut groups = vec![None; settings.feet.len()];
    for (group, names) in settings.gait.iter().enumerate() {
        for wanted in names {
            match settings.feet.iter().position(|foot| foot == wanted) {
                Some(foot) if groups[foot].is_some() => {
                    return refuse(
                        "gait",
                        format!("names `{}` twice; a foot is in one group", shown(wanted)),
                    );
                }
                Some(foot) => groups[foot] = Some(group),
                None => {
                    let feet: Vec<String> = settings.feet.iter().map(|foot| shown(foot)).collect();
                    let what =
                        format!("names `{}`, which is not in task.feet ({})", shown(wanted), feet.join(", "));
                    return refuse("gait", what);
                }
            }
        }
    }
    Ok(groups)
}
