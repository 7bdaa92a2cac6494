//! Walking logs are read, cut and doubted as they deserve.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::fixtures::{policy, puppet, scene};
use super::logs::{LogNotes, Purpose, read};
use crate::Error;
use crate::settings::AdaptConfig;
use gaitfit_adapt::cost::CostKind;
use gaitfit_learn::task::Task;
use gaitfit_log::{BaseState, Trajectory, write_csv};
use gaitfit_policy::Policy;
use std::num::NonZeroUsize;

struct Bench {
    scene: Task,
    policy: Policy,
}

impl Bench {
    fn new() -> Self {
        let scene = scene();
        let policy = policy(&scene, 3);
        Self { scene, policy }
    }

    fn logs(&self) -> Vec<Trajectory> {
        (0..8).map(|number| puppet(&self.policy, number, 2.0)).collect()
    }

    fn read(&self, logs: &[Trajectory]) -> Result<LogNotes, Error> {
        self.read_with(logs, &self.policy, |_| {})
    }

    /// The logs from files, as a configuration's folder has them.
    fn read_with(
        &self,
        logs: &[Trajectory],
        policy: &Policy,
        change: impl Fn(&mut AdaptConfig),
    ) -> Result<LogNotes, Error> {
        let folder = tempfile::tempdir().unwrap();
        for (number, log) in logs.iter().enumerate() {
            write_csv(&folder.path().join(format!("log-{number}.csv")), log).unwrap();
        }
        let mut config = AdaptConfig {
            logs: vec![folder.path().display().to_string()],
            policy: Some("walk.safetensors".to_owned()),
            ..AdaptConfig::default()
        };
        change(&mut config);
        read(&config.logs, Purpose::Fit, &config, &folder.path().join("adapt.toml"), policy, &self.scene)
    }

    fn refused(&self, logs: &[Trajectory], parts: &[&str]) {
        let text = self.read(logs).unwrap_err().to_string();
        for part in parts {
            assert!(text.contains(part), "`{part}` is not in: {text}");
        }
    }
}

fn changed(logs: &[Trajectory], change: impl Fn(&mut Trajectory)) -> Vec<Trajectory> {
    let mut logs = logs.to_vec();
    logs.iter_mut().for_each(change);
    logs
}

fn warned(notes: &LogNotes, part: &str) -> bool {
    notes.warnings.iter().any(|text| text.contains(part))
}

#[test]
fn good_logs_come_as_they_were() {
    let bench = Bench::new();
    let logs = bench.logs();
    let notes = bench.read(&logs).unwrap();
    assert_eq!(notes.logs.len(), 8);
    assert_eq!((notes.falls(), notes.cut_seconds()), (0, 0.0));
    assert!(notes.policy_match.mismatch < 0.01, "{:?}", notes.policy_match);
    for (read, log) in notes.logs.iter().zip(&logs) {
        assert_eq!(read.trajectory.len(), log.len());
        assert_eq!(read.trajectory.joints, bench.scene.walker.interface.joints);
        for (a, b) in read.trajectory.position.iter().zip(&log.position) {
            assert!((a - b).abs() < 1e-6);
        }
    }
    let unexpected = notes
        .warnings
        .iter()
        .find(|text| !text.starts_with("the logs do not cover") && !text.starts_with("the logs cover"));
    assert_eq!(unexpected, None);
}

#[test]
fn what_is_missing_is_named() {
    let bench = Bench::new();
    let logs = bench.logs();
    bench.refused(&changed(&logs, |log| log.command = None), &["vx_cmd", "Record the command"]);
    let silent = changed(&logs, |log| (log.action, log.target) = (None, None));
    bench.refused(&silent, &["act_", "qdes_", "Record the policy's outputs"]);
    let short = changed(&logs, |log| {
        let eleven = log.joints[..11].to_vec();
        *log = log.select_joints(&eleven).unwrap();
    });
    bench.refused(&short, &["lacks the robot's joint", "RR_calf"]);
    bench.refused(&changed(&logs, |log| log.position[30] = f64::NAN), &["log-0.csv", "is NaN"]);
}

#[test]
fn targets_stand_in_for_actions() {
    let bench = Bench::new();
    let logs = bench.logs();
    let notes = bench.read(&changed(&logs, |log| log.action = None)).unwrap();
    let (read, log) = (notes.logs[3].trajectory.action.as_ref().unwrap(), logs[3].action.as_ref().unwrap());
    assert!(read.iter().zip(log).all(|(a, b)| (a - b).abs() < 1e-5));
    let notes =
        bench.read(&changed(&logs, |log| log.target.as_mut().unwrap().iter_mut().for_each(|x| *x += 0.1)));
    assert!(warned(&notes.unwrap(), "logged targets are not default pose"));
}

