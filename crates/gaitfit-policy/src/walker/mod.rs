//! A policy on a robot: its interface resolved on a model, in the simulator.

mod error;
mod fall;
mod feet;
mod noise;
mod start;

use gaitfit_model::rotation::{quat_of, vec_of};
use gaitfit_model::{Model, Root, Surface};
use gaitfit_physics::{Preset, Robot};
use gaitfit_sim::{Batch, BatchOptions, Candidate, Cpu, Engine, Imu, Motion, Start};

use crate::observation::{Layout, Sensed};
use crate::pilot::{clock, target};
use crate::{Interface, frames};
use fall::Fall;

pub use error::WalkerError;
pub use fall::{FallSettings, TOUCH, touching};
pub use feet::FootGeoms;
pub use noise::TorqueNoise;
pub use start::{GAP, standing, standing_on};

/// Settings of a policy's robot: how it is simulated, and when it counts as fallen.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkerOptions {
    /// Physics steps between actions.
    pub substeps: usize,
    /// Solver effort.
    pub preset: Preset,
    /// Physics step of the robot that the simulation stands for, s; see [`BatchOptions::emulated_step`].
    pub emulated_step: Option<f64>,
    /// Largest actuation delay of any robot, s.
    pub max_delay: f64,
    /// The feet: names of geoms, or of bodies, which stand for all their geoms.
    pub feet: Vec<String>,
    /// Direction of gravity in the body frame in the wanted posture, unit: (0, 0, −1) on four legs.
    pub posture: [f64; 3],
    /// Pitch of the base in which the robot starts, degrees; −90 is nose up.
    pub start_pitch: f64,
    /// When the robot counts as fallen.
    pub fall: FallSettings,
}

/// A policy's interface on a robot in the simulator: names resolved once, shared by all environments. Joint vectors
/// are in the model's order unless they say otherwise.
pub struct Walker {
    /// What the policy sees and does.
    pub interface: Interface,
    /// The robot in the simulator.
    pub batch: Batch,
    /// What simulates it: by default this machine's processor.
    pub engine: Box<dyn Engine>,
    /// For each of the policy's joints, its index in the model.
    pub joints: Vec<usize>,
    /// Pose at action zero, rad.
    pub default_pose: Vec<f32>,
    /// Target change per unit action, rad.
    pub action_scale: Vec<f32>,
    /// Largest action magnitude, before scaling; policy order.
    pub action_clip: Vec<f32>,
    /// The model's joints that the policy does not move, by index: held at their default pose, or limp.
    pub other_joints: Vec<usize>,
    /// The feet, as the options name them; their centres are [`Motion::tracked`].
    pub feet: Vec<FootGeoms>,
    /// Rows of the actor's observation.
    pub observation: Layout,
    /// Rows of the critic's observation.
    pub critic_observation: Layout,
    /// For each of the interface's held joints, its index in the model.
    held: Vec<usize>,
    start_pitch: f64,
    fall: Fall,
    /// Heights of the ground; none where it is flat.
    ground: Option<Surface>,
}

