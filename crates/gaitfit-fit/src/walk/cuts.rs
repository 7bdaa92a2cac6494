//! The parts of a log that do not count: falls with a margin, and gaps of lost samples.

use super::{policy_check, rate, tilt};
use crate::Error;
use crate::log::Log;
use gaitfit_learn::task::Task;
use gaitfit_log::{CheckSpec, Trajectory};
use gaitfit_policy::Policy;
use serde::Serialize;
use std::collections::BTreeSet;
use std::ops::Range;

/// After a fall the data count again when the robot has stood this long, s.
const STANDS_S: f64 = 1.0;

/// A part of a log that does not count.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cut {
    /// The log's name.
    pub log: String,
    /// Its start, s, the log's own time.
    pub from_s: f64,
    /// Its end, s, the log's own time.
    pub to_s: f64,
    /// Evidence for it, in words.
    pub reason: String,
    /// Why it does not count.
    pub kind: CutKind,
}

/// Why a part of a log does not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CutKind {
    /// The robot stood and fell.
    Fall,
    /// The robot does not walk: it lies from the beginning, hangs or is stuck.
    Down,
    /// Samples were lost.
    Lost,
}

impl CutKind {
    const ALL: [Self; 3] = [Self::Fall, Self::Down, Self::Lost];

    /// The beginning of a sentence about such cuts.
    fn words(self) -> &'static str {
        match self {
            Self::Fall => "the robot fell",
            Self::Down => "the robot does not walk",
            Self::Lost => "samples were lost",
        }
    }
}

/// Samples in which the robot does not walk.
pub struct Down {
    /// The samples.
    pub samples: Range<usize>,
    /// Evidence for it, in words.
    pub reason: String,
    /// Whether it is the end of a fall, if the robot stood before. One that hangs has not fallen.
    pub fall: bool,
}

/// The signs of a fall, by the task's rule: the trunk is on the ground.
pub fn fall_spec(scene: &Task) -> CheckSpec {
    let model = scene.walker.batch.model();
    let pose = |(&joint, &angle): (&usize, &f64)| (model.joints[joint].name.clone(), angle);
    CheckSpec {
        default_pose: scene
            .walker
            .joints
            .iter()
            .zip(&scene.walker.interface.default_pose)
            .map(pose)
            .collect(),
        posture: Some(scene.settings.posture),
        lying_height: Some(scene.settings.fall.height).filter(|&height| height > 0.0),
        ..CheckSpec::default()
    }
}

/// The sample ranges of `log` that count, and the cuts between them. A cut goes from `margin` s before the robot is down until it has
/// stood for a second, or covers lost samples.
pub fn keep(name: &str, log: &Trajectory, downs: &[Down], margin: f64) -> (Vec<Range<usize>>, Vec<Cut>) {
    let (time, samples) = (&log.time, log.len());
    let at = |seconds: f64| (seconds * log.rate_hz).ceil() as usize;
    let mut cuts = Vec::new();
    let mut kept = Vec::new();
    let mut begin = 0;
    for Down { samples: down, reason, fall } in downs {
        // Both cuts must stay in the log: the margin may reach before its start, the second beyond its end.
        let start = down.start.saturating_sub(at(margin));
        // A robot that is down until the log ends never stands up, so no time is added.
        let end = if down.end >= samples { samples } else { (down.end + at(STANDS_S)).min(samples) };
        // A robot that is down when its log begins has not fallen in it.
        let kind = if *fall && down.start > begin { CutKind::Fall } else { CutKind::Down };
        // The cut before may reach to the end of this one.
        if end <= begin {
            continue;
        }
        // A fall may begin within the margin of the one before; its stretch is then empty and dropped below. Its cut
        // begins where the one before ends, so that no time counts twice.
        let start = start.max(begin);
        kept.push(begin..start);
        begin = end;
        let (from_s, to_s) = (time[start], time[end - 1]);
        cuts.push(Cut { log: name.to_owned(), from_s, to_s, reason: reason.clone(), kind });
    }
    kept.push(begin..samples);
    // Second pass: stretches are split again where samples were lost.
    let mut whole = Vec::new();
    for range in kept {
        let mut begin = range.start;
        for next in range.start + 1..range.end {
            // Below 30 Hz a tenth of a second is hardly more than jitter: there three steps count.
            if time[next] - time[next - 1] > rate::LONG_GAP_S.max(3.0 * log.dt()) {
                whole.push(begin..next);
                let (from_s, to_s) = (time[next - 1], time[next]);
                let kind = CutKind::Lost;
                let reason = kind.words().to_owned();
                cuts.push(Cut { log: name.to_owned(), from_s, to_s, reason, kind });
                begin = next;
            }
        }
        whole.push(begin..range.end);
    }
    whole.retain(|range| !range.is_empty());
    (whole, cuts)
}

