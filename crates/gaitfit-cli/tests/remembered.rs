//! A policy remembers its robot: commands find the robot's file, and a run folder stands for its policy.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json};
use std::path::Path;
use std::process::{Command, Output};

/// A small robot of four legs with two joints each, whose file is read leniently alone.
fn robot() -> String {
    let inertial = |mass: f64, inertia: f64| {
        format!(
            "<inertial><mass value=\"{mass}\"/><inertia ixx=\"{inertia}\" ixy=\"0\" ixz=\"0\" iyy=\"{inertia}\" iyz=\"0\" \
             izz=\"{inertia}\"/></inertial>"
        )
    };
    let hinge = |name: &str, parent: &str, child: &str, origin: &str| {
        format!(
            "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin \
             xyz=\"{origin}\"/><axis xyz=\"0 1 0\"/><limit lower=\"-2.5\" upper=\"2.5\" effort=\"20\" velocity=\"20\"/></joint>"
        )
    };
    let leg = |name: &str, x: f64, y: f64| {
        format!(
            "<link name=\"{name}_thigh\">{}</link><link name=\"{name}_shank\">{}<collision><origin xyz=\"0 0 \
             -0.2\"/><geometry><sphere radius=\"0.02\"/></geometry></collision></link>{}{}",
            inertial(1.0, 0.004),
            inertial(0.3, 0.001),
            hinge(&format!("{name}_hip"), "base", &format!("{name}_thigh"), &format!("{x} {y} 0")),
            hinge(&format!("{name}_knee"), &format!("{name}_thigh"), &format!("{name}_shank"), "0 0 -0.2")
        )
    };
    format!(
        "<robot name=\"quad\"><unknown_to_all/><link name=\"base\">{}</link>{}{}{}{}</robot>",
        inertial(6.0, 0.1),
        leg("FL", 0.2, 0.1),
        leg("FR", 0.2, -0.1),
        leg("RL", -0.2, 0.1),
        leg("RR", -0.2, -0.1)
    )
}

/// Runs the program in `folder`.
fn run(folder: &Path, line: &str) -> Output {
    let program = Path::new(env!("CARGO_BIN_EXE_gaitfit"));
    Command::new(program).args(line.split_whitespace()).current_dir(folder).output().unwrap()
}

/// Runs it to a good end.
fn done(folder: &Path, line: &str) -> Output {
    let output = run(folder, line);
    assert!(output.status.success(), "{line}: {}", errors(&output));
    output
}

const TINY: &str = "--device cpu --set train.iterations=1 --set train.environments=16";
const NETWORKS: &str = "--set ppo.actor_hidden=[8] --set ppo.critic_hidden=[8]";

#[test]
fn commands_find_the_robot_of_the_training_from_its_run_folder() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("project");
    std::fs::create_dir_all(folder.join("robots")).unwrap();
    std::fs::write(folder.join("robots/quad.urdf"), robot()).unwrap();
    done(&folder, "init robots/quad.urdf --lenient");
    done(&folder, &format!("train quad.toml --name walk {TINY} {NETWORKS}"));

    let short = "--trajectories 4 --drift 0 --seconds 0.2 --json";
    let evaluation = json(&done(&folder, &format!("evaluate runs/walk {short}")));
    assert!(evaluation["simulator"].as_str().unwrap_or_default().contains("quad"), "{evaluation}");
    done(&folder, &format!("evaluate runs/walk/seed-1/policy.safetensors {short}"));
    done(&folder, "collect runs/walk --trajectories 2 --seconds 0.2 --out logs");
    let output = run(&folder, "inspect logs/trajectory_00.csv --policy runs/walk --lenient");
    assert_ne!(output.status.code(), Some(2), "{}", errors(&output));
    // It trains and saves. After so short a training the policy does not walk, so the exit code is 3.
    let output = run(&folder, &format!("finetune runs/walk --name tuned {TINY} --set ppo.critic_warmup=0"));
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    assert!(errors(&output).contains("does not walk"), "{}", errors(&output));
    let tuned = json(&done(&folder, "inspect runs/tuned --json"));
    let file = &tuned["provenance"]["robot_file"];
    assert!(file["path"].as_str().unwrap().ends_with("robots/quad.urdf"), "{file}");
    assert_eq!(file["lenient"], true);
    // Effort limits are the robot's, in files that keep the memory too.
    done(&folder, "export runs/walk --onnx walk.onnx --bundle deployed --cpp runner");
    let header = std::fs::read_to_string(folder.join("runner/policy.hpp")).unwrap();
    assert!(header.contains("kEffortLimit"), "effort limits");
    assert!(
        std::fs::read_to_string(folder.join("deployed/controller.yaml")).unwrap().contains("effort_limit")
    );
    done(&folder, &format!("evaluate walk.onnx {short}"));

    // The whole project elsewhere.
    let moved = home.path().join("moved");
    std::fs::rename(&folder, &moved).unwrap();
    let output = done(&moved, &format!("evaluate runs/walk {short}"));
    assert!(errors(&output).contains("the robot file of the training is"), "{}", errors(&output));

    // Another robot under its name, and none.
    let file = moved.join("robots/quad.urdf");
    std::fs::write(&file, robot().replace("value=\"6\"", "value=\"7\"")).unwrap();
    for line in [
        "evaluate runs/walk",
        "collect runs/walk --out more",
        "finetune runs/walk",
        "export runs/walk --cpp other",
    ] {
        let output = run(&moved, line);
        assert_eq!(output.status.code(), Some(2), "{line}: {}", errors(&output));
        let said = errors(&output);
        assert!(
            said.contains("quad.urdf") && said.contains("--robot") && said.contains("--lenient"),
            "{line}: {said}"
        );
    }
    done(&moved, &format!("evaluate runs/walk --robot robots/quad.urdf --lenient {short}"));
    let output = run(&moved, "evaluate robots");
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("a folder without a policy"), "{}", errors(&output));
}