#[test]
fn too_little_is_refused_with_what_is_needed() {
    let bench = Bench::new();
    let logs = bench.logs();
    bench.refused(&logs[..3], &["6.0 s of walking", "at least 10 s"]);
    let mut mixed = logs.clone();
    mixed.push(logs[0].slice(0..20).unwrap());
    let notes = bench.read(&mixed).unwrap();
    assert_eq!(notes.logs.len(), 8);
    assert!(warned(&notes, "log-8.csv: 0.38 s of data are too short"), "{:?}", notes.warnings);
}

#[test]
fn a_wild_sample_is_named() {
    let bench = Bench::new();
    for (value, shown) in [(1e308, "1000"), (f64::NAN, "NaN"), (-1e5, "-100000")] {
        let mut logs = bench.logs();
        let width = logs[1].joints.len();
        logs[1].velocity[7 * width + 2] = value;
        let column = format!("dq_{} of sample 7 is {shown}", logs[1].joints[2]);
        bench.refused(&logs, &["log-1.csv", &column]);
    }
    let mut logs = bench.logs();
    logs[0].command.as_mut().unwrap()[4] = 1e9;
    bench.refused(&logs, &["vy_cmd of sample 1 is 1000000000"]);
}

#[test]
fn the_same_data_count_once() {
    let bench = Bench::new();
    let mut logs = bench.logs();
    logs.push(logs[2].clone());
    let notes = bench.read(&logs).unwrap();
    assert_eq!(notes.logs.len(), 8);
    assert!(warned(&notes, "log-8.csv: the same data as"), "{:?}", notes.warnings);
}

#[test]
fn other_rates_are_brought_to_the_policys() {
    let bench = Bench::new();
    let mut logs = bench.logs();
    // Five samples for each of the policy's, the joints' path interpolated.
    logs[1] = logs[1].resample(250.0).unwrap();
    let notes = bench.read(&logs).unwrap();
    assert!(warned(&notes, "50.0000, 250.0000"), "{:?}", notes.warnings);
    assert_eq!(notes.logs[1].trajectory.rate_hz, 50.0);
    assert!(notes.policy_match.mismatch < 0.05, "{:?}", notes.policy_match);
    let slow = changed(&bench.logs(), |log| *log = log.resample(25.0).unwrap());
    bench.refused(&slow, &["25 samples a second", "policy acts 50 times"]);
}

#[test]
fn another_policy_is_refused() {
    let bench = Bench::new();
    let other = policy(&bench.scene, 4);
    let text = bench.read_with(&bench.logs()[..5], &other, |_| {}).unwrap_err().to_string();
    assert!(text.contains("walk.safetensors") && text.contains("log-"), "{text}");
}

#[test]
fn falls_are_cut_with_a_margin() {
    let bench = Bench::new();
    let mut logs = bench.logs();
    logs.extend((8..10).map(|number| puppet(&bench.policy, number, 2.0)));
    // The base of one log tips over at 1.6 s and stays down.
    let quaternion = |at: f64| if at < 1.599 { [1.0, 0.0, 0.0, 0.0] } else { [0.6, 0.8, 0.0, 0.0] };
    let rows = logs[4].time.iter().flat_map(|&at| quaternion(at)).collect();
    logs[4].base = Some(BaseState { quaternion: Some(rows), ..BaseState::default() });
    let notes = bench.read(&logs).unwrap();
    assert_eq!((notes.falls(), notes.falling.falls), (1, 1));
    assert!((notes.falling.seconds - 19.28).abs() < 0.05, "{:?}", notes.falling);
    let kept = &notes.logs[4].trajectory;
    assert!((kept.duration() - 1.08).abs() < 1e-6, "{}", kept.duration());
    assert!((notes.cut_seconds() - 0.9).abs() < 1e-6);
    assert!(warned(&notes, "the robot fell in 1 of 10 logs"), "{:?}", notes.warnings);
    // All down from the start: nothing is left.
    let down = changed(&logs, |log| {
        let rows = [0.6, 0.8, 0.0, 0.0].repeat(log.len());
        log.base = Some(BaseState { quaternion: Some(rows), ..BaseState::default() });
    });
    bench.refused(&down, &["in all logs the robot falls", "record next time"]);
}

#[test]
fn a_robot_that_is_down_when_its_log_begins_has_not_fallen() {
    let bench = Bench::new();
    let logs: Vec<Trajectory> = (0..8).map(|number| puppet(&bench.policy, number, 4.0)).collect();
    let stands_up = changed(&logs, |log| {
        let quaternion = |at: &f64| if *at < 0.5 { [0.6, 0.8, 0.0, 0.0] } else { [1.0, 0.0, 0.0, 0.0] };
        let rows = log.time.iter().flat_map(quaternion).collect();
        log.base = Some(BaseState { quaternion: Some(rows), ..BaseState::default() });
    });
    let notes = bench.read(&stands_up).unwrap();
    assert_eq!((notes.falls(), notes.falling.falls), (0, 0));
    assert!(warned(&notes, "the robot does not walk in 8 of 8 logs"), "{:?}", notes.warnings);
    assert!(notes.logs[0].trajectory.time[0] > 1.4, "{:?}", notes.logs[0].trajectory.time[0]);
}

