//! Replays: independent of threads and neighbours, continuous in the delay, honest about bad recordings.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::path::Path;
use std::sync::Mutex;

use gaitfit_model::{Model, ReadOptions, Root, read};
use gaitfit_physics::{Isa, Preset, Robot};
use gaitfit_sim::{Cpu, Engine, JointSignals, Recording, Replay, ReplayOptions, SimError};

#[path = "replay/along.rs"]
mod along;

/// One thread of the processor.
const CPU: Cpu = Cpu { threads: 1 };

/// The project's Go2 with its base clamped.
fn go2() -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/go2.xml");
    read(&path, &ReadOptions { root: Some(Root::Fixed), ..ReadOptions::default() }).unwrap()
}

const DT: f64 = 0.005;
const POSE: [f64; 3] = [0.0, 0.9, -1.6];

/// Every joint swings at its own pace about a pose in the air.
fn recording(model: &Model, samples: usize, phase: f64) -> Recording {
    let n = model.joints.len();
    let at = |sample: f64, j: usize| {
        let pace = 1.0 + 0.3 * j as f64;
        POSE[j % 3] + 0.3 * (std::f64::consts::TAU * pace * sample * DT + phase).sin()
    };
    Recording {
        dt: DT,
        q0: (0..n).map(|j| at(0.0, j)).collect(),
        dq0: vec![0.0; n],
        target: (0..samples).flat_map(|i| (0..n).map(move |j| at(i as f64, j))).collect(),
        kp: vec![20.0; n],
        kd: vec![1.0; n],
    }
}

fn candidates(model: &Model, count: usize) -> Vec<Robot> {
    (0..count)
        .map(|c| {
            let mut robot = Robot::nominal(model);
            let share = c as f64 / count as f64;
            robot.armature.iter_mut().for_each(|x| *x = 0.01 + 0.05 * share);
            robot.frictionloss.iter_mut().for_each(|x| *x = 0.4 * (1.0 - share));
            robot.damping.iter_mut().for_each(|x| *x = 0.3 * share);
            robot.delay.iter_mut().for_each(|x| *x = 0.02 * share);
            robot.torque_scale.iter_mut().for_each(|x| *x = 0.8 + 0.3 * share);
            robot
        })
        .collect()
}

/// All signals, `[candidate][recording]`.
fn run(replay: &Replay, candidates: &[Robot], threads: usize) -> Vec<Vec<JointSignals>> {
    let results = Mutex::new(vec![vec![None; replay.recordings().len()]; candidates.len()]);
    let keep = |candidate: usize, recording: usize, signals: &JointSignals| {
        let before = results.lock().unwrap()[candidate][recording].replace(signals.clone());
        assert!(before.is_none(), "candidate {candidate} on recording {recording} came twice");
    };
    Cpu { threads }.replay(replay, candidates, &keep, &|| false).unwrap();
    let results = results.into_inner().unwrap();
    results.into_iter().map(|row| row.into_iter().map(Option::unwrap).collect()).collect()
}

fn bits(signals: &JointSignals) -> Vec<u32> {
    signals.position.iter().chain(&signals.velocity).map(|x| x.to_bits()).collect()
}

fn all_bits(results: &[Vec<JointSignals>]) -> Vec<Vec<u32>> {
    results.iter().flatten().map(bits).collect()
}

fn options(max_delay: f64) -> ReplayOptions {
    ReplayOptions { max_delay, ..ReplayOptions::default() }
}

fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).fold(0.0, |most, (x, y)| f32::max(most, (x - y).abs()))
}

fn isas() -> Vec<Isa> {
    [Isa::Avx512, Isa::Avx2, Isa::Portable].into_iter().filter(|isa| isa.available()).collect()
}

#[test]
fn threads_and_repetition_do_not_change_a_bit() {
    let model = go2();
    let recordings = vec![recording(&model, 60, 0.0), recording(&model, 90, 0.7), recording(&model, 40, 1.9)];
    let candidates = candidates(&model, 37);
    for isa in isas() {
        let options = ReplayOptions { isa: Some(isa), ..options(0.02) };
        let replay = Replay::new(&model, recordings.clone(), options).unwrap();
        let once = all_bits(&run(&replay, &candidates, 1));
        for threads in [1, 2, 3, 16] {
            assert!(all_bits(&run(&replay, &candidates, threads)) == once, "{isa:?}, {threads} threads");
        }
    }
}

