//! Contact points of a shape against a plane or an obstacle, and their constraint rows.
//!
//! Points and distances are MuJoCo's (`engine_collision_primitive`): sphere 1 point, capsule 2, cylinder 4,
//! box 4. A box gives the lower one of each pair of opposite corners, which is what "the corners below the
//! centre" means except where a corner is exactly level with it.

use crate::Real;
use crate::separate::separate;
use crate::smooth::Pass;
use crate::spatial::V6;
use crate::state::{Point, Pose, Work};
use crate::terrain::Nearest;
use crate::tree::{GroundPlane, Impedance, LinkShape, Pair, TINY, Touched, Tree};
use crate::vec3::*;
use gaitfit_model::MIN_FRICTION;

/// Impedance at violation `pos` (MuJoCo, "Solver parameters", the d(r) curve).
#[inline(always)]
pub(crate) fn impedance<T: Real>(c: &Impedance<T::K>, pos: T) -> T {
    rise(c, pos).fma(T::k(c.rise), T::k(c.dmin))
}

/// How far the impedance has risen at violation `pos`, from 0 to 1: y(x) of the curve.
#[inline(always)]
fn rise<T: Real>(c: &Impedance<T::K>, pos: T) -> T {
    let one = T::lit(1.0);
    // Beyond the width the curve stays at its end.
    let x = (pos.abs() * T::k(c.per_width)).min(one);
    let below = T::k(c.midpoint);
    // Above the midpoint the power law holds for the distance from the end of the curve instead.
    let base = T::select_lt(x, below, x, one - x);
    let mut y = base;
    let mut n = 1;
    // The power belongs to the robot's structure: all lanes make the same number of turns.
    while n < c.power {
        y = y * base;
        n += 1;
    }
    // The fraction of the power by square roots, one a binary digit.
    let (mut root, mut digits) = (base, c.fraction);
    while digits != 0 {
        root = root.max(T::zero()).sqrt();
        if digits >> 63 == 1 {
            y = y * root;
        }
        digits <<= 1;
    }
    T::select_lt(x, below, T::k(c.low) * y, (T::k(c.high)).fnma(y, one))
}

separate! {
    /// Contact points of the pairs of the touching link `place`.
    pub(crate) fn link_contacts<T>(
        pass: &Pass<'_, T>,
        place: usize,
        origin: V3<T>,
        origin_velocity: V3<T>,
        work: &mut Work<T>,
    ) {
        let Pass { tree, params, state } = *pass;
        let (link, segment) = tree.touching[place];
        for index in tree.links[link].pairs.clone() {
            let m = &work.touching[place];
            let pair = &tree.pairs[index];
            // The centre, and a number that its distance from the ground does not fall below.
            let (center, level) = match pair.touched {
                Touched::Plane(plane) => {
                    let plane = &tree.planes[plane];
                    let normal = k3::<T>(&plane.frame[0]);
                    let height = dot_add(normal, origin, -T::k(plane.offset));
                    let center = rotate_k_add(&m.rotation, &pair.center, m.position);
                    (center, dot_add(normal, center, height))
                }
                Touched::Block(block) => {
                    let center = rotate_k_add(&m.rotation, &pair.center, m.position);
                    (center, tree.blocks[block].at_least::<T>(add(center, origin)))
                }
                Touched::Field(field) => {
                    let center = rotate_k_add(&m.rotation, &pair.center, m.position);
                    (center, tree.fields[field].at_least::<T>(add(center, origin)))
                }
            };
            // A pair that is out of reach in all lanes costs no more than this bound.
            let active = level.unless_ge(T::k(pair.reach));
            work.pairs[index].active = active;
            if !T::enter(active) {
                continue;
            }
            // A frictionless pair sets its first coefficient too, because it is handed to `row_scale`.
            for k in 0..(pair.condim - 1).max(1) {
                let mu = params.robot.friction_scale * T::k(pair.friction[k]);
                work.pairs[index].friction[k] = mu.max(T::lit(MIN_FRICTION));
            }
            let friction = work.pairs[index].friction[0];
            let weight = params.pairs[index].translation;
            let rows = Softness::new(pair, params.robot.ground_softness, params.robot.ground_impedance);
            let inverse_scale = row_scale(tree, pair.condim, friction, weight) * rows.gain;
            let points = &mut work.points[pair.points.clone()];
            match pair.touched {
                Touched::Plane(plane) => shape_points(pair, &tree.planes[plane], m, center, level, points),
                _ => obstacle_points(tree, pair, m, center, origin, points),
            }
            for point in points {
                let node = &work.nodes[segment.map_or(0, |segment| tree.segments[segment].parent)];
                let (v, a) = (node.motion.velocity, node.jacobian_acceleration);
                // Motion of the link's point: that of its node, and one column of the Jacobian a joint. The
                // nodes' velocities lack the base's linear velocity, so it comes back here.
                let mut velocity = [v[0], cross_add(v[0], point.x, add(v[1], origin_velocity))];
                let mut acceleration = [a[0], cross_add(a[0], point.x, a[1])];
                if let Some(segment) = segment {
                    let joint = tree.segments[segment].first - 1;
                    // Joints of the segment further out do not move this link.
                    for k in 0..=pair.member {
                        let axis = work.segments[segment].axis[k];
                        let column = cross_add(axis[0], point.x, axis[1]);
                        point.columns[k] = column;
                        let (qd, qacc) = (state.qvel[joint + k], state.qacc[joint + k]);
                        velocity[1] = axpy(qd, column, velocity[1]);
                        acceleration[1] = axpy(qacc, column, acceleration[1]);
                        if pair.condim > 3 {
                            velocity[0] = axpy(qd, axis[0], velocity[0]);
                            acceleration[0] = axpy(qacc, axis[0], acceleration[0]);
                        }
                    }
                }
                point_rows(pair, &rows, velocity, acceleration, inverse_scale, point);
            }
            T::leave(active);
        }
    }
}

