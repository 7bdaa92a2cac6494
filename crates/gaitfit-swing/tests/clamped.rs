//! A clamped robot whose logs are computed from known joints.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_log::{Gains, Trajectory};
use gaitfit_model::{Model, Root};
use gaitfit_swing::dynamics::{BaseMotion, Motion};
use gaitfit_swing::{FrictionLaw, SwingError, SwingSettings, Walk, estimate, estimate_walks};
use std::ops::ControlFlow;

const FRICTION: [f64; 3] = [0.2, 0.15, 0.6];
const DAMPING: [f64; 3] = [0.1, 0.05, 0.2];
const ARMATURE: [f64; 3] = [0.013, 0.017, 0.043];
const DELAY: f64 = 0.0075;
const STEP: f64 = 0.0005;

fn clamped() -> Model {
    let mut model = gaitfit_model::builtin::go2().unwrap();
    model.root = Root::Fixed;
    model
}

/// Targets with which joints of the properties above move as sums of sines, at 2 kHz: what the motors must give beyond the
/// PD law's feedback, over kp, `DELAY` later.
fn log(model: &Model, phase: f64) -> Trajectory {
    weak_log(model, phase, 1.0)
}

/// The same of motors that give the share `strength` of their torque.
fn weak_log(model: &Model, phase: f64, strength: f64) -> Trajectory {
    let count = model.joints.len();
    let (kp, kd) = (25.0, 0.5);
    let at = |t: f64| -> [Vec<f64>; 3] {
        let joint = |j: usize, order: i32| -> f64 {
            let middle = [0.0, 0.9, -1.7][j % 3];
            let waves = [(0.3, 11.0 + j as f64), (0.1, 27.0 - j as f64)];
            let wave = |(size, tempo): (f64, f64)| {
                size * tempo.powi(order)
                    * (tempo * t + phase + order as f64 * std::f64::consts::FRAC_PI_2).sin()
            };
            waves.into_iter().map(wave).sum::<f64>() + if order == 0 { middle } else { 0.0 }
        };
        [0, 1, 2].map(|order| (0..count).map(|j| joint(j, order)).collect())
    };
    let base = BaseMotion::at_rest(model.bodies[0].quat);
    let samples = 6000;
    let (mut position, mut velocity, mut target) = (vec![], vec![], vec![]);
    for sample in 0..samples {
        let [q, dq, _] = at(sample as f64 * STEP);
        position.extend(q);
        velocity.extend(dq);
        // A target that is held for a step has its middle half a step after its row.
        let [q, dq, ddq] = at(sample as f64 * STEP + DELAY + STEP / 2.0);
        let (torques, _) = Motion::new(model, &base, &q, &dq, &ddq).inverse_dynamics();
        for j in 0..count {
            let k = j % 3;
            let drag = FRICTION[k] * dq[j].signum() + DAMPING[k] * dq[j] + ARMATURE[k] * ddq[j];
            target.push(q[j] + ((torques[j] + drag) / strength + kd * dq[j]) / kp);
        }
    }
    Trajectory {
        target: Some(target),
        gains: Some(Gains { kp: vec![kp; count], kd: vec![kd; count] }),
        ..Trajectory::of_joints(
            model.joints.iter().map(|joint| joint.name.clone()).collect(),
            1.0 / STEP,
            (0..samples).map(|sample| sample as f64 * STEP).collect(),
            position,
            velocity,
        )
    }
}

#[test]
fn joints_of_a_clamped_robot_come_out_as_they_were_put_in() {
    let model = clamped();
    let logs = [log(&model, 0.0), log(&model, 1.3)];
    let settings = SwingSettings { hop_s: 0.05, clearances_m: vec![0.02], ..SwingSettings::default() };
    let report = estimate(&model, &[&logs[0], &logs[1]], &settings).unwrap();
    let threads = SwingSettings { threads: 3, ..settings };
    assert_eq!(
        estimate(&model, &[&logs[0], &logs[1]], &threads).unwrap(),
        report,
        "other threads, other numbers"
    );
    assert!((report.delay.value - DELAY).abs() < 2e-4, "{:?}", report.delay);
    assert_eq!(report.law, FrictionLaw::Coulomb);
    assert_eq!(report.groups.len(), 3);
    for (k, group) in report.groups.iter().enumerate() {
        let near = |value: f64, truth: f64| (value - truth).abs() < 0.05 * truth;
        assert!(near(group.friction.value, FRICTION[k]), "{group:?}");
        assert!(near(group.damping.value, DAMPING[k]), "{group:?}");
        assert!(near(group.armature.value, ARMATURE[k]), "{group:?}");
        assert!(group.residual < 0.02, "{group:?}");
    }
}