#[test]
fn candidates_and_recordings_do_not_see_each_other() {
    let model = go2();
    let recordings = vec![recording(&model, 60, 0.0), recording(&model, 90, 0.7)];
    let candidates = candidates(&model, 19);
    let replay = Replay::new(&model, recordings.clone(), options(0.02)).unwrap();
    let together = run(&replay, &candidates, 2);
    for (index, candidate) in candidates.iter().enumerate() {
        let alone = run(&replay, std::slice::from_ref(candidate), 1);
        assert!(all_bits(&alone) == all_bits(&together[index..=index]), "candidate {index}");
    }
    for (index, recording) in recordings.into_iter().enumerate() {
        let single = Replay::new(&model, vec![recording], options(0.02)).unwrap();
        for (together, alone) in together.iter().zip(run(&single, &candidates, 1)) {
            assert!(bits(&together[index]) == bits(&alone[0]), "recording {index}");
        }
    }
    let mut reversed = candidates.clone();
    reversed.reverse();
    let mut back = run(&replay, &reversed, 2);
    back.reverse();
    assert!(all_bits(&back) == all_bits(&together), "the order of candidates matters");
}

#[test]
fn instruction_sets_agree() {
    let model = go2();
    let candidates = candidates(&model, 5);
    let results: Vec<_> = isas()
        .into_iter()
        .map(|isa| {
            let options = ReplayOptions { isa: Some(isa), preset: Preset::Converged, ..options(0.02) };
            run(&Replay::new(&model, vec![recording(&model, 100, 0.3)], options).unwrap(), &candidates, 1)
        })
        .collect();
    for other in &results[1..] {
        for (a, b) in results[0].iter().flatten().zip(other.iter().flatten()) {
            let apart = largest_difference(&a.position, &b.position);
            assert!(apart < 1e-4, "{apart} rad apart after half a second");
        }
    }
}

#[test]
fn rows_are_samples_and_row_0_is_the_start() {
    let model = go2();
    let n = model.joints.len();
    let mut log = recording(&model, 50, 0.4);
    log.dq0 = (0..n).map(|j| 0.1 * j as f64).collect();
    let replay = Replay::new(&model, vec![log.clone()], ReplayOptions::default()).unwrap();
    let signals = &run(&replay, &[Robot::nominal(&model)], 1)[0][0];
    assert_eq!(signals.position.len(), 50 * n);
    assert_eq!(signals.velocity.len(), 50 * n);
    for j in 0..n {
        assert_eq!(signals.position[j], log.q0[j] as f32);
        assert_eq!(signals.velocity[j], log.dq0[j] as f32);
    }
    assert_eq!(replay.steps_per_candidate(), 49);
    assert!(largest_difference(&signals.position[..n], &signals.position[49 * n..]) > 0.05, "nothing moves");
}

/// A delay of k control periods is the same as a log whose targets come k samples later.
#[test]
fn a_delay_of_whole_periods_shifts_the_targets() {
    let model = go2();
    let n = model.joints.len();
    let log = recording(&model, 120, 0.2);
    for substeps in [1, 4] {
        for k in [1, 2, 3] {
            let mut shifted = log.clone();
            let rows = shifted.target.len() / n;
            for i in (0..rows).rev() {
                let from = i.saturating_sub(k);
                for j in 0..n {
                    shifted.target[i * n + j] = log.target[from * n + j];
                }
            }
            let options = |max_delay| ReplayOptions { substeps, ..options(max_delay) };
            let mut delayed = Robot::nominal(&model);
            delayed.delay.fill(k as f64 * DT);
            let late = Replay::new(&model, vec![log.clone()], options(0.02)).unwrap();
            let moved = Replay::new(&model, vec![shifted], options(0.0)).unwrap();
            let a = &run(&late, &[delayed], 1)[0][0];
            let b = &run(&moved, &[Robot::nominal(&model)], 1)[0][0];
            let apart = largest_difference(&a.position, &b.position);
            println!("delay of {k} periods, {substeps} substeps: {apart:.1e} rad from shifted targets");
            assert!(apart < 2e-5, "{apart} rad");
        }
    }
}

