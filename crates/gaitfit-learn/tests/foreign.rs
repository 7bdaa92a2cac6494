//! Policies of other programs at work on the Go2: mjlab's with its own metadata, and a recurrent one.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::path::PathBuf;
use std::sync::Mutex;

use crate::task_common::script_with;

use gaitfit_learn::collect::{CollectOptions, collect};
use gaitfit_learn::evaluate::{Subject, run_trials};
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_learn::{Training, TrainingSettings, ppo};
use gaitfit_physics::Preset;
use gaitfit_policy::Policy;
use gaitfit_policy::follow::{Job, Script, Track, follow};
use gaitfit_policy::network::{Activation, Scratch};
use gaitfit_policy::observation::Sensed;
use gaitfit_policy_files::read;
use gaitfit_sim::Candidate;

fn fixture(name: &str) -> PathBuf {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../gaitfit-policy-files/tests/fixtures/policies");
    PathBuf::from(folder).join(name)
}

/// A policy of the fixtures on the Go2.
fn at_work(name: &str) -> (Policy, Task) {
    let policy = read(&fixture(name)).unwrap();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    let model = gaitfit_model::read(path.as_ref(), &Default::default()).unwrap();
    let mut settings = TaskSettings::default().calm();
    (settings.start.yaw, settings.start.tilt, settings.start.joint_position) = (0.0, 0.0, 0.0);
    let interface = policy.interface.clone();
    let task = Task::with_interface(&model, &settings, interface, Preset::Fast, 0.0).unwrap();
    (policy, task)
}

#[test]
fn mjlabs_and_unitrees_files_run_without_a_description() {
    for name in ["mjlab.onnx", "unitree/exported/policy.onnx"] {
        let (policy, task) = at_work(name);
        let subject =
            Subject { task: &task, policy: &policy, candidate: None, seed: 1, cancel: None, moved: None };
        let trials = run_trials(&subject, 3, 0.5, 1).unwrap();
        assert!(trials.iter().all(|trial| trial.steps > 2 && !trial.diverged), "{name}: {trials:?}");
        assert!(trials.iter().all(|trial| trial.action_rate > 0.0), "{name}");
        // On from there it is trained, with a new critic for mjlab's actor.
        let mut interface = policy.interface.clone();
        interface.critic_observation = interface.observation.clone();
        let settings = TaskSettings::default();
        let task =
            Task::with_interface(task.walker.model(), &settings, interface, Preset::Fast, 0.0).unwrap();
        assert!(Training::learner_from(&task, &ppo::Settings::default(), &policy, 1).is_ok(), "{name}");
    }
}

