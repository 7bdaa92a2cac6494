//! What other programs read from a URDF and a robot's motion does not need: it is listed, not refused.
//!
//! Only known names are here. Anything else could have a meaning that changes the motion.

use crate::attributes::{Attributes, Context};
use crate::xml::Element;

const NOT_DYNAMICS: &str = "not part of the robot's dynamics in URDF";
const CONTACT: &str = "contact parameters of another simulator; contacts have MuJoCo's defaults here";
const COLOUR: &str = "it only colours";
const DRIVE: &str = "about a drive's inside; the joint's limits are `effort` and `velocity`";

/// Elements, and why they are left out.
const ELEMENTS: [(&str, &str); 15] = [
    ("gazebo", NOT_DYNAMICS),
    ("sensor", NOT_DYNAMICS),
    ("camera", NOT_DYNAMICS),
    ("plugin", NOT_DYNAMICS),
    ("transmission", NOT_DYNAMICS),
    ("ros2_control", NOT_DYNAMICS),
    ("verbose", NOT_DYNAMICS),
    ("self_filter", NOT_DYNAMICS),
    ("collision_checking", NOT_DYNAMICS),
    ("joint_properties", "settings of another program; the joint's own are in <limit> and <dynamics>"),
    ("self_collision_checking", "contacts are computed between the robot and the ground only"),
    ("contact", CONTACT),
    ("contact_coefficients", CONTACT),
    ("surface", CONTACT),
    ("material", COLOUR),
];

/// Attributes, and why they are left out.
const ATTRIBUTES: [(&str, &str); 5] = [
    ("dont_collapse", "bodies without joints are kept; the dynamics are the same"),
    ("command_effort", DRIVE),
    ("current", DRIVE),
    ("gear_velocity", DRIVE),
    ("concave", "meshes do not collide here"),
];

/// Lists an element without physics; `false`: it is none that is known.
pub(super) fn list_element(ctx: &mut Context, element: &Element, inside: &str) -> bool {
    let Some((_, why)) = ELEMENTS.iter().find(|(name, _)| *name == element.name) else { return false };
    let what = if inside.is_empty() { element.label() } else { format!("{} in {inside}", element.label()) };
    ctx.drop_quietly(element.at, what, *why);
    true
}

/// Lists the attributes without physics of an element.
pub(super) fn list_attributes(ctx: &mut Context, a: &mut Attributes) {
    for (name, why) in ATTRIBUTES {
        if a.text(name).is_some() {
            ctx.drop_quietly(a.at(name), format!("`{name}` of {}", a.element().label()), why);
        }
    }
}