/// The result is continuous in the delay, also across whole periods and at zero, and it moves the right way.
#[test]
fn small_changes_of_delay_make_small_differences() {
    let model = go2();
    let log = recording(&model, 120, 0.2);
    for substeps in [1, 4] {
        let replay =
            Replay::new(&model, vec![log.clone()], ReplayOptions { substeps, ..options(0.02) }).unwrap();
        let steps = 80;
        let swept: Vec<Robot> = (0..=steps)
            .map(|i| {
                let mut robot = Robot::nominal(&model);
                robot.delay.fill(0.02 * i as f64 / steps as f64);
                robot
            })
            .collect();
        let results = run(&replay, &swept, 2);
        let apart = |a: usize, b: usize| largest_difference(&results[a][0].position, &results[b][0].position);
        let whole = apart(0, steps);
        let worst = (0..steps).map(|i| apart(i, i + 1)).fold(0.0, f32::max);
        println!("{substeps} substeps: 20 ms of delay move {whole:.3} rad, 0.25 ms at most {worst:.1e} rad");
        assert!(whole > 0.05, "a delay of 20 ms changes only {whole} rad");
        assert!(worst < 3.0 * whole / steps as f32, "a jump of {worst} rad among steps of 0.25 ms");
    }
    let longer = Replay::new(&model, vec![log.clone()], options(0.05)).unwrap();
    let none = Replay::new(&model, vec![log], options(0.0)).unwrap();
    let nominal = [Robot::nominal(&model)];
    let apart = largest_difference(
        &run(&longer, &nominal, 1)[0][0].position,
        &run(&none, &nominal, 1)[0][0].position,
    );
    assert!(apart < 1e-6, "room for a delay changes a robot without one by {apart} rad");
}

#[test]
fn a_delay_beyond_the_history_is_refused() {
    let model = go2();
    let replay = Replay::new(&model, vec![recording(&model, 10, 0.0)], options(0.01)).unwrap();
    let mut slow = Robot::nominal(&model);
    slow.delay[4] = 0.011;
    let error = CPU.replay(&replay, &[slow], &|_, _, _| panic!("it ran"), &|| false).unwrap_err();
    assert!(error.to_string().contains("max_delay"), "{error}");
}

/// The encoders report true position plus bias, to the log and to the controller alike.
/// With one physics step a sample every velocity is seen: slow readings follow from the quick ones by the filter's equation.
#[test]
fn slow_sensors_read_filtered_velocities_and_the_motion_is_the_same() {
    let model = go2();
    let replay = Replay::new(&model, vec![recording(&model, 80, 0.0)], options(0.02)).unwrap();
    let quick = candidates(&model, 4)[2].clone();
    for play in [0.0, 0.02] {
        let quick = Robot { play: vec![play; 12], ..quick.clone() };
        let slow = Robot { velocity_lag: 0.008, ..quick.clone() };
        let signals = run(&replay, &[quick, slow], 1);
        let [quick, slow] = [&signals[0][0], &signals[1][0]];
        assert_eq!(quick.position, slow.position);
        let mut reading: Vec<f64> = quick.velocity[..12].iter().map(|&v| f64::from(v)).collect();
        assert_eq!(quick.velocity[..12], slow.velocity[..12]);
        let mut apart = 0.0f64;
        for (velocities, readings) in quick.velocity.chunks(12).zip(slow.velocity.chunks(12)).skip(1) {
            for ((wanted, velocity), found) in reading.iter_mut().zip(velocities).zip(readings) {
                *wanted += DT / (0.008 + DT) * (f64::from(*velocity) - *wanted);
                assert!((f64::from(*found) - *wanted).abs() < 2e-5, "{found} {wanted}");
                apart = apart.max(f64::from((found - velocity).abs()));
            }
        }
        assert!(apart > 0.3, "{apart} rad/s");
    }
}

