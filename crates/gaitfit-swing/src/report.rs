//! What is asked and what swings answer.

use crate::torques::Drag;
use crate::walk::Walk;
use gaitfit_log::Estimate;
use gaitfit_model::Model;
use gaitfit_model::patterns::{plain, without_leg};
use serde::{Deserialize, Serialize};

/// Walks that last longer than this together are long, s.
const LONG_S: f64 = 120.0;

/// How legs in the air are looked for and averaged. The defaults suit walking robots of 5 to 60 kg.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SwingSettings {
    /// Joint groups by name: indices of the model's joints. Empty: groups by the last part of the joints' names.
    pub groups: Vec<(String, Vec<usize>)>,
    /// Heights above the lowest foot from which a foot may count as in the air, m, rising. The one with the smallest errors
    /// is taken.
    pub clearances_m: Vec<f64>,
    /// A foot that stands less than this (0 to 1, see [`crate::Foot::stands`]) is in the air.
    pub stands: f64,
    /// Time before and after a window in which the leg must be in the air too, s.
    pub margin_s: f64,
    /// Length of a window over which the equation of motion is averaged, s.
    pub window_s: f64,
    /// Time between windows, s; twice as much for walks that last more than two minutes together.
    pub hop_s: f64,
    /// Beginning of each log that does not count, s.
    pub skip_s: f64,
    /// Shortest and longest delay that is tried, s.
    pub delay_range_s: [f64; 2],
    /// Step between the delays, s.
    pub delay_step_s: f64,
    /// Friction law; absent: the one that explains the logs better.
    pub law: Option<FrictionLaw>,
    /// Whether friction, damping and armature are at least 0.
    pub bounded: bool,
    /// Whether swings are also chosen otherwise (clearance, window, law). Errors then contain how the estimates change.
    pub others: bool,
    /// Number of threads. The report does not depend on it.
    #[serde(skip)]
    pub threads: usize,
}

impl Default for SwingSettings {
    fn default() -> Self {
        Self {
            groups: Vec::new(),
            clearances_m: vec![0.005, 0.008, 0.012, 0.016, 0.02, 0.025, 0.03, 0.04, 0.06, 0.09],
            stands: 0.1,
            margin_s: 0.015,
            window_s: 0.08,
            hop_s: 0.01,
            skip_s: 0.3,
            // Negative delays occur: Isaac Sim's targets act from the row before on, −6.3 ms
            // (docs/results/swings.md).
            delay_range_s: [-0.012, 0.04],
            delay_step_s: 0.002,
            law: None,
            bounded: true,
            others: true,
            threads: 1,
        }
    }
}

impl SwingSettings {
    /// For these walks. Neighbouring windows share most of their time, so walks that last long get half as many.
    pub(crate) fn of_walks(&self, walks: &[Walk]) -> Self {
        let seconds: f64 = walks.iter().map(|walk| walk.points() as f64 * walk.step).sum();
        let hop_s = if seconds > LONG_S { 2.0 * self.hop_s } else { self.hop_s };
        Self { hop_s, ..self.clone() }
    }

    /// The joint groups: those chosen, or else the usual ones.
    pub(crate) fn groups_of(&self, model: &Model) -> Vec<(String, Vec<usize>)> {
        if self.groups.is_empty() { usual_groups(model) } else { self.groups.clone() }
    }

    /// The delays that are tried, s.
    pub(crate) fn delays(&self) -> impl Iterator<Item = f64> + '_ {
        let [low, high] = self.delay_range_s;
        // A window has one number for each delay, so the bound limits memory.
        let steps = ((high - low) / self.delay_step_s).round().clamp(2.0, 1000.0) as usize;
        (0..=steps).map(move |k| low + k as f64 * self.delay_step_s)
    }
}

/// The moment at which a joint's Coulomb friction turns around.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FrictionLaw {
    /// Friction turns when the joint does.
    Coulomb,
    /// Friction is a soft constraint, as in MuJoCo and this engine: it turns some milliseconds before a joint that
    /// brakes.
    Engine,
}

impl FrictionLaw {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Coulomb, Self::Engine];
}

/// Estimates of one group of joints from its swings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroupEstimate {
    /// The group's name.
    pub group: String,
    /// Its joints, by the model's names.
    pub joints: Vec<String>,
    /// Coulomb friction, N·m.
    pub friction: Estimate,
    /// Viscous damping, N·m·s/rad.
    pub damping: Estimate,
    /// Armature, kg·m².
    pub armature: Estimate,
    /// How friction, damping and armature change with the motors' strength, per 1. The values above assume motors that give
    /// the torque that gains and limits state; for a motor that gives 0.9 of it, they are lower by a tenth of this.
    #[serde(default)]
    pub by_strength: [f64; 3],
    /// How friction, damping and armature change with friction under load (`load_friction`), per 1. The values above are those
    /// of a joint without it; for a joint with 0.1, they are lower by a tenth of this.
    #[serde(default)]
    pub by_load: [f64; 3],
    /// Swings that count.
    pub swings: usize,
    /// Averaged equations that count.
    pub windows: usize,
    /// Root mean square of what the equations leave unexplained, N·m.
    pub residual: f64,
}

/// The strength in reports that do not have it: an error of 1 says that nothing is known of it.
fn unknown() -> Estimate {
    Estimate { value: 1.0, error: 1.0 }
}

