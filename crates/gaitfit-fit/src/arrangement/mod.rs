//! Why a policy does not act as it should: joints in another order, signs, or scales of actions and observations. The usual
//! arrangements are tried, and the one that fits is named with the setting to change.
//!
//! Two measures say whether an arrangement fits: logged actions follow from logged observations ([`of_logs`]), or the robot
//! walks in the simulator ([`of_walk`]).

mod logs;
mod orders;
mod search;
mod walk;

pub use logs::{LogMatch, match_log, of_logs};
pub use walk::of_walk;

use gaitfit_policy::{Interface, Quantity};
use orders::Limbs;
use serde::Serialize;

/// An arrangement that fits where the given one does not.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Diagnosis {
    /// The differences, each in words.
    pub changes: Vec<String>,
    /// The settings with which it fits, each a line of a policy's description or of a configuration.
    pub settings: Vec<String>,
    /// The measure of the given arrangement, and with the changes; smaller is better.
    pub measure: [f64; 2],
    /// Name of the measure.
    pub measured: &'static str,
}

impl Diagnosis {
    /// The diagnosis in a sentence or two.
    pub fn text(&self) -> String {
        let [before, after] = self.measure;
        format!(
            "With {} it fits: the {} is {after:.3} instead of {before:.3}. Set {}",
            self.changes.join(" and "),
            self.measured,
            self.settings.join("; ")
        )
    }
}

/// The order, signs and scales by which a policy's outputs and a log or robot belong together. It begins as the
/// policy's file says.
#[derive(Clone, Debug)]
struct Arrangement {
    interface: Interface,
    /// The joint that each of the policy's places stands for, as an index into the given interface's joints.
    order: Vec<usize>,
    /// The same for the logged actions' columns, which may be named in another order than the positions'.
    action_order: Vec<usize>,
    /// Factor of each logged action on the policy's output, policy order.
    action_factor: Vec<f64>,
    changes: Vec<String>,
    settings: Vec<String>,
}

/// One difference from an arrangement.
#[derive(Clone, Debug)]
enum Change {
    /// Joints in the order `order`, called `name`.
    Order { name: String, order: Vec<usize>, part: Ordered },
    /// Joints whose positive direction is the opposite.
    Signs { name: String, flipped: Vec<bool>, actions_alone: bool },
    /// All actions times a factor.
    ActionScale(f64),
    /// Another factor on a term of the observation.
    Scale(Quantity, Vec<f32>),
    /// Two terms of the observation in each other's place.
    Terms([usize; 2]),
}

/// The part that is in another order.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Ordered {
    /// The names in `joints` alone: pose, gains and scales are right place by place.
    Names,
    /// Names with pose, gains and scales.
    All,
    /// The columns of the logged actions alone.
    Actions,
}

impl Arrangement {
    fn new(interface: &Interface) -> Self {
        let joints = interface.joints.len();
        Self {
            interface: interface.clone(),
            order: (0..joints).collect(),
            action_order: (0..joints).collect(),
            action_factor: vec![1.0; joints],
            changes: Vec::new(),
            settings: Vec::new(),
        }
    }

    /// The same arrangement with `change`. `derived`: whether the log's actions follow from its targets, or there is
    /// no log, so that the interface's scale decides, not the log's columns.
    fn with(&self, change: &Change, derived: bool) -> Self {
        let mut new = self.clone();
        match change {
            Change::Order { name, order, part } => new.reorder(name, order, *part),
            Change::Signs { name, flipped, actions_alone } => {
                new.flip(name, flipped, *actions_alone, derived)
            }
            Change::ActionScale(factor) => new.scale_actions(*factor, derived),
            Change::Terms([first, second]) => new.swap_terms(*first, *second),
            Change::Scale(quantity, scale) => {
                for term in new.interface.observation.iter_mut().filter(|term| term.quantity == *quantity) {
                    term.scale.clone_from(scale);
                }
                let numbers: Vec<String> = scale.iter().map(f32::to_string).collect();
                let name = quantity.name();
                new.changes.push(format!("the observation's {name} times {}", numbers.join(", ")));
                new.settings.push(format!("`scale = [{}]` of {name} in `observation`", numbers.join(", ")));
            }
        }
        new
    }

    fn reorder(&mut self, name: &str, order: &[usize], part: Ordered) {
        fn moved<T: Clone>(list: &mut Vec<T>, order: &[usize]) {
            *list = order.iter().map(|&from| list[from].clone()).collect();
        }
        let names: Vec<String> = order.iter().map(|&joint| self.interface.joints[joint].clone()).collect();
        // The columns of actions alone: the interface stays, and the log is at fault.
        if part == Ordered::Actions {
            moved(&mut self.action_order, order);
            self.changes.push(format!("the columns of the actions (act_…) in the order {name}"));
            self.settings.push(format!(
                "the log's columns: those that are called act_{} hold the actions of {}, in this order",
                self.interface.joints.join(", act_"),
                names.join(", ")
            ));
            return;
        }
        moved(&mut self.order, order);
        moved(&mut self.action_order, order);
        let interface = &mut self.interface;
        moved(&mut interface.joints, order);
        if part == Ordered::All {
            let lists = [
                &mut interface.default_pose,
                &mut interface.action_scale,
                &mut interface.kp,
                &mut interface.kd,
            ];
            lists.into_iter().for_each(|list| moved(list, order));
            // A term with one number for each joint belongs to the joints too.
            for term in interface.observation.iter_mut().filter(|term| term.scale.len() == order.len()) {
                moved(&mut term.scale, order);
            }
        }
        let lists = if part == Ordered::All { ", with pose, gains and scales in the same order" } else { "" };
        self.changes.push(format!("the joints in the order {name}"));
        let quoted: Vec<String> = names.iter().map(|name| format!("{name:?}")).collect();
        self.settings.push(format!("`joints = [{}]`{lists}", quoted.join(", ")));
    }

