//! Tasks: what robots see, how they start, when episodes end, what is drawn, and which settings are refused.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod task_common;

use gaitfit_learn::task::{Ended, Environment, NoiseSettings, Task, TaskSettings};
use gaitfit_model::rotation::{inverse, rotate};
use gaitfit_physics::{Preset, Robot};
use gaitfit_policy::{Quantity, Term};
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
        let term = |quantity, scale: &[f32]| Term { quantity, scale: scale.to_vec() };
        interface.observation = vec![
            term(Quantity::LastAction, &[]),
            term(Quantity::JointVelocity, &[0.05]),
            term(Quantity::Command, &[2.0, 3.0, 0.5]),
            term(Quantity::JointPosition, &[10.0]),
            term(Quantity::ProjectedGravity, &[]),
            term(Quantity::BaseAngularVelocity, &[0.25]),
            term(Quantity::GaitPhase, &[]),
            term(Quantity::BaseLinearVelocity, &[]),
        ];
        interface.critic_observation = vec![term(Quantity::BaseLinearVelocity, &[4.0])];
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
    let width = 3 * 12 + 3 + 3 + 3 + 2 + 3;
    assert_eq!(scene.walker.interface.observation_width(), width);
    let mut rows = vec![f32::NAN; count * width];
    environment.observe(4, &mut rows);
    let mut critic = vec![f32::NAN; count * 3];
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
        close(&critic[3 * index..3 * index + 3], &linear.map(|v| 4.0 * v));
    }
}

#[test]
fn noise_fills_its_ranges_and_spares_what_has_none() {
    let noise = NoiseSettings {
        base_angular_velocity: 0.2,
        projected_gravity: 0.05,
        joint_position: 0.01,
        joint_velocity: 1.5,
    };
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
    sinking.policy.kp = 1e-3;
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

#[test]
fn commands_are_drawn_anew_in_their_time_and_ranges() {
    let mut task = calm();
    task.command.seconds = 0.06;
    (task.command.x, task.command.y, task.command.yaw) = ([-0.2, 1.0], [0.3, 0.4], [-2.0, -1.0]);
    task.command.standing = 0.25;
    let scene = scene(&task);
    let count = 32;
    let mut environment = Environment::new(&scene, None, 9, 0, count).unwrap();
    let mut drawn = environment.commands().to_vec();
    for number in 1..=36 {
        let before = environment.commands().to_vec();
        step(&mut environment, number, 0.0);
        let changed = (0..count).filter(|&index| environment.commands()[index] != before[index]).count();
        if number % 3 == 0 {
            assert!(changed > count / 2, "{changed} of {count} commands are new after step {number}");
            drawn.extend(environment.commands());
        } else {
            assert_eq!(changed, 0, "after step {number}");
        }
    }
    let standing = drawn.iter().filter(|command| **command == [0.0; 3]).count();
    // 416 draws of share 1/4: 104, standard deviation 8.8.
    assert!((64..=144).contains(&standing), "{standing} of {} commands stand", drawn.len());
    for (k, [low, high]) in [[-0.2f32, 1.0], [0.3, 0.4], [-2.0, -1.0]].into_iter().enumerate() {
        let moving = drawn.iter().filter(|command| **command != [0.0; 3]).map(|command| command[k]);
        let (least, most) = moving.fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(x), b.max(x)));
        let margin = 0.05 * (high - low);
        assert!(low <= least && least < low + margin, "smallest of command {k} is {least}");
        assert!(high - margin < most && most <= high, "greatest of command {k} is {most}");
    }
    environment.hold_command(3, [0.5, 0.0, 0.0]);
    let held = environment.commands().to_vec();
    (37..=42).for_each(|number| drop(step(&mut environment, number, 0.0)));
    assert!(environment.commands() == held && held[3] == [0.5, 0.0, 0.0]);
}

