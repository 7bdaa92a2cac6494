//! Rotations as unit quaternions (w, x, y, z), and headings, for `f32` and `f64`.
//!
//! A quaternion `q` of a body turns body vectors into world vectors: [`rotate`]. The physics engine has its own
//! rotations over its lanes, with fused multiplications.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A quaternion, w, x, y, z.
pub type Quat<T = f64> = [T; 4];
/// A vector.
pub type Vec3<T = f64> = [T; 3];

/// No rotation.
pub const IDENTITY: Quat = [1.0, 0.0, 0.0, 0.0];

/// Shorter than this, a direction is undefined (MuJoCo's `mjEPS`).
const TINY: f64 = 1e-14;

/// `f32` or `f64`.
pub trait Scalar:
    Copy
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + From<f32>
    + private::Float
{
    /// Square root.
    fn sqrt(self) -> Self;
    /// Angle of the point (`x`, `self`), rad.
    fn atan2(self, x: Self) -> Self;
}

mod private {
    pub trait Float {}
    impl Float for f32 {}
    impl Float for f64 {}
}

impl Scalar for f32 {
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    fn atan2(self, x: Self) -> Self {
        self.atan2(x)
    }
}

impl Scalar for f64 {
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    fn atan2(self, x: Self) -> Self {
        self.atan2(x)
    }
}

/// Scalar product.
#[inline]
pub fn dot<T: Scalar>(a: Vec3<T>, b: Vec3<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
#[inline]
pub fn cross<T: Scalar>(a: Vec3<T>, b: Vec3<T>) -> Vec3<T> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Sum.
#[inline]
pub fn add<T: Scalar>(a: Vec3<T>, b: Vec3<T>) -> Vec3<T> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Difference.
#[inline]
pub fn sub<T: Scalar>(a: Vec3<T>, b: Vec3<T>) -> Vec3<T> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Unit vector along `v`; `None` when `v` is (nearly) zero.
pub fn unit(v: Vec3) -> Option<Vec3> {
    let norm = dot(v, v).sqrt();
    // NaN fails the first comparison.
    (norm >= TINY && norm.is_finite()).then(|| v.map(|x| x / norm))
}

/// The first four numbers of `row` as a quaternion.
///
/// # Panics
/// `row` is shorter.
pub fn quat_of<T: Copy>(row: &[T]) -> Quat<T> {
    [row[0], row[1], row[2], row[3]]
}

/// The first three numbers of `row` as a vector.
///
/// # Panics
/// `row` is shorter.
pub fn vec_of<T: Copy>(row: &[T]) -> Vec3<T> {
    [row[0], row[1], row[2]]
}

/// Hamilton product `a b`: the turn `b`, then `a`.
#[inline]
pub fn product<T: Scalar>(a: Quat<T>, b: Quat<T>) -> Quat<T> {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// The opposite turn of a unit quaternion.
#[inline]
pub fn inverse<T: Scalar>(q: Quat<T>) -> Quat<T> {
    [q[0], -q[1], -q[2], -q[3]]
}

/// Unit quaternion along `q`; the identity when `q` is (nearly) zero, as in MuJoCo.
pub fn normalize(q: Quat) -> Quat {
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    if norm < TINY || !norm.is_finite() {
        return IDENTITY;
    }
    q.map(|x| x / norm)
}

/// `v` turned by the unit quaternion `q`: of a body's orientation, a body vector in the world.
#[inline]
pub fn rotate<T: Scalar>(q: Quat<T>, v: Vec3<T>) -> Vec3<T> {
    let two = T::from(2.0);
    let u = [q[1], q[2], q[3]];
    // v + 2 w (u × v) + 2 u × (u × v): fewer products than with the matrix.
    let t = cross(u, v).map(|x| two * x);
    let w = cross(u, t);
    std::array::from_fn(|k| v[k] + q[0] * t[k] + w[k])
}

/// `v` turned back by the unit quaternion `q`: of a body's orientation, a world vector in the body frame.
#[inline]
pub fn rotate_back<T: Scalar>(q: Quat<T>, v: Vec3<T>) -> Vec3<T> {
    // Products with the axes are those with the transposed matrix, which turns back.
    axes(q).map(|axis| dot(axis, v))
}

/// The x, y and z axes that a unit quaternion turns the world's axes into: the columns of its matrix.
pub fn axes<T: Scalar>(q: Quat<T>) -> [Vec3<T>; 3] {
    let [w, x, y, z] = q;
    let (one, two) = (T::from(1.0), T::from(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)],
        [two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)],
        [two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y)],
    ]
}

