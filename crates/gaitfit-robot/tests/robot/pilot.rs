//! What a policy is given on a robot is what it is given in the simulator that it is trained in.

use std::sync::Mutex;

use gaitfit_physics::Preset;
use gaitfit_policy::follow::{Job, Script, Track, follow};
use gaitfit_policy::observation::Sensed;
use gaitfit_policy::walker::{FallSettings, Walker, WalkerOptions};
use gaitfit_policy::{Pilot, Quantity};
use gaitfit_sim::Candidate;

use crate::session::walk;

#[test]
fn a_pilot_that_senses_what_a_simulated_robot_does_acts_as_it_does_bit_for_bit() {
    let (model, policy) = (gaitfit_model::builtin::go2().unwrap(), walk());
    let options = WalkerOptions {
        substeps: 4,
        preset: Preset::Fast,
        emulated_step: None,
        max_delay: 0.0,
        feet: ["FL", "FR", "RL", "RR"].map(|leg| format!("{leg}_foot")).to_vec(),
        posture: [0.0, 0.0, -1.0],
        start_pitch: 0.0,
        fall: FallSettings { contacts: Vec::new(), tilt: 60.0, height: 0.12 },
    };
    let walker = Walker::new(&model, policy.interface.clone(), options).unwrap();
    let pose = policy.interface.model_pose(&model).unwrap();
    let commands: Vec<[f32; 3]> = (0..100).map(|k| [0.5, 0.1, if k < 50 { 0.0 } else { -0.6 }]).collect();
    let start = walker.start_from_joints(&pose, &vec![0.0; pose.len()]);
    let script = Script {
        commands: commands.clone(),
        start,
        others: Vec::new(),
        motion: Vec::new(),
        turned_back: 0.0,
        states: Vec::new(),
        actions: Vec::new(),
    };
    let job = Job { candidate: Candidate::nominal(&model), reset_every: None, seed: 0 };
    let kept = Mutex::new(Track::default());
    let keep = |_: usize, _: usize, track: &Track| *kept.lock().unwrap() = track.clone();
    follow(&walker, &policy, &[script], &[job], 1, &keep, &|| false).unwrap();
    let track = kept.into_inner().unwrap();
    assert!(track.fell_at.is_none() && track.action.len() == 12 * commands.len());

    let mut pilot = Pilot::new(&policy).unwrap();
    let mut sensed = Sensed::new(12);
    for _ in 0..2 {
        pilot.begin();
        for (sample, command) in commands.iter().enumerate() {
            let row = 12 * sample..12 * (sample + 1);
            sensed.orient(std::array::from_fn(|k| track.base_quaternion[4 * sample + k]));
            sensed.base_angular_velocity = std::array::from_fn(|k| track.base_rates[3 * sample + k]);
            sensed.command = *command;
            sensed.joint_position.copy_from_slice(&track.position[row.clone()]);
            sensed.joint_velocity.copy_from_slice(&track.velocity[row.clone()]);
            let (action, targets) = pilot.step(&mut sensed);
            assert_eq!(action, &track.action[row], "sample {sample}");
            let mut wanted = vec![0.0; 12];
            walker.targets(action, &mut wanted);
            assert!(walker.joints.iter().zip(targets).all(|(&joint, target)| wanted[joint] == *target));
        }
    }
}

#[test]
fn a_policy_that_observes_what_robots_do_not_measure_gets_no_pilot() {
    let mut policy = walk();
    policy.interface.observation[0].quantity = Quantity::BaseLinearVelocity;
    let error = Pilot::new(&policy).err().unwrap().to_string();
    assert!(error.contains("base_linear_velocity"), "{error}");
}
