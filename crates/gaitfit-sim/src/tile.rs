//! Floating robots that one thread advances together, on whatever engine.

use crate::SimError;
use crate::motion::{Motion, Start};

/// Everything of one robot that changes from step to step, wherever it is simulated.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotState {
    /// Motion, in the order of [`gaitfit_physics::State::visit`].
    pub state: Vec<f32>,
    /// Sent targets, rad, newest first; `taps × joints`.
    pub targets: Vec<f32>,
    /// Memory of the modifications.
    pub memory: Vec<f32>,
    /// Normal ground force on each contact geom in the last physics step, N.
    pub normal_force: Vec<f32>,
    /// Centre of each tracked geom in the last physics step, m; `tracked × 3`.
    pub tracked: Vec<f32>,
    /// Torque on each joint in the last physics step, N·m.
    pub torque: Vec<f32>,
    /// Whether targets and memory begin with its next target.
    pub fresh: bool,
}

/// A tile's robots as an engine keeps them. See [`Tile`] for the meaning of each call.
pub trait Robots: Send {
    /// Robots in the tile.
    fn environments(&self) -> usize;
    /// [`Tile::place`].
    fn place(&mut self, environment: usize, start: &Start);
    /// [`Tile::correct`].
    fn correct(&mut self, readings: &[(usize, Start)]);
    /// [`Tile::push`].
    fn push(&mut self, environment: usize, velocity: [f32; 3]);
    /// [`Tile::step`].
    fn step(&mut self, targets: &[f32], disturbance: &[f32], motion: &mut Motion);
    /// [`Tile::observe`].
    fn observe(&self, motion: &mut Motion);
    /// [`Tile::save`].
    fn save(&mut self) -> Vec<f32>;
    /// [`Tile::restore`]; whether the length fits.
    fn restore(&mut self, saved: &[f32]) -> bool;
    /// [`Tile::robot`].
    fn robot(&mut self, environment: usize) -> RobotState;
    /// [`Tile::set_robot`]; whether the lengths fit.
    fn set_robot(&mut self, environment: usize, robot: &RobotState) -> bool;
}

/// Some environments that one thread advances together.
pub struct Tile<'a> {
    robots: Box<dyn Robots + 'a>,
}

impl<'a> Tile<'a> {
    /// The tile of an engine's robots.
    pub fn new(robots: Box<dyn Robots + 'a>) -> Self {
        Self { robots }
    }
}

impl Tile<'_> {
    /// Robots in the tile.
    pub fn environments(&self) -> usize {
        self.robots.environments()
    }

    /// Puts a robot into a state. Before its next target it is taken to have held that target.
    pub fn place(&mut self, environment: usize, start: &Start) {
        self.robots.place(environment, start);
    }

    /// Moves robots, by their numbers, to the states that their sensors are known to read, in midst of their motion: they keep
    /// the targets sent and the accelerations that the solver starts from. Joint angles are the true ones, without encoder bias.
    /// It is faster if the numbers ascend.
    pub fn correct(&mut self, readings: &[(usize, Start)]) {
        self.robots.correct(readings);
    }

    /// Adds `velocity` (m/s, world frame) to a robot's base.
    pub fn push(&mut self, environment: usize, velocity: [f32; 3]) {
        self.robots.push(environment, velocity);
    }

    /// Advances all robots by one control period and reports their motion.
    ///
    /// `targets`: `environments × joints`, rad. `disturbance`: torques added to the motors' after their limits,
    /// N·m, `substeps × environments × joints`, or empty.
    pub fn step(&mut self, targets: &[f32], disturbance: &[f32], motion: &mut Motion) {
        self.robots.step(targets, disturbance, motion);
    }

    /// Reports the motion without advancing (torques, accelerations and forces are those of the last step).
    pub fn observe(&self, motion: &mut Motion) {
        self.robots.observe(motion);
    }

    /// Everything that changes from step to step, for a checkpoint.
    pub fn save(&mut self) -> Vec<f32> {
        self.robots.save()
    }

    /// One robot as it is.
    pub fn robot(&mut self, environment: usize) -> RobotState {
        self.robots.robot(environment)
    }

    /// Makes a robot what it was, here or in another simulation of the same batch.
    ///
    /// # Errors
    /// A state of another length.
    pub fn set_robot(&mut self, environment: usize, robot: &RobotState) -> Result<(), SimError> {
        if self.robots.set_robot(environment, robot) {
            return Ok(());
        }
        let must = "as long as this tile's own; it is of another robot";
        Err(SimError::Option { option: "a robot's state", value: robot.state.len().to_string(), must })
    }

    /// Takes up a state that [`Tile::save`] gave, of a tile of the same robots.
    ///
    /// # Errors
    /// A state of another length.
    pub fn restore(&mut self, saved: &[f32]) -> Result<(), SimError> {
        if self.robots.restore(saved) {
            return Ok(());
        }
        let must = "as long as this tile's own; it is of another robot, batch size or instruction set";
        Err(SimError::Option { option: "a saved tile's length", value: saved.len().to_string(), must })
    }
}