#[test]
fn encoder_bias_moves_the_robot_and_not_the_reading() {
    let model = go2();
    let n = model.joints.len();
    let bias = 0.05;
    let log = recording(&model, 80, 0.6);
    let mut biased = Robot::nominal(&model);
    biased.encoder_bias.fill(bias);
    let replay = Replay::new(&model, vec![log.clone()], ReplayOptions::default()).unwrap();
    let read = &run(&replay, &[biased], 1)[0][0];
    for j in 0..n {
        assert!((f64::from(read.position[j]) - log.q0[j]).abs() < 1e-6, "the first reading is the log's");
    }

    // An unbiased robot that starts and is sent everywhere `bias` lower is where the biased one truly is.
    let mut lower = log;
    lower.q0.iter_mut().chain(&mut lower.target).for_each(|x| *x -= bias);
    let replay = Replay::new(&model, vec![lower], ReplayOptions::default()).unwrap();
    let truth = &run(&replay, &[Robot::nominal(&model)], 1)[0][0];
    let raised: Vec<f32> = truth.position.iter().map(|x| x + bias as f32).collect();
    let apart = largest_difference(&read.position, &raised);
    assert!(apart < 1e-5, "{apart} rad apart");
    assert!(largest_difference(&read.velocity, &truth.velocity) < 1e-3);
}

#[test]
fn gains_scale_as_said() {
    let model = go2();
    let log = recording(&model, 60, 0.1);
    let mut strong = log.clone();
    strong.kp.iter_mut().for_each(|x| *x *= 1.5);
    strong.kd.iter_mut().for_each(|x| *x *= 1.5);
    let mut scaled = Robot::nominal(&model);
    scaled.kp_scale.fill(1.5);
    scaled.kd_scale.fill(1.5);
    let mut boosted = Robot::nominal(&model);
    boosted.torque_scale.fill(1.5);
    let replay = Replay::new(&model, vec![log, strong], ReplayOptions::default()).unwrap();
    let results = run(&replay, &[Robot::nominal(&model), scaled, boosted], 1);
    let want = &results[0][1].position;
    assert!(largest_difference(&results[0][0].position, want) > 1e-3, "gains do not matter");
    assert!(largest_difference(&results[1][0].position, want) < 1e-5);
    assert!(largest_difference(&results[2][0].position, want) < 1e-5);
}

/// A candidate whose simulation blows up spoils its own numbers only: neither its neighbours' nor those of later
/// candidates that the same thread simulates in the same lane.
#[test]
fn a_diverging_candidate_is_alone() {
    let model = go2();
    for preset in [Preset::Fast, Preset::Accurate] {
        let options = ReplayOptions { preset, ..options(0.02) };
        let replay = Replay::new(&model, vec![recording(&model, 60, 0.0)], options).unwrap();
        let mut candidates = candidates(&model, 60);
        let healthy = run(&replay, &candidates, 1);
        let sick = 7;
        // Beyond single precision.
        candidates[sick].encoder_bias[2] = 1e39;
        candidates[sick].armature[5] = 1e39;
        let results = run(&replay, &candidates, 1);
        for (index, (result, healthy)) in results.iter().zip(&healthy).enumerate() {
            let finite = result[0].position.iter().all(|x| x.is_finite());
            if index == sick {
                assert!(!finite, "{preset:?}: it was to diverge");
            } else {
                assert!(finite, "{preset:?}: candidate {index} diverges too");
                assert!(bits(&result[0]) == bits(&healthy[0]), "{preset:?}: candidate {index} caught it");
            }
        }
    }
}

#[test]
fn impossible_robots_are_refused_by_name() {
    let model = go2();
    let replay = Replay::new(&model, vec![recording(&model, 10, 0.0)], ReplayOptions::default()).unwrap();
    let refused = |change: &dyn Fn(&mut Robot)| {
        let mut robot = Robot::nominal(&model);
        change(&mut robot);
        CPU.replay(&replay, &[robot], &|_, _, _| panic!("it ran"), &|| false).unwrap_err().to_string()
    };
    let message = refused(&|robot| robot.armature[3] = -0.1);
    assert!(message.contains("armature") && message.contains(&model.joints[3].name), "{message}");
    let message = refused(&|robot| robot.damping[0] = f64::NAN);
    assert!(message.contains("damping"), "{message}");
    let message = refused(&|robot| robot.frictionloss.truncate(5));
    assert!(message.contains("frictionloss") && message.contains('5'), "{message}");
    // Shorter lists of what a candidate alone has must not panic either.
    let message = refused(&|robot| robot.kp_scale.truncate(5));
    assert!(message.contains("kp"), "{message}");
    let message = refused(&|robot| robot.encoder_bias.truncate(5));
    assert!(message.contains("encoder_bias"), "{message}");
}

