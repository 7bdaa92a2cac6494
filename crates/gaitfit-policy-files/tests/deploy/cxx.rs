//! C++ with the network inside, compiled and compared.

use super::{rich, seeing};
use crate::common::{self, ACTIVATIONS, fixture, interface, numbers, policy, root};
use gaitfit_policy::network::{Activation, Network, Shape};
use gaitfit_policy::observation::Sensed;
use gaitfit_policy::{
    ActionClip, Encoder, FrameOrder, Front, HistoryStart, Latent, Pilot, Policy, Quantity, Term,
};
use gaitfit_policy_files::{deploy, read};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Compiles `source` beside the policy's files.
fn compile(folder: &Path, policy: &Policy, source: &str) -> PathBuf {
    for (name, bytes) in deploy::cxx(policy, None).unwrap().files {
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
    // Clocks of the feet and a constant.
    let mut interface = rich(FrameOrder::Frames, HistoryStart::Zeros).interface;
    for (quantity, scale) in
        [(Quantity::GaitSine, -1.0), (Quantity::Constant, 0.3), (Quantity::GaitSine, 1.0)]
    {
        interface.observation.push(Term::new(quantity).scaled(&[scale]).with_history(3));
    }
    policies.push(seeing(interface.clone(), &[20, 12]));
    interface.observation.push(Term::new(Quantity::EarlierAction).with_history(3));
    let refused = deploy::cxx(&seeing(interface, &[20, 12]), None).err().unwrap().to_string();
    assert!(refused.contains("earlier_action"), "{refused}");
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
    let error = deploy::cxx(&huge, None).unwrap_err().to_string();
    assert!(error.contains("use the ONNX file"), "{error}");
}
