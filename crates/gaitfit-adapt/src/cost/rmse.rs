//! The plain error that validation reports.

use super::aligned::squared_differences;
use super::{CostError, Reference, Signal};
use crate::Signals;
use serde::Serialize;

/// Root-mean-square position error of a free-running simulation, rad.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PositionRmse {
    /// Over all samples and the joints whose angles are compared.
    pub total: f64,
    /// Over all samples, one a joint in the reference's joint order; NaN for a joint whose angle is not compared.
    pub per_joint: Vec<f64>,
}

/// The position error of `simulated` (`samples × joints`, rad, pre-roll included) against recording `recording` of
/// `reference`, unscaled: √(1/(T·J) Σ (q_sim − q)²) over the samples after the pre-roll. Joints whose angles the reference
/// leaves out ([`Reference::without_angles`]) do not count.
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
    // Nothing says here where a robot fell, so every sample needs its partner.
    if counted.len() != measured.len() {
        return Err(CostError::Shape {
            signal: Signal::Position,
            recording,
            len: simulated.len(),
            expected: format!("{} samples × {width} joints", reference.samples(recording)),
        });
    }
    let samples = (measured.len() / width) as f64;
    let mut sums = squared_differences(counted, measured, width);
    // NaN marks the joint in the report and keeps it out of the total.
    for (sum, dimension) in sums.iter_mut().zip(reference.dimensions(Signal::Position).unwrap_or_default()) {
        if dimension.is_left_out() {
            *sum = f64::NAN;
        }
    }
    let compared = || sums.iter().filter(|sum| !sum.is_nan());
    Ok(PositionRmse {
        total: (compared().sum::<f64>() / (samples * compared().count() as f64)).sqrt(),
        per_joint: sums.iter().map(|sum| (sum / samples).sqrt()).collect(),
    })
}
