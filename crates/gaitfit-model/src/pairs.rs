//! MJCF `<contact>`: explicit pairs and excluded bodies.

use crate::attributes::{Attributes, Context};
use crate::defaults::Defaults;
use crate::error::ModelError;
use crate::geom::read_condim;
use crate::model::ContactPair;
use crate::shown::shown;
use crate::spec::{BodySpec, MAX_ITEMS, PairSpec};
use crate::xml::Element;

/// Reads the parameters of a `<pair>` over the present values; the caller finishes the attributes.
pub(crate) fn apply_pair(
    ctx: &mut Context,
    a: &mut Attributes,
    pair: &mut ContactPair,
) -> Result<(), ModelError> {
    pair.condim = read_condim(ctx, a)?.unwrap_or(pair.condim);
    a.prefix(ctx, "friction", &mut pair.friction)?;
    if pair.friction.iter().any(|f| *f < 0.0) {
        return Err(ctx.invalid(a.at("friction"), "negative friction", "give zero or more"));
    }
    a.reference(ctx, "solref", &mut pair.solref)?;
    a.reference(ctx, "solreffriction", &mut pair.solreffriction)?;
    a.prefix(ctx, "solimp", &mut pair.solimp)?;
    a.set(ctx, "margin", &mut pair.margin)?;
    a.set(ctx, "gap", &mut pair.gap)?;
    a.refuse_nonzero(ctx, "adhesion", "adhesion is not simulated", "remove it")
}

/// Reads one `<contact>` section.
pub(crate) fn read_contact(
    ctx: &mut Context,
    element: &Element,
    defaults: &Defaults,
    bodies: &[BodySpec],
    excludes: &mut Vec<(usize, usize)>,
    pairs: &mut Vec<PairSpec>,
) -> Result<(), ModelError> {
    for child in &element.children {
        // Both lists count together, over all <contact> sections of the file.
        if excludes.len() + pairs.len() >= MAX_ITEMS {
            return Err(ctx.too_many(child.at, "contact pairs and excludes", MAX_ITEMS));
        }
        let mut a = Attributes::new(child);
        a.ignore(&["name"]);
        match child.name.as_str() {
            "exclude" => {
                let mut ends = [0; 2];
                for (end, name) in ends.iter_mut().zip(["body1", "body2"]) {
                    let wanted = a.text(name).unwrap_or("");
                    // Bodies without a name get one later; an absent attribute must not find them.
                    let number = bodies.iter().position(|b| !b.name.is_empty() && b.name == wanted);
                    *end = number.ok_or_else(|| unknown(ctx, child, "body", wanted))?;
                }
                a.finish(ctx)?;
                // In ascending order, as contacts ask for them.
                excludes.push((ends[0].min(ends[1]), ends[0].max(ends[1])));
            }
            "pair" => {
                let class = match a.text("class") {
                    Some(name) => defaults.find(ctx, a.at("class"), name)?,
                    None => 0,
                };
                let mut parameters = defaults.class(class).pair.clone();
                apply_pair(ctx, &mut a, &mut parameters)?;
                let mut geoms = [0; 2];
                for (geom, name) in geoms.iter_mut().zip(["geom1", "geom2"]) {
                    let wanted = a.text(name).unwrap_or("");
                    // Geoms are numbered over all bodies of the file, those of the world first.
                    let mut all = bodies.iter().flat_map(|b| &b.geoms);
                    let number = all.position(|g| !g.name.is_empty() && g.name == wanted);
                    *geom = number.ok_or_else(|| unknown(ctx, child, "geom", wanted))?;
                }
                a.finish(ctx)?;
                pairs.push(PairSpec { geoms, parameters });
            }
            _ => ctx.refuse(child.at, child.label(), "not known in <contact>", "remove it")?,
        }
    }
    Ok(())
}

fn unknown(ctx: &Context, element: &Element, what: &str, name: &str) -> ModelError {
    ctx.invalid(
        element.at,
        format!("{} names {what} \"{}\", which does not exist", element.label(), shown(name)),
        format!("name an existing {what}"),
    )
}
