//! The programs in `examples/` run and do what they say.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit::device::Device;
use gaitfit::finetune;
use gaitfit::settings::{TrainConfig, load};
use gaitfit::watch::Watch;
use std::path::{Path, PathBuf};

#[path = "../examples/fit_clamped_logs.rs"]
mod fit_clamped_logs;
#[path = "../examples/own_cost.rs"]
mod own_cost;
#[path = "../examples/own_modification.rs"]
mod own_modification;
#[path = "../examples/own_reward_term.rs"]
mod own_reward_term;
#[path = "../examples/own_simulator.rs"]
mod own_simulator;
#[path = "../examples/walking_loop.rs"]
mod walking_loop;

/// The repository, which is also made the current directory: that is where the examples are run from.
fn root() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    std::env::set_current_dir(&root).unwrap();
    root
}

#[test]
fn clamped_logs_are_fitted() {
    let runs = tempfile::tempdir().unwrap();
    let changes = ["optimizer.seeds=1", "optimizer.generations=8", "simulation.timestep=0.005", "check={}"];
    let cost = fit_clamped_logs::fit(&root(), runs.path(), &changes).unwrap();
    assert!(cost > 0.0 && cost < 1.0, "{cost}");
    assert!(runs.path().join("example/report.html").exists());
}

#[test]
fn the_loop_ends_with_a_policy() {
    let runs = tempfile::tempdir().unwrap();
    let folder = format!("runs={}", runs.path().display());
    let changes = [
        folder.as_str(),
        // Four logs show as much as all 64, in a tenth of the time.
        "logs=[\"examples/go2-ground/logs/trajectory_0[0-3].csv\"]",
        "adapt.optimizer.generations=2",
        "adapt.optimizer.replicates=0",
        "adapt.simulation.timestep=0.01",
        "finetune.train.environments=32",
        "finetune.train.iterations=1",
        "finetune.ppo.critic_warmup=0",
        "evaluate.trajectories=16",
        "evaluate.drift=1",
        "target.probe=[\"false\"]",
    ];
    let policy = walking_loop::run(&root(), &changes).unwrap();
    assert!(gaitfit_policy_files::read(Path::new(&policy)).is_ok(), "{policy}");
}

#[test]
fn an_own_simulator_is_fitted() {
    own_simulator::main().unwrap();
}

#[test]
fn an_own_cost_falls() {
    root();
    own_cost::main().unwrap();
}

#[test]
fn an_own_modification_is_found() {
    root();
    own_modification::main().unwrap();
}

#[test]
fn an_own_reward_term_pays() {
    let paid = own_reward_term::train(16, 2).unwrap();
    // A weight of 2 pays at most 2 a second.
    assert!(paid > 0.0 && paid <= 2.0, "{paid}");
}

/// The first block of TOML in a text.
fn toml_block(text: &str) -> &str {
    let (_, block) = text.split_once("```toml").unwrap();
    block.split_once("```").unwrap().0
}

