//! The ways in which MJCF writes orientations.

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::rotation::{
    IDENTITY, Quat, Vec3, add, axis_angle, cross, from_axes, normalize, product, rotate, unit, z_to,
};

/// Pose of a child (`pos`, `quat` in the parent's frame) seen from where the parent's pose is given.
pub(crate) fn compose(parent: (Vec3, Quat), child: (Vec3, Quat)) -> (Vec3, Quat) {
    // Normalized each time: along a chain of bodies rounding would add up.
    (add(parent.0, rotate(parent.1, child.0)), normalize(product(parent.1, child.1)))
}

/// How angles are written: `compiler angle` and `eulerseq`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AngleUnits {
    pub degree: bool,
    pub eulerseq: [u8; 3],
}

impl Default for AngleUnits {
    fn default() -> Self {
        // MuJoCo's defaults.
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
                // The axis has no unit; only the fourth number is an angle.
                *target = axis_angle(axis, units.radians(angle));
            }
        }
        "xyaxes" => {
            if let Some(v) = attributes.array::<6>(ctx, name)? {
                let x = unit([v[0], v[1], v[2]]).ok_or_else(short)?;
                // Gram–Schmidt: y need not be square to x in the file.
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
    // The turns follow each other in the order of the letters.
    for (angle, letter) in angles.into_iter().zip(sequence) {
        let axis = match letter.to_ascii_lowercase() {
            b'x' => [1.0, 0.0, 0.0],
            b'y' => [0.0, 1.0, 0.0],
            _ => [0.0, 0.0, 1.0],
        };
        let turn = axis_angle(axis, angle);
        q = if letter.is_ascii_lowercase() { product(q, turn) } else { product(turn, q) };
    }
    normalize(q)
}
