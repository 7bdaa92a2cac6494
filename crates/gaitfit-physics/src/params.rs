//! What may differ from one environment to the next, and how a robot's numbers become it.

use gaitfit_model::{Model, Root};

use crate::seat::{Seat, body_inertia, seats};
use crate::vec3::*;
use crate::{PhysicsError, Real, invweight};

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

/// Parameters of one joint and of the PD controller that drives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointParams<T> {
    /// Reflected rotor inertia, kg·m².
    pub armature: T,
    /// Viscous damping, N·m·s/rad.
    pub damping: T,
    /// Dry friction torque, N·m.
    pub frictionloss: T,
    /// Inertia seen by the joint at the reference pose, kg·m² (the reciprocal of MuJoCo's `dof_invweight0`).
    pub weight: T,
    /// Position gain, N·m/rad.
    pub kp: T,
    /// Velocity gain, N·m·s/rad.
    pub kd: T,
    /// Factor on the PD torque.
    pub torque_scale: T,
    /// Constant torque added to the PD torque, N·m.
    pub torque_offset: T,
    /// Largest torque magnitude, N·m.
    pub torque_limit: T,
    /// Encoder reading minus true angle, rad.
    pub encoder_bias: T,
    /// Time from sending a target to its effect, s.
    pub delay: T,
}

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
    /// One a compiled contact pair, in `Tree` order.
    pub pairs: Vec<PairInvweight<T>>,
    /// Factor on all contact friction coefficients.
    pub friction_scale: T,
}

/// A robot as a person would describe it: the model's own numbers, changed joint by joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Reflected rotor inertia, kg·m²; one a joint.
    pub armature: Vec<f64>,
    /// Viscous damping, N·m·s/rad; one a joint.
    pub damping: Vec<f64>,
    /// Dry friction torque, N·m; one a joint.
    pub frictionloss: Vec<f64>,
    /// Actuation delay, s; one a joint.
    pub delay: Vec<f64>,
    /// Encoder reading minus true angle, rad; one a joint.
    pub encoder_bias: Vec<f64>,
    /// Factor on the PD torque; one a joint.
    pub torque_scale: Vec<f64>,
    /// Constant torque added to the PD torque, N·m; one a joint.
    pub torque_offset: Vec<f64>,
    /// Position gain, N·m/rad; one a joint.
    pub kp: Vec<f64>,
    /// Velocity gain, N·m·s/rad; one a joint.
    pub kd: Vec<f64>,
    /// Largest torque magnitude, N·m; one a joint.
    pub torque_limit: Vec<f64>,
    /// Mass added to the root body, kg, at its centre of mass.
    pub base_mass: f64,
    /// Shift of the root body's centre of mass, m, body frame.
    pub base_com: [f64; 3],
    /// Factor on all contact friction coefficients.
    pub friction_scale: f64,
}

impl Robot {
    /// The model's own numbers; no delay, no bias, zero PD gains, torque limits from the joints and actuators.
    pub fn nominal(model: &Model) -> Self {
        let each = |f: &dyn Fn(&gaitfit_model::Joint) -> f64| model.joints.iter().map(f).collect::<Vec<_>>();
        let n = model.joints.len();
        let mut limit = each(&|j| j.actuatorfrcrange.map_or(f64::INFINITY, |r| r[1].min(-r[0])));
        for actuator in &model.actuators {
            // A motor's control is its torque.
            let motor = actuator.gain == 1.0 && actuator.bias == [0.0; 3];
            let ranges = [if motor { actuator.ctrlrange } else { None }, actuator.forcerange];
            for range in ranges.into_iter().flatten() {
                let most = actuator.gear.abs() * range[1].min(-range[0]);
                if most > 0.0 {
                    limit[actuator.joint] = limit[actuator.joint].min(most);
                }
            }
        }
        Self {
            armature: each(&|j| j.armature),
            damping: each(&|j| j.damping),
            frictionloss: each(&|j| j.frictionloss),
            delay: vec![0.0; n],
            encoder_bias: vec![0.0; n],
            torque_scale: vec![1.0; n],
            torque_offset: vec![0.0; n],
            kp: vec![0.0; n],
            kd: vec![0.0; n],
            torque_limit: limit,
            base_mass: 0.0,
            base_com: [0.0; 3],
            friction_scale: 1.0,
        }
    }

