//! A robot's numbers, and how they become the parameters of an environment.

use gaitfit_model::{Model, Root};

use crate::joint_parameter::{JointParameter, joint_parameters};
use crate::params::{JointParams, LinkInertia, PairInvweight, RobotParams};
use crate::seat::{Seat, body_inertia, seats, sides};
use crate::vec3::*;
use crate::{Params, PhysicsError, invweight};

/// Largest torque limit, N·m: an infinite one would make NaN of nothing in single precision.
const MAX_TORQUE: f64 = 1e30;
/// No-load speed from which on a motor's largest torque does not fall with its speed, rad/s.
pub(crate) const MAX_SPEED: f64 = 1e9;

/// How a body differs from the model's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyChange {
    /// Of mass and inertia.
    pub factor: f64,
    /// Of the centre of mass, m, body axes.
    pub shift: [f64; 3],
}

impl BodyChange {
    /// Whether it is one.
    pub fn changed(&self) -> bool {
        self.factor != 1.0 || self.shift != [0.0; 3]
    }

    /// A place of the body that moves with its centre of mass.
    pub(crate) fn moved(&self, place: [f64; 3]) -> [f64; 3] {
        if self.shift == [0.0; 3] { place } else { add(place, self.shift) }
    }
}

macro_rules! define {
    (
        step { $($(#[doc = $doc:literal])* $variant:ident $field:ident; $unit:expr; $least:expr; $nominal:expr; $search:expr)* }
        factors { $($(#[doc = $fdoc:literal])* $fvariant:ident $ffield:ident of $of:ident; $funit:expr; $fleast:expr; $fnominal:expr; $fsearch:expr)* }
        links { $($(#[doc = $ldoc:literal])* $lvariant:ident $lfield:ident; $lunit:expr; $lleast:expr; $lnominal:expr; $lsearch:expr)* }
        robot { $($(#[doc = $rdoc:literal])* $rfield:ident; $rleast:expr; $rnominal:expr)* }
    ) => {
        /// A robot as a person would describe it: the model's own numbers, changed joint by joint. Vectors hold one
        /// number a joint, in the model's order.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Robot {
            $($(#[doc = $doc])* pub $field: Vec<f64>,)*
            $($(#[doc = $fdoc])* pub $ffield: Vec<f64>,)*
            $($(#[doc = $ldoc])* pub $lfield: Vec<f64>,)*
            /// Mass added to the root body, kg, at its centre of mass.
            pub base_mass: f64,
            /// Shift of the root body's centre of mass, m, body frame.
            pub base_com: [f64; 3],
            /// Mass of a load fixed to the root body, a point, kg: it adds inertia as its place says.
            pub payload_mass: f64,
            /// Where the load is, m, body frame.
            pub payload_position: [f64; 3],
            $($(#[doc = $rdoc])* pub $rfield: f64,)*
        }

        impl Robot {
            /// The model's own numbers; no delay, no bias, zero PD gains, torque limits from the joints and actuators.
            pub fn nominal(model: &Model) -> Self {
                let each = |nominal: fn(&Model, usize) -> f64| (0..model.joints.len()).map(|j| nominal(model, j)).collect();
                Self {
                    $($field: each($nominal),)*
                    $($ffield: each($fnominal),)*
                    $($lfield: each($lnominal),)*
                    base_mass: 0.0,
                    base_com: [0.0; 3],
                    payload_mass: 0.0,
                    payload_position: [0.0; 3],
                    $($rfield: $rnominal,)*
                }
            }

            /// One parameter of all joints.
            pub fn joints(&self, parameter: JointParameter) -> &[f64] {
                match parameter {
                    $(JointParameter::$variant => &self.$field,)*
                    $(JointParameter::$fvariant => &self.$ffield,)*
                    $(JointParameter::$lvariant => &self.$lfield,)*
                }
            }

            /// One parameter of all joints, to change.
            pub fn joints_mut(&mut self, parameter: JointParameter) -> &mut [f64] {
                match parameter {
                    $(JointParameter::$variant => &mut self.$field,)*
                    $(JointParameter::$fvariant => &mut self.$ffield,)*
                    $(JointParameter::$lvariant => &mut self.$lfield,)*
                }
            }

            /// The numbers of the step's parameter of this name: of all joints, or one of the robot as a whole. None if there is
            /// no such parameter.
            pub(crate) fn named(&self, name: &str) -> &[f64] {
                $(if name == stringify!($field) { return &self.$field; })*
                $(if name == stringify!($rfield) { return std::slice::from_ref(&self.$rfield); })*
                &[]
            }

            /// What the step takes of the robot as a whole.
            fn robot_params(&self) -> RobotParams<f64> {
                RobotParams { $($rfield: self.$rfield),* }
            }

            /// A number of the robot as a whole that is smaller than it may be, or not finite, by name.
            fn wrong_number(&self) -> Option<(&'static str, f64)> {
                let numbers = [$((stringify!($rfield), self.$rfield, $rleast)),*];
                let wrong = |(name, value, least): (&'static str, f64, Option<f64>)| {
                    least.filter(|&least| !(value >= least && value.is_finite())).map(|_| (name, value))
                };
                numbers.into_iter().find_map(wrong)
            }

            /// What the step takes of joint `j`.
            fn joint_params(&self, j: usize, weight: f64) -> JointParams<f64> {
                let mut params = JointParams { $($field: self.$field[j],)* weight };
                $(params.$of *= self.$ffield[j];)*
                params.torque_limit = params.torque_limit.min(MAX_TORQUE);
                params.stall_torque = params.stall_torque.min(MAX_TORQUE);
                params.no_load_speed = params.no_load_speed.min(MAX_SPEED);
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
                // NaN is below no bound, so it is asked for by itself.
                if value.is_nan() || *value < least {
                    return Err(PhysicsError::Value {
                        object: format!("joint `{}`", joint.name),
                        quantity: what,
                        value: *value,
                        must: match least {
                            0.0 => "zero or positive",
                            least if least > 0.0 => "0.001 or more",
                            _ => "a number",
                        },
                    });
                }
            }
        }
        // Gears are simulated in all joints or in none, and it is not defined yet which compliance of a slide counts as rigid.
        for parameter in
            [JointParameter::Play, JointParameter::Compliance].into_iter().filter(|_| model.has_slides())
        {
            let all = self.joints(parameter).iter().zip(&model.joints);
            if let Some((value, joint)) = all.into_iter().find(|(value, _)| **value != 0.0) {
                return Err(PhysicsError::Value {
                    object: format!("joint `{}`", joint.name),
                    quantity: parameter.name(),
                    value: *value,
                    must: "0 in a robot with slides: gears are simulated only in robots without slides",
                });
            }
        }
        let motors = self.no_load_speed.iter().zip(&self.stall_torque);
        for ((speed, torque), joint) in motors.zip(&model.joints) {
            // The motor's line falls by stall torque over no-load speed, so both must be finite.
            if *speed < MAX_SPEED && torque.is_infinite() {
                return Err(PhysicsError::Value {
                    object: format!("joint `{}`", joint.name),
                    quantity: "stall_torque",
                    value: *torque,
                    must: "finite where there is a no-load speed: the robot's file has no torque limit to take instead",
                });
            }
        }
        // The check of lower bounds lets infinity pass, which only these may have.
        let bounds = [JointParameter::TorqueLimit, JointParameter::NoLoadSpeed, JointParameter::StallTorque];
        for &parameter in JointParameter::ALL.iter().filter(|one| !bounds.contains(one)) {
            let all = self.joints(parameter).iter().zip(&model.joints);
            if let Some((value, joint)) = all.into_iter().find(|(value, _)| value.is_infinite()) {
                return Err(PhysicsError::Value {
                    object: format!("joint `{}`", joint.name),
                    quantity: parameter.name(),
                    value: *value,
                    must: "finite",
                });
            }
        }
        if let Some((quantity, value)) = self.wrong_number() {
            let (object, must) = (format!("robot `{}`", model.name), "zero or positive");
            return Err(PhysicsError::Value { object, quantity, value, must });
        }
        self.check_base(model)
    }

    /// Checks what is added to the root body.
    fn check_base(&self, model: &Model) -> Result<(), PhysicsError> {
        let places = [("base_com", self.base_com), ("payload_position", self.payload_position)];
        let places = places.into_iter().flat_map(|(name, place)| place.map(|value| (name, value)));
        let wrong = |&(_, value): &(&str, f64)| !value.is_finite();
        if let Some((quantity, value)) =
            std::iter::once(("base_mass", self.base_mass)).chain(places).find(wrong)
        {
            let object = format!("body `{}`", model.bodies[0].name);
            return Err(PhysicsError::Value { object, quantity, value, must: "finite" });
        }
        let mass = model.bodies[0].mass + self.base_mass;
        // A fixed root does not move, so nothing depends on its mass.
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
        let (seats, mounts) = seats(model);
        let changes = self.body_changes(model);
        let links = self.link_inertias(model, &seats, &changes, mounts.len() + 1);
        let floating = model.root == Root::Floating;
        // The base itself may be massless, as in many URDF files: what is welded to it moves with it.
        if floating && (links[0].mass <= 0.0 || links[0].mass.is_nan()) {
            return Err(base_mass_error(model, links[0].mass, "positive"));
        }
        let weights = invweight::invweights(model, &links, &changes, &self.armature)?;
        let mut pairs = Vec::new();
        // In the order of the compiled pairs: by link, see `compile_with`.
        for link in 0..=mounts.len() {
            for pair in &model.pairs {
                let body = model.geoms[pair.geom].body;
                if seats[body].link == link && (link > 0 || floating) {
                    let [translation, rotation] = weights.bodies[body];
                    pairs.push(PairInvweight { translation, rotation });
                }
            }
        }
        // Own parts follow the pairs with the ground. Both bodies give way, so their inverse inertias add.
        for pair in &model.self_pairs {
            let [first, second] = [0, 1].map(|side| weights.bodies[pair.geoms[side].body]);
            let (translation, rotation) = (first[0] + second[0], first[1] + second[1]);
            pairs.push(PairInvweight { translation, rotation });
        }
        // The step takes inertias. MuJoCo's `invweight0` are their reciprocals.
        let joints =
            weights.joints.iter().enumerate().map(|(j, weight)| self.joint_params(j, 1.0 / weight)).collect();
        let free = match model.free_joint {
            Some(_) if floating => weights.free.map(|weight| 1.0 / weight).to_vec(),
            _ => Vec::new(),
        };
        Ok(Params { links, joints, pairs, free, robot: self.robot_params() })
    }

    /// How each body of the model differs from its file, by the link that it is part of. Whatever the numbers, a body is
    /// one that there can be: a factor on mass and inertia together, and a shift of both, keep every inertia positive
    /// definite and its triangle inequalities (Wensing, Kim and Slotine 2018).
    pub fn body_changes(&self, model: &Model) -> Vec<BodyChange> {
        let (seats, _) = seats(model);
        let none = BodyChange { factor: 1.0, shift: [0.0; 3] };
        let mut changes = vec![none; model.bodies.len()];
        for (j, (joint, side)) in model.joints.iter().zip(sides(model)).enumerate() {
            // Joint j moves link j + 1; link 0 is the root.
            let factor = self.link_mass[j];
            let shift = [self.link_com_x[j], side * self.link_com_y[j], self.link_com_z[j]];
            // The shift is in the axes of the joint's body; every body welded to it takes the same shift in
            // its own axes.
            let turned = rotate(&seats[joint.body].rotation, shift);
            for (change, seat) in changes.iter_mut().zip(&seats).filter(|(_, seat)| seat.link == j + 1) {
                change.factor *= factor;
                if shift != [0.0; 3] {
                    change.shift = rotate_back(&seat.rotation, turned);
                }
            }
        }
        changes
    }

    /// Bodies welded into links: masses add, inertias add about the common centre of mass.
    fn link_inertias(
        &self,
        model: &Model,
        seats: &[Seat],
        changes: &[BodyChange],
        count: usize,
    ) -> Vec<LinkInertia<f64>> {
        let mut links = vec![LinkInertia { mass: 0.0, com: [0.0; 3], inertia: [0.0; 6] }; count];
        // Second moments about the link origin, turned into central ones at the end.
        for (index, ((body, seat), change)) in model.bodies.iter().zip(seats).zip(changes).enumerate() {
            let (mut mass, mut ipos) = (change.factor * body.mass, change.moved(body.ipos));
            // Only the base itself gets these; bodies that are welded to it stay as they are.
            if index == 0 {
                mass += self.base_mass;
                ipos = add(ipos, self.base_com);
            }
            let com = add(seat.position, rotate(&seat.rotation, ipos));
            let inertia = sym_rotate(&seat.rotation, &body_inertia(body)).map(|one| change.factor * one);
            put(&mut links[seat.link], mass, com, &inertia);
            if index == 0 && self.payload_mass != 0.0 {
                let place = add(seat.position, rotate(&seat.rotation, self.payload_position));
                // A point has no inertia about itself.
                put(&mut links[seat.link], self.payload_mass, place, &[0.0; 6]);
            }
        }
        for link in &mut links {
            // A massless link, such as a fixed root without a body of weight, has no centre of mass.
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
    // Until all bodies are added, `com` holds the sum of mass times place.
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