impl Walker {
    /// `interface` on `model`.
    ///
    /// # Errors
    /// An interface that contradicts itself or is for another robot, a clamped robot, options out of range, patterns
    /// that match nothing.
    pub fn new(model: &Model, interface: Interface, options: WalkerOptions) -> Result<Self, WalkerError> {
        if model.root != Root::Floating {
            return Err(WalkerError::Clamped { robot: model.name.clone() });
        }
        interface.check()?;
        let joints = interface.resolve(model)?;
        if let Some(reference) = &interface.reference {
            reference.check_anchor(model, &interface.joints, &joints)?;
        }
        let mut velocities = joints.clone();
        let mut kinds = interface.velocity_targets().into_iter();
        // One flag for each of the policy's joints, in their order.
        velocities.retain(|_| kinds.next().unwrap_or(false));
        let model = &model.with_velocity_targets(&velocities);
        let WalkerOptions { substeps, preset, emulated_step, max_delay, feet, posture, start_pitch, fall } =
            options;
        let control_dt = interface.control_dt;
        // First by geoms, because the batch reports the centre of each foot's main one; their places among
        // the contacts follow from the batch.
        let feet = feet::named(model, &feet)?;
        let tracked = feet.iter().map(|foot| model.geoms[foot.main].name.clone()).collect();
        let batch = Batch::new(
            model,
            BatchOptions { control_dt, substeps, preset, emulated_step, max_delay, tracked, isa: None },
        )?;
        let fall = Fall::new(&batch, &fall, posture)?;
        let feet = feet.iter().map(|foot| foot.places(&batch)).collect();
        let default_pose = interface.model_pose(model)?.into_iter().map(|angle| angle as f32).collect();
        // Joints that the policy does not move keep a scale of 0.
        let mut action_scale = vec![0.0; model.joints.len()];
        for (index, &joint) in joints.iter().enumerate() {
            action_scale[joint] = interface.action_scale[index] as f32;
        }
        let clip = |index| interface.clip(index).min(f64::from(f32::MAX)) as f32;
        let action_clip = (0..joints.len()).map(clip).collect();
        let other_joints = (0..model.joints.len()).filter(|joint| !joints.contains(joint)).collect();
        let held = interface.resolve_held(model, &joints)?;
        let ground = Surface::new(model).map_err(|leaning| WalkerError::Option {
            option: "the ground",
            what: format!("is wrong: {leaning}"),
        })?;
        Ok(Self {
            observation: Layout::new(&interface, &interface.observation),
            critic_observation: Layout::new(&interface, &interface.critic_observation),
            interface,
            batch,
            // Its threads are for replays; a tile is advanced by the thread that calls it.
            engine: Box::new(Cpu { threads: 1 }),
            joints,
            default_pose,
            action_scale,
            action_clip,
            other_joints,
            feet,
            held,
            start_pitch,
            fall,
            ground,
        })
    }

    /// Whether actor or critic observe past frames.
    pub fn sees_past(&self) -> bool {
        self.observation.frames() > 1 || self.critic_observation.frames() > 1
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        self.batch.model()
    }

    /// Physics step, s.
    pub fn physics_step(&self) -> f64 {
        self.interface.control_dt / self.batch.options().substeps as f64
    }

    /// The robot of a candidate with the policy's gains.
    pub fn robot(&self, candidate: &Candidate) -> Robot {
        let joints = self.default_pose.len();
        // Joints that are neither moved nor held keep gains of 0: they are limp.
        let (mut kp, mut kd) = (vec![0.0; joints], vec![0.0; joints]);
        for (index, &joint) in self.joints.iter().enumerate() {
            kp[joint] = self.interface.kp[index];
            kd[joint] = self.interface.kd[index];
        }
        for (held, &joint) in self.interface.held.iter().zip(&self.held) {
            (kp[joint], kd[joint]) = (held.kp, held.kd);
        }
        candidate.robot(&kp, &kd)
    }

    /// Targets (rad; rad/s for joints with velocity targets; model order) of `actions` (policy order); one row an environment in both.
    pub fn targets(&self, actions: &[f32], targets: &mut [f32]) {
        let rows = targets.chunks_exact_mut(self.default_pose.len());
        for (row, actions) in rows.zip(actions.chunks_exact(self.joints.len())) {
            for ((&joint, &action), &clip) in self.joints.iter().zip(actions).zip(&self.action_clip) {
                row[joint] = target(self.default_pose[joint], self.action_scale[joint], clip, action);
            }
            // Limp joints get a target too, but without gains it makes no torque.
            for &joint in &self.other_joints {
                row[joint] = self.default_pose[joint];
            }
        }
    }

    /// Phase of the gait clock, 0 to 1, `steps` control periods after an episode's start; 0 without a clock.
    pub fn clock(&self, steps: u32) -> f32 {
        clock(&self.interface, steps)
    }

    /// The readings of the sensors of environment `index` of `motion`, with their errors: base and joints; the base by `imu`
    /// if it has errors. Command, last action and clock of `sensed` stay as they are. The linear velocity is the base's
    /// own: no sensor measures it.
    ///
    /// # Panics
    /// If `motion` has no such environment, or `sensed` is of another number of joints: errors of the caller.
    pub fn sense(&self, motion: &Motion, index: usize, imu: Option<&Imu>, sensed: &mut Sensed) {
        self.sense_motion(motion, index, motion.velocity_readings(), sensed);
        // `sense_motion` has put in the present state; a late unit shows an older one.
        if motion.late_imu.is_some() {
            let (attitude, rates) = motion.imu_reading(index);
            sensed.orient(attitude);
            sensed.base_angular_velocity = rates;
        }
        // Errors of the unit come on top of its lateness.
        if let Some(imu) = imu {
            sensed.base_angular_velocity = imu.rates(sensed.base_angular_velocity);
            sensed.projected_gravity = imu.direction(sensed.projected_gravity);
            sensed.orientation = imu.attitude(sensed.orientation);
        }
    }

