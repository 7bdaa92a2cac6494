//! Does the inertial unit agree with itself, with gravity, and with the legs?

use super::windows::{COMMANDED, Window, runs, windows};
use super::{CheckSpec, Finding, FindingKind, Findings, Severity};
use crate::imu_fit::{self, APART, FITS, Reading, Verdict};
use crate::imu_settings::{ImuSettings, QuaternionOrder, RateFrame, RateUnit};
use crate::stats::{decimals, short};
use crate::{BaseState, Trajectory};
use gaitfit_model::rotation::{Vec3, from_rpy};

/// Bias, rad/s, that is worth a word: gyroscopes of walking robots stay below 0.017 of their filters' orientation.
const BIAS: f64 = 0.0175;
/// Lag of the rates that is worth a word, s: healthy walks show up to 1.1 ms.
const LAG: f64 = 0.0025;
/// Lag that is an error, s.
const LONG_LAG: f64 = 0.012;
/// Standard errors that a bias or a lag must exceed.
const SURE: f64 = 3.0;
/// RMS turning, rad/s, of an orientation that is not read.
const STILL: f64 = 1e-6;
/// RMS rate of a base that does not move, rad/s. A slow walk has 0.19.
const STILL_RATE: f64 = 0.03;
/// Change of the vertical of a base that does not move, rad.
const STILL_TILT: f64 = 0.02;
/// Deviation of a joint, rad, that swings a leg.
const SWINGS: f64 = 0.05;
/// Length of the mean direction of gravity of a unit that is mounted turned: a robot that tumbles has less.
const STEADY: f64 = 0.9;
/// Cosine of the angle between that direction and an axis: 30°.
const ALONG: f64 = 0.87;
/// Mean turning of the vertical, rad/s, of a base on legs that walk: one that lies does not turn.
const SWAYS: f64 = 0.05;
/// RMS joint speed, rad/s, of legs that walk.
const WALKS: f64 = 0.3;

/// Names the reading under which orientation and rates agree, in words and as settings.
fn named(reading: &Reading) -> (FindingKind, String) {
    let rates = "wx, wy, wz";
    if reading.order == QuaternionOrder::Xyzw {
        let what = "the quaternion's columns w, x, y, z hold x, y, z, w".to_owned();
        return (FindingKind::QuaternionOrder, what);
    }
    if !reading.base_axes() {
        let axes: Vec<String> = reading
            .axes
            .iter()
            .map(|(axis, sign)| {
                let sign = if (*sign < 0.0) == reading.negated { "" } else { "−" };
                // A negated reading turns all signs, so those of the axes are shown as the unit has them.
                format!("{sign}{}", ["x", "y", "z"][*axis])
            })
            .collect();
        let degrees = if reading.unit == RateUnit::Degrees { ", in degrees per second" } else { "" };
        let what = format!(
            "{rates} are rates about {} of the frame that the orientation is of{degrees}",
            axes.join(", ")
        );
        return (FindingKind::ImuMounting, what);
    }
    let mut parts = Vec::new();
    // Of several faults the last one below names the kind; the words have them all.
    let mut kind = FindingKind::ImuFrame;
    if reading.negated {
        parts.push("have the opposite sign");
        kind = FindingKind::ImuSign;
    }
    if reading.unit == RateUnit::Degrees {
        parts.push("are in degrees per second");
        kind = FindingKind::ImuUnit;
    }
    if reading.frame == RateFrame::World {
        parts.push("are in the world frame, not in the base's");
        kind = FindingKind::ImuFrame;
    }
    (kind, format!("{rates} {}", parts.join(" and ")))
}

/// The settings as lines of a log's `[imu]` table.
fn keys(settings: &ImuSettings) -> String {
    let mut keys = Vec::new();
    if settings.order == Some(QuaternionOrder::Xyzw) {
        keys.push("order = \"xyzw\"");
    }
    if settings.frame == Some(RateFrame::World) {
        keys.push("frame = \"world\"");
    }
    if settings.unit == Some(RateUnit::Degrees) {
        keys.push("unit = \"deg\"");
    }
    if settings.negated == Some(true) {
        keys.push("negated = true");
    }
    keys.join(", ")
}

fn percent(part: f64) -> String {
    format!("{:.0} %", 100.0 * part.min(99.0))
}

