//! Motion, momentum and inverse dynamics of a tree of hinges and slides whose base moves as given.
//!
//! Newton and Euler's equations, body by body, in world axes (Featherstone 2008, "Rigid Body Dynamics Algorithms",
//! section 5.3, in vectors). Armature, damping, friction and springs of the joints are left out: they are what is asked for.

use gaitfit_model::kinematics::Frame;
use gaitfit_model::rotation::{Quat, Vec3, add, cross, dot, product, rotate, rotate_back, sub};
use gaitfit_model::{Geom, Joint, JointAxis, JointKind, Model, Shape};

/// How the root body moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseMotion {
    /// Orientation, wxyz, unit, base to world.
    pub quaternion: Quat,
    /// Angular velocity, rad/s, base frame.
    pub angular_velocity: Vec3,
    /// Its derivative, rad/s², base frame.
    pub angular_acceleration: Vec3,
    /// Velocity of the base's origin, m/s, world axes.
    pub linear_velocity: Vec3,
    /// Acceleration of the base's origin without gravity, m/s², world axes.
    pub linear_acceleration: Vec3,
}

impl BaseMotion {
    /// A base at rest with this orientation (wxyz).
    pub fn at_rest(quaternion: Quat) -> Self {
        Self {
            quaternion,
            angular_velocity: [0.0; 3],
            angular_acceleration: [0.0; 3],
            linear_velocity: [0.0; 3],
            linear_acceleration: [0.0; 3],
        }
    }
}

/// Motion of a body. World axes; positions from the base's origin.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// Orientation, wxyz.
    pub quaternion: Quat,
    /// Origin of the body's frame, m.
    pub origin: Vec3,
    /// Angular velocity, rad/s.
    pub omega: Vec3,
    /// Velocity of the origin, m/s.
    pub velocity: Vec3,
    alpha: Vec3,
    acceleration: Vec3,
}

impl Link {
    /// A point of the body's frame, m.
    pub fn point(&self, inner: Vec3) -> Vec3 {
        add(self.origin, rotate(self.quaternion, inner))
    }

    /// Velocity of the material point that is now at `point`, m/s.
    pub fn velocity_at(&self, point: Vec3) -> Vec3 {
        add(self.velocity, cross(self.omega, sub(point, self.origin)))
    }

    fn frame(&self) -> Frame {
        Frame { position: self.origin, quaternion: self.quaternion }
    }

    fn acceleration_at(&self, point: Vec3) -> Vec3 {
        let r = sub(point, self.origin);
        let turning = add(cross(self.alpha, r), cross(self.omega, cross(self.omega, r)));
        add(self.acceleration, turning)
    }
}

/// Axis of a joint, and how the body that holds it moves. World axes; positions from the base's origin.
#[derive(Clone, Copy, Debug)]
struct Axis {
    joint: JointAxis,
    anchor_velocity: Vec3,
    omega: Vec3,
}

impl Link {
    /// The link after a joint of its body, and the joint's axis.
    fn after(self, joint: &Joint, q: f64, dq: f64, ddq: f64) -> (Self, Axis) {
        let axis = joint.axis_at(&self.frame());
        let moved = joint.moved(&self.frame(), q);
        let rate = axis.axis.map(|x| x * dq);
        let mut link = Self { quaternion: moved.quaternion, origin: moved.position, ..self };
        let anchor_velocity = self.velocity_at(axis.anchor);
        match joint.kind {
            JointKind::Hinge => {
                link.alpha = add(self.alpha, add(axis.axis.map(|x| x * ddq), cross(self.omega, rate)));
                link.omega = add(self.omega, rate);
                // The anchor moves with both bodies.
                let at_anchor = Self {
                    origin: axis.anchor,
                    velocity: anchor_velocity,
                    acceleration: self.acceleration_at(axis.anchor),
                    ..link
                };
                link.velocity = at_anchor.velocity_at(moved.position);
                link.acceleration = at_anchor.acceleration_at(moved.position);
            }
            JointKind::Slide => {
                let coriolis = cross(self.omega, rate).map(|x| 2.0 * x);
                link.velocity = add(self.velocity_at(moved.position), rate);
                let along = add(axis.axis.map(|x| x * ddq), coriolis);
                link.acceleration = add(self.acceleration_at(moved.position), along);
            }
        }
        (link, Axis { joint: axis, anchor_velocity, omega: self.omega })
    }
}

