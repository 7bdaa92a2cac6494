//! MJCF `<joint>`: hinges and slides; a free joint only at the root; what the engine lacks is refused.

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::joint_kind::JointKind;
use crate::model::{FreeJoint, Joint};
use crate::options::Compiler;
use crate::rotation::{Quat, Vec3, add, rotate, unit};
use crate::shown::shown_number;
use crate::spec::default_joint;
use crate::xml::{At, Element};

/// `joint type`, in MuJoCo's words.
const TYPES: [&str; 4] = ["hinge", "free", "slide", "ball"];

/// `limited` and its like.
pub(crate) const LIMITED: [&str; 3] = ["false", "true", "auto"];
/// Index of `auto` in [`LIMITED`].
pub(crate) const AUTO: usize = 2;

/// A `<joint>` as written, over its default class. Angles of hinges are in the file's unit until finished.
#[derive(Clone, Debug)]
pub(crate) struct JointForm {
    kind: usize,
    joint: Joint,
    range: [f64; 2],
    limited: usize,
    force_range: [f64; 2],
    force_limited: usize,
    /// Time constant (s) and damping ratio of the spring, or zeros.
    spring_damper: [f64; 2],
}

impl Default for JointForm {
    fn default() -> Self {
        Self {
            kind: 0,
            joint: default_joint(),
            range: [0.0; 2],
            limited: AUTO,
            force_range: [0.0; 2],
            force_limited: AUTO,
            spring_damper: [0.0; 2],
        }
    }
}

/// Result of reading a `<joint>`.
pub(crate) enum Finished {
    Moving(Box<Joint>),
    Free(FreeJoint),
    /// Refused, but read leniently.
    Dropped,
}

impl JointForm {
    /// Reads attributes over the present values; the caller finishes the attributes.
    pub fn apply(&mut self, ctx: &mut Context, a: &mut Attributes) -> Result<(), ModelError> {
        if let Some(kind) = a.word(ctx, "type", &TYPES)? {
            self.kind = kind;
        }
        let j = &mut self.joint;
        a.set_array(ctx, "pos", &mut j.pos)?;
        a.set_array(ctx, "axis", &mut j.axis)?;
        a.set_array(ctx, "range", &mut self.range)?;
        a.set_array(ctx, "actuatorfrcrange", &mut self.force_range)?;
        if let Some(limited) = a.word(ctx, "limited", &LIMITED)? {
            self.limited = limited;
        }
        if let Some(limited) = a.word(ctx, "actuatorfrclimited", &LIMITED)? {
            self.force_limited = limited;
        }
        a.reference(ctx, "solreflimit", &mut j.solref_limit)?;
        a.prefix(ctx, "solimplimit", &mut j.solimp_limit)?;
        a.reference(ctx, "solreffriction", &mut j.solref_friction)?;
        a.prefix(ctx, "solimpfriction", &mut j.solimp_friction)?;
        a.set_nonnegative(ctx, "armature", &mut j.armature)?;
        a.set_nonnegative(ctx, "frictionloss", &mut j.frictionloss)?;
        linear(ctx, a, "damping", &mut j.damping)?;
        linear(ctx, a, "stiffness", &mut j.stiffness)?;
        a.set(ctx, "margin", &mut j.margin)?;
        a.set(ctx, "ref", &mut j.reference)?;
        a.set(ctx, "springref", &mut j.springref)?;
        a.set_array(ctx, "springdamper", &mut self.spring_damper)?;
        if a.boolean(ctx, "actuatorgravcomp")? == Some(true) {
            let at = a.at("actuatorgravcomp");
            ctx.refuse(at, "`actuatorgravcomp`", "gravity compensation is not simulated", "remove it")?;
        }
        a.ignore(&["group", "user"]);
        Ok(())
    }

