//! The sections of an MJCF file, in the order in which they depend on each other.

use crate::actuator::{FOREIGN_KINDS, KINDS};
use crate::attach::attached;
use crate::attributes::{Attributes, Context};
use crate::bodies::BodyReader;
use crate::coupling::{read_couplings, resolve};
use crate::defaults::{APART, Defaults};
use crate::error::ModelError;
use crate::floor::add_floor;
use crate::mend;
use crate::model::{Joint, Root};
use crate::options::{Compiler, default_options, read_option};
use crate::outline::Meshes;
use crate::pairs::read_contact;
use crate::replicate::expand;
use crate::shown::shown;
use crate::spec::{Disabled, KeySpec, MAX_ITEMS, Spec};
use crate::terrain::{Fields, read_fields};
use crate::xml::Element;

/// Sections whose content has no influence on the motion.
const IGNORED: [&str; 4] = ["size", "visual", "statistic", "asset"];
/// Sections that are read.
const READ: [&str; 9] =
    ["compiler", "option", "default", APART, "worldbody", "contact", "actuator", "keyframe", "custom"];

/// Reads the element tree of a `<mujoco>` document. `wanted`: how the caller attaches the root.
pub(crate) fn read(ctx: &mut Context, document: &Element, wanted: Option<Root>) -> Result<Spec, ModelError> {
    let mut a = Attributes::new(document);
    let name = a.text("model").filter(|name| !name.is_empty()).map(str::to_string);
    a.finish(ctx)?;
    // First, because it says how all other numbers are to be read.
    let mut compiler = Compiler::default();
    for section in document.children.iter().filter(|child| child.name == "compiler") {
        compiler.read(ctx, section)?;
    }
    // Before copies are made: what is attached may hold <replicate> itself.
    let attached = attached(ctx, document)?;
    let document = attached.as_ref().unwrap_or(document);
    let expanded = expand(ctx, document, &compiler)?;
    let document = expanded.as_ref().unwrap_or(document);
    let sections = |wanted: &'static str| document.children.iter().filter(move |c| c.name == wanted);

    // Each section may name things of those before it: classes, assets, bodies, then contacts and actuators.
    let mut options = default_options();
    let mut disabled = Disabled::default();
    for section in sections("option") {
        read_option(ctx, section, &mut options, &mut disabled)?;
    }
    let mut defaults = Defaults::new();
    for section in sections("default").chain(sections(APART)) {
        defaults.read(ctx, section, &compiler)?;
    }
    let mut fields = Fields::default();
    for section in sections("asset") {
        read_fields(ctx, section, &compiler, &mut fields)?;
    }
    let mut meshes = Meshes::default();
    for section in sections("asset") {
        meshes.read(ctx, section, &compiler, &defaults)?;
    }
    let mut reader = BodyReader::new(ctx, &compiler, &defaults, &fields, &meshes);
    for section in sections("worldbody") {
        reader.read_world(section)?;
    }
    let mut bodies = reader.bodies;
    // Before the contacts, which may name it.
    add_floor(ctx, document, &defaults, &mut bodies, wanted);
    // Where the file switches equality constraints off, no joint follows another.
    let named =
        if disabled.equality { Vec::new() } else { read_couplings(ctx, sections("equality"), &defaults)? };
    let couplings = resolve(ctx, named, &bodies)?;

    let mut spec = Spec {
        name,
        options,
        disabled,
        bodies,
        fields: fields.all,
        excludes: Vec::new(),
        pairs: Vec::new(),
        actuators: Vec::new(),
        couplings,
        keys: Vec::new(),
        total_mass: compiler.total_mass,
    };
    for section in sections("contact") {
        read_contact(ctx, section, &defaults, &spec.bodies, &mut spec.excludes, &mut spec.pairs)?;
    }
    for section in sections("actuator") {
        read_actuators(ctx, section, &compiler, &defaults, &mut spec)?;
    }
    for section in sections("keyframe") {
        read_keys(ctx, section, &mut spec)?;
    }
    for section in sections("custom") {
        read_speed_limits(ctx, section, &mut spec)?;
    }
    // What nothing has read so far is listed or refused.
    for section in &document.children {
        other_section(ctx, section)?;
    }
    Ok(spec)
}

/// Sections that are not read: harmless ones pass, sensors are listed, the rest is refused.
fn other_section(ctx: &mut Context, section: &Element) -> Result<(), ModelError> {
    let name = section.name.as_str();
    if READ.contains(&name) || IGNORED.contains(&name) {
        return Ok(());
    }
    let count = section.children.len();
    match name {
        // An empty section asks for nothing.
        _ if count == 0 && ["sensor", "equality", "tendon", "deformable", "extension"].contains(&name) => {
            Ok(())
        }
        "sensor" => {
            ctx.drop_quietly(section.at, format!("<sensor> ({count} sensors)"), "the state is known exactly");
            Ok(())
        }
        "equality" => other_equalities(ctx, section),
        "tendon" | "deformable" => ctx.refuse(
            section.at,
            format!("<{name}> with {count} elements"),
            "the engine simulates trees without tendons or soft parts",
            "remove the section",
        ),
        "extension" => ctx.refuse(section.at, "<extension>", "plugins are not loaded", "remove the section"),
        _ => ctx.refuse(section.at, section.label(), "not a section of MJCF known here", "remove it"),
    }
}

