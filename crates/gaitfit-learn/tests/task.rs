//! Tasks: what robots see, how they start, when episodes end, what is drawn, and which settings are refused.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

#[path = "task/drawn.rs"]
mod drawn;
#[path = "task/ground.rs"]
mod ground;
use crate::task_common;

use gaitfit_learn::task::{Ended, Environment, JointNumber, NoiseSettings, Task, TaskSettings};
use gaitfit_model::rotation::{inverse, rotate};
use gaitfit_physics::{Preset, Robot};
use gaitfit_policy::{ActionClip, Quantity, Term};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::Candidate;
use task_common::{built_in, calm, go2, scene, scene_with, step};

/// `vector` (world frame) in the body frame of `quaternion`.
fn to_body(quaternion: &[f32], vector: [f64; 3]) -> [f64; 3] {
    let q: [f64; 4] = std::array::from_fn(|k| f64::from(quaternion[k]));
    rotate(inverse(q), vector)
}

#[track_caller]
fn close(found: &[f32], wanted: &[f64]) {
    assert_eq!(found.len(), wanted.len());
    for (k, (&found, &wanted)) in found.iter().zip(wanted).enumerate() {
        assert!(
            (f64::from(found) - wanted).abs() < 1e-5 * wanted.abs().max(1.0),
            "[{k}]: {found}, not {wanted}"
        );
    }
}

#[test]
fn observations_are_laid_out_as_the_interface_says() {
    let mut task = calm();
    task.start.tilt = 10.0;
    task.start.angular_velocity = 1.0;
    task.start.joint_velocity = 1.0;
    // Another order of joints and of terms than the model's and the task's own, and unequal scales.
    let scene = scene_with(&task, |interface| {
        for vector in [&mut interface.default_pose, &mut interface.action_scale] {
            vector.reverse();
        }
        interface.joints.reverse();
        interface.action_scale[0] = 0.5;
        interface.gait_frequency = Some(2.0);
        let term = |quantity, scale: &[f32]| Term::new(quantity).scaled(scale);
        interface.observation = vec![
            term(Quantity::LastAction, &[]),
            term(Quantity::JointVelocity, &[0.05]),
            term(Quantity::Command, &[2.0, 3.0, 0.5]),
            term(Quantity::JointPosition, &[10.0]),
            term(Quantity::ProjectedGravity, &[]),
            term(Quantity::BaseAngularVelocity, &[0.25]),
            term(Quantity::GaitPhase, &[]),
            term(Quantity::BaseLinearVelocity, &[]),
            term(Quantity::BaseHeight, &[2.0]),
        ];
        interface.critic_observation =
            vec![term(Quantity::BaseLinearVelocity, &[4.0]), term(Quantity::BaseHeight, &[])];
    });
    assert_eq!(scene.walker.joints[0], 11, "the policy's first joint is the model's last");
    let count = 3;
    let mut environment = Environment::new(&scene, None, 5, 0, count).unwrap();
    let actions: Vec<f32> = (0..12 * count).map(|k| 0.02 * k as f32 - 0.3).collect();
    let (mut reward, mut ended) = (vec![0.0; count], vec![Ended::No; count]);
    for number in 1..=3 {
        environment.step(number, &actions, &mut reward, &mut ended);
    }
    // Targets in the model's order: default pose and scaled action of the same joint.
    for (k, &joint) in scene.walker.joints.iter().enumerate() {
        let scale = if k == 0 { 0.5 } else { 0.25 };
        let wanted = scene.walker.interface.default_pose[k] + scale * f64::from(actions[k]);
        close(&environment.targets()[joint..=joint], &[wanted]);
    }
    let width = 3 * 12 + 3 + 3 + 3 + 2 + 3 + 1;
    assert_eq!(scene.walker.interface.observation_width(), width);
    let mut rows = vec![f32::NAN; count * width];
    environment.observe(4, &mut rows);
    let mut critic = vec![f32::NAN; count * 4];
    environment.observe_critic(&mut critic);
    let motion = environment.motion();
    for (index, row) in rows.chunks_exact(width).enumerate() {
        let joint = |values: &[f32], k: usize| f64::from(values[12 * index + scene.walker.joints[k]]);
        let three =
            |values: &[f32]| -> [f64; 3] { std::array::from_fn(|k| f64::from(values[3 * index + k])) };
        let quaternion = &motion.base_quaternion[4 * index..4 * index + 4];
        assert_eq!(row[..12], actions[12 * index..12 * index + 12]);
        let velocity: Vec<f64> = (0..12).map(|k| 0.05 * joint(&motion.joint_velocity, k)).collect();
        close(&row[12..24], &velocity);
        let command = environment.commands()[index].map(f64::from);
        close(&row[24..27], &[2.0 * command[0], 3.0 * command[1], 0.5 * command[2]]);
        let home = |k: usize| scene.walker.interface.default_pose[k];
        let position: Vec<f64> =
            (0..12).map(|k| 10.0 * (joint(&motion.joint_position, k) - home(k))).collect();
        close(&row[27..39], &position);
        close(&row[39..42], &to_body(quaternion, [0.0, 0.0, -1.0]));
        close(&row[42..45], &three(&motion.base_angular).map(|w| 0.25 * w));
        // Three steps of 0.02 s at 2 Hz are 0.12 of a turn.
        let (sin, cos) = (std::f64::consts::TAU * 0.12).sin_cos();
        close(&row[45..47], &[sin, cos]);
        let linear = to_body(quaternion, three(&motion.base_linear));
        close(&row[47..50], &linear);
        close(&critic[4 * index..4 * index + 3], &linear.map(|v| 4.0 * v));
        let height = f64::from(motion.base_position[3 * index + 2]);
        assert!(height > 0.2, "{height}");
        close(&[row[50], critic[4 * index + 3]], &[2.0 * height, height]);
    }
}

