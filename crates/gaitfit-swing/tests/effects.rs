//! Effects that are put into recorded walks come out of them.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_log::{ReadOptions, Trajectory, read_csv};
use gaitfit_model::Model;
use gaitfit_swing::{Effect, EffectKind, SwingSettings, Walk, effects, estimate, usual_groups};
use std::path::Path;

/// The example's walks, without the calf that has a spring; 50 Hz.
fn logs() -> Vec<Trajectory> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/go2-ground/logs");
    let log = |k: usize| read_csv(&folder.join(format!("trajectory_{k:02}.csv")), &ReadOptions::default());
    (0..8).map(|k| log(k).unwrap()).collect()
}

fn settings(model: &Model) -> SwingSettings {
    let mut groups = usual_groups(model);
    groups[2].1.retain(|&joint| model.joints[joint].name != "RR_calf_joint");
    SwingSettings { clearances_m: vec![0.03], groups, ..SwingSettings::default() }
}

/// Friction of the calves, N·m, and how much of it each part of friction under load makes.
fn friction(model: &Model, logs: &[Trajectory]) -> (f64, f64) {
    let report = estimate(model, &logs.iter().collect::<Vec<_>>(), &settings(model)).unwrap();
    let calf = report.groups.iter().find(|group| group.group == "calf").unwrap();
    (calf.friction.value, calf.by_load[0])
}

fn effects_of(model: &Model, logs: &[Trajectory]) -> Vec<Effect> {
    let settings = settings(model);
    let logs: Vec<&Trajectory> = logs.iter().collect();
    let report = estimate(model, &logs, &settings).unwrap();
    effects(model, &Walk::all(model, &logs, 1).unwrap(), &report, &settings)
}

fn effect(effects: &[Effect], kind: EffectKind, owner: &str) -> Effect {
    effects.iter().find(|effect| effect.kind == kind && effect.of == owner).unwrap().clone()
}

/// Torque of the PD law at a sample, with the targets that act then, half a period late.
fn torque(log: &Trajectory, sample: usize, joint: usize) -> f64 {
    let width = log.joints.len();
    let gains = log.gains.as_ref().unwrap();
    let target = log.target.as_ref().unwrap();
    let at = |row: usize| target[row * width + joint];
    let acts = 0.5 * (at(sample.saturating_sub(1)) + at(sample));
    let place = sample * width + joint;
    gains.kp[joint] * (acts - log.position[place]) - gains.kd[joint] * log.velocity[place]
}

#[test]
fn friction_under_load_is_measured() {
    let model = gaitfit_model::builtin::go2().unwrap();
    let mut logs = logs();
    let before = effect(&effects_of(&model, &logs), EffectKind::LoadFriction, "calf");
    let (dry, by_load) = friction(&model, &logs);
    for log in &mut logs {
        let width = log.joints.len();
        let kp = log.gains.as_ref().unwrap().kp.clone();
        // The motion is as it was, and takes more torque.
        let more: Vec<f64> = (0..log.len() * width)
            .map(|place| {
                let (sample, joint) = (place / width, place % width);
                let rate = log.velocity[place];
                0.15 * torque(log, sample, joint).abs() * rate / rate.hypot(0.05) / kp[joint]
            })
            .collect();
        log.target.as_mut().unwrap().iter_mut().zip(more).for_each(|(target, more)| *target += more);
    }
    let after = effect(&effects_of(&model, &logs), EffectKind::LoadFriction, "calf");
    let change = after.size.value - before.size.value;
    // A torque that is put in at 50 Hz is a part of one that a joint takes at every moment.
    assert!((0.04..0.2).contains(&change), "{before:?} and {after:?}");
    assert!(after.sure() > 8.0 && before.sure() < 4.0, "{before:?} and {after:?}");
    assert!(after.share > 0.08 && before.share < 0.02, "{before:?} and {after:?}");
    // Where friction under load is left out, dry friction seems larger by what `by_load` says.
    let more = friction(&model, &logs).0 - dry;
    let expected = by_load * change;
    assert!(expected > 0.02 && (more - expected).abs() < 0.5 * expected, "{more} for {expected}");
}

#[test]
fn joints_that_twist_are_seen_where_feet_stand() {
    let model = gaitfit_model::builtin::go2().unwrap();
    let mut logs = logs();
    let before = effect(&effects_of(&model, &logs), EffectKind::Elasticity, "calf");
    for log in &mut logs {
        let width = log.joints.len();
        let twist = |place: usize| {
            let (sample, joint) = (place / width, place % width);
            if log.joints[joint].contains("calf") { 0.006 * torque(log, sample, joint) } else { 0.0 }
        };
        let twists: Vec<f64> = (0..log.position.len()).map(twist).collect();
        log.position.iter_mut().zip(&twists).for_each(|(angle, twist)| *angle += twist);
        // The same torque from a motor that is further round.
        log.target.as_mut().unwrap().iter_mut().zip(&twists).for_each(|(target, twist)| *target += twist);
    }
    let after = effect(&effects_of(&model, &logs), EffectKind::Elasticity, "calf");
    assert!((0.002..0.008).contains(&(after.size.value - before.size.value)), "{before:?} and {after:?}");
    // Soft contacts look like a little twist, once the encoders' zeros are unknowns too.
    assert!(after.share > 0.3 && before.share < 0.1, "{before:?} and {after:?}");
}