/// The constraints of `<equality>` other than couplings of joints: they are refused, but for tendons' in a mending reading.
fn other_equalities(ctx: &mut Context, section: &Element) -> Result<(), ModelError> {
    for child in section.children.iter().filter(|child| mend::is_active(child)) {
        match child.name.as_str() {
            "joint" => {}
            // A mending reading drops the tendons, and these constraints go with them.
            "tendon" if ctx.mend && !ctx.lenient => {}
            "tendon" => ctx.refuse(
                child.at,
                format!("{} of <equality>", child.label()),
                "the engine simulates trees without tendons",
                "remove it",
            )?,
            _ => ctx.refuse_unmended(
                child.at,
                format!("{} of <equality>", child.label()),
                "it closes a loop, and the engine simulates trees",
                "take the robot's file of serial legs, if there is one",
            )?,
        }
    }
    Ok(())
}

fn read_actuators(
    ctx: &mut Context,
    section: &Element,
    compiler: &Compiler,
    defaults: &Defaults,
    spec: &mut Spec,
) -> Result<(), ModelError> {
    // In the file's order: an actuator has its joint's number in it until the robot is chosen.
    let joints: Vec<&Joint> = spec.bodies.iter().flat_map(|b| b.joints.iter().map(|(j, _)| j)).collect();
    for element in &section.children {
        let kind = element.name.as_str();
        if !KINDS.contains(&kind) {
            let why = if FOREIGN_KINDS.contains(&kind) {
                "this kind of actuator is not simulated"
            } else {
                "not known in <actuator>"
            };
            ctx.refuse(element.at, element.label(), why, "use motor, position, velocity or general")?;
            continue;
        }
        if spec.actuators.len() >= MAX_ITEMS {
            return Err(ctx.too_many(element.at, "actuators", MAX_ITEMS));
        }
        let mut a = Attributes::new(element);
        let class = match a.text("class") {
            Some(name) => defaults.find(ctx, a.at("class"), name)?,
            None => 0,
        };
        let mut form = defaults.class(class).actuator.clone();
        a.ignore(&["name"]);
        form.apply(ctx, &mut a)?;
        // The other attributes of an actuator that was dropped do not matter.
        if let Some(actuator) = form.finish(ctx, element, &mut a, compiler, &joints)? {
            a.finish(ctx)?;
            spec.actuators.push(actuator);
        }
    }
    Ok(())
}

fn read_keys(ctx: &mut Context, section: &Element, spec: &mut Spec) -> Result<(), ModelError> {
    for element in &section.children {
        if element.name != "key" {
            ctx.refuse(element.at, element.label(), "not known in <keyframe>", "remove it")?;
            continue;
        }
        if spec.keys.len() >= MAX_ITEMS {
            return Err(ctx.too_many(element.at, "keyframes", MAX_ITEMS));
        }
        let mut a = Attributes::new(element);
        // An empty attribute counts as absent.
        let filled = |values: Option<Vec<f64>>| values.filter(|v| !v.is_empty());
        let key = KeySpec {
            at: element.at,
            name: a.text("name").unwrap_or("").to_string(),
            qpos: filled(a.numbers(ctx, "qpos")?),
            qvel: filled(a.numbers(ctx, "qvel")?),
            ctrl: filled(a.numbers(ctx, "ctrl")?),
        };
        a.ignore(&["time", "act", "mpos", "mquat"]);
        a.finish(ctx)?;
        spec.keys.push(key);
    }
    Ok(())
}

/// `<tuple name="velocity_limit">` of joints: the speed limits (rad/s, of slides m/s) that MJCF has no attribute for.
/// Other custom data is the user's own.
fn read_speed_limits(ctx: &mut Context, section: &Element, spec: &mut Spec) -> Result<(), ModelError> {
    let tuples = section.children.iter().filter(|c| c.name == "tuple");
    for tuple in tuples.filter(|t| t.get("name") == Some("velocity_limit")) {
        for element in &tuple.children {
            let mut a = Attributes::new(element);
            a.word(ctx, "objtype", &["joint"])?;
            let wanted = a.text("objname").unwrap_or("");
            let limit = a.number(ctx, "prm")?.filter(|limit| *limit > 0.0);
            let joint = spec.bodies.iter_mut().flat_map(|b| &mut b.joints).find(|(j, _)| j.name == wanted);
            match (joint, limit) {
                (Some((joint, _)), Some(_)) if !wanted.is_empty() => joint.velocity_limit = limit,
                _ => {
                    return Err(ctx.invalid(
                        element.at,
                        format!("velocity_limit of joint \"{}\": no such joint, or no limit", shown(wanted)),
                        "write <element objtype=\"joint\" objname=\"...\" prm=\"speed above zero, rad/s (slides: m/s)\"/>",
                    ));
                }
            }
            a.finish(ctx)?;
        }
    }
    Ok(())
}