#[test]
fn noise_fills_its_ranges_and_spares_what_has_none() {
    let half_ranges = [
        (Quantity::BaseAngularVelocity, 0.2),
        (Quantity::ProjectedGravity, 0.05),
        (Quantity::JointPosition, 0.01),
        (Quantity::JointVelocity, 1.5),
    ];
    let noise = NoiseSettings { half_ranges: half_ranges.into() };
    let task = TaskSettings { noise, ..calm() };
    let scene = scene_with(&task, |interface| interface.critic_observation = interface.observation.clone());
    let environment = Environment::new(&scene, None, 5, 0, 16).unwrap();
    let (mut noisy, mut clean) = (vec![0.0; 16 * 45], vec![0.0; 16 * 45]);
    environment.observe_critic(&mut clean);
    let scales = scene.walker.interface.scales(&scene.walker.interface.observation);
    let mut most = [0.0f32; 45];
    let mut sum = 0.0f64;
    for step in 1..=20 {
        environment.observe(step, &mut noisy);
        for (k, (noisy, clean)) in noisy.iter().zip(&clean).enumerate() {
            let error = (noisy - clean) / scales[k % 45];
            most[k % 45] = most[k % 45].max(error.abs());
            sum += if most[k % 45] > 0.0 { f64::from(error.signum()) } else { 0.0 };
        }
    }
    let half = |k: usize| match k {
        0..3 => 0.2,
        3..6 => 0.05,
        9..21 => 0.01,
        21..33 => 1.5,
        _ => 0.0,
    };
    for (k, &most) in most.iter().enumerate() {
        let half = half(k);
        assert!(most <= half * 1.0001 + 1e-6, "noise of {most} on number {k}, half range {half}");
        // 320 draws leave the outer 5 % empty once in ten million times.
        assert!(most >= 0.95 * half, "noise of at most {most} on number {k}, half range {half}");
    }
    // 9600 signs: five standard deviations.
    assert!(sum.abs() < 500.0, "noise has a sign: {sum}");
    let mut again = vec![0.0; 16 * 45];
    environment.observe(20, &mut again);
    assert!(again == noisy, "the same step has another noise");
    // The fifth joint's position is number 13 of the row, the first of its block.
    let word = Stream::new(5, Purpose::OBSERVATION_NOISE).step(20).environment(3).block(13)[0];
    let uniform = (word >> 8) as f32 / (1 << 24) as f32;
    let want = clean[3 * 45 + 13] + 0.01 * (2.0 * uniform - 1.0) * scales[13];
    assert!((noisy[3 * 45 + 13] - want).abs() < 1e-6);
    let part = Environment::new(&scene, None, 5, 8, 8).unwrap();
    let mut rows = vec![0.0; 8 * 45];
    part.observe(20, &mut rows);
    assert!(rows == noisy[8 * 45..], "noise depends on the tile");
}

