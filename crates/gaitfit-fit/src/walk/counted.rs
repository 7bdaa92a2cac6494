//! The parts of walking logs that count: stretches at the policy's rate that are long enough; and whether they are
//! enough.

use super::cuts::{Cut, CutKind};
use super::rate;
use super::recorded::{Purpose, Read};
use crate::Error;
use crate::log::Log;
use crate::settings::AdaptConfig;
use gaitfit_learn::task::Task;
use gaitfit_log::Regular;
use gaitfit_model::with_decimals;
use std::ops::Range;
use std::path::Path;

/// Counted data that a fit needs, s.
const MIN_S: f64 = 10.0;

/// The logs that are long enough to count, and warnings about the others.
pub(super) fn long_enough(logs: Vec<Log>, config: &AdaptConfig, warnings: &mut Vec<String>) -> Vec<Log> {
    let min = config.min_stretch() + config.skip_seconds();
    let (long, short): (Vec<_>, Vec<_>) = logs.into_iter().partition(|log| log.trajectory.duration() >= min);
    for log in short {
        let seconds = log.trajectory.duration();
        warnings.push(format!(
            "{}: {seconds:.2} s of data are too short to count; the minimum is {min} s",
            log.name
        ));
    }
    long
}

/// A sentence about rows that were lost within the logs and are filled, if there are some.
pub(super) fn filled(logs: &[Log]) -> Option<String> {
    let rows: usize = logs.iter().map(|log| log.filled.len()).sum();
    let with: Vec<&Log> = logs.iter().filter(|log| !log.filled.is_empty()).collect();
    let first = with.first()?;
    Some(format!(
        "{rows} lost rows within {} of {} logs (the first: {}); they are filled by interpolation, and short predictions of \
         them and from them do not count",
        with.len(),
        logs.len(),
        first.name
    ))
}

/// A stretch at the policy's rate.
pub(super) fn count(read: &Read, stretch: Range<usize>, scene: &Task) -> Result<Log, Error> {
    let whole = stretch.len() == read.trajectory.len();
    let failed =
        |error: gaitfit_log::LogError| Error::failed(format!("{}: {error}", read.file.path.display()));
    let trajectory = read.trajectory.slice(stretch).map_err(failed)?;
    let Regular { trajectory, filled, .. } =
        rate::to_control(&trajectory, scene.walker.interface.control_dt).map_err(failed)?;
    // A stretch is called by its start, so that a user finds it in the log.
    let name = if whole {
        read.file.name.clone()
    } else {
        format!("{} from {:.2} s", read.file.name, trajectory.time.first().copied().unwrap_or_default())
    };
    Ok(Log {
        name,
        path: read.file.path.clone(),
        sidecars: read.sidecars.clone(),
        joints: read.joints.clone(),
        trajectory,
        mounting: read.mounting,
        filled,
    })
}

/// Keeps the first `seconds` of a log.
pub(super) fn shorten(log: &mut Log, seconds: f64) -> Result<(), Error> {
    let samples = (seconds * log.trajectory.rate_hz).round() as usize;
    if samples < log.trajectory.len() {
        let failed = |error: gaitfit_log::LogError| Error::failed(format!("{}: {error}", log.path.display()));
        // So many periods have one sample more.
        log.trajectory = log.trajectory.slice(0..samples + 1).map_err(failed)?;
    }
    Ok(())
}

/// Refuses too little data.
pub(super) fn enough(
    purpose: Purpose,
    config: &AdaptConfig,
    config_path: &Path,
    read: usize,
    logs: &[Log],
    cuts: &[Cut],
) -> Result<(), Error> {
    let skipped = config.skip_seconds();
    // The first part of each stretch is not compared, so it does not count as data.
    let seconds: f64 = logs.iter().map(|log| log.trajectory.duration() - skipped).sum();
    let needed = match purpose {
        Purpose::Fit => MIN_S,
        Purpose::Validation => config.min_stretch(),
    };
    if seconds >= needed {
        return Ok(());
    }
    let shown = config_path.display();
    let downs = cuts.iter().filter(|cut| cut.kind != CutKind::Lost);
    // Lost samples are no sign of a robot that does not walk.
    let down: f64 = downs.clone().map(|cut| cut.to_s - cut.from_s).sum();
    let min = config.min_stretch() + skipped;
    // As many falls as logs, and nothing left: the robot is at fault, not the length of the logs.
    Err(Error::failed(if logs.is_empty() && downs.count() >= read {
        format!(
            "{shown}: in all logs the robot falls or does not walk before {min} s have passed ({}). A fit \
             needs walking: record next time with slower commands, on better ground, or with a policy that stands; \
             `gaitfit inspect` shows a log.",
            cuts.first().map_or("", |cut| &cut.reason)
        )
    } else {
        // The message names everything that took data away.
        let mut because = if down > 0.0 {
            format!(" ({down:.1} s of falls or of a robot that hangs are cut)")
        } else {
            String::new()
        };
        if skipped > 0.0 {
            because += &format!(
                " after the first {skipped} s of each (`simulation.skip_seconds`), in pieces of {} s or more",
                config.min_stretch()
            );
        }
        let horizon = config.simulation.horizon_seconds;
        if horizon > 0.0 {
            because += &format!(", at most {horizon} s of each (`simulation.horizon_seconds`)");
        }
        let seconds = with_decimals(seconds.max(0.0), 1);
        match purpose {
            Purpose::Fit => format!(
                "{shown}: the logs hold {seconds} s of walking that count{because}; a fit needs at least {MIN_S} s, \
                 and does well with some minutes: record more and longer, with varied commands."
            ),
            Purpose::Validation => format!(
                "{shown}: the validation logs hold {seconds} s of walking that count{because}; record longer ones."
            ),
        }
    }))
}
