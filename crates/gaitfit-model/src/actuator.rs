//! MJCF actuators on joints: motor, position, velocity, general without dynamics.

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::joint::{AUTO, LIMITED, resolve_range};
use crate::model::{Actuator, Joint};
use crate::options::Compiler;
use crate::shown::shown;
use crate::xml::Element;

/// Actuator elements that are honoured.
pub(crate) const KINDS: [&str; 4] = ["general", "motor", "position", "velocity"];
/// Actuator elements of MuJoCo that are not.
pub(crate) const FOREIGN_KINDS: [&str; 9] =
    ["intvelocity", "damper", "cylinder", "muscle", "adhesion", "dcmotor", "orientation", "pid", "plugin"];

/// What a servo inherits of its class only if an element of a fitting kind set it.
#[derive(Clone, Copy, Debug)]
struct Gains {
    gain: f64,
    bias: [f64; 3],
    inherit_range: f64,
}

impl Default for Gains {
    fn default() -> Self {
        Self { gain: 1.0, bias: [0.0; 3], inherit_range: 0.0 }
    }
}

/// An actuator as written, over its default class. As in MuJoCo one class has a single actuator
/// default, which every kind of actuator element starts from.
#[derive(Clone, Debug)]
pub(crate) struct ActuatorForm {
    /// Kind of the last element that was read; absent for `general`. A servo of another kind does not inherit this class's
    /// gains. It inherits those of the classes around it.
    last: Option<&'static str>,
    gains: Gains,
    /// What position servos and velocity servos inherit from the classes around this one.
    outer: [Gains; 2],
    /// 0 none, 1 affine.
    bias_type: usize,
    gear: f64,
    ctrlrange: [f64; 2],
    ctrllimited: usize,
    forcerange: [f64; 2],
    forcelimited: usize,
}

impl Default for ActuatorForm {
    fn default() -> Self {
        Self {
            last: None,
            gains: Gains::default(),
            outer: [Gains::default(); 2],
            bias_type: 0,
            gear: 1.0,
            ctrlrange: [0.0; 2],
            ctrllimited: AUTO,
            forcerange: [0.0; 2],
            forcelimited: AUTO,
        }
    }
}

const NO_STATE: &str = "actuators with an activation state are not simulated";

impl ActuatorForm {
    /// What a class inside of this one begins with.
    pub fn inside(&self) -> Self {
        Self { outer: [self.inherited("position"), self.inherited("velocity")], ..self.clone() }
    }

    /// The gains that a servo of this kind starts from: the unit of a kp is not that of a kv.
    fn inherited(&self, servo: &str) -> Gains {
        match self.last {
            Some(last) if last != servo => self.outer[usize::from(servo == "velocity")],
            _ => self.gains,
        }
    }

    /// Reads one actuator element over the present values; the caller finishes the attributes.
    pub fn apply(&mut self, ctx: &mut Context, a: &mut Attributes) -> Result<(), ModelError> {
        let kind = a.element().name.as_str();
        let mut gear = [self.gear, 0.0, 0.0, 0.0, 0.0, 0.0];
        a.prefix(ctx, "gear", &mut gear)?;
        // The other five numbers are for sites, ball joints and free joints.
        self.gear = gear[0];
        a.set_array(ctx, "ctrlrange", &mut self.ctrlrange)?;
        a.set_array(ctx, "forcerange", &mut self.forcerange)?;
        if let Some(limited) = a.word(ctx, "ctrllimited", &LIMITED)? {
            self.ctrllimited = limited;
        }
        if let Some(limited) = a.word(ctx, "forcelimited", &LIMITED)? {
            self.forcelimited = limited;
        }
        a.refuse_nonzero(ctx, "delay", "use the simulator's delay parameter", "remove it")?;
        for name in ["damping", "armature"] {
            a.refuse_nonzero(ctx, name, "only joints carry it here", "move it to the joint")?;
        }
        a.ignore(&["group", "user", "lengthrange", "nsample", "interp"]);
        match kind {
            // A motor's force is its control, whatever gains and biases its class gives to servos.
            "motor" => {
                (self.gains.gain, self.gains.bias) = (1.0, [0.0; 3]);
                self.bias_type = 0;
                self.last = Some("motor");
            }
            "position" => self.apply_position(ctx, a)?,
            "velocity" => {
                let mut kv = self.inherited("velocity").gain;
                a.set_nonnegative(ctx, "kv", &mut kv)?;
                // A velocity servo's force is kv · (control − velocity).
                (self.gains.gain, self.bias_type, self.gains.bias) = (kv, 1, [0.0, 0.0, -kv]);
                self.last = Some("velocity");
            }
            _ => self.apply_general(ctx, a)?,
        }
        Ok(())
    }

    fn apply_position(&mut self, ctx: &mut Context, a: &mut Attributes) -> Result<(), ModelError> {
        self.gains = self.inherited("position");
        let mut kp = self.gains.gain;
        a.set_nonnegative(ctx, "kp", &mut kp)?;
        // NaN stands for what the element does not state: 0 is a value that a file may give.
        let (mut kv, mut ratio) = (f64::NAN, f64::NAN);
        a.set_nonnegative(ctx, "kv", &mut kv)?;
        a.set_nonnegative(ctx, "dampratio", &mut ratio)?;
        // A position servo's force is kp · (control − position), less kv times the velocity.
        (self.gains.gain, self.bias_type) = (kp, 1);
        (self.gains.bias[0], self.gains.bias[1]) = (0.0, -kp);
        // As in MuJoCo a positive entry is a damping ratio, resolved when all masses are known.
        match (kv.is_nan(), ratio.is_nan()) {
            (true, true) => {}
            // Not `-kv`: a kv of 0 would become −0.
            (false, true) => self.gains.bias[2] = 0.0 - kv,
            (true, false) => self.gains.bias[2] = ratio,
            (false, false) => {
                return Err(ctx.invalid(a.at("kv"), "both `kv` and `dampratio`", "keep one"));
            }
        }
        self.last = Some("position");
        a.refuse_nonzero(ctx, "timeconst", NO_STATE, "remove it")?;
        a.set_nonnegative(ctx, "inheritrange", &mut self.gains.inherit_range)
    }

