//! Rotations as unit quaternions (wxyz), and the ways MJCF writes them.

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;

/// Quaternion, wxyz.
pub(crate) type Quat = [f64; 4];
/// Vector.
pub(crate) type Vec3 = [f64; 3];

/// Shorter than this, a direction is undefined (MuJoCo's `mjEPS`).
const TINY: f64 = 1e-14;

/// No rotation.
pub(crate) const IDENTITY: Quat = [1.0, 0.0, 0.0, 0.0];

/// Hamilton product `a b`.
pub(crate) fn mul(a: Quat, b: Quat) -> Quat {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// Unit quaternion along `q`; the identity when `q` is (nearly) zero, as in MuJoCo.
pub(crate) fn normalize(q: Quat) -> Quat {
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    if norm < TINY || !norm.is_finite() {
        return IDENTITY;
    }
    q.map(|x| x / norm)
}

/// Unit vector along `v`; `None` when `v` is (nearly) zero.
pub(crate) fn unit(v: Vec3) -> Option<Vec3> {
    let norm = dot(v, v).sqrt();
    (norm >= TINY && norm.is_finite()).then(|| v.map(|x| x / norm))
}

/// Scalar product.
pub(crate) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
pub(crate) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Sum.
pub(crate) fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Rotation matrix (rows) of a unit quaternion.
pub(crate) fn matrix(q: Quat) -> [Vec3; 3] {
    let [w, x, y, z] = q;
    [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
}

/// `q` applied to `v`.
pub(crate) fn rotate(q: Quat, v: Vec3) -> Vec3 {
    if q == IDENTITY {
        return v;
    }
    let r = matrix(q);
    [dot(r[0], v), dot(r[1], v), dot(r[2], v)]
}

/// Rotation by `angle` (rad) about a unit axis.
pub(crate) fn axis_angle(axis: Vec3, angle: f64) -> Quat {
    let (s, c) = (angle / 2.0).sin_cos();
    [c, s * axis[0], s * axis[1], s * axis[2]]
}

/// Shortest rotation that takes z to the unit vector `v`.
pub(crate) fn z_to(v: Vec3) -> Quat {
    let normal = cross([0.0, 0.0, 1.0], v);
    let sine = dot(normal, normal).sqrt();
    let axis = if sine < 1e-10 { [1.0, 0.0, 0.0] } else { normal.map(|x| x / sine) };
    axis_angle(axis, sine.atan2(v[2]))
}

/// Quaternion of a rotation whose columns are the given orthonormal axes (Shepperd's method).
fn from_axes(x: Vec3, y: Vec3, z: Vec3) -> Quat {
    let (m00, m10, m20) = (x[0], x[1], x[2]);
    let (m01, m11, m21) = (y[0], y[1], y[2]);
    let (m02, m12, m22) = (z[0], z[1], z[2]);
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

/// Pose of a child (`pos`, `quat` in the parent's frame) seen from where the parent's pose is given.
pub(crate) fn compose(parent: (Vec3, Quat), child: (Vec3, Quat)) -> (Vec3, Quat) {
    (add(parent.0, rotate(parent.1, child.0)), normalize(mul(parent.1, child.1)))
}

/// How angles are written: `compiler angle` and `eulerseq`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AngleUnits {
    pub degree: bool,
    pub eulerseq: [u8; 3],
}

impl Default for AngleUnits {
    fn default() -> Self {
        Self { degree: true, eulerseq: *b"xyz" }
    }
}

impl AngleUnits {
    /// An angle of the file in radians.
    pub fn radians(&self, angle: f64) -> f64 {
        if self.degree { angle * std::f64::consts::PI / 180.0 } else { angle }
    }
}

/// The five spellings of an orientation.
const SPELLINGS: [&str; 5] = ["quat", "axisangle", "xyaxes", "zaxis", "euler"];

/// Reads whichever of `quat`, `axisangle`, `xyaxes`, `zaxis`, `euler` is present into `target`.
/// Returns whether one was.
///
/// # Errors
/// Two spellings at once, or a direction too short to define one.
pub(crate) fn read_orientation(
    attributes: &mut Attributes,
    ctx: &Context,
    units: AngleUnits,
    target: &mut Quat,
) -> Result<bool, ModelError> {
    let element = attributes.element();
    let given: Vec<&str> = SPELLINGS.into_iter().filter(|name| element.get(name).is_some()).collect();
    let Some(&name) = given.first() else { return Ok(false) };
    if given.len() > 1 {
        return Err(ctx.invalid(
            attributes.at(given[1]),
            format!("{} has its orientation twice: `{}` and `{}`", element.label(), name, given[1]),
            "keep one",
        ));
    }
    let at = attributes.at(name);
    let short = || {
        ctx.invalid(
            at,
            format!("`{name}` of {} is too short to give a direction", element.label()),
            "give vectors that are not zero and not parallel",
        )
    };
    match name {
        "quat" => {
            if let Some(q) = attributes.array::<4>(ctx, name)? {
                *target = normalize(q);
            }
        }
        "axisangle" => {
            if let Some([x, y, z, angle]) = attributes.array::<4>(ctx, name)? {
                let axis = unit([x, y, z]).ok_or_else(short)?;
                *target = axis_angle(axis, units.radians(angle));
            }
        }
        "xyaxes" => {
            if let Some(v) = attributes.array::<6>(ctx, name)? {
                let x = unit([v[0], v[1], v[2]]).ok_or_else(short)?;
                let d = x[0] * v[3] + x[1] * v[4] + x[2] * v[5];
                let y = unit([v[3] - d * x[0], v[4] - d * x[1], v[5] - d * x[2]]).ok_or_else(short)?;
                *target = from_axes(x, y, cross(x, y));
            }
        }
        "zaxis" => {
            if let Some(z) = attributes.array::<3>(ctx, name)? {
                *target = z_to(unit(z).ok_or_else(short)?);
            }
        }
        _ => {
            if let Some(angles) = attributes.array::<3>(ctx, name)? {
                *target = euler(angles.map(|a| units.radians(a)), units.eulerseq);
            }
        }
    }
    Ok(true)
}

/// Euler angles (rad) in MuJoCo's convention: lower-case letters turn about the moving axes, capitals
/// about the fixed ones.
pub(crate) fn euler(angles: Vec3, sequence: [u8; 3]) -> Quat {
    let mut q = IDENTITY;
    for (angle, letter) in angles.into_iter().zip(sequence) {
        let axis = match letter.to_ascii_lowercase() {
            b'x' => [1.0, 0.0, 0.0],
            b'y' => [0.0, 1.0, 0.0],
            _ => [0.0, 0.0, 1.0],
        };
        let turn = axis_angle(axis, angle);
        q = if letter.is_ascii_lowercase() { mul(q, turn) } else { mul(turn, q) };
    }
    normalize(q)
}
