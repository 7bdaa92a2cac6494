//! Parameters in which robots seldom differ from their model, for programs written for robots that keep them.

use crate::robot::MAX_SPEED;
use crate::visit::{Owner, Slot};
use crate::{Params, Parts, Robot};

/// Makes [`Kept`] of its table. A row: documentation, field; its numbers among the parameters; whether a
/// robot keeps it.
macro_rules! kept {
    ($($(#[doc = $doc:literal])* $field:ident: $numbers:pat => $keeps:expr;)*) => {
        /// Which of the parameters that seldom change a robot keeps as its model has them. A program for such robots has
        /// them as constants: a link's inertia takes ten numbers a robot less, and what a robot lacks no operation at all.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub struct Kept {
            $($(#[doc = $doc])* pub $field: bool,)*
            /// The parts that it has, unlike its model: rigid gears, sensors that read at once.
            pub parts: Parts,
        }

        impl Kept {
            /// What `robot` keeps.
            pub fn from_robot(robot: &Robot) -> Self {
                $(let $field: fn(&Robot) -> bool = $keeps;)*
                Self { $($field: $field(robot),)* parts: Parts::from_robot(robot) }
            }

            /// What two robots keep.
            pub fn both(self, other: Self) -> Self {
                Self { $($field: self.$field && other.$field,)* parts: self.parts.or(other.parts) }
            }

            /// Whether the number `slot` of the parameters is kept.
            fn keeps(self, slot: Slot) -> bool {
                match (slot.owner, slot.name) {
                    $($numbers => self.$field,)*
                    (_, name) => self.parts.lack(name),
                }
            }
        }
    };
}

/// Whether all joints have the model's number.
fn all(numbers: &[f64], model: f64) -> bool {
    numbers.iter().all(|&number| number == model)
}

kept! {
    /// Masses, centres of mass and inertias of all links but the root's.
    links: (Owner::Link(1..), _) => |robot| {
        let shifts = [&robot.link_com_x, &robot.link_com_y, &robot.link_com_z];
        all(&robot.link_mass, 1.0) && shifts.into_iter().all(|shift| all(shift, 0.0))
    };
    /// Whether friction at rest is that in motion, on all joints.
    stiction: (_, "stiction") => |robot| all(&robot.stiction, 0.0);
    /// Whether friction does not grow with load, on all joints.
    load_friction: (_, "load_friction") => |robot| all(&robot.load_friction, 0.0);
    /// Whether the ground is as hard as the model's.
    ground: (_, "ground_softness") => |robot| robot.ground_softness == 0.0;
    /// Whether contacts begin with the model's impedance.
    impedance: (_, "ground_impedance") => |robot| robot.ground_impedance == 0.0;
    /// Whether the largest torque of every motor is the same at any speed.
    motors: (_, "no_load_speed") => |robot| robot.no_load_speed.iter().all(|&speed| speed >= MAX_SPEED);
}

impl Kept {
    /// The numbers kept, from the parameters of any robot that keeps them; the same of every one.
    pub fn numbers(self, params: &Params<f64>) -> Vec<(Slot, f64)> {
        let mut numbers = Vec::new();
        params.visit(|slot, &number| {
            if self.keeps(slot) {
                numbers.push((slot, number));
            }
        });
        numbers
    }
}
