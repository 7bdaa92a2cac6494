//! Contacts between parts of the robot that its logs show.
//!
//! Feet that strike each other stop a leg as a larger inertia would, and a robot that falls over its own feet falls more often
//! than a simulated one. So a biped's fit simulates the contacts that the logs show. Contacts cost time, so it leaves out all
//! others. Fits of other robots do not look: a real Go2's feet touch too, but with these contacts its fits took over twice as
//! long, and after 60 % of the search they were no nearer to its logs.

use crate::log::Log;
use gaitfit_model::kinematics::{Frame, body_frames};
use gaitfit_model::{Geom, Model, SelfContact, SelfPair};
use gaitfit_sim::stats;

/// Two parts touch if they do so in this share of the samples, and in this many.
const MIN_SHARE: f64 = 0.001;
const MIN_SAMPLES: usize = 3;
/// Max median of the overlap of two parts that touch, m. Real parts overlap only as far as joints and feet give way: simulated soft
/// contact of a walking humanoid's feet had 4.5 mm. Where the file's shapes overlap by more, they are larger than the parts.
const MAX_OVERLAP: f64 = 0.006;
/// Max number of samples that are looked at, for the time it takes.
const MAX_SAMPLES: usize = 10_000;
/// Max number of pairs that a sentence names.
const MAX_NAMED: usize = 4;

/// Pairs of parts that touch in the logs.
#[derive(Debug)]
pub struct Touching {
    /// The pairs that touch; `None` if none do.
    pub chosen: Option<SelfContact>,
    /// Notes on them, each a sentence.
    pub notes: Vec<String>,
}

/// Overlap of two parts.
struct Closeness {
    pair: SelfPair,
    /// Depths to which they overlap in the samples in which they touch, m.
    overlaps: Vec<f64>,
}

impl Closeness {
    /// The median of the overlaps, m.
    fn overlap(&self) -> f64 {
        stats::median(&self.overlaps).unwrap_or(0.0)
    }
}

/// Looks for parts that the robot file lets touch, and that do so in `logs` of the robot `model`. Parts count if the logs have all
/// joints between them: where a held arm swings, its logs do not say.
pub fn in_logs(model: &Model, logs: &[Log]) -> Touching {
    let logged: Vec<Vec<Option<usize>>> = logs
        .iter()
        .map(|log| log.trajectory.joints.iter().map(|joint| model.find_joint(joint)).collect())
        .collect();
    // All logs must have the joint: a pair is counted over all of them.
    let is_known = |joint: usize| logged.iter().all(|joints| joints.contains(&Some(joint)));
    let mut pairs: Vec<Closeness> = model
        .self_pairs_of_file()
        .into_iter()
        .filter(|pair| joints_between(model, pair).all(is_known))
        .map(|pair| Closeness { pair, overlaps: Vec::new() })
        .collect();
    let rows: usize = logs.iter().map(|log| log.trajectory.time.len()).sum();
    // At least 1, because `step_by` does not take 0.
    let every = rows.div_ceil(MAX_SAMPLES).max(1);
    let mut samples = 0;
    for (log, joints) in logs.iter().zip(&logged) {
        for row in log.trajectory.position.chunks_exact(joints.len().max(1)).step_by(every) {
            // Joints that no log has stay at 0; pairs that depend on them were left out above.
            let mut angles = vec![0.0; model.joints.len()];
            for (joint, angle) in joints.iter().zip(row) {
                if let Some(joint) = joint {
                    angles[*joint] = *angle;
                }
            }
            // The base's place does not change distances within the robot.
            let frames = body_frames(model, &Frame::WORLD, &angles);
            samples += 1;
            for one in &mut pairs {
                let distance = one.pair.distance(&frames);
                if distance <= 0.0 {
                    one.overlaps.push(-distance);
                }
            }
        }
    }
    let share = |one: &Closeness| one.overlaps.len() as f64 / samples.max(1) as f64;
    pairs.retain(|one| one.overlaps.len() >= MIN_SAMPLES && share(one) >= MIN_SHARE);
    // The most frequent contacts come first in the notes.
    pairs.sort_by_key(|one| std::cmp::Reverse(one.overlaps.len()));
    let (touching, too_large): (Vec<_>, Vec<_>) =
        pairs.into_iter().partition(|one| one.overlap() <= MAX_OVERLAP);
    let mut notes = Vec::new();
    if !touching.is_empty() {
        let words = |one: &Closeness| format!("{} in {:.1} % of the samples", names(one), 100.0 * share(one));
        notes.push(format!(
            "parts of the robot touch each other in the logs ({}). The fit simulates these contacts, and so do evaluations and \
             trainings with its theta.toml. Without them: simulation.self_contact = \"off\"",
            listed(&touching, words)
        ));
    }
    if !too_large.is_empty() {
        let words = |one: &Closeness| format!("{} by {:.0} mm", names(one), 1e3 * one.overlap());
        notes.push(format!(
            "shapes of the robot file overlap in the logs ({}). They are larger than the robot's parts, so the fit does not \
             simulate their contact. With it: simulation.self_contact, a list of such pairs of names",
            listed(&too_large, words)
        ));
    }
    let chosen = (!touching.is_empty()).then(|| SelfContact::named(touching.iter().map(|one| &one.pair)));
    Touching { chosen, notes }
}

