//! A robot whose targets are sent more often than its log has them: a replay that holds them takes that for delay, armature
//! and damping.

use super::suspects::{STEPS, Suspect, TOLERANCE};
use crate::Error;
use crate::adapt::log_set::LogSet;
use crate::adapt::setup::Setup;
use gaitfit_adapt::fit::{Problem, descend};
use gaitfit_log::Trajectory;

/// Interval at which a robot is taken to get targets that its log has more seldom, s.
const FINE_S: f64 = 0.005;
/// A target that is held for longer is held by whoever sends it, s.
const HELD_S: f64 = 0.1;
/// Max rows in the place of one.
const MAX_PARTS: usize = 16;

/// Tests whether targets that move smoothly from one to the next, instead of being held, explain the logs: of a
/// robot whose targets are sent more often than the log has them. `None` where the log has every target.
pub(super) fn ramped(
    setup: &Setup,
    number: usize,
    problem: Problem<'_>,
    values: &[f64],
) -> Result<Option<Suspect>, Error> {
    let step = setup.fit.logs.iter().map(|log| log.trajectory.dt()).fold(0.0, f64::max);
    // 0.01 is rounding of the period: a log at exactly the fine interval has one part.
    let parts = ((step / FINE_S - 0.01).ceil().max(1.0) as usize).min(MAX_PARTS);
    let mut logs = setup.fit.logs.clone();
    let mut seldom = false;
    // Each log is simulated in finer steps, with targets on a curve instead of a staircase.
    for log in &mut logs {
        let mut fine = finer(&log.trajectory, parts);
        let (width, longest) = (fine.joints.len(), (HELD_S / fine.dt()) as usize);
        let held = fine.target.clone();
        // Logs without targets cannot be replayed, so all logs of a fit have them.
        if let Some(target) = fine.target.as_mut() {
            ramp(target, width, longest);
        }
        // Logs whose targets never stay still for some rows already have every target.
        seldom |= fine.target != held;
        // Samples that were filled in are counted in rows of the coarse log.
        log.filled.clear();
        log.trajectory = fine;
    }
    // With a longer step every target of the log lasts as long as one that is held on purpose.
    if !seldom || step > HELD_S {
        return Ok(None);
    }
    // In the scaling of the fit, so that both costs can be compared.
    let set = LogSet::new(&setup.config, &setup.method, &setup.base, logs)?.scaled_as(&setup.fit);
    let costs = set.costs(&setup.config)?;
    let problem = Problem { simulator: set.simulator.as_ref(), cost: costs[number].as_ref(), ..problem };
    let minimum = descend(problem, values, STEPS, TOLERANCE).map_err(Error::failed)?;
    Ok(minimum.map(|(moved, cost)| Suspect {
        what: "targets that move smoothly from one to the next".to_owned(),
        remedy: "the robot got targets more often than the log shows; record every target at the rate at which it is \
                 sent"
            .to_owned(),
        values: Vec::new(),
        cost,
        moved,
    }))
}

/// A log with `parts` rows in the place of each: targets are held, positions and velocities follow the cubic through
/// both of a row and the next.
fn finer(log: &Trajectory, parts: usize) -> Trajectory {
    let (width, rows) = (log.joints.len(), log.len().saturating_sub(1) * parts + 1);
    let step = log.dt() / parts as f64;
    let mut fine = Trajectory::of_joints(
        log.joints.clone(),
        log.rate_hz * parts as f64,
        (0..rows).map(|row| log.time.first().copied().unwrap_or(0.0) + row as f64 * step).collect(),
        Vec::with_capacity(rows * width),
        Vec::with_capacity(rows * width),
    );
    let mut target = Vec::with_capacity(rows * width);
    for row in 0..rows {
        let (from, part) = (row / parts * width, (row % parts) as f64 / parts as f64);
        // On a row of the log itself no next row is needed, and at the end there is none.
        let next = if part > 0.0 { from + width } else { from };
        for joint in 0..width {
            let q = |at: usize| log.position[at + joint];
            let v = |at: usize| log.velocity[at + joint];
            fine.position.push(cubic([q(from), q(next)], [v(from), v(next)].map(|v| v * log.dt()), part));
            // Slopes from neighbours: the positions' cubic would have the noise of their differences.
            let last = log.velocity.len() - width;
            let bend = |at: usize| 0.5 * (v((at + width).min(last)) - v(at.saturating_sub(width)));
            fine.velocity.push(cubic([v(from), v(next)], [bend(from), bend(next)], part));
        }
        target.extend(log.target.iter().flat_map(|target| &target[from..from + width]));
    }
    fine.target = Some(target).filter(|target| !target.is_empty());
    fine.gains.clone_from(&log.gains);
    fine.lead = log.lead;
    fine
}