    /// The joint in its body's frame; `frame` is the pose of enclosing `<frame>` elements.
    pub fn finish(
        &self,
        ctx: &mut Context,
        element: &Element,
        compiler: &Compiler,
        frame: (Vec3, Quat),
    ) -> Result<Finished, ModelError> {
        let at = element.at;
        let kind = match TYPES[self.kind] {
            "free" => {
                let j = &self.joint;
                if j.stiffness != 0.0 {
                    ctx.refuse(
                        at,
                        element.label(),
                        "stiffness of the free joint (perhaps from a default class) is not simulated",
                        "use <freejoint/>, which takes no defaults",
                    )?;
                }
                // Axis, range and reference mean nothing to a free joint.
                return Ok(Finished::Free(FreeJoint {
                    armature: j.armature,
                    damping: j.damping,
                    frictionloss: j.frictionloss,
                    solref_friction: j.solref_friction,
                    solimp_friction: j.solimp_friction,
                }));
            }
            "ball" => {
                let remedy = "replace it by hinges, or weld the body by removing the joint";
                ctx.refuse_unmended(at, element.label(), "ball joints are not simulated", remedy)?;
                return Ok(Finished::Dropped);
            }
            "slide" => JointKind::Slide,
            _ => JointKind::Hinge,
        };
        let mut j = self.joint.clone();
        j.name = element.get("name").unwrap_or("").to_string();
        j.kind = kind;
        // The file writes axis and anchor in the axes of the enclosing frames.
        j.axis = unit(rotate(frame.1, j.axis)).ok_or_else(|| {
            ctx.invalid(at, format!("{}: the axis is zero", element.label()), "give a direction")
        })?;
        j.pos = add(frame.0, rotate(frame.1, j.pos));
        // As with `dampratio`, what it stands for is computed when all masses are known.
        if self.spring_damper.iter().all(|value| *value > 0.0) {
            let [time, ratio] = self.spring_damper;
            // Negative numbers mark them until then.
            (j.stiffness, j.damping) = (-time, -ratio);
        }
        // Positions of slides are metres, whatever the file's unit of angles.
        let position = |value: f64| if kind.is_hinge() { compiler.units.radians(value) } else { value };
        j.reference = position(j.reference);
        j.springref = position(j.springref);
        j.range = resolve_range(ctx, at, &element.label(), "range", self.limited, self.range, compiler)?
            .map(|range| range.map(position));
        j.actuatorfrcrange = resolve_range(
            ctx,
            at,
            &element.label(),
            "actuatorfrcrange",
            self.force_limited,
            self.force_range,
            compiler,
        )?;
        Ok(Finished::Moving(Box::new(j)))
    }
}

/// A coefficient that newer MuJoCo lets be a polynomial; only the linear part is simulated.
fn linear(ctx: &mut Context, a: &mut Attributes, name: &str, target: &mut f64) -> Result<(), ModelError> {
    let mut values = [*target, 0.0, 0.0];
    a.prefix(ctx, name, &mut values)?;
    if values[0] < 0.0 {
        return Err(ctx.invalid(
            a.at(name),
            format!("`{name}` of {} is {}", a.element().label(), shown_number(values[0])),
            "give a value of zero or more",
        ));
    }
    if values[1..] != [0.0; 2] {
        let what = format!("`{name}` of {}", a.element().label());
        ctx.refuse(a.at(name), what, "only the linear coefficient is simulated", "give one number")?;
    }
    *target = values[0];
    Ok(())
}

/// MuJoCo's rule for `limited`: explicit, or by the presence of a range under `autolimits`.
pub(crate) fn resolve_range(
    ctx: &Context,
    at: At,
    label: &str,
    name: &str,
    limited: usize,
    range: [f64; 2],
    compiler: &Compiler,
) -> Result<Option<[f64; 2]>, ModelError> {
    // MuJoCo's default, which stands for no range.
    let given = range != [0.0; 2];
    let on = match LIMITED[limited] {
        "true" => true,
        "false" => false,
        _ if given && !compiler.autolimits => {
            return Err(ctx.invalid(
                at,
                format!("{label} has `{name}`, but autolimits is off and it does not say whether limited"),
                "set the `limited` attribute, or autolimits=\"true\"",
            ));
        }
        _ => given,
    };
    // Only a range that acts must be in order.
    if on && range[0] >= range[1] {
        return Err(ctx.invalid(
            at,
            format!("`{name}` of {label} is [{}, {}]", shown_number(range[0]), shown_number(range[1])),
            "give a lower and a higher bound",
        ));
    }
    Ok(on.then_some(range))
}
