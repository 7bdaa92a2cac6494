//! A floor for robots whose file has none.
//!
//! Many robot files leave the ground to a scene that includes them. Such a robot gets what a scene would say in one
//! line: `<geom type="plane"/>` at z = 0, with the file's default class.

use std::collections::HashSet;

use crate::attributes::Context;
use crate::defaults::Defaults;
use crate::model::Root;
use crate::rotation::IDENTITY;
use crate::shown::{shown, shown_number};
use crate::spec::{BodySpec, GeomKind, GeomSpec};
use crate::xml::{At, Element};

/// Name of a floor that no contact pair names.
const NAME: &str = "floor";

/// Adds a plane z = 0 to the world (`bodies[0]`) if the caller wants one, the robot floats and the file has neither a
/// plane nor a height field. Where a contact pair names a geom that is not there, as the floor of a scene, the plane
/// has this name.
pub(crate) fn add_floor(
    ctx: &mut Context,
    document: &Element,
    defaults: &Defaults,
    bodies: &mut [BodySpec],
    wanted: Option<Root>,
) {
    let floats = match wanted {
        Some(root) => root == Root::Floating,
        None => bodies.iter().any(|body| body.free.is_some()),
    };
    let ground = |geom: &GeomSpec| matches!(geom.kind, GeomKind::Plane | GeomKind::Field(_));
    if !ctx.add_floor || !floats || bodies.iter().flat_map(|body| &body.geoms).any(ground) {
        return;
    }
    let named = named_by_pairs(document, bodies);
    let mut name = named.clone().unwrap_or_else(|| NAME.to_string());
    // A geom of the robot may have this name already.
    while bodies.iter().flat_map(|body| &body.geoms).any(|geom| geom.name == name) {
        name.push('_');
    }
    let mut surface = defaults.class(0).geom.surface();
    if surface.is_visual() {
        // The file's default class turns contacts off, for its visuals: the floor gets MuJoCo's defaults.
        (surface.contype, surface.conaffinity) = (1, 1);
    }
    let friction = surface.friction.map(shown_number).join(" ");
    let for_pairs = if named.is_some() { ", as its contact pairs call it" } else { "" };
    ctx.note(
        At::default(),
        format!("floor \"{}\"", shown(&name)),
        format!("added{for_pairs}: the plane z = 0, friction {friction}; the file has no floor"),
    );
    // The floor is at no place of the file, which line 0 says.
    if let Some(change) = ctx.changed.last_mut() {
        (change.line, change.column) = (0, 0);
    }
    bodies[0].geoms.push(GeomSpec {
        name,
        at: At::default(),
        pos: [0.0; 3],
        quat: IDENTITY,
        kind: GeomKind::Plane,
        surface,
        mesh: None,
    });
}

/// The one name that explicit pairs give to a geom that the file does not have; `None` for none or several.
fn named_by_pairs(document: &Element, bodies: &[BodySpec]) -> Option<String> {
    let known: HashSet<&str> = bodies.iter().flat_map(|b| &b.geoms).map(|geom| geom.name.as_str()).collect();
    let pairs = document.children.iter().filter(|c| c.name == "contact").flat_map(|c| &c.children);
    let names = pairs.filter(|c| c.name == "pair").flat_map(|pair| [pair.get("geom1"), pair.get("geom2")]);
    let mut missing: Option<&str> = None;
    for name in names.flatten().filter(|name| !name.is_empty()) {
        if missing == Some(name) || known.contains(name) {
            continue;
        }
        if missing.is_some() {
            return None;
        }
        missing = Some(name);
    }
    missing.map(str::to_string)
}