#[test]
fn play_is_seen_where_feet_stand_and_a_wrong_zero_is_no_play() {
    let model = gaitfit_model::builtin::go2().unwrap();
    let play = |logs: &[Trajectory]| effect(&effects_of(&model, logs), EffectKind::Backlash, "thigh").size;
    let before = play(&logs());
    let (mut slack, mut wrong_zero) = (logs(), logs());
    for log in &mut slack {
        let width = log.joints.len();
        for place in 0..log.position.len() {
            let (sample, joint) = (place / width, place % width);
            if log.joints[joint].contains("thigh") {
                // Half of a play of 0.02 rad, on the side that the torque chooses.
                let turn = 0.01 * (torque(log, sample, joint) / 0.5).tanh();
                log.position[place] += turn;
                log.target.as_mut().unwrap()[place] += turn;
            }
        }
    }
    for log in &mut wrong_zero {
        let width = log.joints.len();
        for place in 0..log.position.len() {
            let joint = log.joints[place % width].as_str();
            if joint.contains("calf") {
                let zero = if joint.starts_with('F') { 0.02 } else { -0.02 };
                log.position[place] += zero;
                log.target.as_mut().unwrap()[place] += zero;
            }
        }
    }
    let slack = play(&slack);
    assert!((0.01..0.03).contains(&(slack.value - before.value)), "{before:?} and {slack:?}");
    // Knees of standing legs push one way all the time, so their play would look like a wrong zero.
    let calves = effects_of(&model, &wrong_zero);
    let is_play = |one: &&Effect| one.kind == EffectKind::Backlash && one.of == "calf" && one.sure() > 4.0;
    assert_eq!(calves.iter().find(is_play), None);
}

#[test]
fn ground_that_gives_way_and_steps_show_in_the_heights() {
    let model = gaitfit_model::builtin::go2().unwrap();
    let level = effect(&effects_of(&model, &logs()), EffectKind::UnevenGround, "");
    assert!(level.size.value < 0.006 && level.sure() > 8.0, "{level:?}");
}

#[test]
fn the_spring_of_one_calf_is_found_and_no_other_joint_has_one() {
    let model = gaitfit_model::builtin::go2().unwrap();
    let logs = logs();
    let logs: Vec<&Trajectory> = logs.iter().collect();
    let springs = |model: &Model| -> Vec<Effect> {
        let settings = SwingSettings { clearances_m: vec![0.03], ..SwingSettings::default() };
        let report = estimate(model, &logs, &settings).unwrap();
        let mut effects = effects(model, &Walk::all(model, &logs, 1).unwrap(), &report, &settings);
        effects.retain(|effect| effect.kind == EffectKind::OddSpring && effect.share > 0.08);
        effects
    };
    // examples/go2-ground/robot.toml
    let [spring] = springs(&model).try_into().unwrap();
    assert_eq!(spring.of, "RR_calf_joint");
    assert!((spring.size.value - 30.0).abs() < 2.0 && spring.sure() > 8.0, "{spring:?}");
    assert!((spring.rest.unwrap() + 1.5).abs() < 0.05 && spring.share > 0.5, "{spring:?}");
    let mut sprung = model.clone();
    let joint = sprung.joints.iter_mut().find(|joint| joint.name == "RR_calf_joint").unwrap();
    (joint.stiffness, joint.springref) = (30.0, -1.5);
    assert_eq!(springs(&sprung), [], "a model that has the spring lacks none");
}

#[test]
fn a_motor_that_is_weaker_than_its_siblings_is_no_spring() {
    let model = gaitfit_model::builtin::go2().unwrap();
    let odd = |logs: &[Trajectory]| -> Vec<Effect> {
        let mut effects = effects_of(&model, logs);
        effects.retain(|one| {
            matches!(one.kind, EffectKind::OddSpring | EffectKind::OddStrength) && one.share > 0.08
        });
        effects
    };
    let mut logs = logs();
    assert_eq!(odd(&logs), []);
    for log in &mut logs {
        let joint = log.joints.iter().position(|joint| joint.contains("FR_calf")).unwrap();
        let gains = log.gains.as_mut().unwrap();
        // Gains that are stated too large look like a weak motor.
        gains.kp[joint] /= 0.7;
        gains.kd[joint] /= 0.7;
    }
    let [weak] = odd(&logs).try_into().unwrap();
    assert_eq!((weak.kind, weak.of.as_str()), (EffectKind::OddStrength, "FR_calf_joint"));
    // This is only the first estimate: the regression gives this joint's windows less weight.
    assert!((-0.6..-0.2).contains(&weak.size.value) && weak.sure() > 8.0, "{weak:?}");
}