/// Factor by which `impedance/(1 − impedance)` becomes D of the normal row (elliptic, frictionless) or of the
/// edges (pyramidal): MuJoCo's `mj_diagApprox` and `mj_makeImpedance`.
#[inline(always)]
pub(crate) fn row_scale<T: Real>(tree: &Tree<T::K>, condim: usize, friction: T, weight: T) -> T {
    if tree.elliptic || condim == 1 {
        weight
    } else {
        // An edge's inverse inertia is (1 + μ²) · invweight; its R is 2μ²/impratio times that.
        let mu2 = friction * friction;
        (mu2 * T::lit(2.0 / tree.impratio.max(TINY))) * (mu2.fma(weight, weight))
    }
}

/// Places and distances of the points.
#[inline(always)]
fn shape_points<T: Real>(
    pair: &Pair<T::K>,
    plane: &GroundPlane<T::K>,
    m: &Pose<T>,
    center: V3<T>,
    level: T,
    points: &mut [Point<T>],
) {
    let normal = k3::<T>(&plane.frame[0]);
    // A point lies halfway between the two surfaces: half the distance below the shape's, with this sign.
    let half = T::lit(-0.5);
    let radius = T::k(pair.radius);
    // Aligned pairs never read their frame: their components are the world's axes in another order.
    for point in points.iter_mut().filter(|_| !pair.aligned) {
        point.frame = [normal, k3::<T>(&plane.frame[1]), k3::<T>(&plane.frame[2])];
    }
    match &pair.shape {
        LinkShape::Sphere => {
            let distance = level - radius;
            points[0].distance = distance;
            points[0].x = axpy(half.fma(distance, -radius), normal, center);
        }
        LinkShape::Capsule { axis, half_length } => {
            let axis = rotate_k_add(&m.rotation, axis, zero3());
            let segment = scale(T::k(*half_length), axis);
            let rise = dot(normal, segment);
            let frame = axis_frame(normal, axis, plane);
            for (index, sign) in [1.0, -1.0].into_iter().enumerate() {
                let sign = T::lit(sign);
                let distance = sign.fma(rise, level) - radius;
                let end = axpy(sign, segment, center);
                points[index].distance = distance;
                points[index].x = axpy(half.fma(distance, -radius), normal, end);
                if !pair.aligned {
                    points[index].frame = frame;
                }
            }
        }
        LinkShape::Cylinder { axis, x_axis, half_length } => {
            let axis = rotate_k_add(&m.rotation, axis, zero3());
            let slope = dot(normal, axis);
            // The axis pointing into the plane.
            let down = T::select_lt(T::zero(), slope, T::lit(-1.0), T::lit(1.0));
            let (axis, slope) = (scale(down, axis), down * slope);
            // From the axis towards the lowest point of the rim: the downward direction without its part
            // along the axis.
            let across = sub(scale(slope, axis), normal);
            // The bound is compared with a squared length, so it is squared too.
            let length2 = dot(across, across);
            let tiny = T::lit(TINY * TINY);
            let by = radius.div(length2.max(tiny).sqrt());
            // A disk parallel to the plane has no lowest point: take its x axis, as MuJoCo does.
            let x_axis = scale(radius, rotate_k_add(&m.rotation, x_axis, zero3()));
            let rim = each3!(i => T::select_lt(length2, tiny, x_axis[i], by * across[i]));
            let drop = dot(rim, normal);
            let half_length = T::k(*half_length);
            let (axis, slope) = (scale(half_length, axis), half_length * slope);
            // Two further points of the near rim, 120° to either side of the lowest one.
            let side = cross(rim, axis);
            let side_scale =
                // A point of the rim at 120° lies half a radius behind the centre and √3/2 radius to the side.
                // A cylinder without length or radius has no side: the bound avoids 0/0.
                (radius * T::lit(3f64.sqrt() / 2.0)).div(dot(side, side).sqrt().max(T::lit(1e-30)));
            let near = add(center, axis);
            let third = axpy(half, rim, near);
            // Lowest point of the near rim, of the far rim, then the two further points of the near rim:
            // MuJoCo's order.
            let spots = [
                (level + slope + drop, add(near, rim)),
                (level - slope + drop, add(sub(center, axis), rim)),
                (half.fma(drop, level + slope), axpy(side_scale, side, third)),
                (half.fma(drop, level + slope), axpy(-side_scale, side, third)),
            ];
            for index in 0..4 {
                points[index].distance = spots[index].0;
                points[index].x = axpy(half * spots[index].0, normal, spots[index].1);
            }
        }
        LinkShape::Box { edges } => {
            let a = rotate_k_add(&m.rotation, &edges[0], zero3());
            let b = rotate_k_add(&m.rotation, &edges[1], zero3());
            let c = rotate_k_add(&m.rotation, &edges[2], zero3());
            // One corner of each opposite pair; the other is its negative.
            let corners = [add(add(a, b), c), sub(add(a, b), c), add(sub(a, b), c), sub(sub(a, b), c)];
            for index in 0..4 {
                let rise = dot(normal, corners[index]);
                let sign = T::select_lt(T::zero(), rise, T::lit(-1.0), T::lit(1.0));
                let distance = sign.fma(rise, level);
                points[index].distance = distance;
                points[index].x = axpy(half * distance, normal, axpy(sign, corners[index], center));
            }
        }
    }
}

