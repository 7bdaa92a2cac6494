//! A rollout's kernels, run on the CPU as C++, against the CPU's environment step by step; and NVIDIA's compiler.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

mod along;
mod logs;
mod policies;
mod stepwise;
mod trials;

use along::*;
use std::path::Path;

use gaitfit_cuda::ppo::Id;
use gaitfit_cuda::rollout::{Mode, Plan, RolloutError, Scene, Sizes};
use gaitfit_cuda::runtime::{Nvrtc, compile};
use gaitfit_learn::task::{CurriculumSettings, JointNumber, Task, TaskSettings, TerrainSettings};
use gaitfit_model::{
    ContactPair, FreeJoint, Ground, HeightField, Obstacle, ObstacleShape, SelfContact, Shape,
};
use gaitfit_physics::{NETWORK_WEIGHTS, NetworkScales, Preset};
use gaitfit_policy::{FrameOrder, History, HistoryStart, Quantity, Term};
use gaitfit_sim::{Candidate, JointNetworks, NetworkKind, Sensors};

#[test]
#[ignore = "needs g++"]
fn long_cxx_steps_of_a_trot_are_the_cpus() {
    let task = Task::new(&go2(), &lively("velocity"), Preset::Fast).unwrap();
    compare("velocity", &task, &Candidate::nominal(&go2()));
}

#[test]
#[ignore = "needs g++"]
fn cxx_steps_on_hind_legs_are_the_cpus() {
    // In fifteen steps a robot that stands does not come far.
    let mut settings = lively("biped");
    settings.fall.tilt = 12.0;
    let task = Task::new(&go2(), &settings, Preset::Fast).unwrap();
    compare("biped", &task, &Candidate::nominal(&go2()));
}

/// A robot that was fitted: delays, biased encoders, a tilted unit whose gyro is biased, slow sensors of velocity,
/// another physics step, joints in another order, clipped actions. Its policy observes a clock and a constant.
fn fitted() -> (Task, Candidate) {
    let model = go2();
    let mut settings = lively("velocity");
    settings.robot_timestep = Some(0.001);
    settings.policy.observation.push(Term::new(Quantity::BaseHeight).scaled(&[3.0]));
    settings.noise.set(Quantity::BaseHeight, 0.02);
    settings.policy.gait_frequency = Some(2.3);
    for (quantity, scale) in [(Quantity::GaitSine, -2.0), (Quantity::Constant, 0.7)] {
        settings.policy.observation.push(Term::new(quantity).scaled(&[scale]));
    }
    let mut interface = Task::new(&model, &settings, Preset::Fast).unwrap().walker.interface;
    interface.joints.reverse();
    interface.default_pose.reverse();
    interface.action_clip = Some(gaitfit_policy::ActionClip::All(0.8));
    for (k, scale) in interface.action_scale.iter_mut().enumerate() {
        *scale += 0.01 * k as f64;
    }
    let task = Task::with_interface(&model, &settings, interface, Preset::Fast, 0.03).unwrap();
    let mut candidate = Candidate::nominal(&model);
    for j in 0..12 {
        candidate.torque_noise = 0.4;
        candidate.robot.delay[j] = 0.002 * j as f64;
        candidate.robot.encoder_bias[j] = 0.01 * j as f64 - 0.05;
    }
    candidate.robot.velocity_lag = 0.004;
    candidate.robot.imu_delay = 0.027;
    candidate.sensors = Sensors { imu_tilt: [0.06, -0.04], gyro_bias: [0.1, -0.15, 0.05] };
    (task, candidate)
}

#[test]
#[ignore = "needs g++"]
fn cxx_steps_of_a_fitted_robot_are_the_cpus() {
    let (task, candidate) = fitted();
    compare("fitted", &task, &candidate);
}

fn networks(kind: NetworkKind, joints: &[usize], amount: f64) -> JointNetworks {
    let weights = (0..joints.len() * NETWORK_WEIGHTS).map(|k| amount * (0.7 * k as f64).sin()).collect();
    let scales = NetworkScales { position: 1.0, velocity: 0.05, output: 0.5 };
    JointNetworks { kind, joints: joints.to_vec(), rest: vec![0.1; joints.len()], weights, scales }
}

