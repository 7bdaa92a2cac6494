//! Rows of observations by hand, with and without past frames.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod common;

use common::interface;
use gaitfit_policy::observation::{LastAction, Layout, Sensed};
use gaitfit_policy::{Interface, Quantity, Term};

fn two_joints() -> Interface {
    let term = |quantity, scale: &[f32]| Term { quantity, scale: scale.to_vec() };
    Interface {
        joints: vec!["a".to_owned(), "b".to_owned()],
        default_pose: vec![0.5, -1.0],
        observation: vec![
            term(Quantity::JointPosition, &[2.0]),
            term(Quantity::BaseAngularVelocity, &[1.0, 10.0, 100.0]),
            term(Quantity::LastAction, &[]),
        ],
        ..interface()
    }
}

fn sensed(k: f32) -> Sensed {
    Sensed {
        base_angular_velocity: [k, k, k],
        joint_position: vec![k, 2.0 * k],
        last_action: vec![-k, k],
        ..Sensed::new(2)
    }
}

#[test]
fn a_row_of_one_frame_a_term() {
    let interface = two_joints();
    let layout = Layout::new(&interface, &interface.observation);
    assert_eq!(layout.width(), 7);
    let mut row = [f32::NAN; 7];
    layout.write(&sensed(1.0), None, |_, _| (), &mut row);
    // (1 − 0.5) · 2 and (2 + 1) · 2; rates by their scales; the action as it was.
    assert_eq!(row, [1.0, 6.0, 1.0, 10.0, 100.0, -1.0, 1.0]);
    // Noise comes before the scale, term by term.
    let mut order = Vec::new();
    let noise = |quantity, values: &mut [f32]| {
        order.push(quantity);
        values.iter_mut().for_each(|value| *value += 1.0);
    };
    layout.write(&sensed(1.0), None, noise, &mut row);
    assert_eq!(row, [3.0, 8.0, 2.0, 20.0, 200.0, 0.0, 2.0]);
    assert_eq!(order, [Quantity::JointPosition, Quantity::BaseAngularVelocity, Quantity::LastAction]);
}

#[test]
fn past_frames_stand_before_the_present_within_each_term() {
    let interface = two_joints();
    let layout = Layout::with_frames(&interface, &interface.observation, &[3, 1, 2]);
    assert_eq!(layout.width(), 3 * 2 + 3 + 2 * 2);
    let ranges: Vec<_> = layout.slots().iter().map(|slot| (slot.range.clone(), slot.frames)).collect();
    assert_eq!(ranges, [(0..6, 3), (6..9, 1), (9..13, 2)]);
    let rows: Vec<Vec<f32>> = (1..=3).fold(Vec::new(), |mut rows, k| {
        let mut row = vec![f32::NAN; layout.width()];
        layout.write(&sensed(k as f32), rows.last().map(Vec::as_slice), |_, _| (), &mut row);
        rows.push(row);
        rows
    });
    // Positions of k: (k − 0.5) · 2 and (2 k + 1) · 2. At the start all frames show the present.
    assert_eq!(rows[0][..6], [1.0, 6.0, 1.0, 6.0, 1.0, 6.0]);
    assert_eq!(rows[1][..6], [1.0, 6.0, 1.0, 6.0, 3.0, 10.0]);
    assert_eq!(rows[2][..6], [1.0, 6.0, 3.0, 10.0, 5.0, 14.0]);
    assert_eq!(rows[2][6..9], [3.0, 30.0, 300.0]);
    assert_eq!(rows[2][9..], [-2.0, 2.0, -3.0, 3.0]);
}

#[test]
fn last_actions_begin_at_zero() {
    let mut last = LastAction::new(2, 3);
    last.take(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    last.begin(0);
    assert_eq!((last.row(0), last.row(1)), (&[0.0; 3][..], &[4.0, 5.0, 6.0][..]));
    last.set(0, &[7.0, 8.0, 9.0]);
    assert_eq!(last.rows(), [7.0, 8.0, 9.0, 4.0, 5.0, 6.0]);
}
