//! From a model's couplings to those of a tree.

use std::ops::RangeInclusive;

use gaitfit_model::Model;

use crate::softness::{impedance, reference};
use crate::tree::{Coupling, Link, Reference, SEGMENT, Segment};
use crate::{PhysicsError, Real, Settings};

/// Sorts couplings by whether one segment holds all their joints.
pub(crate) struct Spans {
    /// Ranges of neighbouring joints that couplings connect. The joints of a range belong into one segment.
    pub near: Vec<RangeInclusive<usize>>,
    /// For each coupling of the model, whether its joints are too far apart for one segment.
    distant: Vec<bool>,
}

impl Spans {
    /// Chooses the couplings that one segment can hold, in the order of the file.
    pub fn new<K>(model: &Model, links: &[Link<K>]) -> Self {
        let mut spans = Self { near: Vec::new(), distant: Vec::new() };
        for coupling in &model.couplings {
            // A coupling without a leader holds its follower at a place, so its span is that one joint.
            let leader = coupling.leader.unwrap_or(coupling.follower);
            let mut span = coupling.follower.min(leader)..=coupling.follower.max(leader);
            let overlaps =
                |other: &RangeInclusive<usize>| other.start() <= span.end() && span.start() <= other.end();
            // A coupling joins the earlier spans that it overlaps: all their joints then need one segment.
            let (joined, apart): (Vec<_>, Vec<_>) = spans.near.iter().cloned().partition(overlaps);
            for other in joined {
                span = *other.start().min(span.start())..=*other.end().max(span.end());
            }
            // If the joined span does not fit into a segment, the earlier spans stay as they are and this
            // coupling is distant.
            let is_near = is_chain(links, &span);
            if is_near {
                spans.near = apart;
                spans.near.push(span);
            }
            spans.distant.push(!is_near);
        }
        spans
    }
}

/// Whether a span of joints fits into one segment: few joints, one after the other, without a branch between them.
fn is_chain<K>(links: &[Link<K>], span: &RangeInclusive<usize>) -> bool {
    let children = |link: usize| links[1..].iter().filter(|other| other.parent == link).count();
    // Joint j moves link j + 1.
    span.end() - span.start() < SEGMENT
        && (*span.start() + 1..=*span.end())
            .all(|joint| links[joint + 1].parent == joint && children(joint) == 1)
}

/// Constants of the couplings: those of each segment, then the distant ones. Sets each segment's range of them.
///
/// # Errors
/// A reference or an impedance that single precision cannot hold.
pub(crate) fn compile<T: Real>(
    model: &Model,
    settings: &Settings,
    spans: &Spans,
    segments: &mut [Segment],
) -> Result<Vec<Coupling<T::K>>, PhysicsError> {
    let mut all = Vec::with_capacity(model.couplings.len());
    // Appends those wanted and returns the end of their range.
    let mut add = |wanted: &dyn Fn(usize, bool) -> bool| {
        for (coupling, &distant) in model.couplings.iter().zip(&spans.distant) {
            if wanted(coupling.follower, distant) {
                all.push(compile_coupling::<T>(model, coupling, settings)?);
            }
        }
        Ok(all.len())
    };
    let mut first = 0;
    for segment in segments.iter_mut() {
        // Link i moves with joint i − 1.
        let joints = segment.first - 1..segment.first - 1 + segment.len;
        let end = add(&|follower, distant| !distant && joints.contains(&follower))?;
        segment.couplings = first..end;
        first = end;
    }
    add(&|_, distant| distant)?;
    Ok(all)
}

fn compile_coupling<T: Real>(
    model: &Model,
    coupling: &gaitfit_model::Coupling,
    settings: &Settings,
) -> Result<Coupling<T::K>, PhysicsError> {
    let (k, b, gain) = reference(&coupling.solref, coupling.solimp[1], settings);
    let label = format!("coupling of joint `{}`", model.joints[coupling.follower].name);
    // A very hard reference would overflow in a step of single precision.
    for (quantity, value) in [("the stiffness of solref", k), ("the damping of solref", b)] {
        if !(value as f32).is_finite() {
            let must = "finite in single precision";
            return Err(PhysicsError::Value { object: label, quantity, value, must });
        }
    }
    Ok(Coupling {
        follower: coupling.follower,
        leader: coupling.leader,
        polynomial: coupling.polynomial.map(T::constant),
        impedance: impedance(&coupling.solimp, T::constant, &label)?,
        reference: Reference { k: T::constant(k), b: T::constant(b), gain: T::constant(gain) },
    })
}
