//! Files for those who run a policy without gaitfit: YAML read back, C++ compiled.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod common;

use common::{ACTIVATIONS, fixture, go2, interface, numbers, policy, root};
use gaitfit_policy::network::{Activation, Network, Normaliser, Shape};
use gaitfit_policy::observation::Sensed;
use gaitfit_policy::{
    ActionClip, Encoder, FrameOrder, Front, Held, History, HistoryStart, Interface, Latent, Pilot, Policy,
    Quantity, Term, deploy, onnx, read,
};
use serde::Deserialize;
use serde_json::Value;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

/// A file of a deployment as text.
fn text(made: &deploy::Deployment, name: &str) -> String {
    let found = made.files.iter().find(|(path, _)| path == name);
    String::from_utf8(found.unwrap_or_else(|| panic!("no {name}")).1.clone()).unwrap()
}

/// A policy that sees `observation`, its network random.
fn seeing(interface: Interface, hidden: &[usize]) -> Policy {
    let (inputs, outputs) = (interface.observation_width(), interface.joints.len());
    let shape = Shape { inputs, hidden: hidden.to_vec(), outputs, activation: Activation::Elu };
    Policy {
        interface: Interface { critic_observation: Vec::new(), ..interface },
        actor: Network::random(shape, 3, 0, 1.0).unwrap(),
        log_std: vec![0.0; outputs],
        critic: None,
        critic_normaliser: None,
        normaliser: Some(Normaliser {
            mean: numbers(inputs, 7).into_iter().map(f64::from).collect(),
            variance: numbers(inputs, 8).into_iter().map(|x| 0.1 + f64::from(x) * f64::from(x)).collect(),
            count: 10.0,
        }),
        ..policy(Activation::Elu)
    }
}

/// Eight joints of the Go2 moved and one held, every quantity that a robot measures, three frames of each.
fn rich(order: FrameOrder, start: HistoryStart) -> Policy {
    let plain = interface();
    let (moved, rest) = plain.joints.split_at(8);
    let quantities = [
        Quantity::GaitPhase,
        Quantity::JointVelocity,
        Quantity::Command,
        Quantity::LastAction,
        Quantity::JointPosition,
        Quantity::ProjectedGravity,
        Quantity::BaseAngularVelocity,
    ];
    let scaled = |quantity| match quantity {
        Quantity::Command => Term::new(quantity).scaled(&[2.0, 1.5, 0.3]),
        Quantity::JointVelocity => Term::new(quantity).scaled(&[0.05]),
        _ => Term::new(quantity),
    };
    let many = |(index, quantity): (usize, &Quantity)| {
        let frames = if order == FrameOrder::Terms { 1 + index % 4 } else { 3 };
        scaled(*quantity).with_history(frames)
    };
    let interface = Interface {
        joints: moved.to_vec(),
        default_pose: plain.default_pose[..8].to_vec(),
        action_scale: (0..8).map(|joint| 0.2 + 0.01 * f64::from(joint)).collect(),
        action_clip: Some(ActionClip::Each((0..8).map(|joint| 0.1 + 0.05 * f64::from(joint)).collect())),
        kp: (0..8).map(|joint| 20.0 + f64::from(joint)).collect(),
        kd: vec![0.5; 8],
        held: vec![Held { joint: rest[0].clone(), position: -0.3, kp: 60.0, kd: 3.0 }],
        control_dt: 0.015,
        gait_frequency: Some(2.3),
        history: History { order, start },
        observation: quantities.iter().enumerate().map(many).collect(),
        ..plain
    };
    seeing(interface, &[20, 12])
}