impl GroupEstimate {
    /// The values as a joint may have them: nothing below 0, and 0 where an error is too large to say anything.
    pub fn drag(&self) -> Drag {
        let value =
            |estimate: Estimate, sure: f64| if estimate.error < sure { estimate.value.max(0.0) } else { 0.0 };
        Drag {
            friction: value(self.friction, 0.5),
            damping: value(self.damping, 0.5),
            armature: value(self.armature, 0.05),
        }
    }
}

/// Estimates of the joints from their swings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SwingReport {
    /// Groups that swing.
    pub groups: Vec<GroupEstimate>,
    /// Time from sending a target (its row in the log, or its stamp where the log has one) to the torque, s. Negative:
    /// targets acted before their row. A simulation with
    /// semi-implicit steps of h acts as if targets came h/2 earlier; its delay is longer by that.
    pub delay: Estimate,
    /// How the delay changes with the motors' strength, s per 1.
    #[serde(default)]
    pub delay_by_strength: f64,
    /// The share of the torque stated by gains and limits that the motors give; 1: all of it.
    #[serde(default = "unknown")]
    pub strength: Estimate,
    /// Friction law that explains the logs better.
    pub law: FrictionLaw,
    /// Height above the lowest foot from which a foot counted as in the air, m.
    pub clearance_m: f64,
    /// Logs that count.
    pub logs: usize,
    /// Groups that do not swing long enough.
    pub unseen: Vec<String>,
}

/// Joint groups by the last part of their names: `FL_hip_joint` and `RR_hip_joint` are `hip`. Hinges alone: what counts as a
/// swing, and as a likely value, is known for rad and N·m. Coupled joints are left out: their equations lack the coupling's torque.
pub fn usual_groups(model: &Model) -> Vec<(String, Vec<usize>)> {
    let mut groups: Vec<(String, Vec<usize>)> = Vec::new();
    let is_clear = |index: usize| model.joints[index].kind.is_hinge() && !model.is_coupled(index);
    for (index, joint) in model.joints.iter().enumerate().filter(|(index, _)| is_clear(*index)) {
        let last = usual_group(&joint.name);
        match groups.iter().position(|(known, _)| *known == last) {
            // Two joints of one limb are not alike, though their names may be.
            Some(at) if groups[at].1.iter().any(|&other| in_one_limb(model, index, other)) => {
                let mut name = plain(&joint.name).to_owned();
                while groups.iter().any(|(known, _)| *known == name) {
                    name.push('_');
                }
                groups.push((name, vec![index]));
            }
            Some(at) => groups[at].1.push(index),
            None => groups.push((last, vec![index])),
        }
    }
    groups
}

/// Whether one of two joints carries the other.
fn in_one_limb(model: &Model, a: usize, b: usize) -> bool {
    let carried_by = |a: usize, b: usize| {
        let up = |body: &usize| model.bodies[*body].parent;
        std::iter::successors(Some(model.joints[a].body), up).any(|body| body == model.joints[b].body)
    };
    carried_by(a, b) || carried_by(b, a)
}

/// Name of the joint's group in [`usual_groups`]: its own name without what says on which side or leg it is.
pub fn usual_group(joint: &str) -> String {
    // Unitree's legs are FL to RR, ANYmal's LF to RH, Spot's fl to hr; humanoids have left and right.
    const SIDES: [&str; 19] = [
        "fl", "fr", "rl", "rr", "hl", "hr", "bl", "br", "lf", "rf", "lm", "rm", "lh", "rh", "lr", "l", "r",
        "left", "right",
    ];
    let name = without_leg(plain(joint));
    let parts: Vec<&str> = name.split('_').collect();
    let kept: Vec<&str> =
        parts.iter().copied().filter(|part| !SIDES.contains(&part.to_lowercase().as_str())).collect();
    // A name that is nothing but a side would become empty.
    if kept.is_empty() { name.to_owned() } else { kept.join("_") }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn joints_of_all_legs_are_one_group() {
        let groups = usual_groups(&gaitfit_model::builtin::go2().unwrap());
        let names: Vec<&str> = groups.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["hip", "thigh", "calf"]);
        assert_eq!(groups[2].1, [2, 5, 8, 11]);
        assert_eq!(usual_group("left_hip_pitch"), "hip_pitch");
        assert_eq!(usual_group("R"), "R");
        assert_eq!(
            ["leg0_femur_joint", "leg_5_femur", "LMFemur"].map(usual_group),
            ["femur", "femur", "Femur"]
        );
    }

    #[test]
    fn joints_of_one_limb_are_in_two_groups() {
        let mut model = gaitfit_model::builtin::go2().unwrap();
        // The thigh of the first leg gets the name of its own hip, but for the side.
        model.joints[1].name = "hip".to_owned();
        let groups = usual_groups(&model);
        assert_eq!((groups[0].1.as_slice(), groups[1].1.as_slice()), (&[0, 3, 6, 9][..], &[1][..]));
    }

    #[test]
    fn coupled_joints_are_in_no_group() {
        let mut model = gaitfit_model::builtin::go2().unwrap();
        model.couplings.push(gaitfit_model::Coupling {
            follower: 5,
            leader: Some(2),
            polynomial: [0.0, 1.0, 0.0, 0.0, 0.0],
            solref: [0.02, 1.0],
            solimp: [0.9, 0.95, 0.001, 0.5, 2.0],
        });
        assert_eq!(usual_groups(&model)[2].1, [8, 11]);
    }
}
