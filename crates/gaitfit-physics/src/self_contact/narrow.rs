//! Where two shapes touch, as MuJoCo finds it (`engine_collision_primitive`): sphere and sphere, sphere and capsule,
//! sphere and box 1 point; capsule and capsule 1, or 2 where they are parallel.

use crate::Real;
use crate::contact::normal_frame;
use crate::self_contact::{Form, MAX_POINTS, SelfContactPair, SelfContactShape};
use crate::state::Pose;
use crate::terrain::{TINY, nearest_of_box};
use crate::vec3::*;

/// A place where two shapes are nearest to each other.
#[derive(Clone, Copy)]
pub(crate) struct Spot<T> {
    pub distance: T,
    /// Halfway between the surfaces.
    pub x: V3<T>,
    /// Unit vector from the first shape to the second.
    pub normal: V3<T>,
}

/// Distance that stands for "no contact", m.
const FAR: f64 = 1e3;

impl<T: Real> Spot<T> {
    /// A spot without contact.
    #[inline(always)]
    pub fn far() -> Self {
        let (zero, one) = (T::zero(), T::lit(1.0));
        Self { distance: T::lit(FAR), x: zero3(), normal: [one, zero, zero] }
    }

    /// After the region that computed it: this spot where `guard` is active, else `before`; see [`Real::merge`].
    #[inline(always)]
    pub fn merge(mut self, guard: T::Guard, before: &Self) -> Self {
        self.distance = self.distance.merge(guard, before.distance);
        merge_all(&mut self.x, guard, &before.x);
        merge_all(&mut self.normal, guard, &before.normal);
        self
    }

    /// Contact frame: normal and tangents.
    #[inline(always)]
    pub fn frame(&self) -> M3<T> {
        normal_frame(self.normal)
    }
}

/// The points of a pair; `centers` and poses are those of its two shapes.
#[inline(always)]
pub(crate) fn spots<T: Real>(
    pair: &SelfContactPair<T::K>,
    poses: [&Pose<T>; 2],
    centers: [V3<T>; 2],
) -> [Spot<T>; MAX_POINTS] {
    // Where a pair has one point, the further ones are copies that nothing reads.
    let [first, second] = &pair.shapes;
    let radii = [T::k(first.radius), T::k(second.radius)];
    match (&first.form, &second.form) {
        (Form::Ball, Form::Rod(axis)) => {
            let axis = rotate_k_add(&poses[1].rotation, axis, zero3());
            // The axis is half of the rod, so the rod's ends are at −1 and 1.
            let along = dot(axis, sub(centers[0], centers[1])).div(dot(axis, axis));
            let one = T::lit(1.0);
            [balls(centers[0], axpy(along.clamp(-one, one), axis, centers[1]), radii); MAX_POINTS]
        }
        (Form::Rod(one), Form::Rod(other)) => {
            let one = rotate_k_add(&poses[0].rotation, one, zero3());
            let other = rotate_k_add(&poses[1].rotation, other, zero3());
            rods(centers, [one, other], radii, pair)
        }
        (Form::Ball, Form::Block(axes, half)) => {
            [ball_box(centers, &poses[1].rotation, axes, half, radii[0]); MAX_POINTS]
        }
        // Two balls; `compile_pair` refuses all other pairs.
        _ => [balls(centers[0], centers[1], radii); MAX_POINTS],
    }
}

/// Two balls.
#[inline(always)]
fn balls<T: Real>(a: V3<T>, b: V3<T>, radii: [T; 2]) -> Spot<T> {
    let (zero, one, tiny) = (T::zero(), T::lit(1.0), T::lit(TINY));
    let between = sub(b, a);
    let length = dot(between, between).sqrt();
    let by = one.div(length.max(tiny));
    // Centres in one place have no direction: x stands for it, as in MuJoCo.
    let none = [one, zero, zero];
    let normal = each3!(i => T::select_lt(length, tiny, none[i], by * between[i]));
    let distance = length - radii[0] - radii[1];
    Spot { distance, x: axpy(T::lit(0.5).fma(distance, radii[0]), normal, a), normal }
}

/// Places along two rods as multiples of their half axes: the nearest to each other, or where the rods are parallel
/// opposite an end.
struct Rods<T> {
    /// Squares of the half lengths, minus the product of the half axes, and the centres' difference along each.
    ma: T,
    mb: T,
    mc: T,
    u: T,
    v: T,
}

impl<T: Real> Rods<T> {
    /// Where the first rod is nearest to the place `x` of the second.
    #[inline(always)]
    fn first(&self, x: T) -> T {
        let one = T::lit(1.0);
        self.mb.fnma(x, self.u).div(self.ma).clamp(-one, one)
    }

    /// Where the second rod is nearest to the place `x` of the first.
    #[inline(always)]
    fn second(&self, x: T) -> T {
        let one = T::lit(1.0);
        self.mb.fnma(x, self.v).div(self.mc).clamp(-one, one)
    }
}

