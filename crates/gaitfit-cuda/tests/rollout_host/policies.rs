//! Steps of policies that observe more than their sensors and their last action.

use super::along::{PROCESSORS, compare, go2, lively};
use super::{logs, stepwise, trials};
use crate::motions::{reference, terms};
use gaitfit_cuda::rollout::{Mode, Plan, Scene, Sizes};
use gaitfit_cuda::runtime::{Nvrtc, compile};
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_physics::Preset;
use gaitfit_policy::{FrameOrder, History, HistoryStart, Interface, Quantity, Reference, Term};
use gaitfit_sim::{Candidate, Sensors};

/// Actor and critic observe the action before the last: the actor behind the last one, the critic before it.
fn with_earlier_actions(frames: usize, order: FrameOrder) -> TaskSettings {
    let mut settings = lively("velocity");
    settings.fall.tilt = 12.0;
    settings.policy.history = History { order, start: HistoryStart::First };
    let policy = &mut settings.policy;
    let scaled = policy.observation.iter_mut().chain(&mut policy.critic_observation);
    let last = scaled.filter(|term| term.quantity == Quantity::LastAction);
    // Powers of two, so that factors that are divided out leave no trace.
    last.for_each(|term| term.scale = vec![0.5]);
    policy.observation.push(Term::new(Quantity::EarlierAction).scaled(&[2.0]));
    policy.critic_observation.insert(1, Term::new(Quantity::EarlierAction));
    let scales: Vec<f32> = (0..12).map(|k| [1.0, -0.25, 4.0][k % 3]).collect();
    policy.critic_observation.insert(3, Term::new(Quantity::EarlierAction).scaled(&scales));
    policy.observation.iter_mut().for_each(|term| term.history = frames);
    settings
}

#[test]
#[ignore = "needs g++"]
fn cxx_steps_with_the_action_before_the_last_are_the_cpus() {
    for (frames, order) in [(1, FrameOrder::Terms), (3, FrameOrder::NewestFirst)] {
        let mut settings = with_earlier_actions(frames, order);
        if order != FrameOrder::Terms {
            settings.policy.critic_observation.iter_mut().for_each(|term| term.history = 2);
        }
        let task = Task::new(&go2(), &settings, Preset::Fast).unwrap();
        compare(&format!("earlier actions, {frames} frames"), &task, &Candidate::nominal(&go2()));
    }
}

#[test]
#[ignore = "needs g++"]
fn cxx_steps_under_given_actions_with_the_action_before_the_last_are_the_cpus() {
    let task = Task::new(&go2(), &with_earlier_actions(1, FrameOrder::Terms), Preset::Fast).unwrap();
    stepwise::compare("earlier actions", &task, &Candidate::nominal(&go2()), true);
}

/// Thighs of which one follows another and is followed by a third; the leaders come last, so that placing them takes two rounds.
#[test]
#[ignore = "needs g++"]
fn cxx_steps_of_joints_that_follow_others_are_the_cpus() {
    let couplings = "</worldbody><equality>\
        <joint joint1=\"RR_thigh_joint\" joint2=\"FR_thigh_joint\" polycoef=\"0 1 0 0 0\"/>\
        <joint joint1=\"FR_thigh_joint\" joint2=\"FL_thigh_joint\" polycoef=\"0.1 0.9 0 0 0\"/></equality>";
    let coupled = gaitfit_model::builtin::GO2.replacen("</worldbody>", couplings, 1);
    let model = gaitfit_model::read_mjcf_str(&coupled, &Default::default()).unwrap();
    let mut settings = lively("velocity");
    settings.start.joint_velocity = 1.5;
    let task = Task::new(&model, &settings, Preset::Fast).unwrap();
    compare("coupled thighs", &task, &Candidate::nominal(&model));
}