/// Motion of all bodies and joint axes at one moment.
#[derive(Clone, Debug)]
pub struct Motion<'m> {
    model: &'m Model,
    links: Vec<Link>,
    axes: Vec<Axis>,
}

/// What the momentum form of a joint's equation of motion is made of: torque = d(momentum)/dt + rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointMomentum {
    /// Momentum along the joint: ∂L/∂q̇ with L the Lagrangian, N·m·s; of a slide N·s.
    pub momentum: f64,
    /// −∂L/∂q, N·m; of a slide N: what velocities and gravity demand.
    pub rest: f64,
    /// How both change with the velocity of the base's origin, world axes: kg·m and kg·m/s; of a slide kg and kg/s.
    pub by_base: [Vec3; 2],
}

impl JointMomentum {
    /// Both after `velocity`, m/s, world axes, is added to the velocity of the base's origin.
    pub fn boosted(&self, velocity: Vec3) -> Self {
        let [momentum, rest] = self.by_base.map(|by_base| dot(by_base, velocity));
        Self { momentum: self.momentum + momentum, rest: self.rest + rest, ..*self }
    }
}

/// A linear and an angular vector, the angular one about the base's origin.
type Pair = [Vec3; 2];

impl<'m> Motion<'m> {
    /// At joint positions `q` (rad), rates `dq` (rad/s) and accelerations `ddq` (rad/s²), of slides in m, all in model order.
    pub fn new(model: &'m Model, base: &BaseMotion, q: &[f64], dq: &[f64], ddq: &[f64]) -> Self {
        let mut links: Vec<Link> = Vec::with_capacity(model.bodies.len());
        let mut axes = Vec::with_capacity(model.joints.len());
        let mut next = 0;
        for (index, body) in model.bodies.iter().enumerate() {
            let mut link = match body.parent {
                Some(parent) => {
                    let parent = &links[parent];
                    let origin = parent.point(body.pos);
                    Link {
                        quaternion: product(parent.quaternion, body.quat),
                        velocity: parent.velocity_at(origin),
                        acceleration: parent.acceleration_at(origin),
                        origin,
                        ..*parent
                    }
                }
                None => Link {
                    quaternion: base.quaternion,
                    origin: [0.0; 3],
                    omega: rotate(base.quaternion, base.angular_velocity),
                    alpha: rotate(base.quaternion, base.angular_acceleration),
                    velocity: base.linear_velocity,
                    acceleration: base.linear_acceleration,
                },
            };
            // Joints are listed in the bodies' order.
            while let Some(joint) = model.joints.get(next).filter(|joint| joint.body == index) {
                let axis;
                (link, axis) = link.after(joint, q[next], dq[next], ddq[next]);
                axes.push(axis);
                next += 1;
            }
            links.push(link);
        }
        Self { model, links, axes }
    }

    /// Motion of a body, by index.
    pub fn link(&self, body: usize) -> &Link {
        &self.links[body]
    }

    /// The point of a geom that is nearest to level ground, m, world axes, from the base's origin. Of a shape that lies
    /// flat, the middle of what lies.
    pub fn lowest_point(&self, geom: &Geom) -> Vec3 {
        /// Corners within this height of the lowest one lie too, m.
        const LIES: f64 = 0.003;
        let link = &self.links[geom.body];
        let centre = link.point(geom.pos);
        let turn = product(link.quaternion, geom.quat);
        let mut corners: Vec<Vec3> = Vec::with_capacity(8);
        let (half, drop) = match geom.shape {
            Shape::Sphere { radius } => return sub(centre, [0.0, 0.0, radius]),
            Shape::Capsule { radius, half_length } => ([0.0, 0.0, half_length], radius),
            Shape::Cylinder { radius, half_length } => ([radius, radius, half_length], 0.0),
            Shape::Box { half_size } => (half_size, 0.0),
        };
        for corner in 0..8usize {
            let sign = |bit: usize| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let inner = std::array::from_fn(|k| sign(k) * half[k]);
            corners.push(add(centre, rotate(turn, inner)));
        }
        let lowest = corners.iter().map(|corner| corner[2]).fold(f64::INFINITY, f64::min);
        corners.retain(|corner| corner[2] <= lowest + LIES);
        let count = corners.len() as f64;
        let sum = corners.iter().fold([0.0; 3], |sum, corner| add(sum, *corner));
        sub(sum.map(|x| x / count), [0.0, 0.0, drop])
    }