/// Rotation matrix (rows) of a unit quaternion, in MuJoCo's formula (`mju_quat2Mat`), so that compiled inertias have
/// its digits.
pub fn matrix(q: Quat) -> [Vec3; 3] {
    let [w, x, y, z] = q;
    [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
}

/// The world's z axis in the frame of a body with orientation `q`: against gravity.
pub fn up<T: Scalar>(q: Quat<T>) -> Vec3<T> {
    let [x, y, z] = axes(q);
    [x[2], y[2], z[2]]
}

/// Rotation by `angle` (rad) about a unit axis.
pub fn axis_angle(axis: Vec3, angle: f64) -> Quat {
    let (s, c) = (0.5 * angle).sin_cos();
    [c, s * axis[0], s * axis[1], s * axis[2]]
}

/// Rotation by `angle` (rad) about x, y or z (`axis` 0, 1, 2).
///
/// # Panics
/// `axis` is above 2.
pub fn turn(axis: usize, angle: f64) -> Quat {
    let (s, c) = (0.5 * angle).sin_cos();
    let mut q = [c, 0.0, 0.0, 0.0];
    q[1..][axis] = s;
    q
}

/// Rotation Rz(yaw)·Ry(pitch)·Rx(roll), rad (Diebel 2006, "Representing Attitude", eq. 290 with the ZYX sequence); NaN
/// in, NaN out.
pub fn from_rpy(roll: f64, pitch: f64, yaw: f64) -> Quat {
    let (sr, cr) = (0.5 * roll).sin_cos();
    let (sp, cp) = (0.5 * pitch).sin_cos();
    let (sy, cy) = (0.5 * yaw).sin_cos();
    [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
}

/// Between `a` (`fraction` 0) and `b` (1) along the shorter way: normalised linear interpolation.
pub fn blend(a: Quat, b: Quat, fraction: f64) -> Quat {
    let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    // q and −q are the same rotation: the sign chooses the nearer one.
    let sign = if dot < 0.0 { -1.0 } else { 1.0 };
    let mixed: Quat = std::array::from_fn(|k| a[k] + fraction * (sign * b[k] - a[k]));
    // A straight line between unit quaternions passes inside of the sphere.
    let norm = mixed.iter().map(|value| value * value).sum::<f64>().sqrt();
    mixed.map(|value| value / norm)
}

/// Shortest rotation that takes z to the unit vector `v`.
pub fn z_to(v: Vec3) -> Quat {
    let normal = cross([0.0, 0.0, 1.0], v);
    let sine = dot(normal, normal).sqrt();
    // For half a turn any axis square to z will do; for none the angle is zero.
    let axis = if sine < 1e-10 { [1.0, 0.0, 0.0] } else { normal.map(|x| x / sine) };
    axis_angle(axis, sine.atan2(v[2]))
}

/// Quaternion of a rotation whose columns are the given orthonormal axes (Shepperd's method).
pub fn from_axes(x: Vec3, y: Vec3, z: Vec3) -> Quat {
    let (m00, m10, m20) = (x[0], x[1], x[2]);
    let (m01, m11, m21) = (y[0], y[1], y[2]);
    let (m02, m12, m22) = (z[0], z[1], z[2]);
    // Each case computes a multiple of the quaternion by a component that is large there, so that little is lost to
    // rounding.
    let q = if m00 + m11 + m22 > 0.0 {
        [1.0 + m00 + m11 + m22, m21 - m12, m02 - m20, m10 - m01]
    } else if m00 > m11 && m00 > m22 {
        [m21 - m12, 1.0 + m00 - m11 - m22, m10 + m01, m20 + m02]
    } else if m11 > m22 {
        [m02 - m20, m10 + m01, 1.0 - m00 + m11 - m22, m21 + m12]
    } else {
        [m10 - m01, m20 + m02, m21 + m12, 1.0 - m00 - m11 + m22]
    };
    normalize(q)
}

/// Direction in which a body with orientation `q` looks over the ground, rad from the world's x axis. It is square to
/// the body's left axis, which stays level on four legs and on two.
pub fn heading<T: Scalar>(q: Quat<T>) -> T {
    let left = axes(q)[1];
    // The left axis, turned back by a quarter turn, points forward.
    (-left[0]).atan2(left[1])
}

/// A world vector in the frame of the [`heading`]: forward, left, up.
pub fn to_heading<T: Scalar>(q: Quat<T>, v: Vec3<T>) -> Vec3<T> {
    let left = axes(q)[1];
    let length = (left[0] * left[0] + left[1] * left[1]).sqrt();
    // A body that lies on its side has no heading; the division stays finite.
    let length = if length > T::from(1e-6) { length } else { T::from(1e-6) };
    let (lx, ly) = (left[0] / length, left[1] / length);
    [ly * v[0] - lx * v[1], lx * v[0] + ly * v[1], v[2]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    fn near(found: &[f64], wanted: &[f64]) {
        assert_eq!(found.len(), wanted.len());
        for (found, wanted) in found.iter().zip(wanted) {
            assert!((found - wanted).abs() < 1e-14, "{found}, not {wanted}");
        }
    }

    /// A quarter turn about z takes x to y, then one about x takes y to z.
    #[test]
    fn products_turn_the_right_one_first() {
        let (z, x) = (turn(2, FRAC_PI_2), turn(0, FRAC_PI_2));
        near(&rotate(z, [1.0, 0.0, 0.0]), &[0.0, 1.0, 0.0]);
        near(&rotate(product(x, z), [1.0, 0.0, 0.0]), &[0.0, 0.0, 1.0]);
        near(&product(z, inverse(z)), &IDENTITY);
        near(&z_to([1.0, 0.0, 0.0]), &turn(1, FRAC_PI_2));
    }

    #[test]
    fn axes_and_turning_back_agree_with_turning() {
        let q = normalize([0.3, -0.5, 0.7, 0.2]);
        let v = [1.0, -2.0, 0.5];
        near(&rotate_back(q, rotate(q, v)), &v);
        near(&rotate(inverse(q), v), &rotate_back(q, v));
        for (k, axis) in axes(q).into_iter().enumerate() {
            let world: Vec3 = std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
            near(&rotate(q, world), &axis);
            near(&matrix(q).map(|row| row[k]), &axis);
        }
        near(&up(q), &rotate_back(q, [0.0, 0.0, 1.0]));
        let [x, y, z] = axes(q);
        near(&from_axes(x, y, z), &q);
        let single = rotate_back(q.map(|x| x as f32), v.map(|x| x as f32));
        assert!(single.iter().zip(rotate_back(q, v)).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-6));
    }

    #[test]
    fn roll_pitch_and_yaw_turn_about_fixed_axes() {
        let q = from_rpy(0.2, -0.3, 0.9);
        near(&q, &product(turn(2, 0.9), product(turn(1, -0.3), turn(0, 0.2))));
        assert!(from_rpy(f64::NAN, 0.0, 0.0).iter().all(|x| x.is_nan()));
    }

    #[test]
    fn blends_take_the_shorter_way() {
        let (a, b) = (turn(2, 0.2), turn(2, 0.6));
        near(&blend(a, b, 0.5), &turn(2, 0.4));
        near(&blend(a, b.map(|x| -x), 0.5), &turn(2, 0.4));
        near(&blend(a, b, 1.0), &b);
    }

    #[test]
    fn headings_agree_on_four_legs_and_on_two() {
        let yaw = turn(2, 0.7);
        let reared = product(yaw, turn(1, -FRAC_PI_2));
        let world = rotate(yaw, [0.3, -0.2, 0.1]);
        for q in [yaw, reared] {
            assert!((heading(q) - 0.7).abs() < 1e-14);
            near(&to_heading(q, world), &[0.3, -0.2, 0.1]);
        }
        // On its side a body has no heading; the numbers stay finite.
        assert!(to_heading(turn(0, FRAC_PI_2), world).iter().all(|x| x.is_finite()));
    }
}