/// The lively task for a policy that follows a motion, and what else `change` gives it.
fn following(rate_hz: f64, samples: usize, change: fn(&mut Interface)) -> Task {
    let mut settings = lively("velocity");
    settings.fall.tilt = 16.0;
    settings.start.tilt = 8.0;
    settings.noise.set(Quantity::ReferenceOrientation, 0.05);
    let mut interface = Task::new(&go2(), &settings, Preset::Fast).unwrap().walker.interface;
    interface.reference = Some(reference(&interface, rate_hz, samples));
    interface.observation.splice(1..1, terms());
    interface.critic_observation.extend(terms());
    change(&mut interface);
    Task::with_interface(&go2(), &settings, interface, Preset::Fast, 0.03).unwrap()
}

/// A robot whose sensors err.
fn sensing() -> Candidate {
    let mut candidate = Candidate::nominal(&go2());
    candidate.robot.encoder_bias = (0..12).map(|j| 0.01 * f64::from(j) - 0.05).collect();
    candidate.robot.imu_delay = 0.007;
    candidate.sensors = Sensors { imu_tilt: [0.06, -0.04], gyro_bias: [0.1, -0.15, 0.05] };
    candidate
}

/// Motions that end within an episode, at the policy's rate and at another one; with past frames; of one sample without
/// orientations; observed by the critic alone.
#[test]
#[ignore = "needs g++"]
fn cxx_steps_along_a_motion_are_the_cpus() {
    // The last sample's time, 7 control periods of 0.02 s, is rounded up to a place behind it.
    compare("a motion", &following(50.0, 8, |_| ()), &sensing());
    let with_frames = following(37.0, 9, |interface| {
        interface.history = History { order: FrameOrder::NewestFirst, start: HistoryStart::Zeros };
        interface.observation.iter_mut().for_each(|term| term.history = 2);
    });
    compare("a motion with past frames", &with_frames, &Candidate::nominal(&go2()));
    let still = following(20.0, 1, |interface| {
        let joints = |term: &Term| term.quantity != Quantity::ReferenceOrientation;
        interface.observation.retain(joints);
        interface.critic_observation.retain(joints);
        let reference = interface.reference.take();
        let without = |reference: Reference| Reference { orientation: Vec::new(), ..reference };
        interface.reference = reference.map(without);
    });
    compare("a motion of one sample", &still, &Candidate::nominal(&go2()));
    let of_critic = following(50.0, 10, |interface| {
        interface.observation.retain(|term| !term.quantity.is_of_reference());
    });
    compare("a critic's motion", &of_critic, &Candidate::nominal(&go2()));
}

#[test]
#[ignore = "needs g++"]
fn cxx_steps_under_given_actions_along_a_motion_are_the_cpus() {
    stepwise::compare("a motion", &following(50.0, 10, |_| ()), &sensing(), true);
}

#[test]
#[ignore = "needs g++"]
fn cxx_steps_of_trajectories_along_a_motion_are_the_cpus() {
    trials::compare(&following(50.0, 21, |_| ()));
}

#[test]
#[ignore = "needs g++"]
fn cxx_logs_along_a_motion_are_the_cpus() {
    logs::compare(&following(37.0, 15, |_| ()), &sensing());
}

#[test]
#[ignore = "needs NVRTC: tools/setup_nvrtc.sh"]
fn nvrtc_compiles_rollouts_of_other_policies() {
    let earlier = Task::new(&go2(), &with_earlier_actions(2, FrameOrder::Frames), Preset::Fast).unwrap();
    for (label, task) in [("earlier actions", earlier), ("a motion", following(50.0, 100, |_| ()))] {
        let candidates = [Candidate::nominal(&go2())];
        let period = Scene::period(&task, &candidates, 4096, PROCESSORS).unwrap();
        for mode in [Mode::Training, Mode::Trials, Mode::Logs, Mode::Steps] {
            let steps = if mode == Mode::Steps { 1 } else { 24 };
            let sizes = Sizes { steps, environments: 4096, networks: 1000, gamma: 0.99, remembered: 0, mode };
            let plan = Plan::new(&Scene::new(&task, &period, sizes).unwrap());
            let program = plan.program.option("--ptxas-options=-v");
            let compiled = compile(Nvrtc::get().unwrap(), &program, (9, 0), None).unwrap();
            println!("{label}, {mode:?}\n{}", compiled.image.log);
        }
    }
}