/// Networks that correct all targets, and one that adds torques to the joint of one leg.
fn with_networks() -> Candidate {
    let all: Vec<usize> = (0..12).collect();
    let mut candidate = Candidate::nominal(&go2());
    candidate.networks =
        vec![networks(NetworkKind::ActionDelta, &all, 0.3), networks(NetworkKind::ResidAct, &[11], 0.9)];
    candidate.robot.encoder_bias = (0..12).map(|j| 0.01 * f64::from(j) - 0.05).collect();
    candidate
}

#[test]
#[ignore = "needs g++"]
fn cxx_steps_with_networks_are_the_cpus() {
    // Networks hold some robots upright: what leans a little counts as fallen.
    let mut settings = lively("velocity");
    settings.fall.tilt = 12.0;
    let task = Task::new(&go2(), &settings, Preset::Fast).unwrap();
    compare("networks", &task, &with_networks());
}

/// Feet of other shapes than balls, joints that the policy does not move, numbers joint by joint.
#[test]
#[ignore = "needs g++"]
fn long_cxx_steps_of_held_joints_and_other_feet_are_the_cpus() {
    let mut model = go2();
    let shapes = [
        Shape::Box { half_size: [0.03, 0.02, 0.02] },
        Shape::Capsule { radius: 0.02, half_length: 0.03 },
        Shape::Cylinder { radius: 0.03, half_length: 0.02 },
        Shape::Sphere { radius: 0.022 },
    ];
    let feet = model.geoms.iter_mut().filter(|geom| geom.name.ends_with("_foot"));
    feet.zip(shapes).for_each(|(geom, shape)| geom.shape = shape);
    let mut settings = lively("velocity");
    let table = |entries: &[(&str, f64)]| {
        JointNumber::Table(entries.iter().map(|(pattern, value)| ((*pattern).to_owned(), *value)).collect())
    };
    settings.policy.joints = vec!["*_thigh".to_owned(), "*_calf".to_owned()];
    settings.policy.kp = table(&[("*", 25.0), ("*_calf", 30.0), ("*_hip", 40.0)]);
    settings.policy.kd = table(&[("*", 0.5), ("*_hip", 1.0)]);
    settings.policy.action_scale = table(&[("*", 0.25), ("F*_calf", 0.3)]);
    settings.policy.action_clip = Some(table(&[("*", 0.8), ("RR_*", 1.5)]));
    // A foot of several geoms.
    settings.feet[0] = "FL_calf".to_owned();
    settings.gait[0][0] = "FL_calf".to_owned();
    // Clipped actions do not throw a robot over: what leans a little counts as fallen.
    settings.fall.tilt = 12.0;
    let task = Task::new(&model, &settings, Preset::Fast).unwrap();
    compare("held", &task, &Candidate::nominal(&model));
}

/// Wheels: joints without limits under velocity targets, whose angles are neither seen nor paid for.
#[test]
#[ignore = "needs g++"]
fn cxx_steps_on_wheels_are_the_cpus() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../gaitfit-physics/tests/fixtures/rover.xml");
    let model =
        gaitfit_model::read(std::path::Path::new(path), &gaitfit_model::ReadOptions::default()).unwrap();
    let mut settings = lively("velocity");
    let table = |entries: &[(&str, f64)]| {
        JointNumber::Table(entries.iter().map(|(pattern, value)| ((*pattern).to_owned(), *value)).collect())
    };
    let wheels = ["FL_wheel", "FR_wheel", "RL_wheel", "RR_wheel"].map(str::to_owned);
    settings.policy.velocity_joints = vec!["*_wheel".to_owned()];
    settings.policy.kp = table(&[("*", 60.0), ("*_wheel", 0.0)]);
    settings.policy.kd = table(&[("*", 1.5), ("*_wheel", 0.6)]);
    settings.policy.action_scale = table(&[("*", 0.25), ("*_wheel", 10.0)]);
    settings.policy.default_pose =
        [("*_hip", 0.4), ("*_knee", -0.8)].map(|(name, at)| (name.to_owned(), at)).into();
    settings.feet = wheels.to_vec();
    settings.gait =
        vec![vec![wheels[0].clone(), wheels[3].clone()], vec![wheels[1].clone(), wheels[2].clone()]];
    settings.fall.contacts = vec!["trunk".to_owned()];
    settings.fall.tilt = 6.0;
    settings.height = 0.43;
    let task = Task::new(&model, &settings, Preset::Fast).unwrap();
    compare("wheels", &task, &Candidate::nominal(&model));
}

