//! Parameters in which robots seldom differ from their model, for programs written for robots that keep them.

use crate::robot::MAX_SPEED;
use crate::visit::{Owner, Slot};
use crate::{Params, Robot};

/// Which of the parameters that seldom change a robot keeps as its model has them. A program for such robots has them
/// as constants: a link's inertia takes ten numbers a robot less, and what a robot lacks no operation at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Kept {
    /// Masses, centres of mass and inertias of all links but the root's.
    pub links: bool,
    /// Whether friction at rest is that in motion, on all joints.
    pub stiction: bool,
    /// Whether friction does not grow with load, on all joints.
    pub load_friction: bool,
    /// Whether gears are rigid and without play, on all joints.
    pub gears: bool,
    /// Whether the ground is as hard as the model's.
    pub ground: bool,
    /// Whether sensors read joint velocities without lag.
    pub velocities: bool,
    /// Whether the largest torque of every motor is the same at any speed.
    pub motors: bool,
}

impl Kept {
    /// What `robot` keeps.
    pub fn from_robot(robot: &Robot) -> Self {
        let all = |numbers: &[f64], model: f64| numbers.iter().all(|&number| number == model);
        let shifts = [&robot.link_com_x, &robot.link_com_y, &robot.link_com_z];
        Self {
            links: all(&robot.link_mass, 1.0) && shifts.into_iter().all(|shift| all(shift, 0.0)),
            stiction: all(&robot.stiction, 0.0),
            load_friction: all(&robot.load_friction, 0.0),
            gears: all(&robot.play, 0.0) && all(&robot.compliance, 0.0),
            ground: robot.ground_softness == 0.0,
            velocities: robot.velocity_lag == 0.0,
            motors: robot.no_load_speed.iter().all(|&speed| speed >= MAX_SPEED),
        }
    }

    /// What two robots keep.
    pub fn both(self, other: Self) -> Self {
        Self {
            links: self.links && other.links,
            stiction: self.stiction && other.stiction,
            load_friction: self.load_friction && other.load_friction,
            gears: self.gears && other.gears,
            ground: self.ground && other.ground,
            velocities: self.velocities && other.velocities,
            motors: self.motors && other.motors,
        }
    }

    /// The numbers kept, from the parameters of any robot that keeps them; the same of every one.
    pub fn numbers(self, params: &Params<f64>) -> Vec<(Slot, f64)> {
        let mut found = Vec::new();
        params.visit(|slot, &number| {
            let kept = match (slot.owner, slot.name) {
                (Owner::Link(link), _) => self.links && link > 0,
                (_, "stiction") => self.stiction,
                (_, "load_friction") => self.load_friction,
                (_, "play" | "compliance") => self.gears,
                (_, "ground_softness") => self.ground,
                (_, "velocity_lag") => self.velocities,
                (_, "no_load_speed") => self.motors,
                _ => false,
            };
            if kept {
                found.push((slot, number));
            }
        });
        found
    }
}
