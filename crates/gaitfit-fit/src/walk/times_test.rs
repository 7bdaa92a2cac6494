//! Lost rows, jitter, and targets that are stamped after their rows, as fits of walking logs take them.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::fixtures::{logs, policy, scene};
use super::logs::{LogNotes, Purpose, read};
use super::walking::Walking;
use crate::Error;
use crate::log::{self, Log};
use crate::settings::AdaptConfig;
use gaitfit_adapt::fit::simulate_one;
use gaitfit_adapt::{Resets, Theta};
use gaitfit_log::{Lead, Trajectory, write_csv};
use gaitfit_policy::Policy;
use gaitfit_sim::Candidate;
use std::sync::Arc;

fn as_logs(trajectories: &[Trajectory]) -> Vec<Log> {
    let log = |(number, trajectory): (usize, &Trajectory)| Log {
        name: format!("log-{number}.csv"),
        path: format!("log-{number}.csv").into(),
        sidecars: Vec::new(),
        joints: trajectory.joints.clone(),
        trajectory: trajectory.clone(),
        mounting: None,
        filled: Vec::new(),
    };
    trajectories.iter().enumerate().map(log).collect()
}

fn walking(policy: &Policy) -> (Arc<Walking>, Candidate) {
    let model = crate::robot::go2().unwrap();
    let (config, nothing, base) = (AdaptConfig::default(), Theta::default(), Candidate::nominal(&model));
    (Arc::new(Walking::new(&config, policy.clone(), &model, &nothing, &base, 1).unwrap()), base)
}

/// The logs from files.
fn read_back(logs: &[Trajectory], policy: &Policy) -> Result<LogNotes, Error> {
    let folder = tempfile::tempdir().unwrap();
    for (number, log) in logs.iter().enumerate() {
        write_csv(&folder.path().join(format!("log-{number}.csv")), log).unwrap();
    }
    let mut config = AdaptConfig {
        logs: vec![folder.path().display().to_string()],
        policy: Some("walk.safetensors".to_owned()),
        ..AdaptConfig::default()
    };
    config.simulation.skip_seconds = Some(0.1);
    let path = folder.path().join("adapt.toml");
    read(&config.logs, Purpose::Validation, &config, &path, policy, &scene())
}

/// A log of two seconds without its row `row`, with stamps that jitter by up to 3 ms.
fn damaged(policy: &Policy, row: usize) -> (Trajectory, Trajectory) {
    let mut whole = super::fixtures::puppet(policy, 1, 2.0);
    for (sample, time) in whole.time.iter_mut().enumerate() {
        *time += 0.003 * ((sample * 7919) as f64).sin();
    }
    let rows = |values: &[f64], width: usize| [&values[..row * width], &values[(row + 1) * width..]].concat();
    let joints = whole.joints.len();
    let lost = Trajectory {
        time: rows(&whole.time, 1),
        position: rows(&whole.position, joints),
        velocity: rows(&whole.velocity, joints),
        target: whole.target.as_ref().map(|values| rows(values, joints)),
        action: whole.action.as_ref().map(|values| rows(values, joints)),
        command: whole.command.as_ref().map(|values| rows(values, 3)),
        ..whole.clone()
    };
    (whole, lost)
}

#[test]
fn a_lost_row_among_jitter_slides_no_action() {
    let policy = policy(&scene(), 3);
    let (whole, lost) = damaged(&policy, 40);
    let notes = read_back(&[lost], &policy).unwrap();
    let log = &notes.logs[0];
    assert_eq!((log.filled.as_slice(), log.trajectory.len()), (&[40][..], whole.len()));
    let rows = |values: &Option<Vec<f64>>| {
        values.as_ref().unwrap().chunks(12).map(<[f64]>::to_vec).collect::<Vec<_>>()
    };
    let (found, want) = (rows(&log.trajectory.action), rows(&whole.action));
    for row in (0..want.len()).filter(|row| *row != 40) {
        assert_eq!(found[row], want[row], "{row}");
    }
    assert_eq!(found[40], want[39]);
    let said = |part: &str| notes.warnings.iter().any(|text| text.contains(part));
    assert!(said("1 lost rows within 1 of 1 logs"), "{:?}", notes.warnings);
    assert!(!said("filters, delays"), "{:?}", notes.warnings);
}

#[test]
fn predictions_at_lost_rows_are_what_the_log_has() {
    let scene = scene();
    let policy = policy(&scene, 3);
    let mut logs = as_logs(&logs(&scene, &policy, true)[..1]);
    logs[0].filled = vec![10];
    let (walking, base) = walking(&policy);
    let track = |logs: &[Log], every: usize| {
        let simulator = walking.simulator(base.clone(), logs);
        simulate_one(&simulator, &Theta::default(), &[], Resets::Sensors(every)).unwrap().remove(0)
    };
    let mut whole = logs.clone();
    whole[0].filled.clear();
    for every in [1, 3] {
        let (predicted, plain) = (track(&logs, every), track(&whole, every));
        for row in 0..logs[0].trajectory.len() {
            let at = row * 12..(row + 1) * 12;
            let measured: Vec<f32> =
                logs[0].trajectory.position[at.clone()].iter().map(|&x| x as f32).collect();
            if (10..=10 + every).contains(&row) {
                assert_eq!(predicted.position[at], measured, "{every} {row}");
            } else {
                assert_eq!(predicted.position[at.clone()], plain.position[at], "{every} {row}");
            }
        }
        assert_ne!(predicted.position, plain.position);
    }
}

#[test]
fn delays_of_walks_count_from_the_rows_and_those_of_replays_from_the_stamps() {
    let scene = scene();
    let policy = policy(&scene, 3);
    let mut trajectories = logs(&scene, &policy, false);
    trajectories.iter_mut().for_each(|log| log.lead = Some(Lead { seconds: 0.002, spread: 1e-4 }));
    let logs = as_logs(&trajectories);
    let note = |walks| log::lead_note(&logs, walks).unwrap().unwrap();
    for walks in [true, false] {
        let note = note(walks);
        assert!(note.contains("stamped 2.00 ms") && note.contains("counts from the rows") == walks, "{note}");
    }
    let (walking, base) = walking(&policy);
    let robot = walking.simulator(base.clone(), &logs).candidate(&Theta::default(), &[]);
    assert_eq!(robot.robot.delay, base.robot.delay, "the policy acts on the row's state");
    // One delay of a replay cannot count from different stamps; that of walks counts from the rows.
    let mut others = logs.clone();
    others[1].trajectory.lead = None;
    let text = log::lead_note(&others, false).unwrap_err().to_string();
    assert!(text.contains("log-1.csv") && text.contains("--clock-offset"), "{text}");
    assert!(log::lead_note(&others, true).is_ok());
    assert_eq!(log::lead_note(&as_logs(&[]), false).unwrap(), None);
}
