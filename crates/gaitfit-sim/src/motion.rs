//! Motion that a batch of robots reports after a control period.

use gaitfit_model::rotation::{quat_of, vec_of};
use gaitfit_physics::{IMU_READING, State};

/// Motion of some environments; every array holds one row an environment, row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    /// Position of the base's origin, m, world frame; `× 3`.
    pub base_position: Vec<f32>,
    /// Orientation of the base, wxyz; `× 4`.
    pub base_quaternion: Vec<f32>,
    /// Linear velocity of the base's origin, m/s, world frame; `× 3`.
    pub base_linear: Vec<f32>,
    /// Angular velocity of the base, rad/s, body frame; `× 3`.
    pub base_angular: Vec<f32>,
    /// Joint positions as the encoders report them, rad; `× joints`.
    pub joint_position: Vec<f32>,
    /// Joint velocities, rad/s; `× joints`.
    pub joint_velocity: Vec<f32>,
    /// Velocities as sensors read them; empty where they read them at once. See
    /// [`Motion::velocity_readings`].
    pub filtered_velocity: Vec<f32>,
    /// Orientation and angular velocity of the base as a late inertial unit reads them: a mean of quaternions (wxyz, nearly
    /// unit) and rad/s, body frame; `× 7`. Absent if it reads the present. See [`Motion::imu_reading`].
    pub late_imu: Option<Vec<f32>>,
    /// Joint accelerations of the last physics step, rad/s²; `× joints`.
    pub joint_acceleration: Vec<f32>,
    /// Torques on the joints in the last physics step, N·m: the motors', with modifications and disturbances;
    /// `× joints`.
    pub torque: Vec<f32>,
    /// Normal ground force on each contact geom in the last physics step, N; `× geoms`, in
    /// [`Batch::contact_geoms`](crate::Batch::contact_geoms) order.
    pub normal_force: Vec<f32>,
    /// Centre of each tracked geom at the start of the last physics step, m, world frame; `× tracked × 3`.
    pub tracked: Vec<f32>,
}

impl Motion {
    /// Zeros for `environments` robots.
    pub fn new(environments: usize, joints: usize, geoms: usize, tracked: usize) -> Self {
        let rows = |width: usize| vec![0.0; environments * width];
        Self {
            base_position: rows(3),
            base_quaternion: rows(4),
            base_linear: rows(3),
            base_angular: rows(3),
            joint_position: rows(joints),
            joint_velocity: rows(joints),
            // Engines make room for these two only where sensors filter or are late.
            filtered_velocity: Vec::new(),
            late_imu: None,
            joint_acceleration: rows(joints),
            torque: rows(joints),
            normal_force: rows(geoms),
            tracked: rows(3 * tracked),
        }
    }

    /// Joint velocities as sensors read them, rad/s; `× joints`.
    pub fn velocity_readings(&self) -> &[f32] {
        if self.filtered_velocity.is_empty() { &self.joint_velocity } else { &self.filtered_velocity }
    }

    /// Orientation (wxyz) and angular velocity (rad/s, body frame) of the base of environment `index` that its inertial unit
    /// reads, before errors of the unit itself ([`Imu`](crate::Imu)): those of the moment that the unit is late by.
    ///
    /// # Panics
    /// If there is no such environment: an error of the caller.
    pub fn imu_reading(&self, index: usize) -> ([f32; 4], [f32; 3]) {
        // A unit that is not late reads the present.
        let Some(readings) = &self.late_imu else {
            return (quat_of(&self.base_quaternion[4 * index..]), vec_of(&self.base_angular[3 * index..]));
        };
        let reading = &readings[IMU_READING * index..];
        let mean: [f32; 4] = quat_of(reading);
        // A mean of unit quaternions is a little shorter than 1.
        let length = mean.iter().map(|x| x * x).sum::<f32>().sqrt();
        (mean.map(|x| x / length), vec_of(&reading[4..]))
    }
}

/// A state to start from; joint vectors are in model order.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// Position of the base's origin, m, world frame.
    pub base_position: [f32; 3],
    /// Orientation of the base, wxyz, unit.
    pub base_quaternion: [f32; 4],
    /// Linear velocity of the base's origin, m/s, world frame.
    pub base_linear: [f32; 3],
    /// Angular velocity of the base, rad/s, body frame.
    pub base_angular: [f32; 3],
    /// True joint angles, rad.
    pub joint_position: Vec<f32>,
    /// Joint velocities, rad/s.
    pub joint_velocity: Vec<f32>,
}

impl Start {
    /// The state, without accelerations.
    pub(crate) fn state(&self) -> State<f32> {
        State {
            base_position: self.base_position,
            base_quaternion: self.base_quaternion,
            base_linear: self.base_linear,
            base_angular: self.base_angular,
            qpos: self.joint_position.clone(),
            qvel: self.joint_velocity.clone(),
            // The solver starts from these; a robot that is placed has no step behind it.
            base_acceleration: [[0.0; 3]; 2],
            qacc: vec![0.0; self.joint_position.len()],
        }
    }
}