/// Reads `log`'s inertial unit as `stated`, and as the data show it where they leave no doubt.
/// Returns findings that say what was changed.
pub fn settle_imu(log: &mut Trajectory, stated: &ImuSettings) -> Vec<Finding> {
    // Stated settings come first; the data decide only what is left open.
    if let Some(base) = &mut log.base {
        stated.apply(base);
    }
    let Some(Verdict { as_named, better: Some((reading, left)), decided: true, .. }) = imu_fit::judge(log)
    else {
        return Vec::new();
    };
    let settings = reading.settings();
    // What someone has stated is not overruled; the checks report the disagreement.
    let contradicts = (settings.order.is_some() && stated.order.is_some())
        || (settings.frame.is_some() && stated.frame.is_some())
        || (settings.unit.is_some() && stated.unit.is_some())
        || (settings.negated.is_some() && stated.negated.is_some());
    if contradicts || stated.mounting.is_some() {
        return Vec::new();
    }
    let mut mended = log.clone();
    if let Some(base) = &mut mended.base {
        settings.apply(base);
    }
    *log = mended;
    let (kind, what) = named(&reading);
    let message = format!(
        "{what}, and were read so: of the orientation's changes the rates leave {} unexplained as they are named and {} so. \
         State it: {} in the table [imu] of log.toml",
        percent(as_named),
        percent(left),
        keys(&settings)
    );
    vec![Finding { kind, severity: Severity::Warning, joints: Vec::new(), span: None, message }]
}

/// Reads the angles `roll_pitch_yaw` (`len × 3`, rad), from which the orientation of `log` was made, as degrees where
/// the data leave no doubt: as degrees they agree with the rates, and as radians they do not.
/// Makes the orientation anew and returns a finding that says so.
pub fn settle_angles(log: &mut Trajectory, roll_pitch_yaw: &[f64]) -> Option<Finding> {
    // Angles in degrees that are read as radians agree with no reading of the rates.
    let as_named =
        imu_fit::judge(log).filter(|verdict| verdict.as_named > APART && verdict.better.is_none())?;
    let mut mended = log.clone();
    let orientation = roll_pitch_yaw
        .chunks_exact(3)
        .flat_map(|angles| from_rpy(angles[0].to_radians(), angles[1].to_radians(), angles[2].to_radians()));
    mended.base.as_mut()?.quaternion = Some(orientation.collect());
    // Taken only if orientation and rates agree in degrees.
    let so = imu_fit::judge(&mended).filter(|verdict| verdict.as_named < FITS)?;
    *log = mended;
    let message = format!(
        "roll, pitch and yaw are in degrees, and were read so: of the orientation's changes the rates leave {} unexplained as \
         radians and {} so; write them in rad",
        percent(as_named.as_named),
        percent(so.as_named)
    );
    Some(Finding {
        kind: FindingKind::ImuUnit,
        severity: Severity::Warning,
        joints: Vec::new(),
        span: None,
        message,
    })
}