#[test]
fn weak_motors_show_their_strength_and_what_joints_resist_with_it() {
    const STRENGTH: f64 = 0.85;
    let model = clamped();
    let logs = [weak_log(&model, 0.0, STRENGTH), weak_log(&model, 1.3, STRENGTH)];
    let settings = SwingSettings { hop_s: 0.05, clearances_m: vec![0.02], ..SwingSettings::default() };
    let report = estimate(&model, &[&logs[0], &logs[1]], &settings).unwrap();
    assert!((report.strength.value - STRENGTH).abs() < 0.02, "{:?}", report.strength);
    assert!(report.strength.error < 0.05, "{:?}", report.strength);
    for (k, group) in report.groups.iter().enumerate() {
        let truths = [FRICTION[k], DAMPING[k], ARMATURE[k]];
        let values = [group.friction.value, group.damping.value, group.armature.value];
        for ((truth, value), slope) in truths.into_iter().zip(values).zip(group.by_strength) {
            let moved = value + slope * (STRENGTH - 1.0);
            assert!((moved - truth).abs() < 0.08 * truth, "{truth}: {moved}, {group:?}");
        }
    }
}

#[test]
fn what_is_missing_is_named() {
    let model = clamped();
    let whole = log(&model, 0.0);
    let refused = |change: fn(&mut Trajectory), model: &Model| {
        let mut log = whole.clone();
        change(&mut log);
        estimate(model, &[&log], &SwingSettings::default()).unwrap_err().to_string()
    };
    assert!(refused(|log| log.target = None, &model).contains("position targets"));
    assert!(refused(|log| log.gains = None, &model).contains("PD gains"));
    assert!(refused(|log| log.joints[3] = "tail".into(), &model).contains("`tail`"));
    let floating = gaitfit_model::builtin::go2().unwrap();
    assert!(refused(|_| (), &floating).contains("orientation and body rates"));
    // A robot that stands still says nothing, and that is no number.
    let mut still = whole.clone();
    still.velocity.fill(0.0);
    for row in 1..still.len() {
        still.position.copy_within(0..12, 12 * row);
    }
    let error = estimate(&model, &[&still], &SwingSettings::default()).unwrap_err();
    assert!(matches!(error, SwingError::NoSwings { .. }), "{error}");
    let mut broken = whole;
    broken.position.fill(f64::NAN);
    assert!(estimate(&model, &[&broken], &SwingSettings::default()).is_err());
}

#[test]
fn regressions_are_counted_and_can_be_stopped() {
    let model = clamped();
    let whole = log(&model, 0.0);
    let settings = SwingSettings { hop_s: 0.05, ..SwingSettings::default() };
    let mut seen = Vec::new();
    let mut count = |done, total| {
        seen.push((done, total));
        ControlFlow::Continue(())
    };
    let walks = Walk::all(&model, &[&whole], 1).unwrap();
    let counted = estimate_walks(&model, &walks, &settings, &mut count).unwrap();
    assert_eq!(counted, estimate(&model, &[&whole], &settings).unwrap());
    let total = seen[0].1;
    assert!(seen.len() > 20 && seen.iter().all(|(_, all)| *all == total), "{seen:?}");
    assert!(seen.iter().zip(0..).all(|((done, _), number)| *done == number || *done == total), "{seen:?}");
    assert_eq!(seen.last(), Some(&(total, total)));
    let mut calls = 0;
    let mut stop = |done, _| {
        calls += 1;
        if done < 3 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let stopped = estimate_walks(&model, &walks, &settings, &mut stop);
    assert!(matches!(stopped, Err(SwingError::Stopped)), "{stopped:?}");
    assert_eq!(calls, 4, "progress was called after it stopped the work");
}