    fn apply_general(&mut self, ctx: &mut Context, a: &mut Attributes) -> Result<(), ModelError> {
        let label = a.element().label();
        if let Some(text) = a.text("dyntype").filter(|t| *t != "none") {
            let what = format!("{label} with dyntype {}", shown(text));
            ctx.refuse(a.at("dyntype"), what, NO_STATE, "use dyntype=\"none\"")?;
        }
        if let Some(text) = a.text("gaintype").filter(|t| *t != "fixed") {
            let what = format!("{label} with gaintype {}", shown(text));
            ctx.refuse(a.at("gaintype"), what, "only fixed gains", "use gaintype=\"fixed\"")?;
        }
        match a.text("biastype") {
            None => {}
            Some("none") => self.bias_type = 0,
            Some("affine") => self.bias_type = 1,
            Some(text) => {
                let what = format!("{label} with biastype {}", shown(text));
                ctx.refuse(a.at("biastype"), what, "only none and affine", "use biastype=\"affine\"")?;
            }
        }
        // MJCF takes ten numbers: of a fixed gain the first counts, of an affine bias the first three.
        let mut gain = [self.gains.gain, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        a.prefix(ctx, "gainprm", &mut gain)?;
        self.gains.gain = gain[0];
        let mut bias = [0.0; 10];
        bias[..3].copy_from_slice(&self.gains.bias);
        a.prefix(ctx, "biasprm", &mut bias)?;
        self.gains.bias = [bias[0], bias[1], bias[2]];
        // Servos of every kind start from its gains.
        self.last = None;
        a.refuse_nonzero(ctx, "actrange", NO_STATE, "remove it")?;
        if a.boolean(ctx, "actearly")? == Some(true) {
            ctx.refuse(a.at("actearly"), format!("`actearly` of {label}"), NO_STATE, "remove it")?;
        }
        // `input` says what the control means; the force of a fixed gain is the same.
        a.ignore(&["actlimited", "actdim", "dynprm", "input"]);
        Ok(())
    }

    /// The actuator, or `None` when it was refused and read leniently.
    pub fn finish(
        &self,
        ctx: &mut Context,
        element: &Element,
        a: &mut Attributes,
        compiler: &Compiler,
        joints: &[&Joint],
    ) -> Result<Option<Actuator>, ModelError> {
        let at = element.at;
        let label = element.label();
        for name in ["tendon", "site", "refsite", "body", "slidersite", "cranksite", "cranklength"] {
            if a.text(name).is_some() {
                ctx.refuse(a.at(name), format!("{label} on a {name}"), "only joints", "use `joint`")?;
                return Ok(None);
            }
        }
        // On hinges and slides `jointinparent` means the same as `joint`.
        let Some(target) = a.text("joint").or_else(|| a.text("jointinparent")) else {
            return Err(ctx.invalid(at, format!("{label} drives nothing"), "add joint=\"...\""));
        };
        let Some(joint) = joints.iter().position(|j| !j.name.is_empty() && j.name == target) else {
            let message =
                format!("{label} names joint \"{}\", which is no hinge or slide of the file", shown(target));
            if ctx.drops() {
                ctx.refuse(at, message, "its joint is missing or was dropped", "correct the name")?;
                return Ok(None);
            }
            return Err(ctx.invalid(at, message, "name one of the file's hinges or slides"));
        };
        let Gains { gain, bias, inherit_range } = self.gains;
        let mut ctrlrange = self.ctrlrange;
        // Only a position servo has targets that a joint's range can bound.
        if inherit_range > 0.0 && self.bias_type == 1 && gain == -bias[1] {
            if ctrlrange != [0.0; 2] {
                return Err(ctx.invalid(
                    at,
                    format!("{label} has both `ctrlrange` and `inheritrange`"),
                    "keep one",
                ));
            }
            let Some([low, high]) = joints[joint].range else {
                return Err(ctx.invalid(
                    at,
                    format!("{label} inherits the range of a joint without one"),
                    "give the joint a range, or the actuator a `ctrlrange`",
                ));
            };
            // MuJoCo widens the joint's range about its middle by this factor.
            let (mean, radius) = (0.5 * (high + low), 0.5 * (high - low) * inherit_range);
            ctrlrange = [mean - radius, mean + radius];
        }
        Ok(Some(Actuator {
            name: element.get("name").unwrap_or("").to_string(),
            joint,
            gear: self.gear,
            ctrlrange: resolve_range(ctx, at, &label, "ctrlrange", self.ctrllimited, ctrlrange, compiler)?,
            forcerange: resolve_range(
                ctx,
                at,
                &label,
                "forcerange",
                self.forcelimited,
                self.forcerange,
                compiler,
            )?,
            gain,
            bias: if self.bias_type == 1 { bias } else { [0.0; 3] },
        }))
    }
}