#[test]
fn episodes_end_by_contact_tilt_height_and_time() {
    // Slack motors: the robot sinks onto its belly. Nothing else may end it.
    let mut sinking = calm();
    sinking.policy.kp = JointNumber::All(1e-3);
    sinking.episode_seconds = 1.0;
    (sinking.fall.tilt, sinking.fall.height) = (180.0, -1.0);
    let belly = sinking.fall.contacts.clone();
    let scene = scene(&sinking);
    let mut environment = Environment::new(&scene, None, 1, 0, 2).unwrap();
    let geoms = scene.walker.batch.contact_geoms();
    let name = |place: usize| scene.walker.batch.model().geoms[geoms[place]].name.as_str();
    let mut fell = None;
    for number in 1..=50 {
        let (_, ended) = step(&mut environment, number, 0.0);
        let forces = &environment.motion().normal_force[..geoms.len()];
        let touching = (0..geoms.len()).any(|k| forces[k] > 1.0 && belly.iter().any(|geom| geom == name(k)));
        assert_eq!(ended[0] == Ended::Fall, touching, "step {number}");
        if touching {
            fell = Some(number);
            break;
        }
    }
    assert!(fell.is_some(), "a robot without motors stands");
    let spared = TaskSettings {
        fall: gaitfit_policy::walker::FallSettings { contacts: vec![], ..sinking.fall },
        ..sinking
    };
    let lying = task_common::scene(&spared);
    let mut environment = Environment::new(&lying, None, 1, 0, 2).unwrap();
    for number in 1..=50 {
        let (_, ended) = step(&mut environment, number, 0.0);
        let wanted = if number == 50 { Ended::TimeOut } else { Ended::No };
        assert_eq!(ended, [wanted; 2], "step {number}");
    }

    for (pitch, height, wanted) in
        [(0.0, 0.12, Ended::No), (50.0, 0.0, Ended::Fall), (30.0, 0.0, Ended::No), (0.0, 0.4, Ended::Fall)]
    {
        let mut task = calm();
        task.start.pitch = pitch;
        task.fall.contacts.clear();
        (task.fall.tilt, task.fall.height) = (40.0, height);
        let scene = task_common::scene(&task);
        let mut environment = Environment::new(&scene, None, 1, 0, 1).unwrap();
        let (_, ended) = step(&mut environment, 1, 0.0);
        assert_eq!(ended, [wanted], "pitch {pitch}°, least height {height} m");
    }
}

#[test]
fn timed_out_episodes_begin_anew_and_a_broken_number_is_told() {
    let task = TaskSettings { episode_seconds: 0.1, ..TaskSettings::default() };
    let scene = scene(&task);
    assert_eq!(scene.episode_steps(), 5);
    let mut environment = Environment::new(&scene, None, 1, 0, 2).unwrap();
    let first = environment.motion().clone();
    for number in 1..=10 {
        let (_, ended) = step(&mut environment, number, 0.0);
        let wanted = if number % 5 == 0 { Ended::TimeOut } else { Ended::No };
        assert_eq!(ended, [wanted; 2], "step {number}");
        environment.begin_episodes(number, &ended);
    }
    assert_eq!(environment.motion().base_position[..2], [0.0, 0.0]);
    assert!(environment.motion().joint_position != first.joint_position, "two episodes start alike");

    let mut actions = [0.0; 24];
    actions[3] = f32::NAN;
    let (mut reward, mut ended) = ([f32::NAN; 2], [Ended::No; 2]);
    environment.step(11, &actions, &mut reward, &mut ended);
    assert_eq!(ended, [Ended::Diverged, Ended::No]);
    assert!(reward[1].is_finite(), "its neighbour is none the worse");
}

#[test]
fn rewards_are_weights_times_terms_times_the_period() {
    let mut task = calm();
    task.rewards.values_mut().for_each(|weight| *weight = 0.0);
    (task.rewards["action_rate"], task.rewards["height"]) = (-0.5, 2.0);
    let scene = scene(&task);
    assert_eq!(scene.reward_names(), ["height", "action_rate"]);
    let mut environment = Environment::new(&scene, None, 1, 0, 3).unwrap();
    let mut sums = vec![0.0; 2];
    // Actions 0.1, 0.4, 0.4: changes of 0.1, 0.3 and 0 in twelve joints.
    for (number, (action, rate)) in [(0.1, 0.12), (0.4, 1.08), (0.4, 0.0)].into_iter().enumerate() {
        let (paid, _) = step(&mut environment, number as u32 + 1, action);
        for (index, paid) in paid.iter().enumerate() {
            let low = (f64::from(environment.motion().base_position[3 * index + 2]) - task.height) / 0.1;
            let height = (-low * low).exp();
            close(&[*paid], &[0.02 * (2.0 * height - 0.5 * rate)]);
            sums[0] += 0.02 * 2.0 * height;
            sums[1] -= 0.02 * 0.5 * rate;
        }
    }
    for (found, wanted) in environment.take_terms().into_iter().zip(sums) {
        assert!((found - wanted).abs() < 1e-5, "{found}, not {wanted}");
    }
    assert_eq!(environment.take_terms(), [0.0, 0.0]);
}

