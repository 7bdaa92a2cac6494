//! Logs of a Go2 whose legs hang: one joint mirrored, and joints numbered in other orders.

use super::*;
use gaitfit_log::{Gains, Trajectory};

/// A log of the Go2 in which slow sweeps are followed with some friction: q_des = q + (weight + friction) / kp.
fn log(model: &Model) -> Trajectory {
    let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    let width = names.len();
    let samples = 800;
    let mut log = Trajectory {
        target: Some(Vec::new()),
        gains: Some(Gains { kp: vec![25.0; width], kd: vec![0.5; width] }),
        ..Trajectory::of_joints(
            names,
            100.0,
            (0..samples).map(|i| f64::from(i) / 100.0).collect(),
            Vec::new(),
            Vec::new(),
        )
    };
    for i in 0..samples {
        let t = f64::from(i) / 100.0;
        let (mut q, mut dq) = (vec![0.0; width], vec![0.0; width]);
        for joint in 0..width {
            let [low, high] = model.joints[joint].range.unwrap_or([-1.0, 1.0]);
            let (middle, turn) = (0.5 * (low + high) + 0.03 * joint as f64, 2.0 + 0.31 * joint as f64);
            q[joint] = middle + 0.2 * (turn * t).sin();
            dq[joint] = 0.2 * turn * (turn * t).cos();
        }
        let weights = holding(model, &q);
        let target = (0..width).map(|joint| {
            // Friction, and an acceleration that the weight knows nothing of.
            let torque =
                weights[joint] + 0.3 * (dq[joint] / 0.05).tanh() + 0.5 * dq[joint] - 0.05 * q[joint].sin();
            q[joint] + torque / 25.0
        });
        log.target.iter_mut().for_each(|all| all.extend(target.clone()));
        log.position.extend(q);
        log.velocity.extend(dq);
    }
    log
}

fn go2() -> Model {
    crate::robot::go2().unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn a_mirrored_joint_is_named_and_a_right_one_is_not() {
    let model = go2();
    let right = log(&model);
    assert_eq!(signs(&right, &model), []);
    // Hips: mirrored thighs and calves lie beyond their limits, which other checks name.
    for joint in [0, 3, 9] {
        let mut mirrored = right.clone();
        let negate = |values: &mut Vec<f64>| {
            values.iter_mut().skip(joint).step_by(12).for_each(|value| *value = -*value)
        };
        negate(&mut mirrored.position);
        negate(&mut mirrored.velocity);
        mirrored.target.iter_mut().for_each(negate);
        let findings = signs(&mirrored, &model);
        let named: Vec<&String> = findings.iter().flat_map(|finding| &finding.joints).collect();
        assert_eq!(named, [&right.joints[joint]], "{findings:?}");
    }
    // Without gains, or of a robot that walks, nothing is said.
    assert_eq!(signs(&Trajectory { gains: None, ..right.clone() }, &model), []);
    let command = Some(vec![0.5; 3 * right.len()]);
    assert_eq!(signs(&Trajectory { command, ..right }, &model), []);
}

#[test]
fn another_usual_order_is_recognised() {
    let model = go2();
    let right = log(&model);
    assert_eq!(order(&right, &model), Order::Shown);
    for sequence in usual_orders(&right.joints).into_iter().skip(1) {
        let names: Vec<&String> = sequence.iter().map(|&joint| &right.joints[joint]).collect();
        let mut other = right.select_joints(&names).unwrap_or_else(|error| panic!("{error}"));
        // Named in the order of the robot's file.
        let truth = std::mem::replace(&mut other.joints, right.joints.clone());
        assert_eq!(order(&other, &model), Order::Other(truth));
    }
    // A walk's torques are the ground's.
    let command = Some(vec![0.5; 3 * right.len()]);
    assert_eq!(order(&Trajectory { command, ..right }, &model), Order::Unknown);
}

#[test]
fn legs_of_one_joint_have_each_order_once() {
    let names = ["FL_knee", "FR_knee", "RL_knee", "RR_knee"].map(str::to_owned);
    assert_eq!(usual_orders(&names), [vec![0, 1, 2, 3], vec![1, 0, 3, 2]]);
}
