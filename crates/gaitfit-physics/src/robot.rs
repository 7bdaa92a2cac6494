//! A robot's numbers, and how they become the parameters of an environment.

use gaitfit_model::{Model, Root};

use crate::joint_parameter::{JointParameter, joint_parameters};
use crate::params::{JointParams, LinkInertia, PairInvweight};
use crate::seat::{Seat, body_inertia, seats};
use crate::vec3::*;
use crate::{Params, PhysicsError, invweight};

/// Largest torque limit, N·m: an infinite one would make NaN of nothing in single precision.
const MOST_TORQUE: f64 = 1e30;

macro_rules! define {
    (
        step { $($(#[doc = $doc:literal])* $variant:ident $field:ident; $unit:expr; $least:expr; $nominal:expr; $search:expr)* }
        factors { $($(#[doc = $fdoc:literal])* $fvariant:ident $ffield:ident of $of:ident; $funit:expr; $fleast:expr; $fnominal:expr; $fsearch:expr)* }
    ) => {
        /// A robot as a person would describe it: the model's own numbers, changed joint by joint. Vectors hold one
        /// number a joint, in the model's order.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Robot {
            $($(#[doc = $doc])* pub $field: Vec<f64>,)*
            $($(#[doc = $fdoc])* pub $ffield: Vec<f64>,)*
            /// Mass added to the root body, kg, at its centre of mass.
            pub base_mass: f64,
            /// Shift of the root body's centre of mass, m, body frame.
            pub base_com: [f64; 3],
            /// Mass of a load fixed to the root body, a point, kg: it adds inertia as its place says.
            pub payload_mass: f64,
            /// Where the load is, m, body frame.
            pub payload_position: [f64; 3],
            /// Factor on all contact friction coefficients.
            pub friction_scale: f64,
        }

        impl Robot {
            /// The model's own numbers; no delay, no bias, zero PD gains, torque limits from the joints and actuators.
            pub fn nominal(model: &Model) -> Self {
                let each = |nominal: fn(&Model, usize) -> f64| (0..model.joints.len()).map(|j| nominal(model, j)).collect();
                Self {
                    $($field: each($nominal),)*
                    $($ffield: each($fnominal),)*
                    base_mass: 0.0,
                    base_com: [0.0; 3],
                    payload_mass: 0.0,
                    payload_position: [0.0; 3],
                    friction_scale: 1.0,
                }
            }

            /// One parameter of all joints.
            pub fn joints(&self, parameter: JointParameter) -> &[f64] {
                match parameter {
                    $(JointParameter::$variant => &self.$field,)*
                    $(JointParameter::$fvariant => &self.$ffield,)*
                }
            }

            /// One parameter of all joints, to change.
            pub fn joints_mut(&mut self, parameter: JointParameter) -> &mut [f64] {
                match parameter {
                    $(JointParameter::$variant => &mut self.$field,)*
                    $(JointParameter::$fvariant => &mut self.$ffield,)*
                }
            }

            /// What the step takes of joint `j`.
            fn joint_params(&self, j: usize, weight: f64) -> JointParams<f64> {
                let mut params = JointParams { $($field: self.$field[j],)* weight };
                $(params.$of *= self.$ffield[j];)*
                params.torque_limit = params.torque_limit.min(MOST_TORQUE);
                params
            }
        }
    };
}
joint_parameters!(define);

impl Robot {
    fn check(&self, model: &Model) -> Result<(), PhysicsError> {
        let n = model.joints.len();
        for &parameter in JointParameter::ALL {
            let (what, values, least) = (parameter.name(), self.joints(parameter), parameter.least());
            if values.len() != n {
                return Err(PhysicsError::Length { what, found: values.len(), expected: n });
            }
            for (value, joint) in values.iter().zip(&model.joints) {
                if value.is_nan() || *value < least {
                    return Err(PhysicsError::Value {
                        object: format!("joint `{}`", joint.name),
                        quantity: what,
                        value: *value,
                        must: if least == 0.0 { "zero or positive" } else { "a number" },
                    });
                }
            }
        }
        let mass = model.bodies[0].mass + self.base_mass;
        if !(mass >= 0.0 || model.root == Root::Fixed) {
            return Err(base_mass_error(model, mass, "zero or positive"));
        }
        if !(self.payload_mass >= 0.0 && self.payload_mass.is_finite()) {
            return Err(PhysicsError::Value {
                object: format!("body `{}`", model.bodies[0].name),
                quantity: "the mass of its load",
                value: self.payload_mass,
                must: "zero or positive",
            });
        }
        Ok(())
    }

    /// Parameters of one environment with this robot. Costs a dense factorisation: done once a robot, not a step.
    pub fn params(&self, model: &Model) -> Result<Params<f64>, PhysicsError> {
        self.check(model)?;
        let (seats, hinges) = seats(model);
        let links = self.link_inertias(model, &seats, hinges.len() + 1);
        let floating = model.root == Root::Floating;
        // The base itself may be massless, as in many URDF files: what is welded to it moves with it.
        if floating && (links[0].mass <= 0.0 || links[0].mass.is_nan()) {
            return Err(base_mass_error(model, links[0].mass, "positive"));
        }
        let weights = invweight::invweights(model, &links, &self.armature)?;
        let mut pairs = Vec::new();
        for link in 0..=hinges.len() {
            for pair in &model.pairs {
                let body = model.geoms[pair.geom].body;
                if seats[body].link == link && (link > 0 || floating) {
                    let [translation, rotation] = weights.bodies[body];
                    pairs.push(PairInvweight { translation, rotation });
                }
            }
        }
        for pair in &model.self_pairs {
            let [first, second] = [0, 1].map(|side| weights.bodies[pair.geoms[side].body]);
            let (translation, rotation) = (first[0] + second[0], first[1] + second[1]);
            pairs.push(PairInvweight { translation, rotation });
        }
        let joints =
            weights.joints.iter().enumerate().map(|(j, weight)| self.joint_params(j, 1.0 / weight)).collect();
        Ok(Params { links, joints, pairs, friction_scale: self.friction_scale })
    }

    /// Bodies welded into links: masses add, inertias add about the common centre of mass.
    fn link_inertias(&self, model: &Model, seats: &[Seat], count: usize) -> Vec<LinkInertia<f64>> {
        let mut links = vec![LinkInertia { mass: 0.0, com: [0.0; 3], inertia: [0.0; 6] }; count];
        // Second moments about the link origin, turned into central ones at the end.
        for (index, (body, seat)) in model.bodies.iter().zip(seats).enumerate() {
            let (mut mass, mut ipos) = (body.mass, body.ipos);
            if index == 0 {
                mass += self.base_mass;
                ipos = add(ipos, self.base_com);
            }
            let com = add(seat.position, rotate(&seat.rotation, ipos));
            let inertia = sym_rotate(&seat.rotation, &body_inertia(body));
            put(&mut links[seat.link], mass, com, &inertia);
            if index == 0 && self.payload_mass != 0.0 {
                let place = add(seat.position, rotate(&seat.rotation, self.payload_position));
                put(&mut links[seat.link], self.payload_mass, place, &[0.0; 6]);
            }
        }
        for link in &mut links {
            if link.mass > 0.0 {
                link.com = scale(1.0 / link.mass, link.com);
                let about_origin = steiner(link.mass, link.com);
                for k in 0..6 {
                    link.inertia[k] -= about_origin[k];
                }
            }
        }
        links
    }
}

/// Adds a body to a link whose moments are about its origin: `mass` at `com`, `inertia` about `com`.
fn put(link: &mut LinkInertia<f64>, mass: f64, com: V3<f64>, inertia: &Sym3<f64>) {
    link.mass += mass;
    link.com = axpy(mass, com, link.com);
    let about_origin = steiner(mass, com);
    for k in 0..6 {
        link.inertia[k] += inertia[k] + about_origin[k];
    }
}

fn base_mass_error(model: &Model, value: f64, must: &'static str) -> PhysicsError {
    PhysicsError::Value {
        object: format!("body `{}`", model.bodies[0].name),
        quantity: "the mass with the added base mass",
        value,
        must,
    }
}

/// `m (c·c 1 − c cᵀ)`.
fn steiner(m: f64, c: V3<f64>) -> Sym3<f64> {
    let [x, y, z] = c;
    [m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y), -m * x * y, -m * x * z, -m * y * z]
}