#[test]
fn gains_vary_within_their_ranges() {
    let mut task = calm();
    // One physics step a period, after which the torque is still that of the start.
    (task.substeps, task.control_dt) = (1, 0.005);
    (task.randomisation.kp, task.randomisation.kd) = ([0.8, 1.1], [0.5, 2.0]);
    task.start.joint_velocity = 1.0;
    task.start.joint_position = 0.0;
    let scene = scene(&task);
    let count = 64;
    let mut environment = Environment::new(&scene, None, 2, 0, count).unwrap();
    let start = environment.motion().joint_velocity.clone();
    // The first half of the robots has actions, too small for the torque limits.
    let mut actions = vec![0.0; 12 * count];
    actions[..6 * count].fill(0.5);
    environment.step(1, &actions, &mut vec![0.0; count], &mut vec![Ended::No; count]);
    let (mut kd, mut kp) = (Vec::new(), Vec::new());
    for index in 0..count {
        let torque = |j: usize| environment.motion().torque[12 * index + j];
        let velocity = |j: usize| start[12 * index + j];
        if index >= count / 2 {
            // At the default pose: torque = −kd q̇.
            let shares: Vec<f32> = (0..12).map(|j| -torque(j) / velocity(j) / 0.5).collect();
            assert!(shares.iter().all(|share| (share - shares[0]).abs() < 0.01 * shares[0]), "{shares:?}");
            kd.push(shares[0]);
        } else {
            // Two joints with torque = kp · 0.125 rad − kd q̇ give both gains.
            let fast = (1..12).max_by(|&a, &b| {
                let far = |j: usize| (velocity(j) - velocity(0)).abs();
                far(a).total_cmp(&far(b))
            });
            let fast = fast.unwrap();
            let damping = -(torque(fast) - torque(0)) / (velocity(fast) - velocity(0));
            kp.push((torque(0) + damping * velocity(0)) / 0.125 / 25.0);
            kd.push(damping / 0.5);
        }
    }
    for (name, gains, low, high) in [("kp", kp, 0.8, 1.1), ("kd", kd, 0.5, 2.0)] {
        let least = gains.iter().copied().fold(f32::MAX, f32::min);
        let most = gains.iter().copied().fold(f32::MIN, f32::max);
        // 32 draws leave an outer fifth empty once in a thousand times; the seed is fixed.
        let fifth = 0.2 * (high - low);
        assert!(low - 0.01 <= least && least <= low + fifth, "smallest {name} scale {least}");
        assert!(high - fifth <= most && most <= high + 0.01, "greatest {name} scale {most}");
    }
}

#[test]
fn what_is_randomised_is_the_robots_own_number() {
    let model = go2();
    let plain = scene(&calm());
    let nominal = plain.walker.robot(&Candidate::nominal(&model));
    assert!(nominal.kp == [25.0; 12] && nominal.kd == [0.5; 12]);
    type Vary = fn(&mut TaskSettings);
    type Change = fn(&mut Robot);
    let same: [(&str, Vary, Change); 5] = [
        ("base_mass", |t| t.randomisation.base_mass = [2.0; 2], |r| r.base_mass = 2.0),
        ("kp", |t| t.randomisation.kp = [1.5; 2], |r| r.kp_scale.fill(1.5)),
        ("kd", |t| t.randomisation.kd = [2.0; 2], |r| r.kd_scale.fill(2.0)),
        (
            "frictionloss",
            |t| t.randomisation.frictionloss = [0.25; 2],
            |r| r.frictionloss.iter_mut().for_each(|loss| *loss += 0.25),
        ),
        (
            "armature",
            |t| t.randomisation.armature = [0.125; 2],
            |r| r.armature.iter_mut().for_each(|inertia| *inertia += 0.125),
        ),
    ];
    let play = |scene: &Task, candidate: Option<&Candidate>| {
        let mut environment = Environment::new(scene, candidate, 3, 0, 1).unwrap();
        (1..=6).for_each(|number| drop(step(&mut environment, number, 0.8)));
        environment.motion().clone()
    };
    let usual = play(&plain, None);
    let drawn = |change: Vary| {
        let mut task = calm();
        change(&mut task);
        play(&scene(&task), None)
    };
    for (name, change_task, change_robot) in same {
        let drawn = drawn(change_task);
        let mut candidate = Candidate::nominal(&model);
        change_robot(&mut candidate.robot);
        assert!(drawn == play(&plain, Some(&candidate)), "{name} is not the robot's");
        assert!(drawn != usual, "{name} has no effect");
    }
    let slippery = drawn(|t| t.randomisation.floor_friction = [0.05; 2]);
    assert!(slippery != usual, "floor_friction has no effect");
}