/// The examples of docs/tasks.md, in a training.
#[test]
fn documented_rewards_are_paid_and_documented_commands_grow() {
    let text = std::fs::read_to_string(root().join("docs/tasks.md")).unwrap();
    let (_, section) = text.split_once("## Rewards").unwrap();
    let (_, growth) = section.split_once("## Commands that grow").unwrap();
    let example: String = [section, growth].map(toml_block).concat();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    std::fs::write(&path, format!("{example}\n[train]\nenvironments = 8\nsteps = 12\niterations = 2\n"))
        .unwrap();
    let runs = format!("runs={}", folder.path().display());
    let config: TrainConfig = load(Some(&path), &[runs]).unwrap();
    let setup = gaitfit::train::setup(&config, "own", None, 2, &Device::Cpu.into()).unwrap();
    let results = gaitfit::train::train(&setup, false, &Watch::silent()).unwrap();
    let warned = results.warnings.iter().any(|warning| warning.contains("grew 0 % of the way"));
    assert!(warned, "two iterations are not enough: {:?}", results.warnings);
    let run = std::fs::read_to_string(folder.path().join("own/seed-1/metrics.jsonl")).unwrap();
    for term in ["crouch", "calf_effort", "high_steps", "torque", "command_level", "command_tracking"] {
        assert!(run.contains(&format!("\"{term}\":")), "{term} is not in {run}");
    }
    let policy = folder.path().join("own/seed-1/policy.safetensors");
    let task = gaitfit_policy_files::read(&policy).unwrap().provenance.task;
    assert!(
        task.contains("calf_effort") && task.contains("curriculum"),
        "the policy's file keeps its task: {task}"
    );
    // A fine-tuning is paid the same, and begins with the final commands unless it says otherwise.
    let finetuned = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
        let request = finetune::Request {
            config: load(None, &sets).unwrap(),
            path: None,
            name: "f".to_owned(),
            files: finetune::Files { policy: Some(policy.clone()), ..Default::default() },
            task: None,
            threads: None,
            devices: Device::Cpu.into(),
        };
        let settings = finetune::setup(request).unwrap().scene.settings;
        (settings.terms.len(), settings.command.curriculum.map(|curriculum| curriculum.iterations))
    };
    assert_eq!(finetuned(&[]), (3, None));
    assert_eq!(finetuned(&["task.command.curriculum.iterations=7"]), (3, Some(Some(7))));
}

/// A replay of a robot whose legs have no geoms.
#[test]
fn links_without_geoms_are_drawn_as_bones() {
    use gaitfit::replay::robot;
    use gaitfit_learn::evaluate::GaitRecord;
    use gaitfit_view::replay::Shape;
    let mut model = gaitfit::robot::go2().unwrap();
    let whole = robot("go2", &model, &GaitRecord::default());
    assert_eq!(whole.geoms.len(), model.geoms.len(), "a robot with geoms everywhere gets no bones");
    let legs: Vec<usize> =
        (0..model.bodies.len()).filter(|&body| model.bodies[body].name.starts_with("FL_")).collect();
    model.geoms.retain(|geom| !legs.contains(&geom.body));
    let drawn = robot("go2", &model, &GaitRecord::default());
    let bones = &drawn.geoms[model.geoms.len()..];
    // Links that are meshes but for the foot's ball: the last bone leads to the ball.
    let mut feet = gaitfit::robot::go2().unwrap();
    feet.geoms.retain(|geom| matches!(geom.shape, gaitfit_model::Shape::Sphere { .. }));
    let calf = feet.bodies.iter().position(|body| body.name == "FL_calf").unwrap();
    let ball = feet.geoms.iter().find(|geom| geom.body == calf).unwrap().pos;
    let drawn_feet = robot("go2", &feet, &GaitRecord::default());
    let to_ball = drawn_feet.geoms[feet.geoms.len()..]
        .iter()
        .any(|bone| (0..3).all(|k| (bone.position[k] - 0.5 * ball[k]).abs() < 1e-9));
    assert!(to_ball, "{:?}", drawn_feet.geoms);
    // Hip to thigh, thigh to calf, and the calf to its centre of mass.
    assert_eq!(bones.len(), 3);
    for (bone, wanted) in
        bones.iter().zip([model.bodies[legs[1]].pos, model.bodies[legs[2]].pos, model.bodies[legs[2]].ipos])
    {
        let Shape::Capsule { half_length, .. } = bone.shape else { panic!("a bone is a capsule") };
        let along = gaitfit_model::rotation::rotate(bone.quaternion, [0.0, 0.0, half_length]);
        for k in 0..3 {
            assert!((bone.position[k] - along[k]).abs() < 1e-9, "it begins at the joint");
            assert!((bone.position[k] + along[k] - wanted[k]).abs() < 1e-9, "it ends at the next: {bone:?}");
        }
    }
}
