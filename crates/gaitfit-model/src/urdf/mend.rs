//! Inertias that no body can have.
//!
//! Exported URDFs give cameras, hatches and other small parts moments of inertia that violate A + B ≥ C, or a tensor that
//! is not positive definite. In a link that turns by itself that changes the motion, and it is refused. In a light link
//! that is fixed to another the mass at its place is what counts; there the three moments become their mean, as MuJoCo's
//! `balanceinertia` does.

use crate::attributes::Context;
use crate::error::ModelError;
use crate::shown::{shown, shown_number};
use crate::xml::At;

use super::Link;
use super::joint::Connection;

/// A link is light below this share of the robot's mass.
const LIGHT: f64 = 0.01;

/// An inertia that cannot be.
pub(super) struct Impossible {
    /// The `<inertial>`.
    pub at: At,
    /// The error if it is not mended.
    pub error: Box<ModelError>,
}

/// Mends the impossible inertias of light fixed links and lists them.
///
/// # Errors
/// An impossible inertia of another link, as its reader said it.
pub(super) fn mend_inertias(
    ctx: &mut Context,
    links: &mut [Link],
    connections: &[Connection],
) -> Result<(), ModelError> {
    let total: f64 = links.iter().map(|link| link.body.inertial.mass.max(0.0)).sum();
    // A dummy root that is fixed to the trunk moves with it.
    let is_base = |index: usize| {
        let fixed = |connection: &Connection| connection.parent == index && connection.is_fixed();
        connections.iter().any(fixed)
    };
    for (index, link) in links.iter_mut().enumerate() {
        let Some(Impossible { at, error }) = link.impossible.take() else { continue };
        let inertial = &mut link.body.inertial;
        // NaN if nothing has mass; no range contains it.
        let share = inertial.mass / total;
        let fixed = match link.held_by {
            Some(joint) => connections[joint].is_fixed(),
            None => is_base(index),
        };
        let finite = inertial.inertia.iter().all(|moment| moment.is_finite());
        if !(fixed && finite && (0.0..LIGHT).contains(&share)) {
            let label = format!("link \"{}\"", shown(&link.body.name));
            *inertial = crate::mend::balance(ctx, at, &label, *inertial).ok_or(*error)?;
            continue;
        }
        // A negative moment would make the mean too small.
        let mean = inertial.inertia.iter().map(|moment| moment.max(0.0)).sum::<f64>() / 3.0;
        let moments = inertial.inertia.map(|moment| shown_number(rounded(moment))).join(", ");
        ctx.note(
            at,
            format!("inertia of link \"{}\"", shown(&link.body.name)),
            format!(
                "no body has the principal moments [{moments}]; their mean {} stands for each: the link is fixed and \
                 has {:.1} % of the robot's mass",
                shown_number(rounded(mean)),
                100.0 * share
            ),
        );
        inertial.inertia = [mean; 3];
    }
    Ok(())
}

/// Three digits, for a message.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}
