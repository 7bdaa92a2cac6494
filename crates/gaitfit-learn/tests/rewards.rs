//! Every reward term by name, against a value worked out by hand.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

#[path = "rewards/expressions.rs"]
mod expressions;
#[path = "rewards/loops.rs"]
mod loops;
use crate::task_common;

use gaitfit_learn::task::expression::{Expression, Names};
use gaitfit_learn::task::{Foot, Moment, Task, reward};
use task_common::{built_in, calm, scene};

const ZEROS: [f32; 12] = [0.0; 12];

/// A robot that stands as it should, commanded to walk.
fn moment<'a>(scene: &'a Task, feet: &'a [Foot]) -> Moment<'a> {
    Moment {
        task: scene,
        command: [0.5, -0.2, 0.3],
        walking: true,
        velocity: [0.0; 3],
        angular_velocity: [0.0; 3],
        yaw_rate: 0.0,
        gravity: [0.0, 0.0, -1.0],
        uprightness: 1.0,
        height: scene.settings.height as f32,
        joint_position: &scene.walker.default_pose,
        joint_velocity: &ZEROS,
        joint_acceleration: &ZEROS,
        torque: &ZEROS,
        target: &ZEROS,
        action: &ZEROS,
        last_action: &ZEROS,
        feet,
        body_contacts: 0,
        clock: 0.0,
        fallen: false,
    }
}

fn value(name: &str, moment: &Moment<'_>) -> f32 {
    let term = reward::TERMS.iter().find(|term| term.name == name).unwrap();
    let names = Names::new(&moment.task.settings, &moment.task.walker);
    Expression::new(term.text, &names).unwrap().value(moment)
}

#[track_caller]
fn expect(name: &str, moment: &Moment<'_>, wanted: f64) {
    let found = f64::from(value(name, moment));
    assert!((found - wanted).abs() <= 1e-5 * wanted.abs().max(1.0), "{name} is {found}, by hand {wanted}");
}

fn down() -> Foot {
    Foot { touching: true, contact: 0.1, ..Foot::default() }
}

fn up(air: f32, height: f32) -> Foot {
    Foot { air, height, ..Foot::default() }
}

#[test]
fn tracking_terms() {
    let scene = scene(&calm());
    assert_eq!((scene.settings.tracking_width, scene.walker.interface.control_dt), (0.5, 0.02));
    let feet = [down(); 4];
    let still = moment(&scene, &feet);
    // |(0, 0) − (0.5, −0.2)|² = 0.29; width² = 0.25. Vertical speed does not count.
    let rising = Moment { velocity: [0.0, 0.0, 3.0], ..moment(&scene, &feet) };
    expect("track_linear_velocity", &rising, (-0.29f64 / 0.25).exp());
    let perfect = Moment { velocity: [0.5, -0.2, 0.0], yaw_rate: 0.3, ..moment(&scene, &feet) };
    expect("track_linear_velocity", &perfect, 1.0);
    expect("track_yaw_rate", &perfect, 1.0);
    expect("track_yaw_rate", &still, (-0.09f64 / 0.25).exp());
    let falling = Moment { velocity: [1.0, 1.0, -0.3], ..moment(&scene, &feet) };
    expect("vertical_velocity", &falling, 0.09);
    // 0.1² + 0.2² + 0.5² less the turn about the vertical.
    let turning = Moment { angular_velocity: [0.1, -0.2, 0.5], yaw_rate: 0.5, ..moment(&scene, &feet) };
    expect("roll_pitch_rate", &turning, 0.05);
    let tilted = Moment { uprightness: 30f32.to_radians().cos(), ..moment(&scene, &feet) };
    expect("posture", &still, 0.0);
    expect("posture", &tilted, 0.25);
    expect("height", &still, 1.0);
    let low = Moment { height: still.height - 0.05, ..moment(&scene, &feet) };
    expect("height", &low, (-0.25f64).exp());
    // Paid once: a step pays by its duration of 0.02 s.
    expect("fall", &still, 0.0);
    expect("fall", &Moment { fallen: true, ..moment(&scene, &feet) }, 50.0);
}

#[test]
fn effort_terms() {
    let scene = scene(&calm());
    let feet = [down(); 4];
    let (mut ramp, mut ones) = ([0.0; 12], [1.0; 12]);
    for (j, slot) in ramp.iter_mut().enumerate() {
        *slot = j as f32;
    }
    // 0² + 1² + … + 11² = 506.
    expect("torque", &Moment { torque: &ramp, ..moment(&scene, &feet) }, 506.0);
    // 0·1 + 1·1 + … + 11·1 = 66 of any sign.
    let braking = ramp.map(|torque| -torque);
    expect("power", &Moment { torque: &braking, joint_velocity: &ones, ..moment(&scene, &feet) }, 66.0);
    expect("joint_acceleration", &Moment { joint_acceleration: &ramp, ..moment(&scene, &feet) }, 506.0);
    // (−1)² + 0² + … + 10² = 386.
    expect("action_rate", &Moment { action: &ramp, last_action: &ones, ..moment(&scene, &feet) }, 386.0);
    for (slot, home) in ones.iter_mut().zip(&scene.walker.default_pose) {
        *slot = home + 0.1;
    }
    let walking = Moment { joint_position: &ones, ..moment(&scene, &feet) };
    let standing = Moment { joint_position: &ones, walking: false, ..moment(&scene, &feet) };
    expect("joint_deviation", &walking, 0.12);
    expect("joint_deviation", &standing, 0.12);
    expect("stand_still", &walking, 0.0);
    expect("stand_still", &standing, 0.12);
}

