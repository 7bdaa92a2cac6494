//! Rows of observations by hand, with and without past frames.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::interface;
use gaitfit_policy::observation::{LastAction, Layout, Past, Sensed};
use gaitfit_policy::{FrameOrder, History, HistoryStart, Interface, Quantity, Term};

fn two_joints() -> Interface {
    let term = |quantity, scale: &[f32]| Term::new(quantity).scaled(scale);
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
fn every_quantity_is_documented_and_has_a_name_elsewhere() {
    let text = std::fs::read_to_string(common::root().join("docs/policies.md")).unwrap();
    for quantity in Quantity::ALL {
        let name = quantity.name();
        let width = match quantity.width(12) {
            12 => "joints".to_owned(),
            width => width.to_string(),
        };
        assert!(text.contains(&format!("| `{name}` | {width} | ")), "{name} is not documented");
        assert_eq!(serde_json::to_value(quantity).unwrap(), *name);
        assert!(quantity.doc().ends_with('.') && !quantity.foreign().is_empty(), "{name}");
        let count = quantity.base().map_or(0, |base| base.spreads.len());
        assert!(count <= quantity.width(12), "{name} lacks more numbers than it has");
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

/// The interface above with so many frames a term.
fn with_frames(frames: [usize; 3], history: History) -> Interface {
    let mut interface = Interface { history, critic_observation: vec![], ..two_joints() };
    for (term, frames) in interface.observation.iter_mut().zip(frames) {
        term.history = frames;
    }
    interface.robot = "two".to_owned();
    (interface.action_scale, interface.kp, interface.kd) = (vec![1.0; 2], vec![1.0; 2], vec![1.0; 2]);
    interface.check().unwrap();
    interface
}

/// Rows of the moments 1, 2 and 3.
fn three_rows(interface: &Interface) -> Vec<Vec<f32>> {
    let layout = Layout::new(interface, &interface.observation);
    assert_eq!(layout.width(), interface.observation_width());
    (1..=3).fold(Vec::new(), |mut rows, k| {
        let mut row = vec![f32::NAN; layout.width()];
        layout.write(&sensed(k as f32), rows.last().map(Vec::as_slice), |_, _| (), &mut row);
        rows.push(row);
        rows
    })
}

#[test]
fn past_frames_stand_before_the_present_within_each_term() {
    let interface = with_frames([3, 1, 2], History::default());
    let layout = Layout::new(&interface, &interface.observation);
    assert_eq!(layout.width(), 3 * 2 + 3 + 2 * 2);
    let places: Vec<_> = layout.slots().iter().map(|slot| (slot.present.clone(), &slot.frames[..])).collect();
    assert_eq!(places, [(4..6, &[0, 2, 4][..]), (6..9, &[6]), (11..13, &[9, 11])]);
    let rows = three_rows(&interface);
    // Positions of k: (k − 0.5) · 2 and (2 k + 1) · 2. At the start all frames show the present.
    assert_eq!(rows[0][..6], [1.0, 6.0, 1.0, 6.0, 1.0, 6.0]);
    assert_eq!(rows[1][..6], [1.0, 6.0, 1.0, 6.0, 3.0, 10.0]);
    assert_eq!(rows[2][..6], [1.0, 6.0, 3.0, 10.0, 5.0, 14.0]);
    assert_eq!(rows[2][6..9], [3.0, 30.0, 300.0]);
    assert_eq!(rows[2][9..], [-2.0, 2.0, -3.0, 3.0]);
    let scales = interface.scales(&interface.observation);
    assert_eq!(scales, [2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 1.0, 10.0, 100.0, 1.0, 1.0, 1.0, 1.0]);
}

#[test]
fn whole_frames_are_stacked_in_either_order() {
    // Frames of k: positions, rates, the action.
    let frame = |k: f32| [2.0 * k - 1.0, 4.0 * k + 2.0, k, 10.0 * k, 100.0 * k, -k, k];
    let history = |order, start| History { order, start };
    let oldest = with_frames([3; 3], history(FrameOrder::Frames, HistoryStart::First));
    let rows = three_rows(&oldest);
    assert_eq!(rows[0], [frame(1.0), frame(1.0), frame(1.0)].concat());
    assert_eq!(rows[1], [frame(1.0), frame(1.0), frame(2.0)].concat());
    assert_eq!(rows[2], [frame(1.0), frame(2.0), frame(3.0)].concat());
    assert_eq!(oldest.scales(&oldest.observation)[7..14], [2.0, 2.0, 1.0, 10.0, 100.0, 1.0, 1.0]);
    let newest = with_frames([3; 3], history(FrameOrder::NewestFirst, HistoryStart::Zeros));
    let rows = three_rows(&newest);
    assert_eq!(rows[0], [frame(1.0), [0.0; 7], [0.0; 7]].concat());
    assert_eq!(rows[1], [frame(2.0), frame(1.0), [0.0; 7]].concat());
    assert_eq!(rows[2], [frame(3.0), frame(2.0), frame(1.0)].concat());
}

#[test]
fn the_action_before_the_last_is_the_last_of_the_row_before() {
    let term = |quantity, scale: &[f32], history| Term::new(quantity).scaled(scale).with_history(history);
    for (order, history) in [(FrameOrder::Terms, 1), (FrameOrder::Frames, 3), (FrameOrder::NewestFirst, 2)] {
        let observation = vec![
            term(Quantity::EarlierAction, &[10.0], history),
            term(Quantity::Constant, &[7.0], history),
            term(Quantity::LastAction, &[2.0, 4.0], history),
        ];
        let interface =
            Interface { observation, ..with_frames([1; 3], History { order, start: HistoryStart::Zeros }) };
        interface.check().unwrap();
        let layout = Layout::new(&interface, &interface.observation);
        assert_eq!(layout.frames(), history + 1);
        let earlier = layout.slots()[0].present.clone();
        let rows = three_rows(&interface);
        let actions: Vec<&[f32]> = rows.iter().map(|row| &row[earlier.clone()]).collect();
        assert_eq!(actions, [[0.0, 0.0], [-10.0, 10.0], [-20.0, 20.0]], "{order:?}");
        assert!(rows.iter().all(|row| row[layout.slots()[1].present.start] == 7.0));
        assert_eq!(rows[2][layout.slots()[2].present.clone()], [-6.0, 12.0]);
        // Rows are kept for it even without a history.
        assert!(Past::new(&layout, 1).is_kept());
        // What a row's past was follows from the row.
        let mut again = vec![f32::NAN; layout.width()];
        layout.write(&sensed(3.0), Some(&layout.before(&rows[2])), |_, _| (), &mut again);
        assert_eq!(again, rows[2], "{order:?}");
    }
    let wrong = |observation: Vec<Term>| {
        let interface = Interface { observation, ..with_frames([1; 3], History::default()) };
        interface.check().unwrap_err().to_string()
    };
    let alone = wrong(vec![Term::new(Quantity::EarlierAction)]);
    assert!(alone.contains("needs last_action there too"), "{alone}");
    let zero = wrong(vec![Term::new(Quantity::EarlierAction), term(Quantity::LastAction, &[0.0], 1)]);
    assert!(zero.contains("factors other than 0"), "{zero}");
    let sine = wrong(vec![Term::new(Quantity::GaitSine)]);
    assert!(sine.contains("gait_frequency is missing"), "{sine}");
}

#[test]
fn past_rows_begin_anew_and_come_back() {
    let interface = with_frames([2; 3], History::default());
    let layout = Layout::new(&interface, &interface.observation);
    let mut past = Past::new(&layout, 2);
    assert_eq!((past.is_kept(), past.row(0)), (true, None));
    let rows: Vec<f32> = (0..28).map(|k| k as f32).collect();
    past.take(&rows);
    past.begin(0);
    assert_eq!((past.row(0), past.row(1)), (None, Some(&rows[14..])));
    let numbers: Vec<f32> = past.numbers().collect();
    let mut back = Past::new(&layout, 2);
    assert_eq!(numbers.len(), back.size());
    back.restore(&numbers);
    assert_eq!(back, past);
    past.set(0, &rows[14..]);
    assert_eq!(past.row(0), past.row(1));
    let plain = two_joints();
    let mut none = Past::new(&Layout::new(&plain, &plain.observation), 2);
    none.take(&rows);
    assert_eq!((none.size(), none.row(1)), (0, None));
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