/// Two rods with half axes `axes` (`mjraw_CapsuleCapsule`).
#[inline(always)]
fn rods<T: Real>(
    centers: [V3<T>; 2],
    axes: [V3<T>; 2],
    radii: [T; 2],
    pair: &SelfContactPair<T::K>,
) -> [Spot<T>; MAX_POINTS] {
    let (one, tiny) = (T::lit(1.0), T::lit(TINY));
    let apart = sub(centers[0], centers[1]);
    let r = Rods {
        ma: dot(axes[0], axes[0]),
        mb: -dot(axes[0], axes[1]),
        mc: dot(axes[1], axes[1]),
        u: -dot(axes[0], apart),
        v: dot(axes[1], apart),
    };
    // Determinant of the two equations for the lines' nearest points; zero if they are parallel.
    let det = r.mb.fnma(r.mb, r.ma * r.mc);
    let parallel = det.abs();
    // Skew: the nearest points of the lines, moved onto the rods one after the other.
    // Parallel rods drop this result below. Dividing by 1 keeps it finite for them.
    let by = one.div(T::select_lt(parallel, tiny, one, det));
    let x1 = r.mb.fnma(r.v, r.mc * r.u) * by;
    let x2 = r.mb.fnma(r.u, r.ma * r.v) * by;
    // 1 where the point lies beyond the end of its rod, else 0: lanes have no booleans.
    let over1 = T::select_lt(one, x1.abs(), one, T::zero());
    let x1 = x1.clamp(-one, one);
    let x2 = T::select_lt(T::zero(), over1, r.mb.fnma(x1, r.v).div(r.mc), x2);
    let over2 = T::select_lt(one, x2.abs(), one, T::zero());
    let x2 = x2.clamp(-one, one);
    let x1 = T::select_lt(T::zero(), over2, r.first(x2), x1);
    let skew = balls(axpy(x1, axes[0], centers[0]), axpy(x2, axes[1], centers[1]), radii);
    // Parallel: opposite the ends, the first two that touch.
    let places = [(one, r.second(one)), (-one, r.second(-one)), (r.first(one), one), (r.first(-one), -one)];
    let far = T::lit(FAR);
    let mut spots = [Spot { distance: far, ..skew }; MAX_POINTS];
    let margin = T::k(pair.margin);
    for (x1, x2) in places {
        let spot = balls(axpy(x1, axes[0], centers[0]), axpy(x2, axes[1], centers[1]), radii);
        // Without branches: a spot that touches goes to the first of the two places that is still free.
        let touches = T::select_lt(spot.distance, margin, one, T::zero());
        let none = T::select_lt(spots[0].distance, far, T::zero(), one);
        let single = (one - none) * T::select_lt(spots[1].distance, far, T::zero(), one);
        spots[0] = chosen(touches * none, &spot, &spots[0]);
        spots[1] = chosen(touches * single, &spot, &spots[1]);
    }
    let skewed = T::select_lt(parallel, tiny, T::zero(), one);
    [chosen(skewed, &skew, &spots[0]), chosen(skewed, &Spot { distance: far, ..skew }, &spots[1])]
}

/// The first where `wanted` is above zero.
#[inline(always)]
fn chosen<T: Real>(wanted: T, a: &Spot<T>, b: &Spot<T>) -> Spot<T> {
    let z = T::zero();
    Spot {
        distance: T::select_lt(z, wanted, a.distance, b.distance),
        x: each3!(i => T::select_lt(z, wanted, a.x[i], b.x[i])),
        normal: each3!(i => T::select_lt(z, wanted, a.normal[i], b.normal[i])),
    }
}

/// A ball and a box (`mjraw_SphereBox`).
#[inline(always)]
fn ball_box<T: Real>(
    centers: [V3<T>; 2],
    rotation: &M3<T>,
    axes: &[[T::K; 3]; 3],
    half: &[T::K; 3],
    radius: T,
) -> Spot<T> {
    let axes: M3<T> = each3!(i => rotate_k_add(rotation, &axes[i], zero3()));
    // The rows of `axes` are the box's axes, so this is the ball's centre in the box's frame.
    let local = rotate(&axes, sub(centers[0], centers[1]));
    let (distance, outward) = nearest_of_box(local, k3::<T>(half));
    // `outward` leads from the box to the ball; a pair's normal leads from its first shape, the ball, to the
    // second.
    let normal = scale(T::lit(-1.0), rotate_back(&axes, outward));
    let distance = distance - radius;
    Spot { distance, x: axpy(T::lit(0.5).fma(distance, radius), normal, centers[0]), normal }
}

/// Centre of a shape from the reference point, world axes.
#[inline(always)]
pub(crate) fn center<T: Real>(shape: &SelfContactShape<T::K>, pose: &Pose<T>) -> V3<T> {
    rotate_k_add(&pose.rotation, &shape.center, pose.position)
}