/// `clock_is_right`: whether the joints show no other sample rate than the time column, by which rates are integrated.
pub(super) fn check(findings: &mut Findings, clock_is_right: bool) {
    // A log without a unit, or whose base hardly turns, cannot be judged.
    let Some(verdict) = imu_fit::judge(findings.log) else { return };
    if let Some((reading, left)) = verdict.better {
        // The remedy depends on whether the settings can express the reading.
        let (kind, what) = named(&reading);
        let settings = reading.settings();
        let remedy = match (reading.base_axes(), reading.negated && !verdict.decided) {
            (false, _) => "record both in the base's frame".to_owned(),
            (true, true) => format!(
                "state {} in the table [imu] of log.toml; if the orientation is from the world to the base, record its \
                 inverse instead",
                keys(&settings)
            ),
            (true, false) => format!("state {} in the table [imu] of log.toml", keys(&settings)),
        };
        let message = format!(
            "it seems that {what}: of the orientation's changes the rates leave {} unexplained as they are named and {} so; \
             {remedy}",
            percent(verdict.as_named),
            percent(left)
        );
        findings.add(kind, Severity::Error, &[], None, message);
        return;
    }
    // An orientation that stands still while rates do not is of another run, or not written.
    if verdict.as_named > APART && clock_is_right && verdict.rms[0] < STILL {
        let message = format!(
            "the orientation of the base does not change, and its rates (wx, wy, wz) are {} rad/s RMS: the orientation is not that \
             of this run; record both from one unit, or leave out the columns that are wrong",
            short(verdict.rms[1])
        );
        findings.add(FindingKind::ImuMismatch, Severity::Error, &[], None, message);
        return;
    }
    if verdict.as_named > APART && clock_is_right {
        let message = format!(
            "orientation and rates (wx, wy, wz) of the base do not belong together: the orientation turns by {} rad/s RMS, the \
             rates are {} rad/s RMS and leave {} of the turning unexplained, and no usual frame, unit, sign or order mends it; \
             record both from one unit, in the base's frame",
            short(verdict.rms[0]),
            short(verdict.rms[1]),
            percent(verdict.as_named)
        );
        findings.add(FindingKind::ImuMismatch, Severity::Error, &[], None, message);
        return;
    }
    // Fine faults cannot be told where the clock is wrong or the signals do not belong together.
    if !clock_is_right || verdict.as_named > APART {
        return;
    }
    let Some(fine) = imu_fit::fine(findings.log) else { return };
    // Rates of a simulator are as late as its joint velocities.
    let late = fine.lag - findings.log.known_lag();
    if fine.bias > BIAS && fine.bias > SURE * fine.bias_error {
        let message = format!(
            "the rates (wx, wy, wz) have a bias of {} rad/s against the orientation; subtract what the unit reads at rest",
            decimals(fine.bias, 3)
        );
        findings.add(FindingKind::GyroBias, Severity::Warning, &[], None, message);
    }
    if late.abs() > LAG && late.abs() > SURE * fine.lag_error {
        let severity = if late.abs() > LONG_LAG { Severity::Error } else { Severity::Warning };
        let message = format!(
            "the rates (wx, wy, wz) come {} ms {} than the orientation; record both at one moment, or shift one of them",
            decimals(1e3 * late.abs(), 1),
            if late > 0.0 { "later" } else { "earlier" }
        );
        findings.add(FindingKind::GyroLag, severity, &[], None, message);
    } else if verdict.as_named > FITS && findings.log.simulated_step.is_none() {
        let message = format!(
            "the rates (wx, wy, wz) leave {} of the orientation's turning unexplained; is one of them filtered, or are their \
             axes askew?",
            percent(verdict.as_named)
        );
        findings.add(FindingKind::ImuMismatch, Severity::Warning, &[], None, message);
    }
}

/// Direction of gravity in the base's frame at each sample with an orientation.
fn gravity(base: &BaseState) -> Vec<Vec3> {
    let quaternion = base.quaternion.as_deref().unwrap_or_default();
    let whole = |q: &&[f64]| q.iter().all(|x| x.is_finite());
    quaternion
        .chunks_exact(4)
        .filter(whole)
        .map(|q| {
            let [w, x, y, z] = [q[0], q[1], q[2], q[3]];
            [2.0 * (w * y - x * z), -2.0 * (y * z + w * x), 2.0 * (x * x + y * y) - 1.0]
        })
        .collect()
}