/// The log of a recurrent policy, its observations put together anew and run through the network, and followed.
#[test]
fn a_recurrent_policy_walks_is_followed_and_trained() {
    for name in ["lstm.toml", "gru.toml"] {
        let (policy, task) = at_work(name);
        let subject =
            Subject { task: &task, policy: &policy, candidate: None, seed: 5, cancel: None, moved: None };
        let options = CollectOptions { count: 2, seconds: 0.5, shift: [0.0; 2], privileged: true };
        let logs = collect(&subject, &options, 1).unwrap();
        let walker = &task.walker;
        let scripts: Vec<Script> = logs
            .iter()
            .map(|log| {
                let log = &log.trajectory;
                let model_order = |values: &[f64]| {
                    let mut all = vec![0.0f32; 12];
                    for (&joint, &value) in walker.joints.iter().zip(values) {
                        all[joint] = value as f32;
                    }
                    all
                };
                let script = script_with(log, model_order);
                let first = &script.states[0];
                let wide = |values: &[f32]| -> Vec<f64> { values.iter().map(|&x| f64::from(x)).collect() };
                let start =
                    walker.start_from_joints(&wide(&first.joint_position), &wide(&first.joint_velocity));
                Script { start, ..script }
            })
            .collect();
        // From the logged states alone the logged actions follow, to 1e-5.
        let (mut memory, mut scratch) = (policy.memory(1), Scratch::default());
        let (mut sensed, mut row) = (Sensed::new(12), vec![0.0; 45]);
        let mut worst = 0.0f32;
        for sample in 0..scripts[0].commands.len() {
            walker.sense_state(&scripts[0].states[sample], &mut sensed);
            sensed.command = scripts[0].commands[sample];
            if sample > 0 {
                sensed.last_action.copy_from_slice(&scripts[0].actions[12 * (sample - 1)..12 * sample]);
            }
            walker.observation.write(&sensed, None, |_, _| (), &mut row);
            let mut action = vec![f32::NAN; 12];
            policy.act_with(1, &row, &mut memory, &mut action, &mut scratch);
            for (a, b) in action.iter().zip(&scripts[0].actions[12 * sample..12 * sample + 12]) {
                worst = worst.max((a - b).abs());
            }
        }
        assert!(worst < 1e-5, "{name}: {worst}");
        let tracks = Mutex::new(vec![Track::default(); 2]);
        let keep = |_: usize, script: usize, track: &Track| tracks.lock().unwrap()[script] = track.clone();
        let job = Job { candidate: Candidate::nominal(walker.model()), reset_every: None, seed: 0 };
        follow(walker, &policy, &scripts, std::slice::from_ref(&job), 2, &keep, &|| false).unwrap();
        for (track, script) in tracks.lock().unwrap().iter().zip(&scripts) {
            assert_eq!(track.action, script.actions, "{name}");
        }
        let reset = [Job { reset_every: Some(5), ..job }];
        let refused = follow(walker, &policy, &scripts, &reset, 1, &keep, &|| false).unwrap_err();
        assert!(refused.to_string().contains("recurrent"), "{refused}");
        // Its file has no critic: a new one needs something to see, and has a memory of its own.
        let refused = Training::learner_from(&task, &ppo::Settings::default(), &policy, 1).map(|_| ());
        assert!(refused.unwrap_err().to_string().contains("critic's observation has width 0"), "{name}");
        let mut interface = policy.interface.clone();
        interface.critic_observation = interface.observation.clone();
        let settings = TaskSettings::default();
        let task = Task::with_interface(walker.model(), &settings, interface, Preset::Fast, 0.0).unwrap();
        let learner = Training::learner_from(&task, &ppo::Settings::default(), &policy, 1).unwrap();
        let memories =
            [learner.actor_memory(), learner.critic_memory()].map(|memory| memory.unwrap().shape());
        assert_eq!((memories[0].cell, &memories[0].hidden), (memories[1].cell, &memories[1].hidden));
        let settings = TrainingSettings { environments: 8, steps: 4, iterations: 1 };
        let mut training = Training::new(&task, None, &settings, learner, 1).unwrap();
        training.iterate(1).unwrap();
        let trained = training.policy("", "");
        assert!(trained.front != policy.front && trained.is_recurrent(), "{name}");
    }
}

/// SiLU layers and a tanh of the output, as Brax and MuJoCo Playground have them: the policy in rollouts and the one in updates are the
/// same, so before the first step no sample is outside the clip.
#[test]
fn a_policy_with_swish_and_a_bounded_output_is_trained_further() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2-walk.safetensors");
    let mut policy = read(path.as_ref()).unwrap();
    policy.actor.shape.activation = Activation::Silu;
    policy.actor.output = Some(Activation::Tanh);
    policy.critic = None;
    let model = gaitfit_model::read(fixture("../../../../../assets/go2.xml").as_ref(), &Default::default());
    let mut interface = policy.interface.clone();
    interface.critic_observation = interface.observation.clone();
    let settings = TaskSettings::default();
    let task = Task::with_interface(&model.unwrap(), &settings, interface, Preset::Fast, 0.0).unwrap();
    let settings = TrainingSettings { environments: 16, steps: 8, iterations: 2 };
    let once = ppo::Settings { epochs: 1, minibatches: 1, ..ppo::Settings::default() };
    let learner = Training::learner_from(&task, &once, &policy, 1).unwrap();
    let mut training = Training::new(&task, None, &settings, learner, 1).unwrap();
    let report = training.iterate(1).unwrap();
    let diagnostics = report.diagnostics;
    assert!(diagnostics.clip_fraction == 0.0 && diagnostics.approx_kl_k3.abs() < 1e-9, "{diagnostics:?}");
    let trained = training.policy("", "").actor;
    assert_eq!((trained.shape.activation, trained.output), (Activation::Silu, Some(Activation::Tanh)));
    assert!(trained.parameters != policy.actor.parameters);
    assert!(trained.parameters.iter().all(|x| x.is_finite()));
}