/// The joints that move one of two parts against the other, in the model's order.
fn joints_between<'a>(model: &'a Model, pair: &SelfPair) -> impl Iterator<Item = usize> + use<'a> {
    let chain = |geom: &Geom| {
        std::iter::successors(Some(geom.body), |&body| model.bodies[body].parent).collect::<Vec<usize>>()
    };
    let [first, second] = pair.geoms.each_ref().map(chain);
    let joints = model.joints.iter().enumerate();
    joints
        // A joint on both chains moves both parts together, so it does not change their distance.
        .filter(move |(_, joint)| first.contains(&joint.body) != second.contains(&joint.body))
        .map(|(number, _)| number)
}

fn names(one: &Closeness) -> String {
    let [first, second] = &one.pair.geoms;
    format!("{} with {}", first.name, second.name)
}

/// The first of some pairs in words.
fn listed(pairs: &[Closeness], words: impl Fn(&Closeness) -> String) -> String {
    let more = if pairs.len() > MAX_NAMED { ", ..." } else { "" };
    let named: Vec<String> = pairs.iter().take(MAX_NAMED).map(words).collect();
    format!("{}{more}", named.join(", "))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_log::Trajectory;
    use gaitfit_model::{ReadOptions, read_mjcf_str};

    /// Two legs of one joint each, 20 cm apart, with a box at the end; an arm that touches a leg at rest.
    const LEGS: &str = r#"<mujoco model="legs"><compiler angle="radian"/><worldbody>
        <geom name="floor" type="plane" size="1 1 1" contype="1" conaffinity="0"/>
        <body name="base" pos="0 0 1"><freejoint/><geom name="trunk" size="0.05" conaffinity="0" contype="0"/>
          <body name="left" pos="0 0.1 0"><joint name="left_roll" axis="1 0 0"/>
            <geom name="left_foot" type="box" size="0.08 0.03 0.01" pos="0 0 -0.5"/></body>
          <body name="right" pos="0 -0.1 0"><joint name="right_roll" axis="1 0 0"/>
            <geom name="right_foot" type="box" size="0.08 0.03 0.01" pos="0 0 -0.5"/></body>
          <body name="arm" pos="0 0.1 -0.4"><joint name="arm_roll" axis="1 0 0"/><geom name="hand" size="0.1"/></body>
        </body></worldbody></mujoco>"#;

    fn log(samples: usize, angle: impl Fn(usize) -> f64) -> Log {
        let joints = ["left_roll", "right_roll"].map(str::to_owned).to_vec();
        let position: Vec<f64> = (0..samples).flat_map(|at| [-angle(at), angle(at)]).collect();
        let time: Vec<f64> = (0..samples).map(|at| 0.02 * at as f64).collect();
        let still = vec![0.0; position.len()];
        let trajectory = Trajectory::of_joints(joints.clone(), 50.0, time, position, still);
        Log {
            name: "walk".to_owned(),
            path: "walk.csv".into(),
            sidecars: Vec::new(),
            joints,
            trajectory,
            mounting: None,
            filled: Vec::new(),
        }
    }

    #[test]
    fn parts_that_touch_in_the_logs_are_found_and_shapes_that_are_too_large_named() {
        let model = read_mjcf_str(LEGS, &ReadOptions::default()).unwrap();
        // The feet's inner edges are 7 cm from the middle: they meet where each leg turns by about 0.14 rad.
        let apart = in_logs(&model, &[log(1000, |_| 0.1)]);
        assert!(apart.chosen.is_none() && apart.notes.is_empty(), "{apart:?}");
        let touching = in_logs(&model, &[log(1000, |at| if at % 50 == 0 { 0.145 } else { 0.1 })]);
        let expected = SelfContact::Pairs(vec![["left_foot".to_owned(), "right_foot".to_owned()]]);
        assert_eq!(touching.chosen, Some(expected), "{touching:?}");
        assert!(touching.notes[0].contains("left_foot with right_foot in 2.0 %"), "{touching:?}");
        // The chosen pairs are read as names.
        assert_eq!(model.touching_itself(&touching.chosen.unwrap()).unwrap().0.self_pairs.len(), 1);
        let overlapping = in_logs(&model, &[log(1000, |at| if at % 50 == 0 { 0.152 } else { 0.1 })]);
        assert!(overlapping.chosen.is_none() && overlapping.notes[0].contains("larger"), "{overlapping:?}");
        // Once in a thousand samples is an accident; and what the arm does is in no log.
        assert!(in_logs(&model, &[log(1000, |at| if at == 0 { 0.145 } else { 0.1 })]).chosen.is_none());
    }
}
