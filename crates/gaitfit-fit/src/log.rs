//! A log as fits take it.

use crate::Error;
use gaitfit_log::Trajectory;
use std::path::PathBuf;

/// A log, or a stretch of one, ready to be compared with simulations.
#[derive(Clone, Debug)]
pub struct Log {
    /// The name by which the configuration leads to it; stretches of a log that was cut say where they begin.
    pub name: String,
    /// File in which it was found.
    pub path: PathBuf,
    /// Files beside it that were read too.
    pub sidecars: Vec<PathBuf>,
    /// The log's own names of its joints, in the trajectory's order.
    pub joints: Vec<String>,
    /// Its samples, under the robot's names: all joints in the robot's order for a clamped robot, the policy's joints in
    /// the policy's order and at the policy's rate for a walking one. Parts of the base's state that are not finite are
    /// absent.
    pub trajectory: Trajectory,
    /// Roll, pitch and yaw, degrees, of an inertial unit that the policy showed to be turned. The trajectory is turned
    /// back, its file is not. Absent if the unit is mounted as the file states.
    pub mounting: Option<[f64; 3]>,
    /// Rows that were lost and are filled by interpolation, rising: predictions of them and from them do not count.
    pub filled: Vec<usize>,
}

/// Leads of targets that differ by more than this among logs of one fit, s, make its delay wrong by as much.
const SAME_LEAD_S: f64 = 5e-4;

/// Time from rows to the stamps of the targets of `logs`, s: the middle one, as logs that are fitted together share
/// one robot. 0 where logs do not say it.
pub fn lead<'a>(logs: impl IntoIterator<Item = &'a Trajectory>) -> f64 {
    let mut leads: Vec<f64> = logs.into_iter().map(|log| log.lead.map_or(0.0, |lead| lead.seconds)).collect();
    leads.sort_by(f64::total_cmp);
    leads.get(leads.len() / 2).copied().unwrap_or(0.0)
}

/// The note of a fit of `logs` on their leads, if they have some. A replay is given the targets, so that a delay
/// counts from their stamps. In a walk (`walks`) the policy computes them from the state of the row, and a delay
/// counts from there, as in a training.
///
/// # Errors
/// Logs of a replay whose leads differ by more than half a millisecond: one delay cannot count from all of them.
pub fn lead_note(logs: &[Log], walks: bool) -> Result<Option<String>, Error> {
    let lead_of_log = |log: &Log| log.trajectory.lead.map_or(0.0, |lead| lead.seconds);
    // The extremes are enough: all others lie between them.
    let by = |a: &&Log, b: &&Log| lead_of_log(a).total_cmp(&lead_of_log(b));
    let (Some(first), Some(last)) = (logs.iter().min_by(by), logs.iter().max_by(by)) else { return Ok(None) };
    // In a walk the delay counts from the rows, so leads that differ do no harm there.
    if !walks && lead_of_log(last) - lead_of_log(first) > SAME_LEAD_S {
        return Err(Error::failed(format!(
            "{}: its targets are stamped {:.2} ms after their rows, those of {} {:.2} ms: one delay cannot count from both. \
             Fit logs of one recorder at a time, or import them all with the same --clock-offset.",
            last.name,
            1e3 * lead_of_log(last),
            first.name,
            1e3 * lead_of_log(first)
        )));
    }
    let lead = lead(logs.iter().map(|log| &log.trajectory));
    let spread =
        logs.iter().filter_map(|log| log.trajectory.lead).map(|lead| lead.spread).fold(0.0, f64::max);
    // A training counts a delay from the rows, so a value from a replay must be converted for it.
    let counts = match walks {
        true => "a delay counts from the rows, and holds these".to_owned(),
        false => format!(
            "a delay counts from the stamp. From the row it is {:.2} ms longer: add that to `randomisation.delay` of a training",
            1e3 * lead
        ),
    };
    Ok((lead != 0.0).then(|| {
        format!(
            "the targets are stamped {:.2} ms (±{:.2} ms) after the rows that they answer; {counts}",
            1e3 * lead,
            1e3 * spread
        )
    }))
}
