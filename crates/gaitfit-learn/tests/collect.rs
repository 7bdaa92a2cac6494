//! Logs say what the policy saw and did: the policy, applied to a log's rows, does the same again.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::task_common;

use gaitfit_learn::collect::{CollectOptions, collect, collect_each};
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::task::{Task, TaskError};
use gaitfit_log::Trajectory;
use gaitfit_model::rotation::rotate;
use gaitfit_policy::network::Scratch;
use gaitfit_policy::{ActionClip, Policy};
use gaitfit_sim::Candidate;
use task_common::{calm, random_policy, scene_with};

/// A task whose policy lists the joints in another order than the model, and clips its actions.
fn reordered() -> Task {
    let mut task = calm();
    task.command.seconds = 0.1;
    scene_with(&task, |interface| {
        interface.joints.rotate_left(5);
        interface.default_pose.rotate_left(5);
        interface.action_scale[2] = 0.1;
        interface.action_clip = Some(ActionClip::All(0.2));
        (interface.kp[0], interface.kd[1]) = (30.0, 0.75);
    })
}

fn logs(scene: &Task, policy: &Policy, options: &CollectOptions, threads: usize) -> Vec<Trajectory> {
    let noisy = Candidate { torque_noise: 1.0, ..Candidate::nominal(scene.walker.batch.model()) };
    let subject =
        Subject { task: scene, policy, candidate: Some(&noisy), seed: 5, cancel: None, moved: None };
    let logs = collect(&subject, options, threads).unwrap();
    assert!(logs.iter().all(|log| !log.fell));
    logs.into_iter().map(|log| log.trajectory).collect()
}

const OPTIONS: CollectOptions = CollectOptions { count: 3, seconds: 0.4, shift: [0.0; 2], privileged: true };

#[test]
fn rows_hold_what_the_policy_saw_and_did() {
    let scene = reordered();
    let policy = random_policy(&scene);
    let interface = &scene.walker.interface;
    assert_eq!(interface.joints[0], "FR_calf_joint");
    let logs = logs(&scene, &policy, &OPTIONS, 1);
    assert_eq!(logs.len(), 3);
    let mut clipped = 0;
    for log in &logs {
        assert_eq!(log.joints, interface.joints);
        assert_eq!((log.rate_hz, log.time.len()), (50.0, 20));
        assert!(log.time.iter().enumerate().all(|(k, time)| (time - 0.02 * k as f64).abs() < 1e-9));
        let gains = log.gains.as_ref().unwrap();
        assert_eq!((&gains.kp, &gains.kd), (&interface.kp, &interface.kd));
        let (targets, actions) = (log.target.as_ref().unwrap(), log.action.as_ref().unwrap());
        let commands = log.command.as_ref().unwrap();
        let base = log.base.as_ref().unwrap();
        let quaternions = base.quaternion.as_ref().unwrap();
        let turning = base.angular_velocity.as_ref().unwrap();
        for row in 0..20 {
            let joints = 12 * row..12 * (row + 1);
            for (k, (target, action)) in
                targets[joints.clone()].iter().zip(&actions[joints.clone()]).enumerate()
            {
                let wanted = interface.default_pose[k] + interface.action_scale[k] * action.clamp(-0.2, 0.2);
                assert!((target - wanted).abs() < 1e-6, "row {row}, joint {k}: {target}, not {wanted}");
                clipped += usize::from(action.abs() > 0.2);
            }
            // The observation, as the velocity task lays it out, from the log alone.
            let [w, x, y, z]: [f64; 4] = quaternions[4 * row..4 * row + 4].try_into().unwrap();
            let mut observation: Vec<f64> = turning[3 * row..3 * row + 3].iter().map(|w| 0.25 * w).collect();
            observation.extend(rotate([w, -x, -y, -z], [0.0, 0.0, -1.0]));
            observation.extend(&commands[3 * row..3 * row + 3]);
            observation.extend((0..12).map(|k| log.position[12 * row + k] - interface.default_pose[k]));
            observation.extend(log.velocity[joints.clone()].iter().map(|qd| 0.05 * qd));
            match row {
                0 => observation.extend([0.0; 12]),
                _ => observation.extend(&actions[12 * (row - 1)..12 * row]),
            }
            let observation: Vec<f32> = observation.into_iter().map(|x| x as f32).collect();
            let mut again = [f32::NAN; 12];
            policy.act(1, &observation, &mut again, &mut Scratch::default());
            for (again, action) in again.iter().zip(&actions[joints]) {
                assert!((f64::from(*again) - action).abs() < 1e-5, "row {row}: {again}, in the log {action}");
            }
        }
        // Commands last five rows.
        let command = |row: usize| &commands[3 * row..3 * row + 3];
        assert!((0..20).all(|row| command(row) == command(row / 5 * 5)) && command(0) != command(5));
    }
    assert!(clipped > 0, "no action was clipped");
}

