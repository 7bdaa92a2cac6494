//! URDF `<joint>`: revolute, continuous, prismatic and fixed; a floating one at the root.

use std::collections::HashMap;

use crate::attributes::{Attributes, Context};
use crate::coupling::NamedCoupling;
use crate::error::ModelError;
use crate::joint_kind::JointKind;
use crate::model::Joint;
use crate::rotation::{IDENTITY, Quat, Vec3, unit};
use crate::shown::shown;
use crate::spec::default_joint;
use crate::xml::{At, Element};

use super::foreign::{list_attributes, list_element};
use super::{read_origin, required};

/// A joint between two links.
pub(super) struct Connection {
    pub element: At,
    pub parent: usize,
    pub child: usize,
    pub pos: Vec3,
    pub quat: Quat,
    /// `None`: the links are welded.
    pub joint: Option<Joint>,
    /// The coupling of a joint that follows another one.
    pub follows: Option<NamedCoupling>,
    /// The child floats: it is the robot's root.
    pub floats: bool,
    /// It is revolute or prismatic, but its file gives it no limits.
    pub unlimited: bool,
    /// Largest torque, N·m, or force, N; 0: not given.
    pub effort: f64,
}

impl Connection {
    /// Whether it welds its links.
    pub fn is_fixed(&self) -> bool {
        self.joint.is_none() && !self.floats
    }
}

/// Reads one joint.
pub(super) fn read_joint(
    ctx: &mut Context,
    element: &Element,
    links: &HashMap<String, usize>,
) -> Result<Option<Connection>, ModelError> {
    let mut a = Attributes::new(element);
    let name = required(ctx, &mut a, "name")?.to_string();
    let kind = required(ctx, &mut a, "type")?;
    list_attributes(ctx, &mut a);
    a.finish(ctx)?;
    let label = element.label();
    let moves = matches!(kind, "revolute" | "continuous" | "prismatic");
    let bounded = matches!(kind, "revolute" | "prismatic");
    let floats = kind == "floating";
    if !moves && !floats && kind != "fixed" {
        // Dropped, the joint becomes a weld: its child stays part of the robot.
        ctx.refuse(
            element.at,
            format!("{label} of type {}", shown(kind)),
            "only revolute, continuous, prismatic and fixed joints are simulated",
            "replace it",
        )?;
    }
    let mut parts = Parts {
        ends: [None; 2],
        pose: ([0.0; 3], IDENTITY),
        joint: Joint {
            name,
            kind: if kind == "prismatic" { JointKind::Slide } else { JointKind::Hinge },
            // URDF's default; MJCF's is z.
            axis: [1.0, 0.0, 0.0],
            ..default_joint()
        },
        effort: 0.0,
        follows: None,
        limits: None,
        // Until a <limit> states a bound.
        unlimited: bounded,
    };
    for child in &element.children {
        read_child(ctx, child, &label, links, &mut parts)?;
    }
    let Parts { ends, pose, mut joint, effort, follows, limits, unlimited } = parts;
    let [Some(parent), Some(child)] = ends else {
        return Err(ctx.invalid(
            element.at,
            format!("{label} without a parent or child link"),
            "add <parent link=\"...\"/> and <child link=\"...\"/>",
        ));
    };
    joint.axis = match unit(joint.axis) {
        Some(axis) => axis,
        // A weld needs no axis.
        None if !moves => joint.axis,
        None => {
            return Err(ctx.invalid(element.at, format!("{label}: the axis is zero"), "give a direction"));
        }
    };
    // A continuous joint turns without end, whatever its <limit> says.
    if bounded && !unlimited {
        joint.range = Some(range(ctx, element, kind, limits)?);
    }
    Ok(Some(Connection {
        element: element.at,
        parent,
        child,
        pos: pose.0,
        quat: pose.1,
        joint: moves.then_some(joint),
        // A weld cannot follow another joint, so its <mimic> means nothing.
        follows: follows.filter(|_| moves),
        floats,
        unlimited,
        effort,
    }))
}