    /// As [`Walker::sense`], without errors of sensors except encoder biases, as a critic observes them.
    ///
    /// # Panics
    /// As [`Walker::sense`].
    pub fn sense_without_errors(&self, motion: &Motion, index: usize, sensed: &mut Sensed) {
        // The plain velocities and not the filtered readings: a critic may see what no sensor shows.
        self.sense_motion(motion, index, &motion.joint_velocity, sensed);
    }

    fn sense_motion(&self, motion: &Motion, index: usize, velocities: &[f32], sensed: &mut Sensed) {
        let joints = self.default_pose.len();
        let row = joints * index..joints * (index + 1);
        self.sense_parts(
            vec_of(&motion.base_position[3 * index..]),
            quat_of(&motion.base_quaternion[4 * index..]),
            vec_of(&motion.base_linear[3 * index..]),
            vec_of(&motion.base_angular[3 * index..]),
            &motion.joint_position[row.clone()],
            &velocities[row],
            sensed,
        );
    }

    /// As [`Walker::sense`], of a robot whose sensors read `state`.
    ///
    /// # Panics
    /// If `state` or `sensed` is of another number of joints: an error of the caller.
    pub fn sense_state(&self, state: &Start, sensed: &mut Sensed) {
        self.sense_parts(
            state.base_position,
            state.base_quaternion,
            state.base_linear,
            state.base_angular,
            &state.joint_position,
            &state.joint_velocity,
            sensed,
        );
    }

    fn sense_parts(
        &self,
        place: [f32; 3],
        quaternion: [f32; 4],
        linear: [f32; 3],
        angular: [f32; 3],
        position: &[f32],
        velocity: &[f32],
        sensed: &mut Sensed,
    ) {
        sensed.base_angular_velocity = angular;
        sensed.orient(quaternion);
        sensed.base_linear_velocity = frames::to_body(quaternion, linear);
        sensed.base_height = place[2] - self.ground_under(place);
        for (to, &joint) in self.joints.iter().enumerate() {
            sensed.joint_position[to] = position[joint];
            sensed.joint_velocity[to] = velocity[joint];
        }
    }

    /// Cosine of the angle between gravity in the body frame (`−up`) and where it is in the wanted posture.
    pub fn uprightness(&self, up: [f32; 3]) -> f32 {
        self.fall.uprightness(up)
    }

    /// Min uprightness and min height (m) of a robot that has not fallen, and where gravity is in the body
    /// frame in the wanted posture.
    pub fn fall_limits(&self) -> (f32, f32, [f32; 3]) {
        (self.fall.least_uprightness, self.fall.height, self.fall.posture)
    }

    /// Whether own parts of the robot touch each other.
    pub fn touches_itself(&self) -> bool {
        !self.model().self_pairs.is_empty()
    }

    /// The ground, where it is not one level plane at height 0.
    pub fn ground(&self) -> Option<&Surface> {
        self.ground.as_ref()
    }

    /// Height of the ground under a point of the world (m), from which heights count.
    pub fn ground_under(&self, point: [f32; 3]) -> f32 {
        match &self.ground {
            Some(ground) => ground.height(f64::from(point[0]), f64::from(point[1])) as f32,
            None => 0.0,
        }
    }

    /// Whether environment `index` of `motion` has fallen: it touches the ground with what must not, leans too far, or
    /// its base is too low above the ground under it.
    ///
    /// # Panics
    /// If `motion` has no such environment: an error of the caller.
    pub fn fallen(&self, motion: &Motion, index: usize) -> bool {
        self.fall.fallen(motion, index, self.ground_under(vec_of(&motion.base_position[3 * index..])))
    }

    /// Places in [`Motion::normal_force`] of the geoms that must not touch the ground.
    pub fn fall_geoms(&self) -> &[usize] {
        &self.fall.geoms
    }
}