#[test]
fn a_shifted_log_begins_later_in_the_same_walk() {
    let scene = reordered();
    let policy = random_policy(&scene);
    let whole = logs(&scene, &policy, &OPTIONS, 1);
    let options = CollectOptions { seconds: 0.2, shift: [0.06; 2], ..OPTIONS };
    for (shifted, whole) in logs(&scene, &policy, &options, 2).iter().zip(&whole) {
        assert_eq!((shifted.time.len(), shifted.time[0]), (10, 0.0));
        let rows = 12 * 3..12 * 13;
        assert_eq!(shifted.position, whole.position[rows.clone()]);
        assert_eq!(shifted.velocity, whole.velocity[rows.clone()]);
        assert_eq!(shifted.action.as_ref().unwrap()[..], whole.action.as_ref().unwrap()[rows]);
        assert_eq!(shifted.command.as_ref().unwrap()[..], whole.command.as_ref().unwrap()[9..39]);
    }
    // Drawn shifts lie between the two, and differ.
    let options = CollectOptions { count: 12, seconds: 0.1, shift: [0.04, 0.2], ..OPTIONS };
    let whole = logs(&scene, &policy, &CollectOptions { count: 12, ..OPTIONS }, 1);
    let shifts: Vec<usize> = logs(&scene, &policy, &options, 1)
        .iter()
        .zip(&whole)
        .map(|(shifted, whole)| {
            (0..=15).find(|&row| whole.position[12 * row..12 * (row + 5)] == shifted.position).unwrap()
        })
        .collect();
    assert!(shifts.iter().all(|shift| (2..=10).contains(shift)), "{shifts:?}");
    assert!(shifts.iter().any(|shift| *shift != shifts[0]), "{shifts:?}");
}

#[test]
fn threads_change_no_bit_and_falls_end_logs() {
    let scene = reordered();
    let policy = random_policy(&scene);
    // More than one tile of 64.
    let options = CollectOptions { count: 70, seconds: 0.1, privileged: false, ..OPTIONS };
    let once = logs(&scene, &policy, &options, 1);
    assert!(once == logs(&scene, &policy, &options, 3));
    for log in &once {
        let base = log.base.as_ref().unwrap();
        assert_eq!((&base.position, &base.linear_velocity), (&None, &None), "no inertial unit measures them");
        let rows = log.len();
        let [turned, rates] =
            [&base.quaternion, &base.angular_velocity].map(|part| part.as_ref().unwrap().len());
        assert_eq!((turned, rates), (4 * rows, 3 * rows));
        assert_eq!(log.simulated_step, Some(scene.walker.physics_step()));
    }

    let mut task = calm();
    task.policy.kp = gaitfit_learn::task::JointNumber::All(1e-3);
    let slack = task_common::scene(&task);
    let policy = task_common::constant_policy(&slack, &[0.0; 12]);
    let subject =
        Subject { task: &slack, policy: &policy, candidate: None, seed: 5, cancel: None, moved: None };
    let fallen = collect(&subject, &CollectOptions { count: 1, seconds: 2.0, ..OPTIONS }, 1).unwrap();
    let rows = fallen[0].trajectory.time.len();
    assert!(fallen[0].fell && rows > 5 && rows < 100, "{rows} rows");
    assert_eq!(fallen[0].trajectory.target.as_ref().unwrap().len(), 12 * rows);
}

#[test]
fn commands_for_a_robot_are_those_of_a_collected_log() {
    let scene = reordered();
    let policy = random_policy(&scene);
    let options = CollectOptions { count: 1, seconds: 0.56, shift: [0.0; 2], privileged: false };
    let log = &logs(&scene, &policy, &options, 1)[0];
    let dt = scene.walker.interface.control_dt;
    let rows = gaitfit_learn::task::commands(&scene.settings.command, dt, 5, 0.56);
    assert_eq!(rows.len(), 7, "a command each 0.1 s, and the end");
    let logged = log.command.as_ref().unwrap();
    for sample in 0..log.len() {
        let time = sample as f64 * dt;
        let row = rows.iter().rev().find(|(begin, _)| *begin <= time + 1e-9).unwrap();
        assert_eq!(row.1.map(f64::from), logged[3 * sample..3 * sample + 3], "sample {sample}");
    }
    assert!((rows[6].0 - 0.56).abs() < 1e-9);
}

#[test]
fn logs_one_by_one_are_those_of_all_together() {
    let scene = reordered();
    let policy = random_policy(&scene);
    let subject =
        Subject { task: &scene, policy: &policy, candidate: None, seed: 5, cancel: None, moved: None };
    let options = CollectOptions { count: 70, seconds: 0.1, ..OPTIONS };
    let all = collect(&subject, &options, 2).unwrap();
    let logs = std::sync::Mutex::new(vec![None; 70]);
    collect_each::<TaskError>(&subject, &options, 2, |number, log| {
        assert!(logs.lock().unwrap()[number].replace(log).is_none());
        Ok(())
    })
    .unwrap();
    let logs: Vec<_> = logs.into_inner().unwrap().into_iter().flatten().collect();
    assert!(logs == all && all[0] != all[65]);
    // The first error ends it.
    let ended = collect_each(&subject, &options, 1, |number, _| match number {
        3 => Err(TaskError::Interrupted),
        number => {
            assert!(number < 3);
            Ok(())
        }
    });
    assert!(matches!(ended, Err(TaskError::Interrupted)));
}