    fn check(&self, model: &Model) -> Result<(), PhysicsError> {
        let n = model.joints.len();
        let positive: [(&'static str, &Vec<f64>, bool); 10] = [
            ("armature", &self.armature, true),
            ("damping", &self.damping, true),
            ("frictionloss", &self.frictionloss, true),
            ("delay", &self.delay, true),
            ("encoder_bias", &self.encoder_bias, false),
            ("torque_scale", &self.torque_scale, false),
            ("torque_offset", &self.torque_offset, false),
            ("kp", &self.kp, false),
            ("kd", &self.kd, false),
            ("torque_limit", &self.torque_limit, true),
        ];
        for (what, values, signed) in positive {
            if values.len() != n {
                return Err(PhysicsError::Length { what, found: values.len(), expected: n });
            }
            for (value, joint) in values.iter().zip(&model.joints) {
                if value.is_nan() || (signed && *value < 0.0) {
                    return Err(PhysicsError::Value {
                        object: format!("joint `{}`", joint.name),
                        quantity: what,
                        value: *value,
                        must: if signed { "zero or positive" } else { "a number" },
                    });
                }
            }
        }
        let mass = model.bodies[0].mass + self.base_mass;
        if !(mass > 0.0 || model.root == Root::Fixed) {
            return Err(PhysicsError::Value {
                object: format!("body `{}`", model.bodies[0].name),
                quantity: "the mass with the added base mass",
                value: mass,
                must: "positive",
            });
        }
        Ok(())
    }

    /// Parameters of one environment with this robot. Costs a dense factorisation: done once a robot, not a step.
    pub fn params(&self, model: &Model) -> Result<Params<f64>, PhysicsError> {
        self.check(model)?;
        let (seats, hinges) = seats(model);
        let links = self.link_inertias(model, &seats, hinges.len() + 1);
        let weights = invweight::invweights(model, &links, &self.armature)?;
        let floating = model.root == Root::Floating;
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
        let joints = (0..model.joints.len())
            .map(|j| JointParams {
                armature: self.armature[j],
                damping: self.damping[j],
                frictionloss: self.frictionloss[j],
                weight: 1.0 / weights.joints[j],
                kp: self.kp[j],
                kd: self.kd[j],
                torque_scale: self.torque_scale[j],
                torque_offset: self.torque_offset[j],
                torque_limit: self.torque_limit[j].min(1e30),
                encoder_bias: self.encoder_bias[j],
                delay: self.delay[j],
            })
            .collect();
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
            let link = &mut links[seat.link];
            link.mass += mass;
            link.com = axpy(mass, com, link.com);
            let about_origin = steiner(mass, com);
            for k in 0..6 {
                link.inertia[k] += inertia[k] + about_origin[k];
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

/// `m (c·c 1 − c cᵀ)`.
fn steiner(m: f64, c: V3<f64>) -> Sym3<f64> {
    let [x, y, z] = c;
    [m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y), -m * x * y, -m * x * z, -m * y * z]
}

impl<T: Real> Params<T> {
    /// The element-wise combination of one set a lane, by `pack` (one value a lane to one `T`).
    pub fn pack(sets: &[&Params<f64>], pack: impl Fn(&dyn Fn(&Params<f64>) -> f64) -> T) -> Self {
        let first = sets[0];
        let links = (0..first.links.len())
            .map(|i| LinkInertia {
                mass: pack(&|p| p.links[i].mass),
                com: each3!(k => pack(&|p| p.links[i].com[k])),
                inertia: std::array::from_fn(|k| pack(&|p| p.links[i].inertia[k])),
            })
            .collect();
        let joints = (0..first.joints.len())
            .map(|j| JointParams {
                armature: pack(&|p| p.joints[j].armature),
                damping: pack(&|p| p.joints[j].damping),
                frictionloss: pack(&|p| p.joints[j].frictionloss),
                weight: pack(&|p| p.joints[j].weight),
                kp: pack(&|p| p.joints[j].kp),
                kd: pack(&|p| p.joints[j].kd),
                torque_scale: pack(&|p| p.joints[j].torque_scale),
                torque_offset: pack(&|p| p.joints[j].torque_offset),
                torque_limit: pack(&|p| p.joints[j].torque_limit),
                encoder_bias: pack(&|p| p.joints[j].encoder_bias),
                delay: pack(&|p| p.joints[j].delay),
            })
            .collect();
        let pairs = (0..first.pairs.len())
            .map(|i| PairInvweight {
                translation: pack(&|p| p.pairs[i].translation),
                rotation: pack(&|p| p.pairs[i].rotation),
            })
            .collect();
        Params { links, joints, pairs, friction_scale: pack(&|p| p.friction_scale) }
    }
}
