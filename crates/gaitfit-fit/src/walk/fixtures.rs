//! Shared by the tests of this folder: a policy that has learnt nothing, and its logs.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::observation::{self, Given};
use gaitfit_learn::collect::{CollectOptions, collect};
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_learn::{Training, TrainingSettings, ppo};
use gaitfit_log::Trajectory;
use gaitfit_physics::Preset;
use gaitfit_policy::network::Scratch;
use gaitfit_policy::observation::{Layout, Past};
use gaitfit_policy::{Policy, Quantity, Term};
use gaitfit_swing::{Estimate, FrictionLaw, GroupEstimate, SwingReport};

/// The Go2 at the built-in task.
pub fn scene() -> Task {
    let model = crate::robot::go2().unwrap();
    Task::new(&model, &TaskSettings::default().calm(), Preset::Fast).unwrap()
}

/// The same with a policy that observes a gait clock, which turns by a twentieth in a control period.
pub fn clocked() -> Task {
    let mut settings = TaskSettings::default().calm();
    settings.policy.gait_frequency = Some(0.05 / scene().walker.interface.control_dt);
    settings.policy.observation.push(Term::new(Quantity::GaitPhase));
    Task::new(&crate::robot::go2().unwrap(), &settings, Preset::Fast).unwrap()
}

/// A policy that has learnt nothing, with outputs that move the legs.
pub fn policy(scene: &Task, seed: u64) -> Policy {
    policy_with(scene, seed, None)
}

/// The same with a memory.
pub fn policy_with(scene: &Task, seed: u64, memory: Option<ppo::MemorySettings>) -> Policy {
    let ppo = ppo::Settings {
        actor_hidden: vec![16],
        critic_hidden: vec![16],
        output_gain: 1.0,
        // A minibatch of a policy with a memory takes whole robots, and there is one.
        minibatches: 1,
        memory,
        ..ppo::Settings::default()
    };
    let learner = Training::fresh_learner(scene, &ppo, seed).unwrap();
    let settings = TrainingSettings { environments: 1, steps: 1, iterations: 1 };
    Training::new(scene, None, &settings, learner, seed).unwrap().policy("", "")
}

/// Eight logs of up to a second, joints only or with the base's state.
pub fn logs(scene: &Task, policy: &Policy, privileged: bool) -> Vec<Trajectory> {
    let subject = Subject { task: scene, policy, candidate: None, seed: 5, cancel: None, moved: None };
    let options = CollectOptions { count: 8, seconds: 1.0, shift: [0.0; 2], privileged };
    let logs = collect(&subject, &options, 1).unwrap().into_iter().map(|log| log.trajectory);
    logs.map(|log| Trajectory { base: log.base.clone().filter(|_| privileged), ..log }).collect()
}

/// A log of joints that run after their targets with a push of their own, under the actions that `policy` chooses if it
/// feels level and at rest. Number and command differ from log to log; a sample a control period.
pub fn puppet(policy: &Policy, number: usize, seconds: f64) -> Trajectory {
    let interface = &policy.interface;
    let joints = interface.joints.len();
    let samples = (seconds / interface.control_dt).round() as usize + 1;
    let spread = |k: usize| 2.0 * ((number * (k + 3) + k * k) as f64 * 0.618).fract() - 1.0;
    let command = [spread(0), spread(1), spread(2)];
    let mut log = Trajectory {
        source: None,
        robot: None,
        joints: interface.joints.clone(),
        time: (0..samples).map(|sample| sample as f64 * interface.control_dt).collect(),
        rate_hz: 1.0 / interface.control_dt,
        position: Vec::new(),
        velocity: Vec::new(),
        target: Some(Vec::new()),
        action: Some(Vec::new()),
        command: Some(command.repeat(samples)),
        motion: None,
        base: None,
        gains: None,
        lead: None,
        simulated_step: None,
        velocity_joints: Vec::new(),
        fell: false,
    };
    let mut scratch = Scratch::default();
    let (mut position, mut velocity) = (interface.default_pose.clone(), vec![0.0; joints]);
    let mut action = vec![0.0f32; joints];
    let layout = Layout::new(interface, &interface.observation);
    let mut observation = vec![0.0f32; layout.width()];
    let (mut past, mut memory) = (Past::new(&layout, 1), policy.memory(1));
    for sample in 0..samples {
        log.position.extend(&position);
        log.velocity.extend(&velocity);
        let last: Vec<f64> = action.iter().map(|&x| f64::from(x)).collect();
        let (given, row) = (Given::default(), past.row(0));
        observation::write(&layout, interface, &log, sample, &last, &given, 0.0, row, &mut observation);
        past.take(&observation);
        policy.act_with(1, &observation, &mut memory, &mut action, &mut scratch);
        for joint in 0..joints {
            let target =
                interface.default_pose[joint] + interface.action_scale[joint] * f64::from(action[joint]);
            log.target.get_or_insert_default().push(target);
            log.action.get_or_insert_default().push(f64::from(action[joint]));
            let push = 0.05 * (0.3 * sample as f64 + (joint + number) as f64).sin();
            let next = position[joint] + 0.5 * (target - position[joint]) + push;
            velocity[joint] = (next - position[joint]) / interface.control_dt;
            position[joint] = next;
        }
    }
    log
}

/// What legs in the air show of one group of joints: friction, damping and armature; beside them the delay and the strength.
pub fn report(
    group: &str,
    joints: Vec<String>,
    [friction, damping, armature]: [Estimate; 3],
    [delay, strength]: [Estimate; 2],
) -> SwingReport {
    let group = GroupEstimate {
        group: group.to_owned(),
        joints,
        friction,
        damping,
        armature,
        by_strength: [0.0; 3],
        by_load: [0.0; 3],
        swings: 100,
        windows: 1000,
        residual: 0.4,
    };
    SwingReport {
        groups: vec![group],
        delay,
        delay_by_strength: 0.0,
        strength,
        law: FrictionLaw::Coulomb,
        clearance_m: 0.012,
        logs: 12,
        unseen: vec![],
    }
}
