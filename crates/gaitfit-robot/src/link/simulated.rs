//! A robot in the project's own engine, at 1 kHz, with the PD controller of the motor boards.

use std::time::Duration;

use gaitfit_model::builtin::GO2;
use gaitfit_model::rotation::{IDENTITY, rotate_back};
use gaitfit_model::{GRAVITY, Model, ReadOptions, Root, read_mjcf_str};
use gaitfit_physics::Preset;
use gaitfit_policy::walker::standing;
use gaitfit_sim::{Batch, BatchOptions, Candidate, Cpu, Engine, Motion, Tile};

use super::Link;
use crate::RobotError;
use crate::command::Command;
use crate::guard::Limits;
use crate::per_motor::PerMotor;
use crate::remote::Remote;
use crate::robot::Robot;
use crate::state::{Battery, Reading, RobotState, Seal};

/// Physics step and time between two looks of the motors' controllers, s.
const STEP: f64 = 0.001;
/// Max number of physics steps to catch up with in a call; a caller that was away longer finds the robot where it was.
const MAX_STEPS: u64 = 200;

/// The engine for a [`Simulated`] robot.
///
/// # Errors
/// A model that the engine cannot step.
pub fn simulation(model: &Model) -> Result<Batch, RobotError> {
    let options = BatchOptions {
        control_dt: STEP,
        substeps: 1,
        preset: Preset::Accurate,
        emulated_step: None,
        max_delay: 0.0,
        tracked: Vec::new(),
        isa: None,
    };
    Batch::new(model, options).map_err(|error| RobotError::Simulation(error.to_string()))
}

/// Friction of a Go2 that hangs (N·m), viscous friction (N·m·s/rad) and armature (kg·m²) of hip, thigh and calf: published
/// estimates of real ones.
const JOINTS: [(&str, [f64; 3]); 3] =
    [("hip", [0.2, 0.2, 0.015]), ("thigh", [0.18, 0.2, 0.018]), ("calf", [0.6, 0.3, 0.048])];
/// Time in which the legs of a robot that hangs come to rest, ms.
const SETTLE: u64 = 4000;

/// The model of a Go2 whose base is held in the air, with friction and armature like those of real ones.
///
/// # Errors
/// None that the built-in robot gives.
pub fn hanging_go2() -> Result<Model, RobotError> {
    let options = ReadOptions { root: Some(Root::Fixed), ..ReadOptions::default() };
    let mut model =
        read_mjcf_str(GO2, &options).map_err(|error| RobotError::Simulation(error.to_string()))?;
    // In the air there is no ground to touch.
    model.pairs.clear();
    for joint in &mut model.joints {
        for (kind, [friction, damping, armature]) in JOINTS {
            if joint.name.contains(kind) {
                (joint.frictionloss, joint.damping, joint.armature) = (friction, damping, armature);
            }
        }
    }
    Ok(model)
}

/// A simulated robot, lying on the ground at first. It moves when it is asked for its state, up to the time of the question.
pub struct Simulated<'a> {
    /// Whether its base is held in the air.
    hangs: bool,
    tile: Tile<'a>,
    motion: Motion,
    /// For each motor, its joint in the model.
    joints: PerMotor<usize>,
    limits: Limits,
    command: Option<Command>,
    /// Milliseconds simulated.
    ms: u64,
    torque: PerMotor<f32>,
    /// A torque of 0 for each joint of the model, and the motors' torques, N·m.
    nothing: Vec<f32>,
    torques: Vec<f32>,
}

