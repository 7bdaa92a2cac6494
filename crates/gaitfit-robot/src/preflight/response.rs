//! A joint's own equation of motion from its own motion: delay, inertia, friction, weight, and how the motor follows.
//!
//! I q̈ + b q̇ + F sign(q̇) + c₀ + c₁ (q − q̄) = kp (q*(t − d) − q) − kd q̇, multiplied by a smooth bump in time and integrated by
//! parts, so that nothing is differentiated. For each delay d the rest is linear. Bumps in which the joint is slow or reverses
//! do not count: friction at a reversal needs a model, and errors of that model look like a delay.
//!
//! The equation takes state and torque of one row as of one moment. If the state is newer by a time a, I comes out too small by
//! about kd·a and b by about kp·a.

use std::ops::Range;

use super::delays::{DELAY_STEP, DELAYS, HELD, LENGTH, STRIDE, least};
use super::gain::{Reported, reported};
use super::log::{DT, Row, SampledStates};
use super::statistics::{Measured, least_squares, mean, slope, span};

/// Min number of bumps.
const FEWEST: usize = 30;
/// Slowest motion that counts, rad/s.
const SLOWEST: f64 = 0.1;
/// An inertia is identified if it is more than so many of its standard errors.
const SEEN: f64 = 5.0;

/// Results of a joint's own motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Response {
    /// Its equation of motion; absent if it moves too slowly for one.
    pub(super) equation: Option<Equation>,
    /// Its reported torque; absent where none is reported.
    pub(super) torque: Option<Reported>,
    /// Change of the angle over change of the target.
    pub(super) follows: f64,
}

/// A joint's equation of motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Equation {
    /// Time from a target to its torque, s; absent where friction hides the inertia.
    pub(super) delay: Option<Measured>,
    /// Inertia about the axis, kg·m²; absent likewise.
    pub(super) inertia: Option<Measured>,
    /// Viscous friction, N·m·s/rad.
    pub(super) damping: Measured,
    /// Dry friction, N·m.
    pub(super) friction: Measured,
    /// Torque that holds the joint at its mean angle, N·m.
    pub(super) weight: Measured,
}

/// The motion of `motor` in `sampled.rows[window]`, whose first `slow` rows are slow. `None` if it hardly moves or the rows have
/// gaps.
pub(super) fn response(
    sampled: &SampledStates,
    window: Range<usize>,
    motor: usize,
    slow: usize,
) -> Option<Response> {
    let rows = &sampled.rows;
    let inside = rows.get(window.clone())?;
    // Rows across a gap are no motion to integrate over.
    if inside.len() < 4 * LENGTH || inside.windows(2).any(|pair| pair[1].time - pair[0].time > 1.5 * DT) {
        return None;
    }
    let angles: Vec<f64> = inside.iter().map(|row| f64::from(row.state.q[motor])).collect();
    // Such a joint gets no equation. `judge` reports it by its travel alone.
    if span(angles.iter().copied()) < 0.01 {
        return None;
    }
    // The reported torque is the fallback for the delay where friction hides the inertia.
    let torque = reported(rows, window.clone(), motor, sampled.message);
    let otherwise = torque.map_or(0.0, |torque| torque.delay.value);
    let equation = equation(rows, window.clone(), motor, mean(&angles), otherwise);
    // The motion itself is the better witness: reported torques may be late.
    let delay = equation.and_then(|equation| equation.delay).or(torque.map(|torque| torque.delay));
    let late = delay.map_or(0.0, |delay| delay.value);
    // The target is taken as late as it acts, so that a delay does not look like a joint that follows too
    // little.
    let steps = ((late + HELD) / DELAY_STEP).round().max(0.0) as usize;
    let slow = window.start..(window.start + slow).min(window.end);
    Some(Response { equation, torque, follows: follows(rows, slow, motor, steps) })
}

/// A delay in s of one in steps.
fn seconds(steps: Measured) -> Measured {
    Measured { value: DELAY_STEP * steps.value - HELD, error: DELAY_STEP * steps.error }
}

