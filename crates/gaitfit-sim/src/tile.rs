//! Floating robots that one thread advances together, on whatever engine.

use crate::SimError;
use crate::motion::{Motion, Start};

/// A tile's robots as an engine keeps them. See [`Tile`] for the meaning of each call.
pub trait Robots: Send {
    /// Robots in the tile.
    fn environments(&self) -> usize;
    /// [`Tile::place`].
    fn place(&mut self, environment: usize, start: &Start);
    /// [`Tile::correct`].
    fn correct(&mut self, environment: usize, reading: &Start);
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

    /// Moves a robot to the state that its sensors are known to read, in midst of its motion: it keeps the targets sent
    /// and the accelerations that the solver starts from. Joint angles are the true ones, without encoder bias.
    pub fn correct(&mut self, environment: usize, reading: &Start) {
        self.robots.correct(environment, reading);
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