    fn flip(&mut self, name: &str, flipped: &[bool], actions_alone: bool, derived: bool) {
        let sign = |joint: usize| if flipped[joint] { -1.0 } else { 1.0 };
        let joints = flipped.len();
        // Actions that follow from targets turn with the joint. Logged ones are the policy's own outputs and do not.
        if derived {
            (0..joints).for_each(|joint| self.interface.action_scale[joint] *= sign(joint));
        } else if actions_alone {
            (0..joints).for_each(|joint| self.action_factor[joint] *= sign(joint));
        }
        if actions_alone {
            self.changes.push(format!("the actions of {name} reversed"));
            self.settings.push(match derived {
                true => format!("`action_scale` of {name} to its negative"),
                false => format!("the log's columns act_… of {name} to their negatives"),
            });
            return;
        }
        // A joint that turns the other way is also measured the other way.
        let measured = [Quantity::JointPosition, Quantity::JointVelocity];
        for term in self.interface.observation.iter_mut().filter(|term| measured.contains(&term.quantity)) {
            let old = |joint: usize| match term.scale[..] {
                [] => 1.0,
                [one] => one,
                _ => term.scale[joint],
            };
            // A scale may be absent, one number for all, or one for each joint.
            term.scale = (0..joints).map(|joint| old(joint) * sign(joint) as f32).collect();
        }
        self.changes.push(format!("{name} turning the other way"));
        self.settings.push(format!(
            "negative `scale` of joint_position and joint_velocity in `observation`, and negative `action_scale`, for {name}; \
             or turn the signs of their columns in the log"
        ));
    }

    fn swap_terms(&mut self, first: usize, second: usize) {
        let terms = &mut self.interface.observation;
        let [a, b] = [first, second].map(|place| terms[place].quantity.name());
        terms.swap(first, second);
        let names: Vec<&str> = terms.iter().map(|term| term.quantity.name()).collect();
        self.changes.push(format!("{a} and {b} in each other's place in the observation"));
        self.settings.push(format!("`observation` in the order {}", names.join(", ")));
    }

    fn scale_actions(&mut self, factor: f64, derived: bool) {
        if derived {
            self.interface.action_scale.iter_mut().for_each(|scale| *scale *= factor);
            let scale = self.interface.action_scale.first().copied().unwrap_or_default();
            self.changes.push(format!("an `action_scale` {factor:.3} times as large"));
            self.settings.push(format!(
                "`action_scale` to {factor:.3} times what it is (the first joint's is {scale:.4} then)"
            ));
        } else {
            self.action_factor.iter_mut().for_each(|old| *old *= factor);
            self.changes.push(format!("logged actions that are {factor:.3} times the policy's outputs"));
            self.settings.push(format!("the log's columns act_… divided by {factor:.3}"));
        }
    }
}

/// The changes that are tried on any arrangement. `with_logs`: whether logged actions may be in an order of their own.
fn changes(interface: &Interface, limbs: &Limbs, with_logs: bool) -> Vec<Change> {
    let mut changes = Vec::new();
    let uniform = |list: &[f64]| list.iter().all(|value| (value - list[0]).abs() < 1e-9);
    // Where every list has one number for all joints, reordering the lists too changes nothing.
    let lists = [&interface.default_pose, &interface.action_scale, &interface.kp, &interface.kd];
    let plain = lists.iter().all(|list| uniform(list));
    for (name, order) in limbs.orders() {
        let mut parts = vec![Ordered::Names];
        parts.extend((!plain).then_some(Ordered::All));
        parts.extend(with_logs.then_some(Ordered::Actions));
        for part in parts {
            changes.push(Change::Order { name: name.clone(), order: order.clone(), part });
        }
    }
    for (name, flipped) in limbs.groups() {
        for actions_alone in [false, true] {
            let (name, flipped) = (name.clone(), flipped.clone());
            changes.push(Change::Signs { name, flipped, actions_alone });
        }
    }
    // Ratios between the usual action scales 0.25, 0.5 and 1.
    changes.extend([0.25, 0.5, 2.0, 4.0].map(Change::ActionScale));
    // The factors of legged_gym, walk-these-ways and Isaac Lab's usual tasks; gravity that points up; an action that is observed
    // as the change of the target.
    let scaled = [interface.action_scale.first().copied().unwrap_or(1.0) as f32];
    let usual: [(Quantity, &[&[f32]]); 5] = [
        (Quantity::ProjectedGravity, &[&[1.0], &[-1.0]]),
        (Quantity::LastAction, &[&[1.0], &scaled]),
        (Quantity::BaseAngularVelocity, &[&[1.0], &[0.25], &[0.2]]),
        (Quantity::JointVelocity, &[&[1.0], &[0.05], &[0.1]]),
        (Quantity::Command, &[&[1.0], &[2.0, 2.0, 0.25]]),
    ];
    for (quantity, scales) in usual {
        let seen = interface.observation.iter().find(|term| term.quantity == quantity);
        // Terms that the policy does not observe cannot be scaled wrongly.
        let Some(term) = seen else { continue };
        let same = |scale: &[f32]| term.scale == scale || (term.scale.is_empty() && scale == [1.0]);
        let others = scales.iter().filter(|scale| !same(scale));
        changes.extend(others.map(|scale| Change::Scale(quantity, scale.to_vec())));
    }
    let terms = interface.observation.len();
    changes.extend(
        (0..terms).flat_map(|first| (first + 1..terms).map(move |second| Change::Terms([first, second]))),
    );
    changes
}

#[cfg(test)]
mod tests;