#[test]
fn gait_terms() {
    let scene = scene(&calm());
    let settings = &scene.settings;
    assert_eq!(scene.gait_group, [Some(0), Some(1), Some(1), Some(0)], "a trot: FL with RR, FR with RL");
    assert_eq!((settings.swing_seconds, settings.swing_height), (0.25, 0.10));
    let idle = |feet| Moment { walking: false, ..moment(&scene, feet) };

    // One foot lands after half the wanted time, one after more than all of it, one did not land now.
    let landed = |last_air| Foot { landed: true, last_air, ..down() };
    let feet = [landed(0.125), landed(0.4), Foot { last_air: 0.25, ..down() }, up(0.2, 0.1)];
    expect("air_time", &moment(&scene, &feet), (0.25 + 1.0) / 0.02);
    expect("air_time", &idle(&feet), 0.0);

    let trot = [down(), up(0.1, 0.05), up(0.1, 0.2), down()];
    expect("gait", &moment(&scene, &trot), 1.0);
    expect("gait", &idle(&trot), 0.0);
    // Of six pairs only the two diagonals agree in a robot that stands on four feet, or jumps with all.
    expect("gait", &moment(&scene, &[down(); 4]), 2.0 / 6.0);
    expect("gait", &moment(&scene, &[up(0.1, 0.1); 4]), 2.0 / 6.0);
    // A pace: the pairs that agree are FL with FR and RL with RR, as their feet differ.
    expect("gait", &moment(&scene, &[down(), up(0.1, 0.1), down(), up(0.1, 0.1)]), 2.0 / 6.0);
    // FL has stood for longer than twice 0.25 s: its three pairs no longer count.
    let stuck = [Foot { contact: 0.51, ..down() }, trot[1], trot[2], trot[3]];
    expect("gait", &moment(&scene, &stuck), 0.5);

    // Half the height, more than the height, two on the ground: (0.5 + 1 + 0 + 0)/4.
    expect("swing_height", &moment(&scene, &trot), 0.375);
    expect("swing_height", &idle(&trot), 0.0);
    let held = [trot[0], up(0.51, 0.1), trot[2], trot[3]];
    expect("swing_height", &moment(&scene, &held), 0.25);

    let slipping = |speed| Foot { speed, ..down() };
    let feet = [slipping(0.3), slipping(0.4), Foot { speed: 2.0, ..up(0.1, 0.1) }, down()];
    expect("foot_slip", &moment(&scene, &feet), 0.25);
    expect("undesired_contact", &Moment { body_contacts: 3, ..moment(&scene, &feet) }, 3.0);
}

#[test]
fn two_legged_terms() {
    let scene = scene(&built_in("biped"));
    assert_eq!(scene.gait_group, [None, None, Some(0), Some(1)]);
    let feet = [up(1.0, 0.1), up(1.0, 0.4), down(), up(0.1, 0.05)];
    let at = |uprightness, clock| Moment { uprightness, clock, ..moment(&scene, &feet) };
    expect("upright", &at(1.0, 0.0), 1.0);
    expect("upright", &at(0.0, 0.0), 0.25);
    expect("upright", &at(-1.0, 0.0), 0.0);
    // 0.1 m, and 0.4 m that counts as 0.25 m; hind feet do not count.
    expect("front_feet_height", &at(1.0, 0.0), 0.35);
    expect("front_contact", &at(1.0, 0.0), 0.0);
    let mut pawing = feet;
    pawing[1] = down();
    expect("front_contact", &moment(&scene, &pawing), 1.0);
    // The left hind foot stands in the first half of the clock, the right one in the second.
    expect("step_clock", &at(1.0, 0.25), 1.0);
    expect("step_clock", &at(1.0, 0.75), 0.0);
    let both = [feet[0], feet[1], down(), down()];
    expect("step_clock", &Moment { clock: 0.25, ..moment(&scene, &both) }, 0.5);
}

#[test]
fn every_term_is_worked_out_above() {
    let here = include_str!("rewards.rs");
    for term in reward::TERMS {
        assert!(here.contains(&format!("\"{}\", ", term.name)), "{} has no value by hand", term.name);
    }
}