/// Places, distances and frames of the points of a sphere or a capsule, whose ends count as spheres, on an obstacle.
#[inline(always)]
fn obstacle_points<T: Real>(
    tree: &Tree<T::K>,
    pair: &Pair<T::K>,
    m: &Pose<T>,
    center: V3<T>,
    origin: V3<T>,
    points: &mut [Point<T>],
) {
    let half = T::lit(-0.5);
    let radius = T::k(pair.radius);
    // The half axis leads from the centre to an end. A sphere has the centre alone.
    let segment = match &pair.shape {
        LinkShape::Capsule { axis, half_length } => {
            scale(T::k(*half_length), rotate_k_add(&m.rotation, axis, zero3()))
        }
        _ => zero3(),
    };
    // A capsule has two points: the first end is centre + half axis, the second centre − half axis.
    let mut sign = T::lit(1.0);
    for point in points {
        let ball = axpy(sign, segment, center);
        let x = add(ball, origin);
        let Nearest { distance, normal } = match pair.touched {
            Touched::Block(block) => tree.blocks[block].nearest(x),
            Touched::Field(field) => tree.fields[field].nearest(x),
            // Not reached: planes go to `shape_points`.
            Touched::Plane(_) => Nearest { distance: T::zero(), normal: zero3() },
        };
        let distance = distance - radius;
        point.distance = distance;
        point.x = axpy(half.fma(distance, -radius), normal, ball);
        point.frame = normal_frame(normal);
        // In MuJoCo the box is the second of the two, and the first tangent points the other way for the robot.
        if matches!(pair.touched, Touched::Block(_)) {
            point.frame[1] = scale(T::lit(-1.0), point.frame[1]);
        }
        sign = -sign;
    }
}

