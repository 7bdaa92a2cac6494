//! The shape of a compiled tree without its numbers, for code generators that look for equal limbs.

use std::fmt::Write as _;
use std::ops::Range;

use gaitfit_model::JointKind;

use crate::tree::{Impedance, LinkShape, Touched, Tree};

/// One link of a compiled tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkOutline {
    /// The link that carries it; 0 for the root itself.
    pub parent: usize,
    /// Everything but numbers that decides which operations a step does for this link. Links of the same kind, under
    /// parents that correspond, have equal operations with other numbers.
    pub kind: String,
    /// Its compiled contact pairs.
    pub pairs: Range<usize>,
}

impl<K> Tree<K> {
    /// The links, the root first, parents before children. Link `i` moves with joint `i − 1`.
    pub fn outline(&self) -> Vec<LinkOutline> {
        let outline = |number: usize| {
            let link = &self.links[number];
            let mut kind =
                format!("{:?} turned {} sprung {}", link.axis, link.turn.is_some(), link.has_spring);
            if link.kind == JointKind::Slide {
                kind.push_str(" slides");
            }
            // Writing to a string cannot fail, so the results are dropped.
            let _ = match &link.limit {
                Some(limit) => write!(kind, " limit {}", powers(&limit.impedance)),
                None => write!(kind, " free"),
            };
            for pair in &self.pairs[link.pairs.clone()] {
                let shape = match pair.shape {
                    LinkShape::Sphere => "sphere",
                    LinkShape::Capsule { .. } => "capsule",
                    LinkShape::Cylinder { .. } => "cylinder",
                    LinkShape::Box { .. } => "box",
                };
                let (condim, aligned) = (pair.condim, pair.aligned);
                let ground = match pair.touched {
                    Touched::Plane(plane) => format!("plane {plane}"),
                    other => format!("{other:?}"),
                };
                let powers = powers(&pair.impedance);
                let _ = write!(kind, " {shape} {condim} {ground} aligned {aligned} {powers}");
            }
            LinkOutline { parent: link.parent, kind, pairs: link.pairs.clone() }
        };
        (0..self.links.len()).map(outline).collect()
    }
}

/// The power of an impedance curve, which is written out as products and roots.
fn powers<K>(impedance: &Impedance<K>) -> String {
    format!("power {} {:x}", impedance.power, impedance.fraction)
}
