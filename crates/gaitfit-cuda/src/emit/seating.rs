//! Which thread of an environment works on which part of the robot.
//!
//! Limbs are subtrees that hang on one link. Equal limbs, as many as the threads or a multiple of them, are shared out;
//! everything else belongs to all threads, which compute it alike.

use gaitfit_physics::{LinkOutline, Owner};

/// The place of a link or a contact pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    /// Its lane, or `None` if it belongs to all.
    lane: Option<usize>,
    /// Its counterpart in lane 0; itself if it belongs to all.
    twin: usize,
}

/// The places of everything on a robot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seating {
    lanes: usize,
    links: Vec<Place>,
    pairs: Vec<Place>,
}

impl Seating {
    /// Everything in one thread.
    pub fn alone(outline: &[LinkOutline]) -> Self {
        let in_all = |twin| Place { lane: None, twin };
        let pairs = outline.iter().map(|link| link.pairs.end).max().unwrap_or(0);
        Self {
            lanes: 1,
            links: (0..outline.len()).map(in_all).collect(),
            pairs: (0..pairs).map(in_all).collect(),
        }
    }

    /// Limbs shared among `lanes` threads, two or four; `None` if the robot has no limbs to share.
    pub fn shared(outline: &[LinkOutline], lanes: usize) -> Option<Self> {
        let mut seating = Self { lanes, ..Self::alone(outline) };
        let children = children(outline);
        let kinds = kinds(outline, &children);
        let mut has_limbs = false;
        // Links that belong to all, whose children are looked at.
        let mut trunk = vec![0];
        while let Some(link) = trunk.pop() {
            let mut left = children[link].clone();
            while let Some(&first) = left.first() {
                let (alike, others): (Vec<usize>, Vec<usize>) =
                    left.iter().partition(|&&child| kinds[child] == kinds[first]);
                left = others;
                // These limbs cannot be shared evenly. All threads compute them, and limbs that hang on them
                // may fit better.
                if !alike.len().is_multiple_of(lanes) {
                    trunk.extend(alike);
                    continue;
                }
                has_limbs = true;
                // With several limbs a lane, neighbours in the list go together.
                let each = alike.len() / lanes;
                for (number, &limb) in alike.iter().enumerate() {
                    seating.seat(outline, &children, number / each, limb, alike[number % each]);
                }
            }
        }
        has_limbs.then_some(seating)
    }

    /// Puts the limb that begins with `link` into a lane. `twin` begins its counterpart in lane 0.
    fn seat(
        &mut self,
        outline: &[LinkOutline],
        children: &[Vec<usize>],
        lane: usize,
        link: usize,
        twin: usize,
    ) {
        self.links[link] = Place { lane: Some(lane), twin };
        for (pair, twin) in outline[link].pairs.clone().zip(outline[twin].pairs.clone()) {
            self.pairs[pair] = Place { lane: Some(lane), twin };
        }
        for (&child, &twin) in children[link].iter().zip(&children[twin]) {
            self.seat(outline, children, lane, child, twin);
        }
    }

    /// Threads of an environment.
    pub fn lanes(&self) -> usize {
        self.lanes
    }

    /// The lane of an owner, `None` if it belongs to all, and its counterpart in lane 0.
    pub fn place(&self, owner: Owner) -> (Option<usize>, Owner) {
        let place = match owner {
            Owner::Base => None,
            Owner::Link(link) => self.links.get(link).map(|place| (place.lane, Owner::Link(place.twin))),
            Owner::Joint(joint) => self
                .links
                // Link 0 is the base; each further link hangs on one joint.
                .get(joint + 1)
                .map(|place| (place.lane, Owner::Joint(place.twin.saturating_sub(1)))),
            Owner::Pair(pair) => self.pairs.get(pair).map(|place| (place.lane, Owner::Pair(place.twin))),
        };
        place.unwrap_or((None, owner))
    }
}

fn children(outline: &[LinkOutline]) -> Vec<Vec<usize>> {
    let mut children = vec![Vec::new(); outline.len()];
    for (link, own) in outline.iter().enumerate().skip(1) {
        children[own.parent].push(link);
    }
    children
}

/// The kind of each subtree, as a text: equal texts mean equal subtrees, their children in the same order.
fn kinds(outline: &[LinkOutline], children: &[Vec<usize>]) -> Vec<String> {
    let mut kinds = vec![String::new(); outline.len()];
    // From the last link on: children have larger numbers than their parents.
    for link in (0..outline.len()).rev() {
        let inner: String = children[link].iter().map(|&child| kinds[child].as_str()).collect();
        kinds[link] = format!("({}{inner})", outline[link].kind);
    }
    kinds
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]
mod tests {
    use super::*;

    /// Links by parent and kind; the root first.
    fn outline(links: &[(usize, &str)]) -> Vec<LinkOutline> {
        let link =
            |&(parent, kind): &(usize, &str)| LinkOutline { parent, kind: kind.to_owned(), pairs: 0..0 };
        links.iter().map(link).collect()
    }

    #[test]
    fn a_quadruped_has_a_leg_or_two_a_thread() {
        let legs: Vec<(usize, &str)> =
            (0..4).flat_map(|leg| [(0, "hip"), (3 * leg + 1, "thigh"), (3 * leg + 2, "calf")]).collect();
        let outline = outline(&[vec![(0, "base")], legs].concat());
        let four = Seating::shared(&outline, 4).unwrap();
        assert_eq!(four.place(Owner::Joint(4)), (Some(1), Owner::Joint(1)));
        let two = Seating::shared(&outline, 2).unwrap();
        assert_eq!(two.place(Owner::Joint(4)), (Some(0), Owner::Joint(4)));
        assert_eq!(two.place(Owner::Joint(10)), (Some(1), Owner::Joint(4)));
        assert_eq!(two.place(Owner::Link(0)), (None, Owner::Link(0)));
    }

    #[test]
    fn arms_on_a_turning_trunk_are_shared() {
        // Two legs on the pelvis; a waist that carries two arms and a head.
        let outline = outline(&[
            (0, "pelvis"),
            (0, "leg"),
            (0, "leg"),
            (0, "waist"),
            (3, "arm"),
            (3, "head"),
            (3, "arm"),
        ]);
        assert_eq!(Seating::shared(&outline, 4), None);
        let two = Seating::shared(&outline, 2).unwrap();
        assert_eq!(two.place(Owner::Link(6)), (Some(1), Owner::Link(4)));
        assert_eq!(two.place(Owner::Link(5)), (None, Owner::Link(5)));
        assert_eq!(two.place(Owner::Joint(2)), (None, Owner::Joint(2)));
    }

    #[test]
    fn limbs_of_other_kinds_are_not_shared() {
        let outline = outline(&[(0, "base"), (0, "leg"), (0, "arm")]);
        assert_eq!(Seating::shared(&outline, 2), None);
    }
}
