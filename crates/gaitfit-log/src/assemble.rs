//! Makes a trajectory of columns, samples and metadata.

use crate::attitude::orientation_of_gravity;
use crate::check::{CheckSpec, FallSign, falls, settle_angles, settle_imu};
use crate::columns::{Layout, NO_POSITION};
use crate::finding::{Finding, FindingKind, Severity};
use crate::metadata::Metadata;
use crate::motor::{self, MotorColumns};
use crate::scale::shared_factor;
use crate::spacing::spacing;
use crate::stamps::{EvenRows, Stamps, is_news, look, rate_of_velocities};
use crate::stats::{median, short};
use crate::time_unit::recognise;
use crate::{
    BaseState, ConvertedTime, Gains, IgnoredColumn, Lead, LogError, ReadReport, TimeUnit, Trajectory,
};
use gaitfit_model::rotation::from_rpy;
use gaitfit_model::{shown, shown_number, shown_path, shown_sentence};
use std::path::Path;

/// Sample arrays, one a channel in the order of the reader's channels.
pub(crate) struct Samples {
    pub time: Vec<f64>,
    pub channels: Vec<Vec<f64>>,
}

/// Puts columns, samples and metadata together; `report` gains what assembly leaves out.
/// `every`: one row of so many was taken.
pub(crate) fn assemble(
    path: &Path,
    layout: Layout,
    mut samples: Samples,
    metadata: Metadata,
    every: usize,
    mut report: ReadReport,
) -> Result<(Trajectory, ReadReport), LogError> {
    report.ignored = layout.ignored;
    let joints = layout.joints;
    report.allowed = metadata.allow.as_ref().map_or_else(Vec::new, |allow| allow.value.clone());
    let mut gains = resolve_gains(&metadata, &joints, &mut report)?;
    let stated = stated_rate(&metadata, &mut report)?;
    report.converted_time = time_in_seconds(&mut samples, layout.time_unit, stated, joints.len())
        .map_err(|problem| LogError::Metadata { place: shown_path(path), problem })?;
    // What is stated is the rate of all rows.
    let stated = stated.map(|rate| rate / every.max(1) as f64);
    report.even_rows = even_rows(path, &mut samples, stated, joints.len())?;
    let rate_hz = match stated {
        Some(rate) => rate,
        None => measured_rate(&samples.time).ok_or_else(|| LogError::Metadata {
            place: shown_path(path),
            problem: without_rate(&samples.time),
        })?,
    };

    let lead = lead(&metadata)?;
    let mut channels = samples.channels.into_iter();
    let mut next = || channels.next().unwrap_or_default();
    // In the order in which the reader lists its channels.
    let (position, velocity, target, action, command) = (next(), next(), next(), next(), next());
    let motion = next();
    let mut base_channel = |name: &'static str, columns: Option<Vec<usize>>| {
        let values = next();
        if values.iter().all(|value| value.is_nan()) {
            for column in columns.unwrap_or_default() {
                report.ignored.push(IgnoredColumn {
                    column: column + 1,
                    name: layout.names[column].clone(),
                    reason: format!("every {name} cell is NaN"),
                });
            }
            return None;
        }
        Some(values)
    };
    let base_position = base_channel("base position", layout.base_position);
    let quaternion = base_channel("base orientation", layout.base_quaternion);
    // Angles count only where there is no quaternion.
    let angles = base_channel("roll, pitch, yaw", layout.roll_pitch_yaw).filter(|_| quaternion.is_none());
    let from_angles = angles
        .as_ref()
        .map(|angles| angles.chunks_exact(3).flat_map(|rpy| from_rpy(rpy[0], rpy[1], rpy[2])).collect());
    let linear_velocity = base_channel("base velocity", layout.base_velocity);
    let angular_velocity = base_channel("body rate", layout.base_rates);
    let from_gravity = base_channel("gravity", layout.gravity)
        .map(|gravity| orientation_of_gravity(&samples.time, &gravity, angular_velocity.as_deref()));
    let base = BaseState {
        position: base_position,
        quaternion: quaternion.or(from_angles).or(from_gravity),
        linear_velocity,
        angular_velocity,
    };
    let [kp, kd, target_velocity, feed_forward] = std::array::from_fn(|_| next());
    let columns = MotorColumns { kp, kd, target_velocity, feed_forward };
    let mut target = layout.target.map(|_| target);
    report.noticed.extend(motor::gains(&columns, &samples.time, &joints, &mut gains, &mut report.gains_from));
    report.noticed.extend(motor::fold(&columns, &joints, gains.as_ref(), target.as_mut()));
    // In the order of the file's columns.
    report.ignored.sort_by_key(|ignored| ignored.column);
    let mut trajectory = Trajectory {
        source: Some(path.to_owned()),
        robot: metadata.robot.map(|robot| robot.value),
        velocity_joints: metadata.velocity_joints.map(|names| names.value).unwrap_or_default(),
        joints,
        time: samples.time,
        rate_hz,
        position,
        velocity,
        target,
        action: layout.action.map(|_| action),
        command: layout.command.map(|_| command),
        motion: layout.motion.map(|_| motion),
        base: (base != BaseState::default()).then_some(base),
        gains,
        lead,
        simulated_step: metadata.simulated_step_s.map(|step| step.value),
        fell: metadata.fell.as_ref().is_some_and(|fell| fell.value),
    };
    // What follows relies on arrays of the right lengths.
    trajectory.validate()?;
    // A mounted unit's angles have been turned.
    if let Some(angles) = angles.filter(|_| metadata.imu.mounting.is_none()) {
        let settled = settle_angles(&mut trajectory, &angles);
        report.angles_in_degrees = settled.is_some();
        report.noticed.extend(settled);
    }
    report.noticed.extend(settle_imu(&mut trajectory, &metadata.imu));
    if metadata.fell.as_ref().is_some_and(|fell| !fell.value) {
        report.noticed.extend(fell_after_all(&trajectory));
    }
    Ok((trajectory, report))
}