#[test]
fn a_term_of_ones_own_is_paid_after_the_settings_terms() {
    let mut settings = calm();
    settings.rewards.values_mut().for_each(|weight| *weight = 0.0);
    settings.rewards["action_rate"] = -0.5;
    let lift = 0.25f32;
    let task = scene(&settings).with_term("lift", 3.0, move |moment| moment.height + lift).unwrap();
    assert_eq!(task.reward_names(), ["action_rate", "lift"]);
    let mut environment = Environment::new(&task, None, 1, 0, 2).unwrap();
    let (paid, _) = step(&mut environment, 1, 0.1);
    for (index, paid) in paid.iter().enumerate() {
        let height = f64::from(environment.motion().base_position[3 * index + 2]);
        close(&[*paid], &[0.02 * (3.0 * (height + 0.25) - 0.5 * 0.12)]);
    }
    assert_eq!(environment.take_terms().len(), 2);
    // The settings, and with them the policy's file, stay readable by everyone.
    assert!(!task.settings.rewards.contains_key("lift"));
    for (name, weight, what) in
        [("lift", 1.0, "already"), ("height", 1.0, "already"), ("new", f64::NAN, "NaN")]
    {
        let again = scene(&settings).with_term("lift", 1.0, |_| 0.0).unwrap();
        let error = again.with_term(name, weight, |_| 0.0).err().unwrap().to_string();
        assert!(error.starts_with("task.rewards") && error.contains(what), "{error}");
    }
}

/// By hand: the Go2's hip goes from −1.0472 to 1.0472 rad about its default of 0.1 (left), its motor gives 23.7 N·m.
#[test]
fn action_bounds_are_what_range_effort_and_clip_leave() {
    let task = calm();
    let scene = scene(&task);
    let interface = &scene.walker.interface;
    let bounds = scene.action_bounds();
    let model = scene.walker.model();
    for (index, name) in interface.joints.iter().enumerate() {
        let joint = model.find_joint(name).unwrap();
        let [low, high] = model.joints[joint].range.unwrap();
        let beyond = model.effort(joint).unwrap() / interface.kp[index];
        let action =
            |target: f64| ((target - interface.default_pose[index]) / interface.action_scale[index]) as f32;
        assert_eq!(bounds[index], [action(low - beyond), action(high + beyond)], "{name}");
        assert!(bounds[index][0] < 0.0 && bounds[index][1] > 0.0 && bounds[index][1] < 30.0, "{bounds:?}");
    }
    let clipped = scene_with(&task, |interface| interface.action_clip = Some(ActionClip::All(1.5)));
    assert!(clipped.action_bounds().iter().all(|bounds| *bounds == [-1.5, 1.5]));
    let negative =
        scene_with(&task, |interface| interface.action_scale.iter_mut().for_each(|scale| *scale = -*scale));
    let mirrored: Vec<[f32; 2]> = bounds.iter().map(|[low, high]| [-high, -low]).collect();
    assert_eq!(negative.action_bounds(), mirrored);
}

/// Robots that flail as wildly as the bounds allow fall, and do not diverge.
#[test]
fn random_actions_within_the_bounds_do_not_diverge() {
    let scene = scene(&TaskSettings::default());
    let bounds = scene.action_bounds();
    let count = 64;
    let mut environment = Environment::new(&scene, None, 3, 0, count).unwrap();
    let mut ended = vec![Ended::No; count];
    let (mut reward, mut falls) = (vec![0.0; count], 0);
    for step in 0..200_u32 {
        let draws = Stream::new(9, Purpose(99)).environment(step);
        let action = |at: usize| {
            let [low, high] = bounds[at % bounds.len()];
            low + (high - low) * draws.uniform(at as u32) as f32
        };
        let actions: Vec<f32> = (0..count * bounds.len()).map(action).collect();
        environment.step(step, &actions, &mut reward, &mut ended);
        assert!(!ended.contains(&Ended::Diverged), "step {step}");
        falls += ended.iter().filter(|&&ended| ended == Ended::Fall).count();
        environment.begin_episodes(step, &ended);
    }
    assert!(falls > count, "{falls} falls");
}