/// The cubic with the values and slopes of two ends, `part` of the way between them (Hermite).
fn cubic([from, to]: [f64; 2], [begins, ends]: [f64; 2], part: f64) -> f64 {
    let (a, b) = (2.0 * (from - to) + begins + ends, 3.0 * (to - from) - 2.0 * begins - ends);
    from + part * (begins + part * (b + part * a))
}

/// Puts targets (rows of `width`) that are held for at most `longest` rows on smooth curves from one to the next.
fn ramp(target: &mut [f64], width: usize, longest: usize) {
    let rows = target.len() / width.max(1);
    for joint in 0..width {
        // Where a new target begins, and what it is.
        let mut knots: Vec<(usize, f64)> = Vec::new();
        for row in 0..rows {
            let value = target[row * width + joint];
            if knots.last().is_none_or(|(_, held)| *held != value) {
                knots.push((row, value));
            }
        }
        let short = |at: usize| at + 1 < knots.len() && knots[at + 1].0 - knots[at].0 <= longest;
        let slope = |at: usize| {
            // At the first target and beside a long hold the robot is at rest, so curves begin and end flat there.
            if at == 0 || !short(at - 1) || !short(at) {
                return 0.0;
            }
            let ((row, value), (end, next)) = (knots[at - 1], knots[at + 1]);
            (next - value) / (end - row) as f64
        };
        // Targets that are held for long stay steps: there the robot waits.
        for at in (0..knots.len()).filter(|at| short(*at)) {
            let ((row, held), (end, next)) = (knots[at], knots[at + 1]);
            let length = (end - row) as f64;
            let slopes = [slope(at) * length, slope(at + 1) * length];
            for place in row..end {
                target[place * width + joint] = cubic([held, next], slopes, (place - row) as f64 / length);
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn held_targets_become_curves_and_long_holds_stay() {
        let mut target = vec![0.0, 0.0, 4.0, 4.0, 4.0, 4.0, 4.0, 1.0];
        ramp(&mut target, 1, 4);
        assert_eq!(target, [0.0, 2.0, 4.0, 4.0, 4.0, 4.0, 4.0, 1.0]);
        // A wave that is held for three of four rows comes back.
        let wave = |row: usize| (0.1 * row as f64).sin();
        let mut two: Vec<f64> = (0..200).flat_map(|row| [wave(row / 4 * 4), wave(row)]).collect();
        ramp(&mut two, 2, 20);
        for row in 8..190 {
            assert!((two[2 * row] - wave(row)).abs() < 2e-3, "{row} {} {}", two[2 * row], wave(row));
            assert_eq!(two[2 * row + 1], wave(row));
        }
        ramp(&mut [], 3, 4);
    }

    #[test]
    fn a_finer_log_follows_the_motion_between_its_rows() {
        let time: Vec<f64> = (0..50).map(|row| 0.02 * f64::from(row)).collect();
        let swing = |t: &f64| (12.0 * t).sin();
        let mut log = Trajectory::of_joints(
            vec!["knee".into()],
            50.0,
            time.clone(),
            time.iter().map(swing).collect(),
            time.iter().map(|t| 12.0 * (12.0 * t).cos()).collect(),
        );
        log.target = Some(time.clone());
        let fine = finer(&log, 4);
        assert_eq!((fine.len(), fine.rate_hz, fine.target.as_ref().unwrap()[7]), (197, 200.0, 0.02));
        for (row, t) in fine.time.iter().enumerate() {
            assert!((fine.position[row] - swing(t)).abs() < 1e-5, "{row}");
            let off = (fine.velocity[row] - 12.0 * (12.0 * t).cos()).abs();
            assert!((off < 0.02 || !(4..190).contains(&row)) && off < 0.2, "{row} {off}");
        }
        assert_eq!(finer(&log, 1).position, log.position);
    }
}