/// The sample rate that the metadata states, Hz.
fn stated_rate(metadata: &Metadata, report: &mut ReadReport) -> Result<Option<f64>, LogError> {
    let Some(rate) = &metadata.rate_hz else { return Ok(None) };
    if !(rate.value.is_finite() && rate.value > 0.0) {
        return Err(LogError::Metadata {
            place: rate.place.clone(),
            problem: format!("rate_hz is {}; give a positive sample rate in Hz", shown_number(rate.value)),
        });
    }
    report.rate_from = Some(rate.place.clone());
    Ok(Some(rate.value))
}

/// Returns a finding if the log states that the robot did not fall, and shows that it did.
fn fell_after_all(log: &Trajectory) -> Option<Finding> {
    let falls = falls(log, &CheckSpec::default());
    let fall = falls.iter().find(|fall| matches!(fall.sign, FallSign::Tilt | FallSign::Height))?;
    Some(Finding {
        kind: FindingKind::Fallen,
        severity: Severity::Warning,
        joints: Vec::new(),
        span: None,
        message: format!(
            "the log states `fell = false`, and its base is tilted or low as that of a robot that fell, from {} s on: what the \
             signals show counts, and this part is cut off. If the robot stood, correct orientation or height",
            shown_number(log.time[fall.samples.start])
        ),
    })
}

/// Returns why times have no sample rate, and what to do.
fn without_rate(time: &[f64]) -> String {
    match time.windows(2).position(|pair| pair[1] < pair[0]) {
        Some(row) => format!(
            "time runs backwards, first from {} s to {} s after sample {}; sort the rows by time, or correct the time column",
            shown_number(time[row]),
            shown_number(time[row + 1]),
            row + 1
        ),
        None => "time does not say the sample rate (one sample, or time stands still); state it as `# rate_hz = 200` above the \
                 header or in the sidecar"
            .to_owned(),
    }
}

/// Converts the time column to seconds, from the unit that its name says or its values show.
fn time_in_seconds(
    samples: &mut Samples,
    named: Option<TimeUnit>,
    stated_hz: Option<f64>,
    joints: usize,
) -> Result<Option<ConvertedTime>, String> {
    let converted = match named {
        Some(TimeUnit::Seconds) => None,
        Some(unit) => Some(ConvertedTime { unit, because: "the column's name says so".to_owned() }),
        None => {
            let [position, velocity, ..] = samples.channels.as_slice() else { return Ok(None) };
            recognise(&samples.time, stated_hz, || shared_factor(&samples.time, position, velocity, joints))?
        }
    };
    if let Some(ConvertedTime { unit, .. }) = &converted {
        samples.time.iter_mut().for_each(|time| *time /= unit.per_second());
    }
    Ok(converted)
}

/// The lead of the targets that the metadata states.
fn lead(metadata: &Metadata) -> Result<Option<Lead>, LogError> {
    let (Some(stated), spread) = (&metadata.target_lead_s, &metadata.target_lead_spread_s) else {
        return Ok(None);
    };
    let lead = Lead { seconds: stated.value, spread: spread.as_ref().map_or(0.0, |spread| spread.value) };
    // Written so that NaN is refused too.
    if !(lead.seconds.abs() <= 1.0 && (0.0..=1.0).contains(&lead.spread)) {
        return Err(LogError::Metadata {
            place: stated.place.clone(),
            problem: format!(
                "target_lead_s is {}, target_lead_spread_s {}; give the seconds from a row's time to the stamp of its \
                 target, at most 1",
                shown_number(lead.seconds),
                shown_number(lead.spread)
            ),
        });
    }
    Ok(Some(lead))
}