#[test]
fn bad_recordings_are_refused_with_reasons() {
    let model = go2();
    let good = recording(&model, 20, 0.0);
    let refused = |change: &dyn Fn(&mut Recording), word: &str| {
        let mut bad = good.clone();
        change(&mut bad);
        match Replay::new(&model, vec![good.clone(), bad], ReplayOptions::default()) {
            Err(SimError::Recording { index, what }) => {
                assert_eq!(index, 1);
                assert!(what.contains(word), "`{what}` does not speak of `{word}`");
            }
            Err(other) => panic!("{other}"),
            Ok(_) => panic!("accepted: {word}"),
        }
    };
    refused(&|r| r.target.truncate(25), "rows of 12 joints");
    refused(&|r| r.target.truncate(12), "two samples");
    refused(&|r| r.target.clear(), "two samples");
    refused(&|r| r.q0.truncate(3), "q0");
    refused(&|r| r.dq0.push(0.0), "dq0");
    refused(&|r| r.kp.truncate(1), "kp");
    refused(&|r| r.kd.clear(), "kd");
    refused(&|r| r.target[17] = f64::NAN, "finite");
    refused(&|r| r.q0[0] = f64::INFINITY, "finite");
    refused(&|r| r.dt = 0.0, "period");
    refused(&|r| r.dt = -0.005, "period");
    refused(&|r| r.dt = f64::NAN, "period");
    refused(&|r| r.dt = 0.01, "resample");
    assert!(matches!(
        Replay::new(&model, vec![], ReplayOptions::default()),
        Err(SimError::Recording { index: 0, .. })
    ));
}

#[test]
fn options_out_of_range_are_refused() {
    let model = go2();
    let with =
        |options| Replay::new(&model, vec![recording(&model, 10, 0.0)], options).err().unwrap().to_string();
    let message = with(ReplayOptions { substeps: 0, ..ReplayOptions::default() });
    assert!(message.contains("substeps"), "{message}");
    let message = with(options(-0.1));
    assert!(message.contains("max_delay"), "{message}");
    let message = with(options(f64::NAN));
    assert!(message.contains("max_delay"), "{message}");
}

#[test]
fn a_cancelled_replay_ends_within_a_recording() {
    let model = go2();
    let replay =
        Replay::new(&model, vec![recording(&model, 100_000, 0.0)], ReplayOptions::default()).unwrap();
    let asked = std::sync::atomic::AtomicUsize::new(0);
    let third_time = || asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed) >= 2;
    let candidates = vec![Robot::nominal(&model); 40];
    CPU.replay(&replay, &candidates, &|_, _, _| panic!("it went on to the end"), &third_time).unwrap();
}

/// Costs that the engine evaluates are those of the signals it would hand out.
#[test]
fn costs_are_those_of_the_signals() {
    let model = go2();
    let recordings = vec![recording(&model, 30, 0.0), recording(&model, 20, 1.0)];
    let options = ReplayOptions { max_delay: 0.02, ..ReplayOptions::default() };
    let replay = Replay::new(&model, recordings, options).unwrap();
    let candidates = candidates(&model, 5);
    let cost = |recording: usize, signals: &JointSignals| {
        let squares: f64 = signals.position.iter().map(|&x| f64::from(x).powi(2)).sum();
        squares + recording as f64
    };
    let signals = run(&replay, &candidates, 2);
    let costs = Cpu { threads: 2 }.costs(&replay, &candidates, &cost, &|| false).unwrap();
    let want: Vec<f64> =
        signals.iter().flat_map(|all| all.iter().enumerate().map(|(r, signals)| cost(r, signals))).collect();
    assert_eq!(costs, want);
    let cancelled = CPU.costs(&replay, &candidates, &cost, &|| true).unwrap();
    assert!(cancelled.iter().all(|cost| cost.is_nan()));
}
