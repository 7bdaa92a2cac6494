//! Long physics steps that stand for short ones.

use super::*;

/// A period on the ground, and then a further one from what the sensors of `truth` read after the first.
fn second_period(batch: &Batch, params: &[Params<f64>], truth: Option<&Motion>) -> [Motion; 2] {
    let count = params.len();
    let mut tile = CPU.tile(batch, params, &[]).unwrap();
    let mut motions = [batch.motion(count), batch.motion(count)];
    for index in 0..count {
        tile.place(index, &start(batch.model(), index));
    }
    tile.step(&targets(0..count, 0), &[], &mut motions[0]);
    if let Some(truth) = truth {
        fn part<const N: usize>(values: &[f32], index: usize) -> [f32; N] {
            std::array::from_fn(|k| values[N * index + k])
        }
        for (index, params) in params.iter().enumerate() {
            let joints = 12 * index..12 * index + 12;
            let readings = truth.joint_position[joints.clone()].iter();
            let reading = Start {
                base_position: part(&truth.base_position, index),
                base_quaternion: part(&truth.base_quaternion, index),
                base_linear: part(&truth.base_linear, index),
                base_angular: part(&truth.base_angular, index),
                joint_position: readings
                    .zip(&params.joints)
                    .map(|(q, p)| q - p.encoder_bias as f32)
                    .collect(),
                joint_velocity: truth.joint_velocity[joints].to_vec(),
            };
            tile.correct(&[(index, reading)]);
        }
    }
    tile.step(&targets(0..count, 1), &[], &mut motions[1]);
    motions
}

/// The median error of velocities after a period of `batch`, from what the sensors of `truth` read.
fn error(batch: &Batch, params: &[Params<f64>], truth: &[Motion; 2]) -> f64 {
    let motion = &second_period(batch, params, Some(&truth[0]))[1];
    let errors =
        motion.joint_velocity.iter().zip(&truth[1].joint_velocity).map(|(a, b)| f64::from(a - b).abs());
    let mut errors: Vec<f64> = errors.collect();
    errors.sort_by(f64::total_cmp);
    errors[errors.len() / 2]
}

fn batch(model: &Model, substeps: usize, emulated_step: Option<f64>) -> Batch {
    let preset = Preset::Accurate;
    Batch::new(model, BatchOptions { control_dt: 0.02, substeps, preset, emulated_step, ..options() })
        .unwrap()
}

/// A robot simulated at 1 ms, and 5 ms steps that stand for it: from the same readings they reach nearly the same
/// velocities a period later. Plain 5 ms steps do not.
#[test]
fn long_steps_stand_for_short_ones() {
    let model = go2();
    let robots: Vec<Robot> = (robots(&model, 16).into_iter())
        .map(|robot| Robot { damping: vec![0.0; 12], frictionloss: vec![0.2; 12], ..robot })
        .collect();
    let params = params(&model, &robots);
    let batch = |substeps, emulated_step| batch(&model, substeps, emulated_step);
    let truth = second_period(&batch(20, None), &params, None);
    let error = |batch: &Batch| error(batch, &params, &truth);
    let (same, plain) = (error(&batch(20, None)), error(&batch(4, None)));
    let (half, long) = (error(&batch(8, Some(0.001))), error(&batch(4, Some(0.001))));
    assert!(same < 1e-4, "{same}");
    assert!(long < 0.6 * plain && half < 0.3 * long, "{plain} {long} {half}");
    // A step that stands for itself is the plain one: only the drives' history is one target longer.
    assert!(error(&batch(20, Some(0.001))) < 1e-4);
    let wrong = BatchOptions { emulated_step: Some(f64::NAN), ..options() };
    assert!(Batch::new(&model, wrong).is_err());
}

/// A file may have its dampers act on a step's own velocity (`eulerdamp="disable"`, as files made for MJX do). Long steps
/// stand for that robot too: errors are 0.69 and 0.13 of a plain long step's; 1.04 and 0.24 if only the file is obeyed.
#[test]
fn long_steps_stand_for_explicit_dampers() {
    let mut model = go2();
    model.options.eulerdamp = false;
    let robots: Vec<Robot> = (robots(&model, 16).into_iter())
        .map(|robot| Robot {
            damping: vec![0.5; 12],
            frictionloss: vec![0.2; 12],
            armature: vec![0.03; 12],
            ..robot
        })
        .collect();
    let params = params(&model, &robots);
    let truth = second_period(&batch(&model, 20, None), &params, None);
    let error = |substeps, emulated| error(&batch(&model, substeps, emulated), &params, &truth);
    let (plain, long, half) = (error(4, None), error(4, Some(0.001)), error(8, Some(0.001)));
    assert!(long < 0.75 * plain && half < 0.18 * plain, "{plain} {long} {half}");
}
