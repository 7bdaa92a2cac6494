//! The delays that are tried between a target and its torque, and the best of them.

use super::log::DT;
use super::statistics::Measured;

/// Samples of a bump: 30 ms.
pub(super) const LENGTH: usize = 15;
/// Samples from one bump to the next.
pub(super) const STRIDE: usize = 3;
/// Longest delay that is tried, in steps of [`DELAY_STEP`]: 60 ms.
pub(super) const DELAYS: usize = 60;
/// Step of the delays that are tried, s: half a row.
pub(super) const DELAY_STEP: f64 = 0.5 * DT;
/// A target holds until the next one is sent: on average it is late by half a row, s.
pub(super) const HELD: f64 = 0.5 * DT;

/// The delay with the least squares near `best`, in steps, and its error: by the noise of one of the squares, and how much they
/// overlap.
pub(super) fn least(squares: &[f64], best: usize, count: usize, overlap: f64) -> Measured {
    // The vertex of the parabola through the squares at the best delay and its two neighbours. Six degrees of
    // freedom go to the five coefficients and the delay.
    let noise = squares[best] / count.saturating_sub(6).max(1) as f64;
    let around = best.checked_sub(1).map(|at| squares[at]).zip(squares.get(best + 1).copied());
    let (fraction, error) = match around {
        Some((before, after))
            if before + after - 2.0 * squares[best] > 0.0 && (before + after).is_finite() =>
        {
            // One standard error off, the squares exceed their minimum by the noise of one of them.
            let bend = before + after - 2.0 * squares[best];
            (0.5 * (before - after) / bend, overlap * (2.0 * noise / bend).sqrt())
        }
        // At an end of the tried delays, or without a bend, there is no vertex: the error is a whole step.
        _ => (0.0, 1.0),
    };
    Measured { value: best as f64 + fraction, error }
}