/// Slides as knees, whose starts and targets are in m; a mast of slides and hinges is held.
#[test]
#[ignore = "needs g++"]
fn cxx_steps_of_telescopic_legs_are_the_cpus() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../gaitfit-physics/tests/fixtures/telescope.xml");
    let model =
        gaitfit_model::read(std::path::Path::new(path), &gaitfit_model::ReadOptions::default()).unwrap();
    let mut settings = lively("velocity");
    let table = |entries: &[(&str, f64)]| {
        JointNumber::Table(entries.iter().map(|(pattern, value)| ((*pattern).to_owned(), *value)).collect())
    };
    settings.policy.joints = vec!["*_hip".to_owned(), "*_slide".to_owned()];
    settings.policy.kp =
        table(&[("*", 1.0), ("*_hip", 60.0), ("*_slide", 3000.0), ("lift", 800.0), ("boom", 200.0)]);
    settings.policy.kd =
        table(&[("*", 0.03), ("*_hip", 1.5), ("*_slide", 80.0), ("lift", 30.0), ("boom", 9.0)]);
    settings.policy.action_scale = table(&[("*", 0.25), ("*_slide", 0.03)]);
    settings.policy.default_pose =
        [("*_hip", 0.1), ("*_slide", 0.02), ("lift", 0.05)].map(|(name, at)| (name.to_owned(), at)).into();
    settings.start.joint_position = 0.02;
    let feet = ["FL_foot", "FR_foot", "RL_foot", "RR_foot"].map(str::to_owned);
    settings.feet = feet.to_vec();
    settings.gait = vec![vec![feet[0].clone(), feet[3].clone()], vec![feet[1].clone(), feet[2].clone()]];
    settings.fall.contacts = vec!["trunk".to_owned()];
    settings.fall.tilt = 6.0;
    settings.height = 0.37;
    let task = Task::new(&model, &settings, Preset::Fast).unwrap();
    compare("telescope", &task, &Candidate::nominal(&model));
}