impl<'a> Simulated<'a> {
    /// `robot` as it lies, or limp in the air if its base is fixed; `batch` has its model.
    ///
    /// # Errors
    /// A model without the robot's joints.
    pub fn new(batch: &'a Batch, robot: &Robot) -> Result<Self, RobotError> {
        let model = batch.model();
        let mut joints = robot.each(|_| 0usize);
        let mut angles = vec![0.0; model.joints.len()];
        for (index, motor) in robot.motors.iter().enumerate() {
            let joint = model.find_joint(&motor.joint).ok_or_else(|| {
                RobotError::Simulation(format!("its model has no joint `{}`", motor.joint.escape_debug()))
            })?;
            joints[index] = joint;
            // Joints without a motor stay at 0.
            angles[joint] = f64::from(motor.lying);
        }
        // The body has no gains of its own: torques come from the commands, as on the robot.
        let limp = vec![0.0; model.joints.len()];
        let failed = |error: String| RobotError::Simulation(error);
        let body = Candidate::nominal(model).robot(&limp, &limp);
        let body = body.params(model).map_err(|error| failed(error.to_string()))?;
        // One robot has no work for a second thread.
        let engine = Cpu { threads: 1 };
        let mut tile = engine.tile(batch, &[body], &[]).map_err(|error| failed(error.to_string()))?;
        tile.place(0, &standing(model, IDENTITY, &angles));
        let mut motion = batch.motion(1);
        tile.observe(&mut motion);
        let hangs = model.root == Root::Fixed;
        let mut simulated = Self {
            hangs,
            tile,
            motion,
            joints,
            limits: robot.limits(),
            command: None,
            ms: 0,
            torque: robot.each(|_| 0.0),
            nothing: vec![0.0; model.joints.len()],
            torques: vec![0.0; model.joints.len()],
        };
        // Limbs that hang in the air swing down first.
        if hangs {
            (0..SETTLE).for_each(|_| simulated.step());
            simulated.ms = 0;
        }
        Ok(simulated)
    }

    /// Where the base is, m, world frame.
    pub fn position(&self) -> [f32; 3] {
        std::array::from_fn(|k| self.motion.base_position[k])
    }

    /// One millisecond.
    fn step(&mut self) {
        for (motor, &joint) in self.joints.iter().enumerate() {
            let (q, dq) = (self.motion.joint_position[joint], self.motion.joint_velocity[joint]);
            // Before the first command the motors give no torque.
            let wanted = self.command.map_or(0.0, |command| command[motor].torque(q, dq));
            // Between two commands the joint moves and the torque with it, so the motor's limit acts at every
            // step.
            let max = self.limits.torque[motor];
            self.torque[motor] = wanted.clamp(-max, max);
            self.torques[joint] = self.torque[motor];
        }
        self.tile.step(&self.nothing, &self.torques, &mut self.motion);
        self.ms += 1;
    }

    fn reading(&self) -> Reading {
        // A base that is held fast has no motion, whatever the engine computes for it.
        let held = |held: f32, free: &[f32], k: usize| if self.hangs { held } else { free[k] };
        let quaternion =
            std::array::from_fn(|k| held(f32::from(u8::from(k == 0)), &self.motion.base_quaternion, k));
        Reading {
            state: RobotState {
                q: self.joints.map(|joint| self.motion.joint_position[joint]),
                dq: self.joints.map(|joint| self.motion.joint_velocity[joint]),
                torque: self.torque,
                // Temperature, errors and battery of a sound robot: no guard objects to them.
                temperature: self.joints.map(|_| 30),
                error: self.joints.map(|_| 0),
                lost: self.joints.map(|_| 0),
                quaternion,
                gyroscope: std::array::from_fn(|k| held(0.0, &self.motion.base_angular, k)),
                // That of a robot at rest, in the body's frame: preflight compares it with the orientation.
                accelerometer: rotate_back(quaternion, [0.0, 0.0, GRAVITY as f32]),
                battery: Some(Battery { charge: 100, volts: 30.0, amps: 0.0 }),
                tick: self.ms as u32,
                remote: Remote::default(),
            },
            seal: Seal::Right,
        }
    }
}

impl Link for Simulated<'_> {
    fn receive(&mut self, now: Duration, each: &mut dyn FnMut(Duration, &Reading)) -> Result<u64, String> {
        let due = now.as_millis() as u64;
        self.ms = self.ms.max(due.saturating_sub(MAX_STEPS));
        while self.ms < due {
            self.step();
            // Every second millisecond, as a Go2.
            if self.ms.is_multiple_of(2) {
                each(Duration::from_millis(due - self.ms), &self.reading());
            }
        }
        Ok(0)
    }

    fn send(&mut self, command: &Command) -> Result<(), String> {
        self.command = Some(*command);
        Ok(())
    }
}
