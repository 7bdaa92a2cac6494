//! The plain error that validation reports.

use super::aligned::squared_differences;
use super::{CostError, Reference, Signal};
use crate::Signals;
use serde::Serialize;

/// Root-mean-square position error of a free-running simulation, rad.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PositionRmse {
    /// Over all samples and joints.
    pub total: f64,
    /// Over all samples, one a joint in the reference's joint order.
    pub per_joint: Vec<f64>,
}

/// The position error of `simulated` (`samples × joints`, rad, pre-roll included) against recording `recording` of
/// `reference`, unscaled: √(1/(T·J) Σ (q_sim − q)²) over the samples after the pre-roll.
///
/// # Errors
/// [`CostError::UnknownRecording`], [`CostError::Shape`], [`CostError::NotFinite`].
pub fn position_rmse(
    reference: &Reference,
    recording: usize,
    simulated: &[f32],
) -> Result<PositionRmse, CostError> {
    let measured = reference
        .recording(Signal::Position, recording)
        .ok_or(CostError::UnknownRecording { recording, count: reference.recordings() })?;
    let counted = reference.checked(Signal::Position, recording, &Signals::of_joints(simulated, &[]))?.matrix;
    let width = reference.joints().len();
    if counted.len() != measured.len() {
        return Err(CostError::Shape {
            signal: Signal::Position,
            recording,
            len: simulated.len(),
            expected: format!("{} samples × {width} joints", reference.samples(recording)),
        });
    }
    let sums = squared_differences(counted, measured, width);
    let samples = (measured.len() / width) as f64;
    Ok(PositionRmse {
        total: (sums.iter().sum::<f64>() / measured.len() as f64).sqrt(),
        per_joint: sums.iter().map(|sum| (sum / samples).sqrt()).collect(),
    })
}