/// `otherwise`: the delay where the motion does not show it, s.
fn equation(
    rows: &[Row],
    window: Range<usize>,
    motor: usize,
    centre: f64,
    otherwise: f64,
) -> Option<Equation> {
    // For each delay the equation is linear in its five coefficients: the delay with the least squares is taken.
    let all: Vec<_> =
        (0..=DELAYS).map(|delay| equations(rows, window.clone(), motor, centre, delay)).collect();
    // Velocities alone decide which bumps count, so all delays have the same ones.
    let count = all[0].len();
    if count < FEWEST {
        return None;
    }
    let squares: Vec<f64> =
        all.iter().map(|rows| least_squares(rows).map_or(f64::INFINITY, |(_, _, left)| left)).collect();
    // Neighbouring bumps overlap, so there are fewer independent rows: a bump is effectively about LENGTH / 1.5
    // samples wide.
    let overlap = (LENGTH as f64 / (1.5 * STRIDE as f64)).sqrt();
    let best = (0..squares.len()).min_by(|a, b| squares[*a].total_cmp(&squares[*b]))?;
    if !squares[best].is_finite() {
        return None;
    }
    let delay = least(&squares, best, count, overlap);
    let solved = |at: usize| {
        let (coefficients, covariance, left) = least_squares(&all[at.min(DELAYS)])?;
        // Six degrees of freedom go to the five coefficients and the delay.
        let noise = left / count.saturating_sub(6).max(1) as f64;
        // The fifth coefficient, the change of weight with the angle, is solved for but not reported.
        Some(std::array::from_fn::<Measured, 4, _>(|k| Measured {
            value: coefficients[k],
            error: overlap * (noise * covariance[k][k].max(0.0)).sqrt(),
        }))
    };
    // At an end of the tried delays the least squares may lie outside, so they show no delay.
    let seen = |inertia: &Measured| inertia.value > SEEN * inertia.error && best > 0 && best < DELAYS;
    let [inertia, damping, friction, weight] = solved(best)?;
    if seen(&inertia) {
        // The error of the inertia holds for one delay. An error of the delay moves the inertia too.
        let neighbours = solved(best - 1).zip(solved(best + 1));
        let by_delay =
            neighbours.map_or(0.0, |([before, ..], [after, ..])| 0.5 * (after.value - before.value));
        let inertia = Measured { error: inertia.error.hypot(by_delay * delay.error), ..inertia };
        let (delay, inertia) = (Some(seconds(delay)), Some(inertia));
        return Some(Equation { delay, inertia, damping, friction, weight });
    }
    // Without a delay of its own the joint gets the one that its torque shows.
    // The steps are the inverse of `seconds`.
    let [_, damping, friction, weight] = solved(((otherwise + HELD) / DELAY_STEP).round().max(0.0) as usize)?;
    Some(Equation { delay: None, inertia: None, damping, friction, weight })
}

/// A target `delay` half rows before row `at`, rad.
fn target(rows: &[Row], at: usize, motor: usize, delay: usize) -> f64 {
    let value = |back: usize| f64::from(rows[at.saturating_sub(back)].command[motor].q);
    let whole = delay / 2;
    if delay.is_multiple_of(2) { value(whole) } else { 0.5 * (value(whole) + value(whole + 1)) }
}

/// The torque that a command makes at row `at`, N·m.
fn commanded(rows: &[Row], at: usize, motor: usize, delay: usize) -> f64 {
    let (slot, state) = (&rows[at].command[motor], &rows[at].state);
    f64::from(slot.kp) * (target(rows, at, motor, delay) - f64::from(state.q[motor]))
        - f64::from(slot.kd) * f64::from(state.dq[motor])
}

fn equations(
    rows: &[Row],
    window: Range<usize>,
    motor: usize,
    centre: f64,
    delay: usize,
) -> Vec<([f64; 5], f64)> {
    let half = 0.5 * LENGTH as f64 * DT;
    let mut equations = Vec::new();
    let mut begin = window.start;
    while begin + LENGTH <= window.end {
        let (mut row, mut right) = ([0.0; 5], 0.0);
        let velocity = |k: usize| f64::from(rows[begin + k].state.dq[motor]);
        let sign = velocity(0).signum();
        // Within a bump the joint moves one way: there friction is a constant.
        if (0..LENGTH).any(|k| sign * velocity(k) < SLOWEST) {
            begin += STRIDE;
            continue;
        }
        for k in 0..LENGTH {
            let at = begin + k;
            // Samples lie in the middles of equal parts of the bump (midpoint rule).
            let x = (k as f64 + 0.5) * DT / half - 1.0;
            // 0 at both ends, so that integration by parts leaves no boundary terms; `bent` is its derivative by
            // time.
            let bump = (1.0 - x * x).powi(3);
            let bent = -6.0 * x * (1.0 - x * x).powi(2) / half;
            let state = &rows[at].state;
            let (q, dq) = (f64::from(state.q[motor]), f64::from(state.dq[motor]));
            // Inertia (by parts), viscous friction, dry friction, weight, and its change with the angle.
            row[0] -= DT * bent * dq;
            row[1] += DT * bump * dq;
            row[2] += DT * bump * sign;
            row[3] += DT * bump;
            row[4] += DT * bump * (q - centre);
            right += DT * bump * commanded(rows, at, motor, delay);
        }
        equations.push((row, right));
        begin += STRIDE;
    }
    equations
}

fn follows(rows: &[Row], window: Range<usize>, motor: usize, delay: usize) -> f64 {
    let targets: Vec<f64> = window.clone().map(|at| target(rows, at, motor, delay)).collect();
    let angles: Vec<f64> = window.map(|at| f64::from(rows[at].state.q[motor])).collect();
    slope(&targets, &angles)
}