#[test]
fn short_predictions_learn_until_the_robot_lies_and_need_every_reading() {
    let bench = Bench::new();
    let mut logs = changed(&bench.logs(), |log| {
        // A base that does not turn at all while the legs walk hangs.
        let sway = (0..3 * log.len()).map(|at| 0.1 * (0.7 * at as f64).sin()).collect();
        log.base = Some(BaseState {
            quaternion: Some([1.0, 0.0, 0.0, 0.0].repeat(log.len())),
            angular_velocity: Some(sway),
            ..BaseState::default()
        });
    });
    let upright = |at: f64| if at < 1.599 { [1.0, 0.0, 0.0, 0.0] } else { [0.6, 0.8, 0.0, 0.0] };
    let rows: Vec<f64> = logs[4].time.iter().flat_map(|&at| upright(at)).collect();
    logs[4].base.as_mut().unwrap().quaternion = Some(rows);
    let sensed = |config: &mut AdaptConfig| config.costs = vec![CostKind::MatchR(NonZeroUsize::MIN)];
    let notes = bench.read_with(&logs, &bench.policy, sensed).unwrap();
    let kept = &notes.logs[4].trajectory;
    assert!((kept.duration() - 1.58).abs() < 1e-6, "{}", kept.duration());
    let notes = bench
        .read_with(&logs, &bench.policy, |config| {
            sensed(config);
            config.falls.margin_seconds = Some(0.2);
        })
        .unwrap();
    assert!((notes.logs[4].trajectory.duration() - 1.38).abs() < 1e-6);

    logs[2].base.as_mut().unwrap().angular_velocity.as_mut().unwrap()[3 * 9 + 1] = f64::NAN;
    let text = bench.read_with(&logs, &bench.policy, sensed).unwrap_err().to_string();
    assert!(text.contains("log-2.csv:") && text.contains("`wy` has no number"), "{text}");
    assert!(bench.read(&logs).is_ok(), "other costs do without");
}

#[test]
fn lost_samples_part_a_log() {
    let bench = Bench::new();
    let mut logs = bench.logs();
    let whole = puppet(&bench.policy, 9, 3.0);
    let gap = changed(&[whole], |log| log.time.iter_mut().skip(75).for_each(|time| *time += 0.4));
    logs.extend(gap);
    let notes = bench.read(&logs).unwrap();
    assert_eq!(notes.logs.len(), 10);
    assert!(notes.logs[9].name.ends_with("from 1.90 s"), "{}", notes.logs[9].name);
    assert_eq!(notes.falls(), 0);
    assert!(warned(&notes, "samples were lost in 1 of 9 logs"), "{:?}", notes.warnings);
}

#[test]
fn gains_and_robots_that_differ_are_told() {
    let bench = Bench::new();
    let odd = changed(&bench.logs(), |log| {
        log.robot = Some("b2".into());
        log.gains = Some(gaitfit_log::Gains { kp: vec![40.0; 12], kd: vec![0.5; 12] });
    });
    let notes = bench.read(&odd).unwrap();
    assert!(warned(&notes, "made with kp 40 of joint `"), "{:?}", notes.warnings);
    assert!(warned(&notes, "robot `b2`"), "{:?}", notes.warnings);
}

#[test]
fn logs_of_a_simulator_with_other_steps_are_told() {
    let bench = Bench::new();
    let step = bench.scene.walker.physics_step();
    let stated = |step: f64| {
        let notes = bench.read(&changed(&bench.logs(), |log| log.simulated_step = Some(step))).unwrap();
        warned(&notes, &format!("Set `robot_timestep = {step}`"))
    };
    assert!(!stated(step) && stated(0.5 * step));
}

#[test]
fn only_the_horizon_of_each_log_counts_and_it_must_leave_enough() {
    let bench = Bench::new();
    let logs = bench.logs();
    let with = |seconds: f64| {
        bench.read_with(&logs, &bench.policy, |config| {
            config.simulation.skip_seconds = Some(0.25);
            config.simulation.horizon_seconds = seconds;
        })
    };
    let whole = with(0.0).unwrap();
    let short = with(1.5).unwrap();
    for (short, whole) in short.logs.iter().zip(&whole.logs) {
        assert_eq!(short.trajectory.duration(), 1.76, "skipped and counted, in steps of 20 ms");
        let kept = short.trajectory.position.len();
        assert!(short.trajectory.position[..] == whole.trajectory.position[..kept]);
    }
    assert!(with(1e300).unwrap().logs[0].trajectory.position == whole.logs[0].trajectory.position);
    let text = with(1.0).unwrap_err().to_string();
    assert!(text.contains("at most 1 s of each (`simulation.horizon_seconds`)"), "{text}");
}
