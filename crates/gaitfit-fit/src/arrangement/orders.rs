//! The orders in which programs list the joints of a robot with legs.

use crate::init::path;
use gaitfit_model::Model;
use gaitfit_model::patterns::plain;

/// More limbs than these have too many orders: then the usual ones alone are tried.
const MAX_PERMUTED: usize = 4;

/// A policy's joints as limbs: joints that hang on one another.
pub(super) struct Limbs {
    /// Names of the joints, in the policy's order.
    names: Vec<String>,
    /// For each limb its joints as places in the policy's order, from the base outwards.
    limbs: Vec<Vec<usize>>,
    /// Places in the policy's order, in the order of the robot's file.
    file: Vec<usize>,
    /// The same level by level from the base, each level in the order of the file, as Isaac Lab lists joints.
    breadth_first: Vec<usize>,
}

impl Limbs {
    /// `joints`: for each place of the policy the joint's index in `model`.
    pub fn new(model: &Model, joints: &[usize]) -> Self {
        let names = joints.iter().map(|&joint| plain(&model.joints[joint].name).to_owned()).collect();
        let mut file: Vec<usize> = (0..joints.len()).collect();
        file.sort_by_key(|&place| joints[place]);
        let mut limbs: Vec<(usize, Vec<usize>)> = Vec::new();
        for &place in &file {
            // Joints whose ways from the base begin with the same joint are one limb.
            let first = path(model, model.joints[joints[place]].body).first().copied().unwrap_or_default();
            match limbs.iter_mut().find(|(root, _)| *root == first) {
                Some((_, limb)) => limb.push(place),
                None => limbs.push((first, vec![place])),
            }
        }
        let depth = |place: usize| path(model, model.joints[joints[place]].body).len();
        let mut limbs: Vec<Vec<usize>> = limbs.into_iter().map(|(_, limb)| limb).collect();
        // The sort is stable, so joints on one body stay in the file's order.
        limbs.iter_mut().for_each(|limb| limb.sort_by_key(|&place| depth(place)));
        let mut breadth_first = file.clone();
        breadth_first.sort_by_key(|&place| depth(place));
        Self { names, limbs, file, breadth_first }
    }

    /// Whether limbs are as long as one another.
    fn alike(&self) -> bool {
        self.limbs.len() > 1 && self.limbs.iter().all(|limb| limb.len() == self.limbs[0].len())
    }

    /// Orders other than the policy's, each with a name: place k of the policy stands for the joint at `order[k]`.
    pub fn orders(&self) -> Vec<(String, Vec<usize>)> {
        let mut orders = vec![("of the robot's file".to_owned(), self.file.clone())];
        let mut sorted: Vec<usize> = (0..self.names.len()).collect();
        sorted.sort_by(|&a, &b| self.names[a].cmp(&self.names[b]));
        orders.push(("of the alphabet".to_owned(), sorted));
        // Only limbs with the same joints can be listed leg by leg or type by type.
        if self.alike() {
            for sequence in self.sequences() {
                let legs: Vec<String> = sequence.iter().map(|&limb| self.label(limb)).collect();
                let legs = legs.join(" ");
                let by_leg = sequence.iter().flat_map(|&limb| self.limbs[limb].iter().copied()).collect();
                let by_type = (0..self.limbs[0].len())
                    .flat_map(|joint| sequence.iter().map(move |&limb| (limb, joint)))
                    .map(|(limb, joint)| self.limbs[limb][joint])
                    .collect();
                let known = |by_type: bool| match (legs.as_str(), by_type) {
                    ("FR FL RR RL", false) => " (Unitree's motors)",
                    ("FL FR RL RR", true) => " (Isaac Lab's, breadth first)",
                    _ => "",
                };
                orders.push((format!("{legs}, leg by leg{}", known(false)), by_leg));
                orders.push((format!("{legs}, type by type{}", known(true)), by_type));
            }
        } else {
            orders.push(("breadth first (Isaac Lab's)".to_owned(), self.breadth_first.clone()));
        }
        // The policy's own order is no change.
        let same: Vec<usize> = (0..self.names.len()).collect();
        // Different names may mean the same order; the first name is kept.
        let mut seen = vec![same];
        orders.retain(|(_, order)| {
            let new = !seen.contains(order);
            if new {
                seen.push(order.clone());
            }
            new
        });
        orders
    }

    /// Sequences of the limbs.
    fn sequences(&self) -> Vec<Vec<usize>> {
        let count = self.limbs.len();
        if count > MAX_PERMUTED {
            let forward: Vec<usize> = (0..count).collect();
            // Neighbours swapped: limbs are often listed with left and right side by side.
            let swapped = (0..count).map(|limb| if limb ^ 1 < count { limb ^ 1 } else { limb }).collect();
            let backward = (0..count).rev().collect();
            return vec![forward, swapped, backward];
        }
        // All permutations, by adding one limb at a time.
        let mut sequences: Vec<Vec<usize>> = vec![Vec::new()];
        for _ in 0..count {
            let longer = |sequence: &Vec<usize>| {
                let rest = (0..count).filter(|limb| !sequence.contains(limb));
                rest.map(|limb| [sequence.clone(), vec![limb]].concat()).collect::<Vec<_>>()
            };
            sequences = sequences.iter().flat_map(longer).collect();
        }
        // Orders that have names of their own come first: of two that fit alike the first is taken.
        sequences.sort_by_key(|sequence| {
            let legs: Vec<String> = sequence.iter().map(|&limb| self.label(limb)).collect();
            !["FR FL RR RL", "FL FR RL RR"].contains(&legs.join(" ").as_str())
        });
        sequences
    }

    /// A limb's name: what the names of its joints begin with alike, or its first joint's name.
    fn label(&self, limb: usize) -> String {
        let limb = &self.limbs[limb];
        let first = &self.names[limb[0]];
        let parts = first.split('_').collect::<Vec<_>>();
        // The longest common beginning comes first, so `FL_front_hip` and `FL_front_knee` are called
        // `FL_front`.
        let shared = (1..parts.len())
            .rev()
            .map(|count| parts[..count].join("_"))
            .find(|start| limb.iter().all(|&place| self.names[place].starts_with(start.as_str())));
        shared.unwrap_or_else(|| first.clone())
    }

    /// Joints that may turn the other way together, by name: those of one type, also of one side, and all.
    pub fn groups(&self) -> Vec<(String, Vec<bool>)> {
        let joints = self.names.len();
        let marked = |places: &[usize]| (0..joints).map(|place| places.contains(&place)).collect::<Vec<_>>();
        let mut groups = vec![("all joints".to_owned(), vec![true; joints])];
        if self.alike() {
            for joint in 0..self.limbs[0].len() {
                let chosen_joints = |limbs: &dyn Fn(usize) -> bool| -> Vec<usize> {
                    let chosen = (0..self.limbs.len()).filter(|&limb| limbs(limb));
                    chosen.map(|limb| self.limbs[limb][joint]).collect()
                };
                // Sides by the names, or every other limb.
                let right = |limb: usize| {
                    let label = self.label(limb).to_lowercase();
                    let is_right = label.ends_with('r') || label.contains("right");
                    let other = label.ends_with('l') || label.contains("left");
                    if is_right || other { is_right } else { limb % 2 == 1 }
                };
                for places in
                    [chosen_joints(&|_| true), chosen_joints(&right), chosen_joints(&|limb| !right(limb))]
                {
                    let names: Vec<&str> = places.iter().map(|&place| self.names[place].as_str()).collect();
                    groups.push((names.join(", "), marked(&places)));
                }
            }
        }
        groups
    }
}