/// Spaces rows evenly whose stamps lost their digits, where the stamps or the stated rate leave no doubt.
fn even_rows(
    path: &Path,
    samples: &mut Samples,
    stated_hz: Option<f64>,
    joints: usize,
) -> Result<Option<EvenRows>, LogError> {
    // Stamps that run backwards have another fault, which the checks name.
    if samples.time.windows(2).any(|pair| pair[1] < pair[0]) {
        return Ok(None);
    }
    let rows = samples.time.len();
    // A row that repeats the one before may rightly share its stamp.
    let is_new = |row: usize| {
        samples.channels.iter().any(|channel| {
            let width = channel.len() / rows;
            let [before, cells] = [row - 1, row].map(|row| &channel[row * width..(row + 1) * width]);
            cells.iter().zip(before).any(|(cell, before)| is_news(*cell, *before))
        })
    };
    match look(&samples.time, stated_hz, is_new) {
        Stamps::Fine => Ok(None),
        Stamps::Even(times, even) => {
            samples.time = times;
            Ok(Some(even))
        }
        Stamps::Lost(coarse, why) => {
            // If velocities and positions are of one clock, their ratio shows the rate.
            let hint = match samples.channels.as_slice() {
                [position, velocity, ..] => rate_of_velocities(position, velocity, joints),
                _ => None,
            };
            let hint = hint.map_or(String::new(), |rate| {
                format!(" (the velocities fit about {} rows a second)", short(rate))
            });
            if let Some(rate) = stated_hz {
                let rate = shown_number(rate);
                return Err(LogError::Metadata {
                    place: shown_path(path),
                    problem: format!(
                        "{coarse}. {why}: {rate} Hz is stated, so the times are wrong or the rate is{hint}. Record the times \
                         again, write evenly spaced times (row / {rate}), or correct the stated rate"
                    ),
                });
            }
            Err(LogError::Metadata {
                place: shown_path(path),
                problem: format!(
                    "{coarse}. {why}. State the rate at which the rows were sampled, as `# rate_hz = 200` above the header \
                     or in the sidecar, or import the log with `--rate 200`{hint}; the rows are then spaced evenly"
                ),
            })
        }
    }
}

fn resolve_gains(
    metadata: &Metadata,
    joints: &[String],
    report: &mut ReadReport,
) -> Result<Option<Gains>, LogError> {
    // One gain without the other is a mistake, not half a controller.
    let (kp, kd) = match (&metadata.kp, &metadata.kd) {
        (Some(kp), Some(kd)) => (kp, kd),
        (None, None) => return Ok(None),
        (Some(given), None) => return Err(lone_gain(&given.place, "kp", "kd")),
        (None, Some(given)) => return Err(lone_gain(&given.place, "kd", "kp")),
    };
    // A list of gains may be longer because a position is missing.
    let lacking = report.ignored.iter().find(|one| one.reason.starts_with(NO_POSITION));
    let refuse = |place: &str, mut problem: String| {
        if let Some(IgnoredColumn { name, reason, .. }) = lacking {
            problem.push_str(&format!(
                ". The log has the column `{}`, but {}",
                shown(name),
                shown_sentence(reason)
            ));
        }
        LogError::Metadata { place: place.to_owned(), problem }
    };
    let gains = Gains {
        kp: kp.value.resolve("kp", joints).map_err(|problem| refuse(&kp.place, problem))?,
        kd: kd.value.resolve("kd", joints).map_err(|problem| refuse(&kd.place, problem))?,
    };
    report.gains_from = Some(if kp.place == kd.place {
        kp.place.clone()
    } else {
        format!("kp: {}, kd: {}", kp.place, kd.place)
    });
    Ok(Some(gains))
}

fn lone_gain(place: &str, given: &str, lacking: &str) -> LogError {
    LogError::Metadata {
        place: place.to_owned(),
        problem: format!("{given} without {lacking}; state both gains of the PD controller"),
    }
}

/// 1 / sample interval of times in s ([`spacing`]), in Hz, rounded to a whole number where that is within 0.5 %: recorders run at
/// round rates and write rounded times. `None` when there is no interval or the median is not positive.
pub fn measured_rate(time: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // Time that stands still or runs backwards for most samples has no rate.
    median(&mut steps).filter(|step| *step > 0.0)?;
    let rate = 1.0 / spacing(time)?.step;
    if !(rate.is_finite() && rate > 0.0) {
        return None;
    }
    let whole = rate.round();
    Some(if (rate - whole).abs() <= 0.005 * whole { whole } else { rate })
}