/// Values that the children of a `<joint>` give.
struct Parts {
    /// Parent and child link.
    ends: [Option<usize>; 2],
    pose: (Vec3, Quat),
    joint: Joint,
    effort: f64,
    /// Its coupling, if it follows another joint.
    follows: Option<NamedCoupling>,
    limits: Option<[f64; 2]>,
    unlimited: bool,
}

fn read_child(
    ctx: &mut Context,
    child: &Element,
    label: &str,
    links: &HashMap<String, usize>,
    parts: &mut Parts,
) -> Result<(), ModelError> {
    let mut a = Attributes::new(child);
    match child.name.as_str() {
        "parent" | "child" => {
            let wanted = required(ctx, &mut a, "link")?;
            let Some(&link) = links.get(wanted) else {
                return Err(ctx.invalid(
                    child.at,
                    format!("{label} names link \"{}\", which does not exist", shown(wanted)),
                    "name an existing link",
                ));
            };
            parts.ends[usize::from(child.name == "child")] = Some(link);
        }
        "origin" => {
            // `read_origin` checks the attributes itself.
            parts.pose = read_origin(ctx, child)?;
            return Ok(());
        }
        "axis" => a.set_array(ctx, "xyz", &mut parts.joint.axis)?,
        "limit" => {
            let (lower, upper) = (a.number(ctx, "lower")?, a.number(ctx, "upper")?);
            // One bound is enough for limits; the other one is then 0.
            parts.unlimited &= lower.is_none() && upper.is_none();
            a.set_nonnegative(ctx, "effort", &mut parts.effort)?;
            let mut speed = 0.0;
            a.set_nonnegative(ctx, "velocity", &mut speed)?;
            // 0 counts as not given, as with `effort`.
            parts.joint.velocity_limit = (speed > 0.0).then_some(speed);
            list_attributes(ctx, &mut a);
            // URDF's default for a bound that is absent.
            parts.limits = Some([lower.unwrap_or(0.0), upper.unwrap_or(0.0)]);
        }
        "dynamics" => {
            a.set_nonnegative(ctx, "damping", &mut parts.joint.damping)?;
            a.set_nonnegative(ctx, "friction", &mut parts.joint.frictionloss)?;
        }
        "mimic" => {
            let leader = required(ctx, &mut a, "joint")?;
            let (mut factor, mut offset) = (1.0, 0.0);
            a.set(ctx, "multiplier", &mut factor)?;
            a.set(ctx, "offset", &mut offset)?;
            if parts.follows.is_some() {
                return Err(ctx.invalid(child.at, format!("{label} has two <mimic>"), "remove one of them"));
            }
            parts.follows = Some(NamedCoupling::mimic(child.at, &parts.joint.name, leader, offset, factor));
        }
        "safety_controller" | "calibration" => {
            let what = format!("<{}> of {label}", child.name);
            ctx.drop_quietly(child.at, what, "part of a controller, not of the robot");
            return Ok(());
        }
        _ if list_element(ctx, child, label) => return Ok(()),
        _ => {
            ctx.refuse(child.at, child.label(), "not known in <joint>", "remove it")?;
            return Ok(());
        }
    }
    a.finish(ctx)
}

/// The limits of a revolute or prismatic joint.
fn range(
    ctx: &mut Context,
    element: &Element,
    kind: &str,
    limits: Option<[f64; 2]>,
) -> Result<[f64; 2], ModelError> {
    let label = element.label();
    match limits {
        Some([lower, upper]) if lower < upper => Ok([lower, upper]),
        Some([upper, lower]) if lower < upper && ctx.mend => {
            let how = "`lower` is above `upper` in the file: they are exchanged";
            ctx.note(element.at, format!("limits of {label}"), how);
            Ok([lower, upper])
        }
        _ => Err(ctx.invalid(
            element.at,
            format!("{label} is {kind}, but has no limits with lower < upper"),
            match kind {
                "revolute" => {
                    "add <limit lower=\"...\" upper=\"...\" effort=\"...\" velocity=\"...\"/>, or make it continuous"
                }
                _ => "add <limit lower=\"...\" upper=\"...\" effort=\"...\" velocity=\"...\"/>",
            },
        )),
    }
}