#[test]
fn robots_start_within_their_ranges() {
    for (name, up) in [("velocity", [0.0, 0.0, 1.0]), ("biped", [1.0, 0.0, 0.0])] {
        let mut task = built_in(name);
        (task.start.joint_velocity, task.start.linear_velocity, task.start.angular_velocity) =
            (0.3, 0.2, 0.1);
        let scene = scene(&task);
        let count = 32;
        let environment = Environment::new(&scene, None, 4, 0, count).unwrap();
        let motion = environment.motion();
        let spread = |what: &str, values: &mut dyn Iterator<Item = f32>, half: f32| {
            let most = values.fold(0.0f32, |most, value| most.max(value.abs()));
            assert!(most <= half * 1.0001 && most >= 0.8 * half, "{name}: {what} up to {most}, not {half}");
        };
        let from_pose = |(k, q): (usize, &f32)| q - scene.start_pose[k % 12];
        spread("joint positions", &mut motion.joint_position.iter().enumerate().map(from_pose), 0.1);
        spread("joint velocities", &mut motion.joint_velocity.iter().copied(), 0.3);
        spread("turn rates", &mut motion.base_angular.iter().copied(), 0.1);
        let linear = motion.base_linear.chunks_exact(3);
        spread("velocities", &mut linear.flat_map(|v| [v[0], v[1]]), 0.2);
        assert!(motion.base_linear.iter().skip(2).step_by(3).all(|&v| v == 0.0));
        // Roll and pitch of at most 5° each, about the task's posture; headings all around.
        let mut quadrants = [0; 4];
        for quaternion in motion.base_quaternion.chunks_exact(4) {
            let found = to_body(quaternion, [0.0, 0.0, 1.0]);
            let cos: f64 = (0..3).map(|k| found[k] * up[k]).sum();
            assert!(cos > (7.1f64).to_radians().cos(), "{name}: tilted by {}°", cos.acos().to_degrees());
            let q: [f64; 4] = std::array::from_fn(|k| f64::from(quaternion[k]));
            let left = rotate(q, [0.0, 1.0, 0.0]);
            quadrants[usize::from(left[0] > 0.0) + 2 * usize::from(left[1] > 0.0)] += 1;
        }
        assert!(quadrants.iter().all(|&robots| robots > 0), "{name}: headings by quadrant {quadrants:?}");
        let (least, most) = motion
            .base_position
            .iter()
            .skip(2)
            .step_by(3)
            .fold((9.0, 0.0), |(a, b), &z| (f32::min(a, z), f32::max(b, z)));
        assert!(0.2 < least && most < 0.7, "{name}: heights from {least} to {most} m");
    }
}

#[test]
fn pushes_come_in_their_time_and_size() {
    let mut task = calm();
    (task.push.seconds, task.push.velocity) = (0.1, 0.5);
    let (pushed, still) = (scene(&task), scene(&calm()));
    let count = 8;
    let mut with = Environment::new(&pushed, None, 6, 0, count).unwrap();
    let mut without = Environment::new(&still, None, 6, 0, count).unwrap();
    let mut first = vec![None; count];
    for number in 1..=7 {
        step(&mut with, number, 0.0);
        step(&mut without, number, 0.0);
        for index in 0..count {
            let row = 3 * index..3 * index + 3;
            let (a, b) = (&with.motion().base_linear[row.clone()], &without.motion().base_linear[row]);
            if a != b && first[index].is_none() {
                first[index] = Some(number);
                // What the push gave, less what the feet took in one period.
                assert!(
                    (0..2).all(|k| (a[k] - b[k]).abs() <= 0.55),
                    "robot {index} jumps from {b:?} to {a:?}"
                );
            }
        }
    }
    let times: Vec<u32> = first.into_iter().map(Option::unwrap).collect();
    // Every five steps, not in the first one of an episode, and not all robots at once.
    assert!(times.iter().all(|time| (2..=6).contains(time)), "{times:?}");
    assert!(times.iter().any(|time| *time != times[0]), "{times:?}");
}

