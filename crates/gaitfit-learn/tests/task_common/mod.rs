//! Small tasks on the Go2.
#![allow(clippy::unwrap_used, dead_code, reason = "a failed unwrap is a failed test; no test uses all of it")]

use gaitfit_learn::task::{Ended, Environment, Task, TaskSettings, preset};
use gaitfit_log::Trajectory;
use gaitfit_model::Model;
use gaitfit_physics::Preset;
use gaitfit_policy::Interface;
use gaitfit_policy::follow::Script;
use gaitfit_policy::network::{Activation, Network, Shape};
use gaitfit_policy::{Policy, Provenance};
use gaitfit_sim::Start;

/// `N` numbers of sample `row`.
pub fn row<const N: usize>(values: &Option<Vec<f64>>, row: usize) -> [f32; N] {
    let values = values.as_ref().unwrap();
    std::array::from_fn(|k| values[row * N + k] as f32)
}

/// The same numbers in single precision.
pub fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&x| x as f32).collect()
}

/// The commands, states and actions of a log with the whole state, from its first state on. `joints`: changes a
/// row from the log's joints to the model's.
pub fn script_with(log: &Trajectory, joints: impl Fn(&[f64]) -> Vec<f32>) -> Script {
    let base = log.base.as_ref().unwrap();
    let width = log.joints.len();
    let states: Vec<Start> = (0..log.len())
        .map(|sample| Start {
            base_position: row(&base.position, sample),
            base_quaternion: row(&base.quaternion, sample),
            base_linear: row(&base.linear_velocity, sample),
            base_angular: row(&base.angular_velocity, sample),
            joint_position: joints(&log.position[width * sample..width * (sample + 1)]),
            joint_velocity: joints(&log.velocity[width * sample..width * (sample + 1)]),
        })
        .collect();
    Script {
        commands: (0..log.len()).map(|sample| row(&log.command, sample)).collect(),
        start: states[0].clone(),
        others: Vec::new(),
        motion: Vec::new(),
        turned_back: 0.0,
        states,
        actions: single(log.action.as_ref().unwrap()),
    }
}

/// The same of a log whose joints are the model's.
pub fn script(log: &Trajectory) -> Script {
    script_with(log, single)
}

/// The project's Go2.
pub fn go2() -> Model {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    gaitfit_model::read(path.as_ref(), &Default::default()).unwrap()
}

/// The velocity task without noise, pushes and random starts.
pub fn calm() -> TaskSettings {
    TaskSettings::default().calm()
}

/// A built-in task.
pub fn built_in(name: &str) -> TaskSettings {
    toml::from_str(preset(name).unwrap()).unwrap()
}

/// The task on the Go2.
pub fn scene(task: &TaskSettings) -> Task {
    Task::new(&go2(), task, Preset::Fast).unwrap()
}

/// The task on the Go2 with its interface changed.
pub fn scene_with(task: &TaskSettings, change: impl Fn(&mut Interface)) -> Task {
    let mut interface = scene(task).walker.interface;
    change(&mut interface);
    Task::with_interface(&go2(), task, interface, Preset::Fast, 0.0).unwrap()
}

/// A policy whose actions are `actions`, whatever it sees.
pub fn constant_policy(scene: &Task, actions: &[f32]) -> Policy {
    let inputs = scene.walker.interface.observation_width();
    let shape = Shape { inputs, hidden: vec![4], outputs: actions.len(), activation: Activation::Elu };
    let mut parameters = vec![0.0; shape.parameters()];
    let bias = shape.layers().last().unwrap().bias.clone();
    parameters[bias].copy_from_slice(actions);
    policy(scene, Network::new(shape, &parameters).unwrap())
}

/// A policy that reacts to everything it sees, gently.
pub fn random_policy(scene: &Task) -> Policy {
    let (inputs, outputs) = (scene.walker.interface.observation_width(), scene.walker.joints.len());
    let shape = Shape { inputs, hidden: vec![16], outputs, activation: Activation::Elu };
    policy(scene, Network::random(shape, 3, 0, 0.5).unwrap())
}

fn policy(scene: &Task, actor: Network) -> Policy {
    Policy {
        interface: scene.walker.interface.clone(),
        front: None,
        log_std: vec![-1.0; actor.shape.outputs],
        actor,
        critic: None,
        normaliser: None,
        critic_memory: None,
        critic_normaliser: None,
        provenance: Provenance::default(),
        notes: Vec::new(),
    }
}

/// One step of all robots under the same action in every joint: rewards and ends.
pub fn step(environment: &mut Environment<'_>, step: u32, action: f32) -> (Vec<f32>, Vec<Ended>) {
    let count = environment.count();
    let (mut reward, mut ended) = (vec![f32::NAN; count], vec![Ended::No; count]);
    environment.step(step, &vec![action; 12 * count], &mut reward, &mut ended);
    (reward, ended)
}