/// Reward terms that are expressions, with every quantity and operator.
#[test]
#[ignore = "needs g++"]
fn cxx_steps_with_written_rewards_are_the_cpus() {
    let model = go2();
    let mut settings = lively("velocity");
    settings.policy.joints = vec!["*_thigh".to_owned(), "*_calf".to_owned()];
    settings.policy.action_clip = Some(JointNumber::All(0.8));
    settings.policy.gait_frequency = Some(2.0);
    settings.fall.tilt = 12.0;
    settings.rewards.clear();
    for (name, text, weight) in [
        (
            "track",
            r#"exp(-sum((velocity["x", "y"] - command["x", "y"])^2) / 0.25) - abs(velocity["z"])"#,
            1.0,
        ),
        (
            "base",
            "norm(angular_velocity) - yaw_rate / 3 + gravity['z'] * uprightness + ln(1 + square(height))",
            0.5,
        ),
        ("calves", r#"mean(abs(tau["*_calf"])) - min(tau["FL_*", "RR_hip"]) / (1 + max(tau))"#, 0.1),
        (
            "joints",
            "sum(tanh(qacc / 100)) + max(qvel - mean(qvel)) * sin(sum(qpos)) * cos(default_pose['FL_calf'])",
            0.1,
        ),
        ("targets", "sum(square(target - qpos)) + sum(target['FL_hip', 'FR_calf']) + 0.2^2.5", 0.1),
        // A row of nine, not in a row: it is a loop.
        ("most", "norm(tau['*_thigh', '*_calf', 'FL_hip']) + min(qvel['*_thigh', '*_calf', 'FL_hip'])", 0.01),
        ("smooth", "-sqrt(sum(square(action - last_action)))", 0.1),
        (
            "feet",
            "sum(contact * foot_speed + landed * last_air_time + select(air_time > 0.04 and not contact, foot_height, 0))",
            0.3,
        ),
        (
            "stance",
            "sum(contact_time >= 0.06 or contact == 0) + (contact['FL_foot'] != contact['RR_foot'])",
            0.01,
        ),
        (
            "rest",
            "walking * clock - 2 * fallen / dt + clamp(body_contacts, 0, 2) + (height <= 0.3) + (height < 0.2)",
            0.02,
        ),
    ] {
        settings.terms.insert(name.to_owned(), text.to_owned());
        settings.rewards.insert(name.to_owned(), weight);
    }
    settings.rewards.insert("torque".to_owned(), -2e-4);
    let (x, yaw) = (Some([0.0, 0.1]), Some([-0.2, 0.3]));
    settings.command.curriculum =
        Some(CurriculumSettings { x, y: None, yaw, tracking: None, step: 0.1, iterations: Some(5) });
    let task = Task::new(&model, &settings, Preset::Fast).unwrap();
    compare("written", &task, &Candidate::nominal(&model));
}

/// Levels of all kinds. Cells are so small that robots leave them and the ground.
fn on_levels(curriculum: bool) -> TaskSettings {
    let mut settings = lively("velocity");
    settings.fall.tilt = 12.0;
    settings.start.linear_velocity = 6.0;
    settings.terrain = Some(TerrainSettings {
        levels: 3,
        columns: 4,
        size: 1.5,
        platform: 1.0,
        border: 1.0,
        curriculum,
        start_level: 1,
        ..TerrainSettings::default()
    });
    settings
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_steps_on_uneven_ground_are_the_cpus() {
    for (label, curriculum) in [("levels", true), ("drawn levels", false)] {
        let task = Task::new(&go2(), &on_levels(curriculum), Preset::Fast).unwrap();
        compare(label, &task, &Candidate::nominal(&go2()));
    }
}

/// Past frames in actor and critic, in two orders, with either beginning.
#[test]
#[ignore = "needs g++"]
fn cxx_steps_with_past_frames_are_the_cpus() {
    for (order, start, frames) in [
        (FrameOrder::Terms, HistoryStart::First, [3, 2]),
        (FrameOrder::NewestFirst, HistoryStart::Zeros, [2, 3]),
    ] {
        let mut settings = lively("velocity");
        settings.fall.tilt = 12.0;
        settings.policy.history = History { order, start };
        settings.policy.observation.iter_mut().for_each(|term| term.history = frames[0]);
        settings.policy.critic_observation.iter_mut().for_each(|term| term.history = frames[1]);
        if order == FrameOrder::Terms {
            settings.policy.observation[0].history = 1;
        }
        let task = Task::new(&go2(), &settings, Preset::Fast).unwrap();
        compare(&format!("{order:?}"), &task, &Candidate::nominal(&go2()));
    }
}

/// Ground of the robot's file: a plane, boxes, one of them leaning, and a turned height field.
#[test]
#[ignore = "needs g++"]
fn cxx_steps_on_the_files_ground_are_the_cpus() {
    let mut model = go2();
    let pairs = model.pairs.clone();
    let leaning = [0.5f64.cos(), 0.0, 0.5f64.sin(), 0.0];
    let turned = [0.3f64.cos(), 0.0, 0.0, 0.3f64.sin()];
    let heights = (0..12).map(|k| 0.02 * f64::from(k % 5)).collect();
    let field = HeightField { rows: 3, columns: 4, half_size: [0.4, 0.5], heights };
    for (pos, quat, shape) in [
        ([0.2, 0.1, -0.02], [1.0, 0.0, 0.0, 0.0], ObstacleShape::Box { half_size: [0.1, 0.2, 0.05] }),
        ([-0.3, 0.0, -0.05], leaning, ObstacleShape::Box { half_size: [0.1, 0.3, 0.1] }),
        ([0.1, -0.2, -0.01], turned, ObstacleShape::Field(field)),
    ] {
        let ground = Ground::Obstacle { obstacle: model.obstacles.len() };
        model.obstacles.push(Obstacle { name: "step".to_owned(), pos, quat, shape });
        let round = |geom: usize| matches!(model.geoms[geom].shape, Shape::Sphere { .. });
        let feet = pairs.iter().filter(|pair| round(pair.geom)).cloned();
        model.pairs.extend(feet.map(|pair| ContactPair { ground, ..pair }));
    }
    let mut settings = lively("velocity");
    settings.fall.tilt = 12.0;
    let task = Task::new(&model, &settings, Preset::Fast).unwrap();
    compare("the file's ground", &task, &Candidate::nominal(&model));
}

/// Legs that swing wildly hit each other and the trunk.
#[test]
#[ignore = "needs g++"]
fn cxx_steps_of_a_robot_that_touches_itself_are_the_cpus() {
    let mut settings = lively("velocity");
    settings.fall.tilt = 12.0;
    settings.start.linear_velocity = 6.0;
    settings.self_contact = SelfContact::File;
    let task = Task::new(&go2(), &settings, Preset::Fast).unwrap();
    assert!(task.walker.touches_itself());
    compare("self-contact", &task, &Candidate::nominal(&go2()));
}

/// A base that is dragged: armature, damping and friction loss of its free joint.
#[test]
#[ignore = "needs g++"]
fn long_cxx_steps_of_a_dragged_base_are_the_cpus() {
    let mut model = go2();
    let (solref_friction, solimp_friction) = ([0.02, 1.0], [0.9, 0.95, 0.001, 0.5, 2.0]);
    let free = FreeJoint { armature: 0.2, damping: 3.0, frictionloss: 4.0, solref_friction, solimp_friction };
    model.free_joint = Some(free);
    let mut settings = lively("velocity");
    settings.fall.tilt = 12.0;
    let task = Task::new(&model, &settings, Preset::Fast).unwrap();
    compare("dragged", &task, &Candidate::nominal(&model));
}

#[test]
fn what_a_gpu_does_not_do_is_refused() {
    let model = go2();
    let settings = lively("velocity");
    let task = Task::new(&model, &settings, Preset::Fast).unwrap();
    let one = networks(NetworkKind::ResidAct, &[0], 0.1);
    let short = JointNetworks { weights: Vec::new(), ..one.clone() };
    let with = |networks: Vec<JointNetworks>| Candidate { networks, ..Candidate::nominal(&model) };
    for (candidates, what) in [
        (vec![with(vec![one]), with(Vec::new())], "robots whose networks differ"),
        (vec![with(vec![short])], "97 weights"),
    ] {
        let error = Scene::period(&task, &candidates, 8, PROCESSORS).map(|_| ()).unwrap_err();
        assert!(error.to_string().contains(what), "{error}");
    }
    let period = Scene::period(&task, &[Candidate::nominal(&model)], 8, PROCESSORS).unwrap();
    let task = task.with_term("own", 1.0, |_| 0.0).unwrap();
    let error = Scene::new(&task, &period, sizes()).map(|_| ()).unwrap_err();
    assert!(matches!(&error, RolloutError::Unsupported(what) if what.contains("`own`")), "{error}");
}

#[test]
#[ignore = "needs NVRTC: tools/setup_nvrtc.sh"]
fn nvrtc_compiles_rollouts() {
    let model = go2();
    let nominal = Candidate::nominal(&model);
    let mut slow = nominal.clone();
    slow.robot.velocity_lag = 0.004;
    slow.robot.imu_delay = 0.01;
    for (label, name, candidate) in [
        ("slow sensors", "velocity", slow),
        ("velocity", "velocity", nominal.clone()),
        ("biped", "biped", nominal),
        ("networks", "velocity", with_networks()),
    ] {
        let mut settings = lively(name);
        settings.terms.insert("calves".to_owned(), r#"sum(abs(tau["*_calf"]))"#.to_owned());
        settings.rewards.insert("calves".to_owned(), -1e-3);
        let task = Task::new(&model, &settings, Preset::Fast).unwrap();
        let sizes = Sizes {
            steps: 24,
            environments: 4096,
            networks: 100_000,
            gamma: 0.99,
            remembered: 0,
            mode: Mode::Training,
        };
        let period = Scene::period(&task, &[candidate], 4096, PROCESSORS).unwrap();
        assert_eq!(period.lanes(), 4);
        let plan = Plan::new(&Scene::new(&task, &period, sizes).unwrap());
        assert_eq!(plan.array("tail").map(|Id(number)| plan.arrays[number].length > 0), Some(true));
        if let Some(folder) = std::env::var_os("GAITFIT_KEEP_TEXT") {
            std::fs::write(Path::new(&folder).join(format!("rollout_{label}.cu")), &plan.program.text)
                .unwrap();
        }
        let sizes = Sizes { steps: 1, networks: 0, mode: Mode::Steps, ..sizes };
        let steps = Plan::new(&Scene::new(&task, &period, sizes).unwrap());
        for program in [plan.program, steps.program, period.program()] {
            let program = program.option("--ptxas-options=-v");
            let start = std::time::Instant::now();
            let compiled = compile(Nvrtc::get().unwrap(), &program, (9, 0), None).unwrap();
            println!("{label} {:.1} s\n{}", start.elapsed().as_secs_f64(), compiled.image.log);
        }
    }
}
