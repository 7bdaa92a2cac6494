//! Names of a file's things: present, different, short and printable.

use std::collections::HashSet;

use crate::attributes::Context;
use crate::error::ModelError;
use crate::scan::MAX_NAME;
use crate::shown::{commands, shown};
use crate::spec::Spec;
use crate::xml::At;

/// Gives unnamed things names and refuses names used twice.
pub(crate) fn name_everything(ctx: &Context, spec: &mut Spec) -> Result<(), ModelError> {
    if let Some(name) = &spec.name {
        check_name(ctx, At::default(), "model", name)?;
    }
    let mut bodies = Vec::new();
    let mut joints = Vec::new();
    let mut geoms = Vec::new();
    let mut sites = Vec::new();
    for body in &mut spec.bodies {
        // Sites have no place in the file here; messages name that of their body.
        let at = body.at;
        bodies.push((&mut body.name, at));
        joints.extend(body.joints.iter_mut().map(|(j, at)| (&mut j.name, *at)));
        geoms.extend(body.geoms.iter_mut().map(|g| (&mut g.name, g.at)));
        sites.extend(body.sites.iter_mut().map(|s| (&mut s.name, at)));
    }
    unique(ctx, "body", bodies)?;
    unique(ctx, "joint", joints)?;
    unique(ctx, "geom", geoms)?;
    unique(ctx, "site", sites)?;
    // Actuators do not keep their place in the file.
    unique(ctx, "actuator", spec.actuators.iter_mut().map(|a| (&mut a.name, At::default())).collect())?;
    unique(ctx, "keyframe", spec.keys.iter_mut().map(|k| (&mut k.name, k.at)).collect())
}

/// Names go into tables, pages and file names: they are short, and none commands a terminal.
fn check_name(ctx: &Context, at: At, kind: &str, name: &str) -> Result<(), ModelError> {
    if name.len() > MAX_NAME {
        let message = format!("{kind} name \"{}\" has {} bytes", shown(name), name.len());
        return Err(ctx.invalid(at, message, format!("give it at most {MAX_NAME}")));
    }
    if name.chars().any(commands) {
        let message = format!("{kind} name \"{}\" has control characters", shown(name));
        return Err(ctx.invalid(at, message, "remove them"));
    }
    Ok(())
}

fn unique(ctx: &Context, kind: &str, names: Vec<(&mut String, At)>) -> Result<(), ModelError> {
    let mut seen: HashSet<String> = HashSet::new();
    for (name, at) in &names {
        check_name(ctx, *at, kind, name)?;
        if !name.is_empty() && !seen.insert((*name).clone()) {
            return Err(ctx.invalid(
                *at,
                format!("{kind} name \"{}\" is used twice", shown(name)),
                "names must differ",
            ));
        }
    }
    // Only now are all names of the file known that a made-up one must differ from.
    for (index, (name, _)) in names.into_iter().enumerate() {
        if name.is_empty() {
            let mut made = format!("{kind}{index}");
            while seen.contains(&made) {
                made.push('_');
            }
            seen.insert(made.clone());
            *name = made;
        }
    }
    Ok(())
}
