//! Derivatives of replays against differences of replays.

use super::*;
use gaitfit_sim::Direction;

/// All derivatives, `[direction][recording]`.
fn along(replay: &Replay, directions: &[Direction], threads: usize) -> Vec<Vec<JointSignals>> {
    let results = Mutex::new(vec![vec![None; replay.recordings().len()]; directions.len()]);
    let keep = |direction: usize, recording: usize, slopes: &JointSignals| {
        let before = results.lock().unwrap()[direction][recording].replace(slopes.clone());
        assert!(before.is_none(), "direction {direction} on recording {recording} came twice");
    };
    Cpu { threads }.replay_along(replay, directions, &keep, &|| false).unwrap();
    let results = results.into_inner().unwrap();
    results.into_iter().map(|row| row.into_iter().map(Option::unwrap).collect()).collect()
}

/// A change of a robot by a number.
type Change = fn(&mut Robot, f64);

/// What changes, by how much differences are taken, and how. Narrower ones are spoilt where the signals jump, as those of
/// a solver do that stops before its end.
const CHANGES: [(&str, f64, Change); 9] = [
    ("frictionloss", 1.6e-2, |robot, by| robot.frictionloss.iter_mut().for_each(|x| *x += by)),
    ("armature", 4e-4, |robot, by| robot.armature.iter_mut().for_each(|x| *x += by)),
    ("damping", 1e-2, |robot, by| robot.damping.iter_mut().for_each(|x| *x += by)),
    ("delay", 2e-4, |robot, by| robot.delay.iter_mut().for_each(|x| *x += by)),
    ("kp_scale", 1e-2, |robot, by| robot.kp_scale.iter_mut().for_each(|x| *x += by)),
    ("kd_scale", 1e-2, |robot, by| robot.kd_scale.iter_mut().for_each(|x| *x += by)),
    ("encoder_bias", 1.6e-2, |robot, by| robot.encoder_bias.iter_mut().for_each(|x| *x += by)),
    ("velocity_lag", 2e-4, |robot, by| robot.velocity_lag += by),
    ("one calf's torque_offset", 5e-2, |robot, by| robot.torque_offset[2] += by),
];

fn moved(robot: &Robot, change: Change, by: f64) -> Robot {
    let mut moved = robot.clone();
    change(&mut moved, by);
    moved
}

#[test]
fn derivatives_are_those_of_the_signals() {
    let model = go2();
    let recordings = vec![recording(&model, 150, 0.0), recording(&model, 120, 0.7)];
    let mut robot = candidates(&model, 4)[2].clone();
    robot.delay.iter_mut().for_each(|x| *x = 0.0073);
    robot.velocity_lag = 0.004;
    let direction = |(_, _, change): &(&str, f64, Change)| Direction {
        robot: robot.clone(),
        ahead: moved(&robot, *change, 1e-6),
        behind: moved(&robot, *change, -1e-6),
        distance: 2e-6,
    };
    let directions: Vec<Direction> = CHANGES.iter().map(direction).collect();
    let options = ReplayOptions { preset: Preset::Accurate, substeps: 2, ..options(0.02) };
    let replay = Replay::new(&model, recordings, options).unwrap();
    let slopes = along(&replay, &directions, 1);
    assert!(all_bits(&along(&replay, &directions, 3)) == all_bits(&slopes), "threads matter");
    let near: Vec<Robot> =
        CHANGES.iter().flat_map(|&(_, by, change)| [by, -by].map(|by| moved(&robot, change, by))).collect();
    let near = run(&replay, &near, 1);
    for (at, (name, by, _)) in CHANGES.iter().enumerate() {
        for (recording, slopes) in slopes[at].iter().enumerate() {
            let (up, down) = (&near[2 * at][recording], &near[2 * at + 1][recording]);
            for (signal, slope, up, down) in [
                ("position", &slopes.position, &up.position, &down.position),
                ("velocity", &slopes.velocity, &up.velocity, &down.velocity),
            ] {
                let (mut off, mut all) = (0.0, 0.0);
                for ((slope, up), down) in slope.iter().zip(up).zip(down) {
                    let wanted = f64::from(up - down) / (2.0 * by);
                    off += (f64::from(*slope) - wanted).powi(2);
                    all += wanted * wanted;
                }
                if *name == "velocity_lag" && signal == "position" {
                    assert_eq!((off, all), (0.0, 0.0), "sensors do not move the robot");
                    continue;
                }
                let error = (off / all).sqrt();
                println!("recording {recording}, {name} {signal}: {error:.1e} of {:.3}", all.sqrt());
                assert!(error < 0.15, "{name}: {signal} is off by {error}");
            }
        }
    }
}

/// A lag is 0 where a search begins, and its derivative there is that of robots with one.
#[test]
fn a_lag_of_none_has_a_derivative() {
    let model = go2();
    let replay = Replay::new(&model, vec![recording(&model, 60, 0.0)], options(0.01)).unwrap();
    let quick = Robot::nominal(&model);
    let with = |lag: f64| Robot { velocity_lag: lag, ..quick.clone() };
    let (ahead, behind) = (with(1e-5), quick.clone());
    let direction = Direction { robot: quick.clone(), ahead, behind, distance: 1e-5 };
    let slopes = along(&replay, &[direction], 1);
    let near = run(&replay, &[quick.clone(), with(1e-5)], 1);
    let (mut off, mut all) = (0.0, 0.0);
    let pairs = near[0][0].velocity.iter().zip(&near[1][0].velocity);
    for (slope, (here, there)) in slopes[0][0].velocity.iter().zip(pairs) {
        let wanted = f64::from(there - here) / 1e-5;
        off += (f64::from(*slope) - wanted).powi(2);
        all += wanted * wanted;
    }
    assert!(all > 100.0 && off < 1e-3 * all, "{off} of {all}");
}

#[test]
fn directions_are_checked() {
    let model = go2();
    let replay = Replay::new(&model, vec![recording(&model, 30, 0.0)], options(0.01)).unwrap();
    let robot = Robot::nominal(&model);
    let direction = Direction { robot: robot.clone(), ahead: robot.clone(), behind: robot, distance: 0.0 };
    let refused = |direction: Direction| {
        CPU.replay_along(&replay, &[direction], &|_, _, _| panic!("nothing is simulated"), &|| false)
            .unwrap_err()
    };
    assert!(refused(direction.clone()).to_string().contains("distance"));
    let mut late = Direction { distance: 1.0, ..direction };
    late.robot.delay[0] = 0.02;
    assert!(refused(late.clone()).to_string().contains("delay"));
    late.robot.delay[0] = 0.01;
    late.behind.armature[0] = -1.0;
    assert!(refused(late).to_string().contains("armature"));
}