    /// Velocity that a joint alone, at 1 rad/s or 1 m/s, gives to a point of what it moves, m/s, world axes.
    pub fn lever(&self, joint: usize, point: Vec3) -> Vec3 {
        self.axes[joint].joint.lever(point)
    }

    /// Sums over every body's subtree of a wrench of each body.
    fn subtree(&self, of: impl Fn(usize, &Link) -> Pair) -> Vec<Pair> {
        let mut sums: Vec<Pair> = self.links.iter().enumerate().map(|(body, link)| of(body, link)).collect();
        for body in (1..sums.len()).rev() {
            if let Some(parent) = self.model.bodies[body].parent {
                let [force, moment] = sums[body];
                sums[parent] = [add(sums[parent][0], force), add(sums[parent][1], moment)];
            }
        }
        sums
    }

    /// A vector that acts at the centre of mass and one about it, about the base's origin.
    fn about_base(&self, body: usize, link: &Link, linear: Vec3, angular: Vec3) -> Pair {
        let com = link.point(self.model.bodies[body].ipos);
        [linear, add(angular, cross(com, linear))]
    }

    /// The body's inertia about its centre of mass times a vector.
    fn inertia_times(&self, body: usize, link: &Link, v: Vec3) -> Vec3 {
        let body = &self.model.bodies[body];
        let turn = product(link.quaternion, body.iquat);
        let inner = rotate_back(turn, v);
        rotate(turn, std::array::from_fn(|k| body.inertia[k] * inner[k]))
    }

    /// Torques (N·m, of slides forces, N; model order) that the joints need for this motion against inertia and gravity, and the force (N)
    /// and the moment about the base's origin (N·m) that the root body needs from outside, world axes.
    pub fn inverse_dynamics(&self) -> (Vec<f64>, Pair) {
        let gravity = self.model.options.gravity;
        let sums = self.subtree(|body, link| {
            let part = &self.model.bodies[body];
            let force = sub(link.acceleration_at(link.point(part.ipos)), gravity).map(|x| x * part.mass);
            let moment = add(
                self.inertia_times(body, link, link.alpha),
                cross(link.omega, self.inertia_times(body, link, link.omega)),
            );
            self.about_base(body, link, force, moment)
        });
        let torque = |(joint, axis): (&Joint, &Axis)| {
            let [force, moment] = sums[joint.body];
            axis.joint.share_of(force, moment)
        };
        let torques = self.model.joints.iter().zip(&self.axes).map(torque).collect();
        (torques, sums.first().copied().unwrap_or_default())
    }