/// Names a unit whose axes are not the base's: gravity is along another axis from the first sample on, while the legs walk.
/// Returns whether it did, so that no fall is reported.
pub(super) fn mounting(findings: &mut Findings, spec: &CheckSpec) -> bool {
    let log = findings.log;
    let Some(base) = &log.base else { return false };
    let directions = gravity(base);
    // A robot whose posture is not level may have gravity along another axis for good.
    if directions.len() < 2 || spec.posture.is_some_and(|posture| posture[2] > -ALONG) {
        return false;
    }
    // The mean direction; its length tells how steady it is.
    let mut mean = [0.0; 3];
    for direction in &directions {
        (0..3).for_each(|k| mean[k] += direction[k] / directions.len() as f64);
    }
    let length = mean.iter().map(|x| x * x).sum::<f64>().sqrt();
    // A lying robot may have the same direction, but its legs do not walk.
    let sways = directions.windows(2).map(|pair| {
        let change: f64 = pair[0].iter().zip(pair[1]).map(|(a, b)| (a - b).powi(2)).sum();
        change.sqrt()
    });
    let walks = crate::stats::rms(&log.velocity) > WALKS && sways.sum::<f64>() > SWAYS * log.duration();
    if length < STEADY || !walks {
        return false;
    }
    let [x, y, z] = mean.map(|part| part / length);
    let (direction, mounting) = match [x, y, z] {
        [x, ..] if x > ALONG => ("+x", "[0, 90, 0]"),
        [x, ..] if x < -ALONG => ("−x", "[0, -90, 0]"),
        [_, y, _] if y > ALONG => ("+y", "[-90, 0, 0]"),
        [_, y, _] if y < -ALONG => ("−y", "[90, 0, 0]"),
        [_, _, z] if z > ALONG => ("+z (it is upside down)", "[180, 0, 0]"),
        _ => return false,
    };
    let first = directions[0].iter().zip([x, y, z]).map(|(a, b)| a * b).sum::<f64>();
    // A robot that falls over later has gravity along the base's own axis at first.
    if first < ALONG {
        return false;
    }
    // A turn about x and one about y both put a unit upside down, and gravity does not show which it was.
    let other = if z > ALONG { " or mounting = [0, 180, 0], whichever the unit is turned about" } else { "" };
    let message = format!(
        "gravity points along {direction} of the inertial unit all the time while the legs move: the unit is mounted turned, or the \
         robot lies all the time. If it is the unit, state how it is mounted, as roll, pitch and yaw of its axes in the \
         base's frame in degrees: mounting = {mounting}{other}, in the table [imu] of log.toml. A logged gravity vector must \
         point down, (0, 0, −1) when upright"
    );
    findings.add(FindingKind::ImuMounting, Severity::Error, &[], None, message);
    true
}

/// Whether the base stands still in a window in which commands ask for walking and the legs swing.
pub(super) fn hangs(log: &Trajectory, window: &Window) -> bool {
    let Some(base) = &log.base else { return false };
    // A robot whose legs hardly move may simply stand.
    let swinging = window.joints.iter().filter(|joint| joint.motion > SWINGS).count();
    if window.command < COMMANDED || 2 * swinging < window.joints.len() || swinging < 2 {
        return false;
    }
    // Samples that are not finite show no stillness.
    let part = |values: &Option<Vec<f64>>, width: usize| -> Option<Vec<f64>> {
        let values = values.as_ref()?.get(width * window.start..width * window.end)?;
        values.iter().all(|x| x.is_finite()).then(|| values.to_vec())
    };
    let rates = part(&base.angular_velocity, 3);
    let quaternion = part(&base.quaternion, 4);
    let still = |rates: &Vec<f64>| {
        let rows = rates.len() / 3;
        (rates.iter().map(|x| x * x).sum::<f64>() / rows as f64).sqrt() < STILL_RATE
    };
    let level = |quaternion: &Vec<f64>| {
        let base = BaseState { quaternion: Some(quaternion.clone()), ..BaseState::default() };
        let all = gravity(&base);
        let first = all.first().copied().unwrap_or_default();
        all.iter().all(|g| (0..3).map(|k| (g[k] - first[k]).powi(2)).sum::<f64>().sqrt() < STILL_TILT)
    };
    // A robot whose orientation alone is known may turn on the spot.
    match (&rates, &quaternion) {
        (Some(rates), Some(quaternion)) => still(rates) && level(quaternion),
        (Some(rates), None) => still(rates),
        _ => false,
    }
}

/// Names stretches in which the base stands still while the legs walk.
pub(super) fn hanging(findings: &mut Findings) {
    let log = findings.log;
    let windows = windows(log);
    let flags: Vec<bool> = windows.iter().map(|window| hangs(log, window)).collect();
    for run in runs(&flags) {
        let span = windows[run.start].start..windows[run.end - 1].end;
        let (from, to) = (log.time[span.start], log.time[span.end - 1]);
        let message = format!(
            "from {} to {} s, the base does not turn at all while commands ask for walking and the legs swing: the robot hangs \
             or is held, or its inertial unit is not read; that is no walk: leave this part out",
            decimals(from, 2),
            decimals(to, 2)
        );
        findings.add(FindingKind::Hanging, Severity::Error, &[], Some(span), message);
    }
}