/// `controller.yaml` as another program reads it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Controller {
    robot: String,
    network: Value,
    control_rate: f64,
    joints: Vec<String>,
    command_interfaces: Vec<String>,
    state_interfaces: Vec<String>,
    default_position: Vec<f64>,
    action_scale: Vec<f64>,
    action_clip: Option<Vec<f64>>,
    kp: Vec<f64>,
    kd: Vec<f64>,
    effort_limit: Option<Vec<f64>>,
    held: Option<HeldLists>,
    observation: Observation,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HeldLists {
    joints: Vec<String>,
    position: Vec<f64>,
    kp: Vec<f64>,
    kd: Vec<f64>,
    effort_limit: Option<Vec<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Observation {
    width: usize,
    terms: Vec<Quantity>,
    widths: Vec<usize>,
    present: Vec<usize>,
    history: Vec<usize>,
    scale: Vec<f32>,
    history_order: FrameOrder,
    history_start: HistoryStart,
    gait_frequency: Option<f64>,
}

fn controller(text: &str) -> Controller {
    let mut value: Value = serde_saphyr::from_str(text).unwrap();
    serde_json::from_value(value["policy_controller"]["ros__parameters"].take()).unwrap()
}

#[test]
fn controller_yaml_holds_the_whole_interface() {
    let mut odd = rich(FrameOrder::Terms, HistoryStart::First);
    odd.interface.robot = "a: \"b\" #c \\ é\u{2028}".to_owned();
    odd.interface.joints[0] = "{{ joint }}: 'x', [y]".to_owned();
    let all = [
        policy(Activation::Elu),
        rich(FrameOrder::Frames, HistoryStart::Zeros),
        rich(FrameOrder::NewestFirst, HistoryStart::First),
        odd,
        read(&root().join("assets/go2-walk.safetensors")).unwrap(),
    ];
    for policy in all {
        let wanted = &policy.interface;
        let found = controller(&text(&deploy::bundle(&policy, None).unwrap(), "controller.yaml"));
        let Controller { observation, held, .. } = found;
        let mut scale = observation.scale.iter().copied();
        let term = |index: usize| {
            let (quantity, width) = (observation.terms[index], observation.widths[index]);
            assert_eq!(width, quantity.width(wanted.joints.len()));
            Term {
                quantity,
                scale: (0..width).map(|_| scale.next().unwrap()).collect(),
                history: observation.history[index],
            }
        };
        let observed: Vec<Term> = (0..observation.terms.len()).map(term).collect();
        assert_eq!(scale.next(), None);
        let held = held.map_or_else(Vec::new, |held| {
            assert!(held.effort_limit.is_none());
            let one = |index: usize| Held {
                joint: held.joints[index].clone(),
                position: held.position[index],
                kp: held.kp[index],
                kd: held.kd[index],
            };
            (0..held.joints.len()).map(one).collect()
        });
        let spread = |interface: &Interface| Interface {
            observation: interface
                .observation
                .iter()
                .map(|term| match term.scale[..] {
                    [] => term.clone().scaled(&vec![1.0; term.quantity.width(interface.joints.len())]),
                    [one] => term.clone().scaled(&vec![one; term.quantity.width(interface.joints.len())]),
                    _ => term.clone(),
                })
                .collect(),
            action_clip: interface.action_clip.as_ref().map(|clip| {
                ActionClip::Each((0..interface.joints.len()).map(|joint| clip.of(joint)).collect())
            }),
            critic_observation: Vec::new(),
            ..interface.clone()
        };
        assert!((found.control_rate * wanted.control_dt - 1.0).abs() < 1e-12);
        let again = Interface {
            robot: found.robot,
            joints: found.joints,
            default_pose: found.default_position,
            action_scale: found.action_scale,
            action_clip: found.action_clip.map(ActionClip::Each),
            kp: found.kp,
            kd: found.kd,
            held,
            control_dt: wanted.control_dt,
            gait_frequency: observation.gait_frequency,
            history: History { order: observation.history_order, start: observation.history_start },
            observation: observed,
            critic_observation: Vec::new(),
        };
        assert_eq!(again, spread(wanted));
        assert_eq!(observation.width, wanted.observation_width());
        let slots = gaitfit_policy::observation::Layout::new(wanted, &wanted.observation);
        let present: Vec<usize> = slots.slots().iter().map(|slot| slot.present.start).collect();
        assert_eq!(observation.present, present);
        assert_eq!(found.network["file"], "exported/policy.onnx");
        assert_eq!((found.command_interfaces.len(), found.state_interfaces.len()), (1, 2));
        assert!(found.effort_limit.is_none());
    }
}

#[test]
fn effort_limits_are_the_robots() {
    let (policy, model) = (rich(FrameOrder::Terms, HistoryStart::First), go2());
    let made = deploy::bundle(&policy, Some(&model)).unwrap();
    let found = controller(&text(&made, "controller.yaml"));
    let limit = |name: &str| model.effort(model.find_joint(name).unwrap()).unwrap();
    let wanted: Vec<f64> = policy.interface.joints.iter().map(|name| limit(name)).collect();
    assert_eq!(found.effort_limit.unwrap(), wanted);
    assert_eq!(found.held.unwrap().effort_limit.unwrap(), [limit("RL_calf_joint")]);
    assert!(!made.unsaid.iter().any(|line| line.contains("--robot")), "{:?}", made.unsaid);
    let made = deploy::bundle(&policy, None).unwrap();
    assert!(made.unsaid.iter().any(|line| line.contains("--robot")), "{:?}", made.unsaid);
    let mut other = policy;
    other.interface.joints[2] = "tail".to_owned();
    let error = deploy::bundle(&other, Some(&model)).unwrap_err().to_string();
    assert!(error.contains("no joint `tail`"), "{error}");
}

#[test]
fn deploy_yaml_is_read_as_the_same_interface() {
    let mut walk = read(&root().join("assets/go2-walk.safetensors")).unwrap();
    walk.interface.kp = (0..12).map(|joint| 20.0 + f64::from(joint)).collect();
    walk.interface.observation[4].history = 3;
    let mut frames = walk.interface.clone();
    frames.observation.iter_mut().for_each(|term| term.history = 2);
    frames.history.order = FrameOrder::Frames;
    for interface in [walk.interface.clone(), frames] {
        let policy = Policy { provenance: walk.provenance.clone(), ..seeing(interface, &[8]) };
        let made = deploy::bundle(&policy, None).unwrap();
        let folder = tempfile::tempdir().unwrap();
        for name in ["exported", "params"] {
            std::fs::create_dir(folder.path().join(name)).unwrap();
        }
        for (name, bytes) in &made.files {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        // The network has one row, whose width and pose stand in its end points.
        let network = folder.path().join("exported/policy.onnx");
        assert_eq!(read(&network).unwrap().interface, policy.interface);
        // Without its metadata the reader of unitree_rl_lab's files has to find everything in deploy.yaml.
        let scale = policy.normaliser.as_ref().unwrap().scale();
        std::fs::write(&network, onnx::write_network("bare", &policy.actor, &scale).unwrap()).unwrap();
        let again = read(&network).unwrap();
        assert!(again.notes[0].contains("deploy.yaml"), "{:?}", again.notes);
        let wanted = Interface {
            robot: String::new(),
            observation: policy
                .interface
                .observation
                .iter()
                .map(|term| {
                    let width = term.quantity.width(12);
                    let scale = term.scale.first().map_or(1.0, |&one| one);
                    let all = if term.scale.len() == width { term.scale.clone() } else { vec![scale; width] };
                    term.clone().scaled(&all)
                })
                .collect(),
            ..policy.interface.clone()
        };
        assert_eq!(again.interface, wanted);
        let value: Value = serde_saphyr::from_str(&text(&made, "params/deploy.yaml")).unwrap();
        let ranges = &value["commands"]["base_velocity"]["ranges"];
        assert_eq!(ranges["lin_vel_x"], serde_json::json!([-1.0, 1.0]));
        assert!(ranges["heading"].is_null() && value["actions"]["JointPositionAction"]["clip"].is_null());
        let says = |part: &str| made.unsaid.iter().any(|line| line.contains(part));
        assert!(says("places in Unitree's SDK") && !says("-1 to 1"), "{:?}", made.unsaid);
    }
}

#[test]
fn deploy_yaml_has_places_clips_and_the_clock_and_says_what_it_cannot() {
    let policy = rich(FrameOrder::Terms, HistoryStart::Zeros);
    let made = deploy::bundle(&policy, None).unwrap();
    let value: Value = serde_saphyr::from_str(&text(&made, "params/deploy.yaml")).unwrap();
    // FL 3 to 5, FR 0 to 2, RL 9 to 11, RR 6 to 8; the held one is RL_calf, at 11.
    assert_eq!(value["joint_ids_map"], serde_json::json!([3, 4, 5, 0, 1, 2, 9, 10]));
    assert_eq!(
        value["stiffness"],
        serde_json::json!([23.0, 24.0, 25.0, 20.0, 21.0, 22.0, 0.0, 0.0, 0.0, 26.0, 27.0, 60.0])
    );
    assert_eq!(value["damping"][11], 3.0);
    let bounds: Vec<[f64; 2]> =
        serde_json::from_value(value["actions"]["JointPositionAction"]["clip"].clone()).unwrap();
    // The second joint: pose 0.8, scale 0.21, clip 0.15.
    assert!((bounds[1][0] - (0.8 - 0.0315)).abs() < 1e-12 && (bounds[1][1] - (0.8 + 0.0315)).abs() < 1e-12);
    let names: Vec<&str> = value["observations"].as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(names.len(), 7);
    let phase = value["observations"]["gait_phase"]["params"]["period"].as_f64().unwrap();
    assert!((phase - 1.0 / 2.3).abs() < 1e-12);
    assert_eq!(value["observations"]["velocity_commands"]["params"]["command_name"], "base_velocity");
    assert_eq!(value["observations"]["velocity_commands"]["history_length"], 3);
    assert_eq!(value["commands"]["base_velocity"]["ranges"]["ang_vel_z"], serde_json::json!([-1.0, 1.0]));
    for part in ["held joint RL_calf_joint, -0.3 rad", "-1 to 1", "zeros", "gait clock", "effort limits"] {
        assert!(made.unsaid.iter().any(|line| line.contains(part)), "{part}: {:?}", made.unsaid);
    }
}

#[test]
fn what_unitree_rl_lab_cannot_run_has_no_deploy_yaml_and_a_reason() {
    let mut other = policy(Activation::Elu);
    other.interface.joints[0] = "tail".to_owned();
    let mut blind = interface();
    blind.observation.push(Term::new(Quantity::BaseLinearVelocity));
    let mut twice = interface();
    twice.observation.push(Term::new(Quantity::Command));
    for (policy, part) in [
        (other, "Unitree's robots"),
        (rich(FrameOrder::NewestFirst, HistoryStart::First), "newest frame"),
        (seeing(blind, &[8]), "does not measure"),
        (seeing(twice, &[8]), "command twice"),
    ] {
        let made = deploy::bundle(&policy, None).unwrap();
        assert!(!made.files.iter().any(|(name, _)| name.contains("deploy.yaml")));
        let why = made.unsaid.iter().find(|line| line.starts_with("no params/deploy.yaml")).unwrap();
        assert!(why.contains(part), "{why}");
    }
    let recurrent = read(&fixture("lstm.toml")).unwrap();
    let error = deploy::bundle(&recurrent, None).unwrap_err().to_string();
    assert!(error.contains("--cpp"), "{error}");
}

/// Compiles `source` beside the policy's files.
fn compile(folder: &Path, policy: &Policy, source: &str) -> std::path::PathBuf {
    for (name, bytes) in deploy::cxx(policy).unwrap().files {
        std::fs::write(folder.join(name), bytes).unwrap();
    }
    let program = folder.join("program");
    let made = Command::new("g++")
        .args([
            "-std=c++17",
            "-O2",
            "-Wall",
            "-Wextra",
            "-Wpedantic",
            "-Wshadow",
            "-Wconversion",
            "-Werror",
            "-o",
        ])
        .args([&program, &folder.join(source)])
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    program
}

/// What a program says to numbers on its standard input, and its exit code.
fn say(program: &Path, arguments: &[&str], input: &str) -> (String, Option<i32>) {
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipe = child.stdin.take().unwrap();
    let input = input.to_owned();
    let writer = std::thread::spawn(move || drop(pipe.write_all(input.as_bytes())));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap();
    let text = String::from_utf8(output.stdout).unwrap() + &String::from_utf8(output.stderr).unwrap();
    (text, output.status.code())
}

fn line(values: &[f32]) -> String {
    values.iter().map(|value| format!("{value:e} ")).collect::<String>() + "\n"
}

fn parsed(text: &str) -> Vec<f32> {
    text.split_whitespace().map(|word| word.parse().unwrap()).collect()
}

/// Largest difference, relative to numbers above 1.
fn difference(found: &[f32], wanted: &[f32]) -> f32 {
    assert_eq!(found.len(), wanted.len());
    assert!(wanted.iter().any(|value| value.abs() > 0.05), "zeros would prove nothing");
    found.iter().zip(wanted).map(|(a, b)| (a - b).abs() / b.abs().max(1.0)).fold(0.0, f32::max)
}

#[test]
#[ignore = "needs g++"]
fn cxx_runner_gives_the_policys_actions_of_random_observations() {
    let mut policies = vec![("walk".to_owned(), read(&root().join("assets/go2-walk.safetensors")).unwrap())];
    policies.extend(ACTIVATIONS.map(|activation| (activation.to_string(), policy(activation))));
    for name in ["functions/norm.toml", "lstm.toml", "gru.toml"] {
        policies.push((name.to_owned(), read(&fixture(name)).unwrap()));
    }
    policies.push(("squashed".to_owned(), {
        let mut squashed = policy(Activation::Relu);
        squashed.actor.output = Some(Activation::Tanh);
        squashed
    }));
    let linear = Network::random(
        Shape { inputs: 45, hidden: vec![], outputs: 12, activation: Activation::Elu },
        9,
        0,
        1.0,
    );
    policies.push(("linear".to_owned(), Policy { actor: linear.unwrap(), ..policy(Activation::Elu) }));
    for (latent, passed) in [(Latent::First, vec![44, 0]), (Latent::Last, vec![3, 1]), (Latent::Last, vec![])]
    {
        let encoder = Shape { inputs: 45, hidden: vec![8], outputs: 3, activation: Activation::Tanh };
        let actor =
            Shape { inputs: 3 + passed.len(), hidden: vec![9], outputs: 12, activation: Activation::Elu };
        let two = Policy {
            actor: Network::random(actor, 6, 0, 1.0).unwrap(),
            front: Some(Front::Encoder(Encoder {
                network: Network::random(encoder, 5, 0, 1.0).unwrap(),
                passed,
                latent,
            })),
            ..policy(Activation::Elu)
        };
        policies.push((format!("{latent:?}"), two));
    }
    for (name, policy) in policies {
        let folder = tempfile::tempdir().unwrap();
        let program = compile(folder.path(), &policy, "example.cpp");
        let width = policy.interface.observation_width();
        let observations = numbers(200 * width, 21);
        let (mut memory, mut scratch) = (policy.memory(1), Default::default());
        let (mut input, mut wanted) = (String::new(), Vec::new());
        for row in observations.chunks_exact(width) {
            let mut action = vec![f32::NAN; policy.interface.joints.len()];
            policy.act_with(1, row, &mut memory, &mut action, &mut scratch);
            wanted.extend(action);
            input += &line(row);
        }
        let (text, code) = say(&program, &[], &input);
        assert_eq!(code, Some(0), "{text}");
        let found = difference(&parsed(&text), &wanted);
        eprintln!("{name}: off by {found:e}");
        assert!(found < 1e-6, "{name}: {found:e}");
    }
}

#[test]
#[ignore = "needs g++"]
fn cxx_runner_observes_as_the_pilot_does() {
    const MAIN: &str = r#"
#include "policy.hpp"
#include <cstdio>
using namespace gaitfit_policy;
int main() {
  Policy policy;
  Sensed sensed;
  const auto get = [](auto& values) {
    for (float& value : values) if (std::scanf("%f", &value) != 1) return false;
    return true;
  };
  const auto put = [](const auto& values) {
    for (const float value : values) std::printf("%.9g ", static_cast<double>(value));
  };
  for (int step = 0;; ++step) {
    if (step == 60) policy.reset();
    if (!get(sensed.base_angular_velocity) || !get(sensed.projected_gravity) || !get(sensed.command) ||
        !get(sensed.joint_position) || !get(sensed.joint_velocity)) return 0;
    const Action& action = policy.step(policy.observe(sensed));
    put(action);
    put(targets(action));
  }
}
"#;
    let mut policies = vec![
        read(&root().join("assets/go2-walk.safetensors")).unwrap(),
        read(&fixture("lstm.toml")).unwrap(),
    ];
    for order in [FrameOrder::Terms, FrameOrder::Frames, FrameOrder::NewestFirst] {
        policies.extend([HistoryStart::First, HistoryStart::Zeros].map(|start| rich(order, start)));
    }
    // Names that end no literal and no line.
    policies[2].interface.robot = "\"; #error ??/ \\ é".to_owned();
    policies[2].interface.joints[0] = "a\\".to_owned();
    for policy in policies {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("main.cpp"), MAIN).unwrap();
        let program = compile(folder.path(), &policy, "main.cpp");
        let joints = policy.interface.joints.len();
        let mut pilot = Pilot::new(&policy).unwrap();
        let mut sensed = Sensed::new(joints);
        let (mut input, mut wanted) = (String::new(), Vec::new());
        for (step, row) in numbers(120 * (9 + 2 * joints), 4).chunks_exact(9 + 2 * joints).enumerate() {
            if step == 60 {
                pilot.begin();
            }
            sensed.base_angular_velocity.copy_from_slice(&row[..3]);
            sensed.projected_gravity.copy_from_slice(&row[3..6]);
            sensed.command.copy_from_slice(&row[6..9]);
            sensed.joint_position.copy_from_slice(&row[9..9 + joints]);
            sensed.joint_velocity.copy_from_slice(&row[9 + joints..]);
            let (action, targets) = pilot.step(&mut sensed);
            wanted.extend([action, targets].concat());
            input += &line(row);
        }
        let (text, code) = say(&program, &[], &input);
        assert_eq!(code, Some(0), "{text}");
        let (order, found) = (policy.interface.history, difference(&parsed(&text), &wanted));
        eprintln!("{order:?}: off by {found:e}");
        // Roundings return with the last action and the memory, and a policy may widen them.
        assert!(found < 2e-6, "{order:?}: {found:e}");
    }
}

#[test]
#[ignore = "needs g++"]
fn cxx_example_gives_targets_and_refuses_what_is_no_observation() {
    let mut policy = policy(Activation::Elu);
    policy.interface.action_clip = Some(ActionClip::All(0.1));
    let folder = tempfile::tempdir().unwrap();
    let program = compile(folder.path(), &policy, "example.cpp");
    let row = numbers(45, 2);
    let action = common::act(&policy, &row);
    let (text, code) = say(&program, &["--targets"], &line(&row));
    assert_eq!(code, Some(0), "{text}");
    for (joint, found) in parsed(&text).into_iter().enumerate() {
        let wanted = policy.interface.default_pose[joint] as f32 + 0.25 * action[joint].clamp(-0.1, 0.1);
        assert!((found - wanted).abs() < 1e-6, "{found} {wanted}");
    }
    assert!(action.iter().any(|action| action.abs() > 0.1), "the clip would prove nothing");
    assert_eq!(say(&program, &[], ""), (String::new(), Some(0)));
    for (arguments, input, code, part) in [
        (&[][..], "1 2 3", 1, "number 4 of 45 is missing"),
        (&[][..], "1 two", 1, "observation 1: number 2"),
        (&["--tragets"][..], "", 2, "usage"),
        (&["--targets", "x"][..], "", 2, "usage"),
    ] {
        let (text, found) = say(&program, arguments, input);
        assert_eq!(found, Some(code), "{text}");
        assert!(text.contains(part), "{text}");
    }
    // A number that is none stays one that is none, and reaches the one who commands the motors.
    let (text, _) = say(&program, &["--targets"], &line(&[f32::NAN; 45]).to_lowercase());
    assert!(parsed(&text).iter().all(|target| target.is_nan()), "{text}");
}

#[test]
fn a_network_too_large_for_a_compiler_is_refused() {
    let huge = seeing(interface(), &[2000, 1200]);
    let error = deploy::cxx(&huge).unwrap_err().to_string();
    assert!(error.contains("use the ONNX file"), "{error}");
}
