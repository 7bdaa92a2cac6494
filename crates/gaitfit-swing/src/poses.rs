//! What follows from a walk's poses alone, before the base's velocity, the delay and the joints' drag are estimated. The passes of
//! an estimate share it.
//!
//! Momenta and forces are linear in the velocity of the base's origin, so that velocity can be added afterwards.

use crate::dynamics::{BaseMotion, JointMomentum, Motion};
use crate::walk::Walk;
use gaitfit_model::rotation::Vec3;
use gaitfit_model::{Model, Root};

/// A body at the end of a limb that may touch the ground.
#[derive(Clone, Debug)]
pub(crate) struct End {
    /// The body.
    pub body: usize,
    /// Its geoms that may touch.
    geoms: Vec<usize>,
    /// Joints that move it.
    pub chain: Vec<usize>,
    /// Place of its first joint among the joints of all chains.
    first_lever: usize,
}

/// The end of a limb at one moment, if the base's origin rests. World axes; positions from the base's origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tip {
    /// Its lowest point, m.
    pub point: Vec3,
    /// Velocity of that point, m/s.
    pub velocity: Vec3,
}

/// Poses of one walk at all grid points.
#[derive(Clone, Debug, Default)]
pub(crate) struct Poses {
    /// Ends of limbs; none of a clamped robot.
    pub ends: Vec<End>,
    /// Each end at each grid point; `len × ends`.
    pub tips: Vec<Tip>,
    /// For each joint of each end's chain, the Jacobian's column of the end's lowest point, m/s for 1 rad/s or 1 m/s; `len × all
    /// chains`.
    levers: Vec<Vec3>,
    /// Velocity of the centre of mass if the base's origin rests, m/s; `len`.
    pub com_velocity: Vec<Vec3>,
    /// The momentum form of each joint if the base's origin rests; `len × joints`.
    pub momenta: Vec<JointMomentum>,
}

impl Poses {
    /// Computes the poses at all grid points of a walk. The walk has the model's joints, in the model's order.
    pub fn new(model: &Model, walk: &Walk) -> Self {
        let (points, joints) = (walk.points(), walk.joints);
        let ends = if model.root == Root::Fixed { Vec::new() } else { ends(model, joints) };
        let mass = model.bodies.iter().map(|body| body.mass).sum::<f64>();
        // Momenta and velocities do not depend on accelerations.
        let zeros = vec![0.0; joints];
        let mut poses = Self {
            tips: Vec::with_capacity(points * ends.len()),
            levers: Vec::with_capacity(points * levers_per_point(&ends)),
            com_velocity: Vec::with_capacity(points),
            momenta: Vec::with_capacity(points * joints),
            ends,
        };
        for point in 0..points {
            // Only the turning of the base is measured. Its origin is at rest here; its velocity is added later.
            let base = BaseMotion {
                angular_velocity: walk.rates[point],
                ..BaseMotion::at_rest(walk.quaternion[point])
            };
            let motion = Motion::new(model, &base, walk.q_at(point), walk.dq_at(point), &zeros);
            let (momenta, whole) = motion.momentum();
            poses.momenta.extend(momenta);
            poses.com_velocity.push(whole.map(|p| p / mass));
            // The point of a limb's end that would touch first, and the Jacobian there.
            for end in &poses.ends {
                let lowest = end
                    .geoms
                    .iter()
                    .map(|&geom| motion.lowest_point(&model.geoms[geom]))
                    .min_by(|a, b| a[2].total_cmp(&b[2]))
                    .unwrap_or_default();
                let velocity = motion.link(end.body).velocity_at(lowest);
                poses.tips.push(Tip { point: lowest, velocity });
                poses.levers.extend(end.chain.iter().map(|&joint| motion.lever(joint, lowest)));
            }
        }
        poses
    }

    /// The ends of all limbs at a grid point.
    pub fn tips_at(&self, point: usize) -> &[Tip] {
        &self.tips[point * self.ends.len()..(point + 1) * self.ends.len()]
    }

    /// Levers of the joints in the chain of an end.
    pub fn levers(&self, point: usize, end: &End) -> &[Vec3] {
        let first = point * levers_per_point(&self.ends) + end.first_lever;
        &self.levers[first..first + end.chain.len()]
    }
}

/// Joints in the chains of all ends.
fn levers_per_point(ends: &[End]) -> usize {
    ends.last().map_or(0, |last| last.first_lever + last.chain.len())
}

/// Bodies at the end of limbs that may touch the ground, with their geoms and joints.
fn ends(model: &Model, joints: usize) -> Vec<End> {
    let mut geoms: Vec<Vec<usize>> = vec![Vec::new(); model.bodies.len()];
    for pair in &model.pairs {
        let list = &mut geoms[model.geoms[pair.geom].body];
        // A geom that may touch several others is in several pairs.
        if !list.contains(&pair.geom) {
            list.push(pair.geom);
        }
    }
    // A body counts as an end if it may touch and nothing below it may.
    let mut touches: Vec<bool> = geoms.iter().map(|geoms| !geoms.is_empty()).collect();
    // Parents come before their children, so one pass backwards reaches all ancestors.
    for body in (1..touches.len()).rev() {
        if let Some(parent) = model.bodies[body].parent {
            touches[parent] |= touches[body];
        }
    }
    // Of a limb whose shank and foot may touch, only the foot is an end.
    let last = |body: usize| {
        !(0..model.bodies.len()).any(|child| model.bodies[child].parent == Some(body) && touches[child])
    };
    let mut ends = Vec::new();
    for body in (1..model.bodies.len()).filter(|&body| !geoms[body].is_empty() && last(body)) {
        let chain = (0..joints).filter(|&joint| is_below(model, body, model.joints[joint].body)).collect();
        ends.push(End { body, geoms: geoms[body].clone(), chain, first_lever: levers_per_point(&ends) });
    }
    ends
}

/// Whether `body` is `ancestor` or hangs on it.
fn is_below(model: &Model, mut body: usize, ancestor: usize) -> bool {
    loop {
        if body == ancestor {
            return true;
        }
        match model.bodies[body].parent {
            Some(parent) => body = parent,
            None => return false,
        }
    }
}
