//! Logs that were not fitted: a sentence, and the distances joint by joint.

use super::Signal;
use crate::format::{clean, clean_prose, significant};
use serde::Serialize;

/// Joints shown at most.
const MAX_JOINTS: usize = 100;
const SIGNALS: [(Signal, &str); 3] =
    [(Signal::Position, "Position"), (Signal::Velocity, "Velocity"), (Signal::Action, "Action")];

/// How far simulated walks are from logs that were not fitted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeldOut {
    /// The result in a sentence.
    pub sentence: String,
    /// Whether the fit is as close to these logs as the robot is to itself; none: unknown.
    pub explained: Option<bool>,
    /// How many times closer the fitted simulator is to these logs than the one before the fit.
    pub gain: Option<f64>,
    /// Wasserstein-1 distances, one a joint and signal.
    pub distances: Vec<JointDistance>,
}

/// Wasserstein-1 distance of one joint's signal to the held-out logs, in the signal's unit; NaN when unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct JointDistance {
    /// The joint's name.
    pub joint: String,
    /// Whether the joint slides: its positions are in m.
    pub slides: bool,
    /// The signal.
    pub signal: Signal,
    /// Distance from the simulator before the fit.
    pub nominal: f64,
    /// Distance from the fitted simulator.
    pub fitted: f64,
    /// Distance of the robot's walks from each other.
    pub floor: f64,
}

impl Default for JointDistance {
    fn default() -> Self {
        let none = f64::NAN;
        Self {
            joint: String::new(),
            slides: false,
            signal: Signal::Position,
            nominal: none,
            fitted: none,
            floor: none,
        }
    }
}

/// View of held-out logs on a page.
#[derive(Serialize)]
pub(crate) struct HeldOutView {
    sentence: String,
    /// Signals that any joint has, with their units.
    signals: Vec<String>,
    rows: Vec<Row>,
    left_out: usize,
}

#[derive(Serialize)]
struct Row {
    joint: String,
    /// Nominal, fitted and floor of each signal in turn.
    cells: Vec<Cell>,
}

#[derive(Serialize)]
struct Cell {
    text: String,
    /// Whether a new signal begins here.
    first: bool,
}

/// The gain that is worth a sentence.
pub(crate) fn gain(held: &HeldOut) -> Option<f64> {
    // Less than a tenth is not worth a sentence. Beyond 1e9 the fitted distance is 0 but for rounding.
    held.gain.filter(|gain| (1.1..1e9).contains(gain))
}

/// A gain as a sentence.
pub(crate) fn gain_text(gain: f64, motion: &str) -> String {
    // Two significant digits are enough for a sentence.
    let digits = if gain < 10.0 { 1 } else { 0 };
    format!("Predicts {motion} that were not fitted {gain:.digits$} times better than the robot file")
}

pub(crate) fn view(held: &HeldOut) -> HeldOutView {
    let distances = |signal: Signal| held.distances.iter().filter(move |one| one.signal == signal);
    // A signal that nobody measured gets no columns.
    let known: Vec<(Signal, &str)> =
        SIGNALS.into_iter().filter(|(signal, _)| distances(*signal).next().is_some()).collect();
    // In the order in which the distances name them.
    let mut joints: Vec<&str> = Vec::new();
    for one in &held.distances {
        if !joints.contains(&one.joint.as_str()) {
            joints.push(&one.joint);
        }
    }
    let cells = |joint: &str, signal: Signal| -> [Cell; 3] {
        let distance = distances(signal).find(|one| one.joint == joint);
        let number = |get: fn(&JointDistance) -> f64| significant(distance.map_or(f64::NAN, get), 2);
        [number(|one| one.nominal), number(|one| one.fitted), number(|one| one.floor)]
            .map(|text| Cell { text, first: false })
    };
    let row = |joint: &&str| {
        let mut row = Vec::new();
        for (signal, _) in &known {
            let mut three = cells(joint, *signal);
            // The page draws a line there between the signals.
            three[0].first = true;
            row.extend(three);
        }
        Row { joint: clean(joint), cells: row }
    };
    let heading = |(signal, name): &(Signal, &str)| {
        let (hinge, slide) = (signal.unit(), signal.unit_of_slides());
        match (distances(*signal).any(|one| one.slides), distances(*signal).all(|one| one.slides)) {
            _ if hinge.is_empty() => (*name).to_owned(),
            (false, _) => format!("{name} ({hinge})"),
            (true, true) => format!("{name} ({slide})"),
            (true, false) => format!("{name} ({hinge}, slides: {slide})"),
        }
    };
    HeldOutView {
        sentence: clean_prose(&held.sentence),
        signals: known.iter().map(heading).collect(),
        rows: joints.iter().take(MAX_JOINTS).map(row).collect(),
        left_out: joints.len().saturating_sub(MAX_JOINTS),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_joint_has_a_row_and_a_signal_three_columns() {
        let distance = |joint: &str, signal, fitted| JointDistance {
            joint: joint.into(),
            signal,
            fitted,
            nominal: 0.5,
            floor: 0.01,
            slides: false,
        };
        let held = HeldOut {
            sentence: "as well".into(),
            explained: Some(true),
            gain: Some(4.44),
            distances: vec![
                distance("hip", Signal::Position, 0.02),
                distance("calf", Signal::Velocity, f64::NAN),
            ],
        };
        assert_eq!(
            gain(&held).map(|gain| gain_text(gain, "walks")).as_deref(),
            Some("Predicts walks that were not fitted 4.4 times better than the robot file")
        );
        assert_eq!(gain(&HeldOut { gain: Some(1.0), ..HeldOut::default() }), None);
        let slider = JointDistance { slides: true, ..distance("rail", Signal::Position, 0.1) };
        let mixed = HeldOut { distances: [&held.distances[..], &[slider]].concat(), ..held.clone() };
        assert_eq!(super::view(&mixed).signals, ["Position (rad, slides: m)", "Velocity (rad/s)"]);
        let view = view(&held);
        assert_eq!(view.signals, ["Position (rad)", "Velocity (rad/s)"]);
        let texts = |row: &Row| row.cells.iter().map(|cell| cell.text.clone()).collect::<Vec<_>>();
        assert_eq!(texts(&view.rows[0]), ["0.50", "0.020", "0.010", "–", "–", "–"]);
        assert_eq!(texts(&view.rows[1]), ["–", "–", "–", "0.50", "–", "0.010"]);
        assert!(view.rows[0].cells[3].first && !view.rows[0].cells[4].first);
    }
}