/// Cuts falls that only the policy felt (see [`tilt`]) out of logs without the base's orientation.
pub fn cut_felt(
    policy: &Policy,
    logs: Vec<Log>,
    margin: f64,
    cuts: &mut Vec<Cut>,
) -> Result<Vec<Log>, Error> {
    let trajectories: Vec<&Trajectory> = logs.iter().map(|log| &log.trajectory).collect();
    let spread = policy_check::spread(&trajectories, policy.interface.joints.len());
    let mut left = Vec::with_capacity(logs.len());
    for log in logs {
        // The logs are at the policy's rate here, and their earlier cuts are made.
        let leaning: Vec<_> = tilt::falls(policy, &log.trajectory, &spread)
            .into_iter()
            .map(|samples| Down {
                samples,
                reason: "the policy acts as if the base leaned by more than 50°".to_owned(),
                fall: true,
            })
            .collect();
        if leaning.is_empty() {
            left.push(log);
            continue;
        }
        let (kept, removed) = keep(&log.path.display().to_string(), &log.trajectory, &leaning, margin);
        cuts.extend(removed);
        for range in kept {
            let failed =
                |error: gaitfit_log::LogError| Error::failed(format!("{}: {error}", log.path.display()));
            // Filled rows are numbered from the start of the stretch.
            let rows = range.clone();
            let filled =
                log.filled.iter().filter(|row| rows.contains(row)).map(|row| row - rows.start).collect();
            let trajectory = log.trajectory.slice(range).map_err(failed)?;
            let name =
                format!("{} from {:.2} s", log.name, trajectory.time.first().copied().unwrap_or_default());
            left.push(Log { name, trajectory, filled, ..log.clone() });
        }
    }
    Ok(left)
}

/// Sentences about the cuts.
pub fn cut_text(cuts: &[Cut], logs: usize) -> Vec<String> {
    let mut warnings = Vec::new();
    for kind in CutKind::ALL {
        let these: Vec<&Cut> = cuts.iter().filter(|cut| cut.kind == kind).collect();
        let Some(first) = these.first() else { continue };
        let seconds: f64 = these.iter().map(|cut| cut.to_s - cut.from_s).sum();
        let names: BTreeSet<&str> = these.iter().map(|cut| cut.log.as_str()).collect();
        let why = if kind == CutKind::Lost { String::new() } else { format!(", {}", first.reason) };
        warnings.push(format!(
            "{} in {} of {logs} logs; {seconds:.1} s do not count (the first: {} from {:.2} to {:.2} s{why})",
            kind.words(),
            names.len(),
            first.log,
            first.from_s,
            first.to_s
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cuts_do_not_overlap() {
        let time: Vec<f64> = (0..500).map(|sample| 0.02 * f64::from(sample)).collect();
        let log = Trajectory::of_joints(Vec::new(), 50.0, time, Vec::new(), Vec::new());
        let down = |samples: Range<usize>| Down { samples, reason: String::new(), fall: true };
        // The margin of the second fall reaches into the cut of the first. The fourth fall lies in the cut of the third.
        let downs = [down(200..210), down(270..280), down(440..452), down(455..460)];
        let (kept, cuts) = keep("log", &log, &downs, 0.5);
        assert_eq!(kept, [0..175, 330..415]);
        let ends: Vec<_> =
            cuts.iter().map(|cut| [cut.from_s, cut.to_s].map(|s| (50.0 * s).round())).collect();
        assert_eq!(ends, [[175.0, 259.0], [260.0, 329.0], [415.0, 499.0]]);
    }
}
