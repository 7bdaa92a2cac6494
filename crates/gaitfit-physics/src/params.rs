//! What may differ from one environment to the next.

use crate::Real;
use crate::joint_parameter::joint_parameters;
use crate::vec3::*;
use crate::visit::{Owner, Slot, all, visit_methods};

/// Mass properties of one link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkInertia<T> {
    /// Mass, kg.
    pub mass: T,
    /// Centre of mass in the link frame, m.
    pub com: V3<T>,
    /// Rotational inertia about the centre of mass, link axes (xx, yy, zz, xy, xz, yz), kg·m².
    pub inertia: Sym3<T>,
}

macro_rules! define {
    (
        step { $($(#[doc = $doc:literal])* $variant:ident $field:ident; $unit:expr; $least:expr; $nominal:expr; $search:expr)* }
        factors { $($factors:tt)* }
        links { $($links:tt)* }
        robot { $($(#[doc = $rdoc:literal])* $rfield:ident; $rleast:expr; $rnominal:expr)* }
    ) => {
        /// Parameters of one joint and of the PD controller that drives it.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct JointParams<T> {
            $($(#[doc = $doc])* pub $field: T,)*
            /// Inertia seen by the joint at the reference pose, kg·m² (the reciprocal of MuJoCo's `dof_invweight0`).
            pub weight: T,
        }

        impl<T: Copy> JointParams<T> {
            /// Every parameter `value`.
            pub(crate) fn uniform(value: T) -> Self {
                Self { $($field: value,)* weight: value }
            }
        }

        impl<T> JointParams<T> {
            fn numbers(&self) -> impl Iterator<Item = (&'static str, &T)> {
                [$((stringify!($field), &self.$field),)* ("weight", &self.weight)].into_iter()
            }

            fn numbers_mut(&mut self) -> impl Iterator<Item = (&'static str, &mut T)> {
                [$((stringify!($field), &mut self.$field),)* ("weight", &mut self.weight)].into_iter()
            }
        }

        /// Numbers of the robot as a whole.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct RobotParams<T> {
            $($(#[doc = $rdoc])* pub $rfield: T,)*
        }

        impl<T: Copy> RobotParams<T> {
            /// Every number `value`.
            fn uniform(value: T) -> Self {
                Self { $($rfield: value),* }
            }
        }

        impl RobotParams<f64> {
            /// Those of the model.
            pub(crate) fn nominal() -> Self {
                Self { $($rfield: $rnominal),* }
            }
        }

        impl<T> RobotParams<T> {
            fn numbers(&self) -> impl Iterator<Item = (&'static str, &T)> {
                [$((stringify!($rfield), &self.$rfield)),*].into_iter()
            }

            fn numbers_mut(&mut self) -> impl Iterator<Item = (&'static str, &mut T)> {
                [$((stringify!($rfield), &mut self.$rfield)),*].into_iter()
            }
        }
    };
}
joint_parameters!(define);

/// Inverse inertia of a contact pair's body at the reference pose (MuJoCo's `body_invweight0`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairInvweight<T> {
    /// Translational, 1/kg.
    pub translation: T,
    /// Rotational, 1/(kg·m²).
    pub rotation: T,
}

/// All per-environment parameters of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Params<T> {
    /// One a link; link 0 is the root.
    pub links: Vec<LinkInertia<T>>,
    /// One a joint.
    pub joints: Vec<JointParams<T>>,
    /// One a compiled contact pair, in `Tree` order; then one a self-contact pair, the sum of both bodies'.
    pub pairs: Vec<PairInvweight<T>>,
    /// Inertia that a free joint sees at the reference pose, kg and kg·m²: translation and rotation, each a mean over three
    /// axes (the reciprocals of MuJoCo's `dof_invweight0`); empty where nothing but inertia resists the base.
    pub free: Vec<T>,
    /// Numbers of the robot as a whole.
    pub robot: RobotParams<T>,
}

macro_rules! params_numbers {
    ($params:ident, $visit:ident, $numbers:ident, [$($reference:tt)+]) => {
        for (i, link) in ($($reference)+ $params.links).into_iter().enumerate() {
            let slot = Slot::new(Owner::Link(i), "mass");
            $visit(slot, $($reference)+ link.mass);
            all(&mut $visit, Slot { name: "com", ..slot }, $($reference)+ link.com);
            all(&mut $visit, Slot { name: "inertia", ..slot }, $($reference)+ link.inertia);
        }
        for (j, joint) in ($($reference)+ $params.joints).into_iter().enumerate() {
            for (name, number) in joint.$numbers() {
                $visit(Slot::new(Owner::Joint(j), name), number);
            }
        }
        for (p, pair) in ($($reference)+ $params.pairs).into_iter().enumerate() {
            $visit(Slot::new(Owner::Pair(p), "translation"), $($reference)+ pair.translation);
            $visit(Slot::new(Owner::Pair(p), "rotation"), $($reference)+ pair.rotation);
        }
        all(&mut $visit, Slot::new(Owner::Base, "free_weight"), $($reference)+ $params.free);
        for (name, number) in $params.robot.$numbers() {
            $visit(Slot::new(Owner::Base, name), number);
        }
    };
}

impl<T> Params<T> {
    visit_methods!(params_numbers);
}

impl<T: Real> Params<T> {
    /// Zeros for as many links, joints and pairs.
    pub fn zeros(links: usize, joints: usize, pairs: usize) -> Self {
        let z = T::zero();
        Self {
            links: vec![LinkInertia { mass: z, com: zero3(), inertia: [z; 6] }; links],
            joints: vec![JointParams::uniform(z); joints],
            pairs: vec![PairInvweight { translation: z, rotation: z }; pairs],
            free: Vec::new(),
            robot: RobotParams::uniform(z),
        }
    }

    /// Several robots' sets in one: `pack` makes each number from the sets' numbers, in the order of the sets.
    pub fn pack(sets: &[&Params<f64>], mut pack: impl FnMut(&[f64]) -> T) -> Self {
        // All sets are visited in the same order, so the number i of each belongs to column i.
        let mut columns: Vec<Vec<f64>> = Vec::new();
        for set in sets {
            let mut next = 0;
            set.visit(|_, &number| {
                if next == columns.len() {
                    columns.push(Vec::with_capacity(sets.len()));
                }
                columns[next].push(number);
                next += 1;
            });
        }
        let Some(first) = sets.first() else { return Self::zeros(0, 0, 0) };
        let mut packed = Self::zeros(first.links.len(), first.joints.len(), first.pairs.len());
        // `zeros` makes no numbers of a free joint.
        packed.free = vec![T::zero(); first.free.len()];
        let mut columns = columns.iter();
        packed.visit_mut(|_, number| {
            if let Some(column) = columns.next() {
                *number = pack(column);
            }
        });
        packed
    }
}