#[test]
fn bad_settings_are_refused_by_name() {
    let model = go2();
    type Change = fn(&mut TaskSettings);
    let wrong: [(Change, &str, &str); 22] = [
        (
            |t| t.rewards.extend([("walk".to_owned(), 1.0)]),
            "task.rewards",
            "`walk`; known terms: track_linear",
        ),
        (|t| t.rewards["gait"] = f64::NAN, "task.rewards", "gives `gait` the weight NaN"),
        (|t| t.feet = vec!["paw".to_owned()], "a tracked geom", "paw"),
        (|t| t.feet.clear(), "task.feet", "has 0 names"),
        (|t| t.gait[0][1] = "FR_paw".to_owned(), "task.gait", "`FR_paw`, which is not in task.feet"),
        (
            |t| t.fall.contacts = vec!["tail".to_owned()],
            "task.fall.contacts",
            "`tail`, which matches no geom of go2",
        ),
        (|t| t.fall.contacts = vec!["[".to_owned()], "task.fall.contacts", "`[`, which is no pattern"),
        (|t| t.fall.tilt = 0.0, "task.fall.tilt", "is 0"),
        (|t| t.control_dt = f64::NAN, "task.control_dt", "is NaN"),
        (|t| t.substeps = 0, "substeps", "is 0"),
        (|t| t.episode_seconds = -1.0, "task.episode_seconds", "is -1"),
        (|t| t.command.x = [1.0, -1.0], "task.command.x", "is [1, -1]"),
        (|t| t.command.standing = 1.5, "task.command.standing", "is 1.5"),
        (|t| t.randomisation.kp = [-0.1, 1.0], "task.randomisation.kp", "is [-0.1, 1]"),
        (|t| t.noise.joint_velocity = f64::INFINITY, "task.noise.joint_velocity", "is inf"),
        (|t| t.start.tilt = -1.0, "task.start.tilt", "is -1"),
        (|t| t.push.velocity = f64::NAN, "task.push.velocity", "is NaN"),
        (|t| t.posture = [0.0, 0.0, -2.0], "task.posture", "length 1"),
        (
            |t| t.policy.default_pose.extend([("*_tail".to_owned(), 0.0)]),
            "task.policy.default_pose",
            "`*_tail`",
        ),
        (|t| t.start.pose.extend([("knee".to_owned(), 0.0)]), "task.start.pose", "`knee`"),
        (
            |t| t.policy.observation[0].scale = vec![1.0; 2],
            "task.policy.observation",
            "2 numbers; give one or 3",
        ),
        (
            |t| t.policy.observation.push(Term { quantity: Quantity::GaitPhase, scale: vec![] }),
            "task.policy.gait_frequency",
            "is missing",
        ),
    ];
    for (change, setting, what) in wrong {
        let mut task = TaskSettings::default();
        change(&mut task);
        let error = Task::new(&model, &task, Preset::Fast).err().unwrap().to_string();
        assert!(error.starts_with(setting) && error.contains(what), "`{setting}` and `{what}`: {error}");
    }
    let clamped = gaitfit_model::ReadOptions { root: Some(gaitfit_model::Root::Fixed), ..Default::default() };
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    let model = gaitfit_model::read(path.as_ref(), &clamped).unwrap();
    let error = Task::new(&model, &TaskSettings::default(), Preset::Fast).err().unwrap().to_string();
    assert!(error.contains("go2 is clamped"), "{error}");
}
