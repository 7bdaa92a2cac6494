//! The stance and the gait of a first task as a 3-D page: what is wrong with a guess is seen at once.

use super::anatomy::Anatomy;
use super::pose;
use crate::dress::dressed;
use crate::replay::bare;
use gaitfit_model::Model;
use gaitfit_view::replay::{Frame, Replay, ReplayRobot};

/// Frames a second (one every 20 ms), frames of the stance before the gait (1 s) and of a step (0.5 s), and steps of
/// each group.
const RATE: f64 = 50.0;
const STANDING: usize = 50;
const STEP: usize = 25;
const STEPS: usize = 3;

/// The robot on its feet, then each group of its gait in turn off the ground. Feet light up while they touch. `height`: of
/// the base, m; `angles`: rad, model order.
pub fn stance(model: &Model, anatomy: &Anatomy, angles: &[f64], height: f64) -> Replay {
    let feet: Vec<String> = anatomy.legs.iter().map(|leg| leg.foot.clone()).collect();
    let mut robot = bare(&model.name, model, &feet);
    // A foot may be a body with all its geoms.
    for (number, leg) in anatomy.legs.iter().enumerate() {
        for &geom in &leg.geoms {
            if let Some(drawn) = robot.geoms.get_mut(geom) {
                drawn.foot = Some(number);
            }
        }
    }
    let frame = |angles: &[f64], swinging: &[usize]| Frame {
        base_position: [0.0, 0.0, height],
        base_quaternion: [1.0, 0.0, 0.0, 0.0],
        // A page's joints count from the pose of the file; the model's count from their own zero.
        joints: angles.iter().zip(&model.joints).map(|(angle, joint)| angle - joint.reference).collect(),
        contacts: (0..feet.len()).map(|leg| !swinging.contains(&leg)).collect(),
        command: [0.0; 3],
        // NaN: the page then shows no velocity, because nothing moves here by itself.
        velocity: [f64::NAN; 3],
    };
    let mut frames = vec![frame(angles, &[]); STANDING];
    for group in std::iter::repeat_n(&anatomy.gait, STEPS).flatten() {
        let lifted = pose::lifted(model, anatomy, group, angles);
        frames.extend((0..STEP).map(|step| {
            // Half a sine: the foot leaves the ground, is highest in mid-swing, and comes back.
            let share = (std::f64::consts::PI * step as f64 / STEP as f64).sin();
            let between: Vec<f64> =
                angles.iter().zip(&lifted).map(|(from, to)| from + share * (to - from)).collect();
            frame(&between, group)
        }));
    }
    let robot = ReplayRobot { frames, ..dressed(robot, model) };
    Replay {
        title: format!("{}: stance and gait of a first task", model.name),
        note: "Written by gaitfit init. Feet light up while they are to touch the ground. Forward is x: right in the first view. \
               Change the stance with task.policy.default_pose, the feet with task.feet, the gait with task.gait."
            .to_owned(),
        dt: 1.0 / RATE,
        robots: vec![robot],
    }
}