/// Contact frame of a normal alone (MuJoCo's `mju_makeFrame`): the first tangent lies towards y, or towards z where the
/// normal is near y.
#[inline(always)]
pub(crate) fn normal_frame<T: Real>(normal: V3<T>) -> M3<T> {
    let (zero, one, half) = (T::zero(), T::lit(1.0), T::lit(0.5));
    let steep = normal[1].abs();
    let guess = [zero, T::select_lt(steep, half, one, zero), T::select_lt(steep, half, zero, one)];
    let along = axpy(-dot(normal, guess), normal, guess);
    let t1 = scale(one.div(dot(along, along).sqrt()), along);
    [normal, t1, cross(normal, t1)]
}

/// Contact frame whose first tangent lies along `axis` (MuJoCo's `mju_makeFrame`).
#[inline(always)]
fn axis_frame<T: Real>(normal: V3<T>, axis: V3<T>, plane: &GroundPlane<T::K>) -> M3<T> {
    let along = axpy(-dot(normal, axis), normal, axis);
    let length2 = dot(along, along);
    // An axis along the normal has no direction in the plane: the plane's own tangent stands in for it. The bound is one
    // of a squared length, so it is a sine of 3e-8.
    let tiny = T::lit(TINY);
    let by = T::lit(1.0).div(length2.max(tiny).sqrt());
    let fallback = k3::<T>(&plane.frame[1]);
    let t1 = each3!(i => T::select_lt(length2, tiny, fallback[i], by * along[i]));
    [normal, t1, cross(normal, t1)]
}

/// Contact components of a world vector.
#[inline(always)]
pub(crate) fn components<T: Real>(pair: &Pair<T::K>, frame: &M3<T>, v: V3<T>) -> V3<T> {
    if pair.aligned { [v[2], v[1], v[0]] } else { rotate(frame, v) }
}

/// Spring, dampers and impedance of a pair's rows. The ground may be softer or firmer than the model's.
struct Softness<T> {
    k: T,
    b: T,
    friction_b: T,
    gain: T,
    /// Impedance at first touch.
    dmin: T,
    /// What the impedance rises by, the deeper the feet sink in.
    rise: T,
}

impl<T: Real> Softness<T> {
    /// A time constant that is longer by the factor s = 1 + `softness` makes the damping b/s and the stiffness k/s²; where
    /// velocities act later than at the step's start, the rows' gain 1 + b·lead changes with them. The impedance at first
    /// touch is at least `least`, but not above the curve's end.
    #[inline(always)]
    fn new(pair: &Pair<T::K>, softness: T, least: T) -> Self {
        let (dmin, rise) = Self::curve(pair, least);
        let (k, b) = (T::k(pair.reference.k), T::k(pair.reference.b));
        let (friction_b, gain) = (T::k(pair.friction_b), T::k(pair.reference.gain));
        let hard = Self { k, b, friction_b, gain, dmin, rise };
        let soft = softness.unless_zero();
        // Without extra softness the divisions below are skipped.
        if !T::enter(soft) {
            return hard;
        }
        let one = T::lit(1.0);
        let less = (one + softness).recip();
        // What is kept is 1/gain, and the numbers over the gain.
        let change = (gain + (one - gain) * less).recip();
        let softer = Self {
            k: k * (change * less * less),
            b: b * (change * less),
            friction_b: friction_b * (change * less),
            gain: gain * change,
            ..hard
        };
        T::leave(soft);
        Self {
            k: softer.k.merge(soft, hard.k),
            b: softer.b.merge(soft, hard.b),
            friction_b: softer.friction_b.merge(soft, hard.friction_b),
            gain: softer.gain.merge(soft, hard.gain),
            ..hard
        }
    }