    /// The momentum form of every joint's equation, model order, and the momentum of the whole robot, N·s, world axes. It needs
    /// no accelerations.
    pub fn momentum(&self) -> (Vec<JointMomentum>, Vec3) {
        let gravity = self.model.options.gravity;
        let momenta = self.subtree(|body, link| {
            let part = &self.model.bodies[body];
            let linear = link.velocity_at(link.point(part.ipos)).map(|x| x * part.mass);
            self.about_base(body, link, linear, self.inertia_times(body, link, link.omega))
        });
        // Mass in the place of the force's first component: a subtree's mass and its first moment.
        let masses = self.subtree(|body, link| {
            let part = &self.model.bodies[body];
            [[part.mass, 0.0, 0.0], link.point(part.ipos).map(|x| x * part.mass)]
        });
        let terms = |(joint, axis): (&Joint, &Axis)| {
            let [linear, angular] = momenta[joint.body];
            let [[mass, ..], moment] = masses[joint.body];
            let along = &axis.joint;
            let axis_rate = cross(axis.omega, along.axis);
            let (moving, by_base) = match joint.kind {
                JointKind::Hinge => {
                    // d(a·(L − A×P))/dt = a·(dL/dt − A×dP/dt) + da/dt·(L − A×P) − a·(dA/dt×P). The base's origin
                    // moves too. L is taken about it. Its motion cancels in L − A×P if dA/dt is the anchor's full velocity.
                    let about_anchor = sub(angular, cross(along.anchor, linear));
                    let moving =
                        dot(axis_rate, about_anchor) - dot(along.axis, cross(axis.anchor_velocity, linear));
                    // If the base's velocity changes by v, then P changes by m v, L by S×v and dA/dt by v. S: first moment.
                    let centre = sub(moment, along.anchor.map(|x| x * mass));
                    let anchor_velocity = axis.anchor_velocity.map(|x| x * mass);
                    let boosted = add(cross(linear, along.axis), cross(along.axis, anchor_velocity));
                    let rest = sub(boosted, cross(axis_rate, centre));
                    (moving, [cross(along.axis, centre), rest])
                }
                // d(a·P)/dt = a·dP/dt + da/dt·P.
                JointKind::Slide => {
                    let by_base = [along.axis.map(|x| x * mass), axis_rate.map(|x| -x * mass)];
                    (dot(axis_rate, linear), by_base)
                }
            };
            JointMomentum {
                momentum: along.share_of(linear, angular),
                rest: -moving - along.share_of(gravity.map(|x| x * mass), cross(moment, gravity)),
                by_base,
            }
        };
        let whole = momenta.first().map_or([0.0; 3], |[linear, _]| *linear);
        (self.model.joints.iter().zip(&self.axes).map(terms).collect(), whole)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_model::rotation::{axis_angle, normalize};

    /// A smooth motion: base and joints at time t, with derivatives by hand.
    fn base(t: f64) -> BaseMotion {
        // Rates in the base frame; the orientation follows by integrating them, below.
        let (s, c) = (3.0 * t).sin_cos();
        BaseMotion {
            quaternion: gaitfit_model::rotation::IDENTITY,
            angular_velocity: [0.5 * s, -0.8 * c, 0.3 + 0.2 * s],
            angular_acceleration: [1.5 * c, 2.4 * s, 0.6 * c],
            linear_velocity: [0.4 * s, 0.2 * c, 0.5 * s * c],
            linear_acceleration: [1.2 * c, -0.6 * s, 1.5 * (c * c - s * s)],
        }
    }

    fn joints(t: f64, count: usize) -> [Vec<f64>; 3] {
        let phase = |j: usize| 0.7 * j as f64;
        let q = (0..count).map(|j| 0.4 * (7.0 * t + phase(j)).sin()).collect();
        let dq = (0..count).map(|j| 2.8 * (7.0 * t + phase(j)).cos()).collect();
        let ddq = (0..count).map(|j| -19.6 * (7.0 * t + phase(j)).sin()).collect();
        [q, dq, ddq]
    }

    /// The momentum form and the one with accelerations are two algorithms for one torque.
    #[test]
    fn momentum_and_accelerations_ask_for_the_same_torque() {
        ask_for_the_same(&gaitfit_model::builtin::go2().unwrap());
        ask_for_the_same(&telescope());
    }

    /// A robot with hinges, slides, and both beyond each other.
    fn telescope() -> Model {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../gaitfit-physics/tests/fixtures/telescope.xml");
        gaitfit_model::read(std::path::Path::new(file), &gaitfit_model::ReadOptions::default()).unwrap()
    }

    fn ask_for_the_same(model: &Model) {
        let count = model.joints.len();
        let h = 1e-4;
        let turned = |from: Quat, t: f64, h: f64| {
            // One step of the midpoint rule of the attitude.
            let rate = base(t + h / 2.0).angular_velocity;
            let speed = dot(rate, rate).sqrt();
            normalize(product(from, axis_angle(rate.map(|x| x / speed), speed * h)))
        };
        let start = normalize([0.9, 0.2, -0.3, 0.1]);
        let at = |quaternion: Quat, t: f64| {
            let [q, dq, ddq] = joints(t, count);
            Motion::new(model, &BaseMotion { quaternion, ..base(t) }, &q, &dq, &ddq)
        };
        let t = 0.3;
        let (torques, _) = at(start, t).inverse_dynamics();
        let (before, after) =
            (at(turned(start, t, -h), t - h).momentum().0, at(turned(start, t, h), t + h).momentum().0);
        let (here, _) = at(start, t).momentum();
        for joint in 0..count {
            let rate = (after[joint].momentum - before[joint].momentum) / (2.0 * h);
            let torque = rate + here[joint].rest;
            assert!(
                (torque - torques[joint]).abs() < 1e-5,
                "joint {joint}: {torque}, not {}",
                torques[joint]
            );
        }
        let push: Vec3 = [0.3, -0.2, 0.5];
        let [q, dq, ddq] = joints(t, count);
        let moved =
            BaseMotion { quaternion: start, linear_velocity: add(base(t).linear_velocity, push), ..base(t) };
        let (faster, _) = Motion::new(model, &moved, &q, &dq, &ddq).momentum();
        for (joint, (here, faster)) in here.iter().zip(&faster).enumerate() {
            let boosted = here.boosted(push);
            let apart = (boosted.momentum - faster.momentum).abs().max((boosted.rest - faster.rest).abs());
            assert!(apart < 1e-12, "joint {joint}: {boosted:?}, not {faster:?}");
        }
    }

    /// A mass that slides along a pendulum, by hand: m (r̈ − r θ̇² − g cos θ), and at the hinge m r² θ̈ + I θ̈ + 2 m r ṙ θ̇ +
    /// m g r sin θ.
    #[test]
    fn a_slide_on_a_pendulum_needs_what_the_book_says() {
        let text = r#"<mujoco><compiler angle="radian"/><worldbody><geom type="plane" size="1 1 1"/>
            <body><freejoint/><geom type="box" size=".1 .1 .1"/>
              <body><joint axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
              <body pos="0 0 -0.4"><joint type="slide" axis="0 0 -1" ref="0.1" pos="0.3 0 0"/>
                <inertial pos="0 0 0" mass="2" diaginertia="0.1 0.2 0.3"/></body></body>
            </body></worldbody></mujoco>"#;
        let model = gaitfit_model::read_mjcf_str(text, &gaitfit_model::ReadOptions::default()).unwrap();
        let base = BaseMotion::at_rest(gaitfit_model::rotation::IDENTITY);
        let ([angle, turning, faster], [along, speed, push]) = ([0.3, 1.7, -4.0], [0.25, 0.8, 3.0]);
        let motion = Motion::new(&model, &base, &[angle, along], &[turning, speed], &[faster, push]);
        let (mass, r, g) = (2.0, 0.4 + along - 0.1, 9.81);
        let (torques, [force, _]) = motion.inverse_dynamics();
        let at_slide = mass * (push - r * turning * turning - g * angle.cos());
        let at_hinge =
            (mass * r * r + 0.21) * faster + 2.0 * mass * r * speed * turning + mass * g * r * angle.sin();
        assert!((torques[1] - at_slide).abs() < 1e-12, "{}, not {at_slide}", torques[1]);
        assert!((torques[0] - at_hinge).abs() < 1e-12, "{}, not {at_hinge}", torques[0]);
        let (momentum, _) = motion.momentum();
        assert!((momentum[1].momentum - mass * speed).abs() < 1e-12);
        let rest = -mass * (r * turning * turning + g * angle.cos());
        assert!((momentum[1].rest - rest).abs() < 1e-12);
        assert!(force.iter().all(|part| part.is_finite()));
        let lever = motion.lever(1, [0.2, 0.1, 0.5]);
        assert!(
            (lever[0] + angle.sin()).abs() < 1e-12 && (lever[2] + angle.cos()).abs() < 1e-12,
            "{lever:?}"
        );
    }

    /// A pendulum by hand: m l² q̈ + I q̈ + m g l sin q.
    #[test]
    fn a_pendulum_needs_what_the_book_says() {
        let text = r#"<mujoco><compiler angle="radian"/><worldbody><geom type="plane" size="1 1 1"/>
            <body><freejoint/><geom type="box" size=".1 .1 .1"/>
              <body><joint axis="0 1 0"/><inertial pos="0 0 -0.5" mass="2" diaginertia="0.1 0.2 0.3"/></body>
            </body></worldbody></mujoco>"#;
        let model = gaitfit_model::read_mjcf_str(text, &gaitfit_model::ReadOptions::default()).unwrap();
        let base = BaseMotion::at_rest(gaitfit_model::rotation::IDENTITY);
        let motion = Motion::new(&model, &base, &[0.3], &[1.7], &[-4.0]);
        let by_hand = (2.0 * 0.25 + 0.2) * -4.0 + 2.0 * 9.81 * 0.5 * 0.3f64.sin();
        let (torques, _) = motion.inverse_dynamics();
        assert!((torques[0] - by_hand).abs() < 1e-12, "{}, not {by_hand}", torques[0]);
        let momentum = motion.momentum().0[0];
        assert!((momentum.momentum - 0.7 * 1.7).abs() < 1e-12);
        assert!((momentum.rest - 9.81 * 0.3f64.sin()).abs() < 1e-12);
    }
}