    /// First value and rise of the impedance curve. With `least` 0 they are the model's, bit by bit.
    #[inline(always)]
    fn curve(pair: &Pair<T::K>, least: T) -> (T, T) {
        let (dmin, rise) = (T::k(pair.impedance.dmin), T::k(pair.impedance.rise));
        let harder = least.unless_zero();
        if !T::enter(harder) {
            return (dmin, rise);
        }
        let higher = least.min(dmin + rise).max(dmin);
        let left = rise - (higher - dmin);
        T::leave(harder);
        (higher.merge(harder, dmin), left.merge(harder, rise))
    }
}

/// Residual `J a − aref` and D of one point with the given velocity and `J a` (angular, linear at the point).
#[inline(always)]
fn point_rows<T: Real>(
    pair: &Pair<T::K>,
    rows: &Softness<T>,
    velocity: V6<T>,
    acceleration: V6<T>,
    inverse_scale: T,
    point: &mut Point<T>,
) {
    let depth = point.distance - T::k(pair.margin);
    let imp = rise(&pair.impedance, depth).fma(rows.rise, rows.dmin);
    // MuJoCo's R is (1 − imp)/imp times an estimate of the row's inverse inertia, and D is 1/R.
    let d = imp * ((T::lit(1.0) - imp) * inverse_scale).recip();
    // A point that does not touch has D = 0: its row has neither force nor stiffness.
    point.d = T::select_lt(depth, T::zero(), d, T::zero());
    let v = components(pair, &point.frame, velocity[1]);
    let a = components(pair, &point.frame, acceleration[1]);
    let (b, bf) = (rows.b, rows.friction_b);
    // Residual: J q̈ less the reference acceleration −b v − k imp depth. Friction rows have no spring.
    let spring = rows.k * (imp * depth);
    point.residual[0] = [b.fma(v[0], a[0] + spring), bf.fma(v[1], a[1]), bf.fma(v[2], a[2])];
    if pair.condim > 3 {
        let w = components(pair, &point.frame, velocity[0]);
        let a = components(pair, &point.frame, acceleration[0]);
        point.residual[1] = each3!(i => bf.fma(w[i], a[i]));
    }
}

impl<T: Real> Work<T> {
    /// Normal contact force of compiled pair `pair` in the last step, N; pairs as [`Tree::model_pairs`] lists them.
    pub fn normal_force(&self, tree: &Tree<T::K>, pair: usize) -> T {
        let mut force = T::zero();
        let active = self.pairs[pair].active;
        if T::enter(active) {
            // Points hold the negative of the force.
            for k in tree.pairs[pair].points.clone() {
                force = force - self.points[k].force[0][0];
            }
            T::leave(active);
            force = force.merge(active, T::zero());
        }
        force
    }

    /// Centre of compiled pair `pair`'s shape from the base's origin, m, world axes, at the start of the last step.
    pub fn pair_center(&self, tree: &Tree<T::K>, pair: usize) -> V3<T> {
        let link = tree.links.iter().find(|link| link.pairs.contains(&pair));
        match link.and_then(|link| link.touching) {
            Some(place) => {
                let pose = &self.touching[place];
                rotate_k_add(&pose.rotation, &tree.pairs[pair].center, pose.position)
            }
            None => zero3(),
        }
    }

    /// Normal stiffness of every contact point in the last step, zero where nothing touched.
    pub fn contact_stiffness(&self, tree: &Tree<T::K>) -> Vec<T> {
        let mut all = vec![T::zero(); self.points.len()];
        for (pair, work) in tree.pairs.iter().zip(&self.pairs) {
            if T::enter(work.active) {
                T::leave(work.active);
                for k in pair.points.clone() {
                    all[k] = self.points[k].d.merge(work.active, T::zero());
                }
            }
        }
        all
    }
}
