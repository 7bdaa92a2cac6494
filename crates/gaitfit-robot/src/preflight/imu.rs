//! The inertial unit while the robot hangs still: gravity, orientation, bias of the gyro.

use gaitfit_model::GRAVITY;
use gaitfit_model::rotation::{Quat, Vec3, from_rpy, inverse, up};
use serde::Serialize;

use super::statistics::{Measured, deviation, mean, mean_of_blocks};
use super::turned::{angle, mean_attitude, orientation, roll_pitch_yaw, turn_between};
use super::{Check, Finding, Heard};

/// Difference of the mean length of the accelerometer's readings from gravity: a warning, and a fault, m/s².
const OFF: [f64; 2] = [0.3, 0.8];
/// Bias of the gyro that is a warning, and one that is a fault, rad/s: 0.01 rad/s adds up to 34° in a minute.
const BIAS: [f64; 2] = [0.01, 0.02];
/// Angle between orientation and accelerometer that is a fault, degrees.
const APART: f64 = 5.0;
/// Angle between orientation and accelerometer from which on another order of the quaternion is tried, degrees.
const TRIED: f64 = 2.0;
/// Part to which the other order must reduce the angle.
const SMALLER: f64 = 0.3;
/// A robot that hangs leans less than this, degrees.
const LEANS: f64 = 20.0;
/// An orientation this near to a quarter turn counts as one, degrees.
const QUARTER: f64 = 25.0;
/// Mountings that gravity can show: roll, pitch, yaw, degrees.
const MOUNTINGS: [[f64; 3]; 5] =
    [[180.0, 0.0, 0.0], [90.0, 0.0, 0.0], [-90.0, 0.0, 0.0], [0.0, 90.0, 0.0], [0.0, -90.0, 0.0]];

/// The inertial unit at rest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImuReport {
    /// Mean roll, pitch and yaw of the orientation, degrees; absent if there is none.
    pub roll_pitch_yaw: Option<[f64; 3]>,
    /// Angle between the vertical of the orientation and that of the accelerometer, degrees.
    pub apart: Option<f64>,
    /// Mean reading of the accelerometer, m/s², body frame.
    pub accelerometer: [f64; 3],
    /// Length of each reading, m/s².
    pub gravity: Measured,
    /// Noise of the accelerometer, m/s² (standard deviation).
    pub accelerometer_noise: [f64; 3],
    /// Mean reading of the gyro less the rate at which the orientation turns, rad/s.
    pub gyro_bias: [Measured; 3],
    /// Noise of the gyro, rad/s (standard deviation).
    pub gyro_noise: [f64; 3],
    /// How the unit is mounted if the robot hangs level: roll, pitch, yaw, degrees. Absent if its axes are the base's, or if
    /// this is unknown.
    pub mounting: Option<[f64; 3]>,
}

/// The inertial unit's numbers from states. Numbers that are not finite are left out.
pub(super) fn imu(heard: &[Heard]) -> ImuReport {
    let finite = |v: &[f32; 3]| v.iter().all(|x| x.is_finite());
    let rows = |vector: &dyn Fn(&Heard) -> [f32; 3]| -> [Vec<f64>; 3] {
        let kept: Vec<[f32; 3]> = heard.iter().map(vector).filter(finite).collect();
        std::array::from_fn(|k| kept.iter().map(|v| f64::from(v[k])).collect())
    };
    let accelerometer = rows(&|one| one.state.accelerometer);
    let gyro = rows(&|one| one.state.gyroscope);
    let lengths: Vec<f64> = (0..accelerometer[0].len())
        .map(|at| accelerometer.iter().map(|v| v[at].powi(2)).sum::<f64>().sqrt())
        .collect();
    // At rest an accelerometer reads the reaction to gravity, which points up.
    let pull: Vec3 = std::array::from_fn(|k| mean(&accelerometer[k]));
    let attitude = mean_attitude(heard);
    // A robot that really turned a little must not look like a gyro with a bias.
    let turned = turning(heard);
    let bias = |k: usize| {
        let Measured { value, error } = mean_of_blocks(&gyro[k]);
        Measured { value: value - turned[k], error }
    };
    ImuReport {
        roll_pitch_yaw: attitude.map(|q| roll_pitch_yaw(q).map(f64::to_degrees)),
        apart: attitude.map(|q| angle(up(q), pull).to_degrees()),
        accelerometer: pull,
        gravity: mean_of_blocks(&lengths),
        accelerometer_noise: std::array::from_fn(|k| deviation(&accelerometer[k])),
        gyro_bias: std::array::from_fn(bias),
        gyro_noise: std::array::from_fn(|k| deviation(&gyro[k])),
        mounting: None,
    }
}

/// Mean rate at which the orientation turned, rad/s, body frame.
fn turning(heard: &[Heard]) -> Vec3 {
    let mut known = heard.iter().filter_map(|one| Some((one.came, orientation(one.state.quaternion)?)));
    match (known.next(), known.next_back()) {
        (Some((begin, from)), Some((end, to))) if end > begin => {
            let seconds = (end - begin).as_secs_f64();
            turn_between(from, to).map(|x| x / seconds)
        }
        _ => [0.0; 3],
    }
}

/// Adds what is wrong with it, and writes to `report` how it is mounted.
pub(super) fn judge(report: &mut ImuReport, heard: &[Heard], simulator: bool, findings: &mut Vec<Finding>) {
    type Part = fn(&Heard) -> &[f32];
    let parts: [(&str, Part); 3] = [
        ("orientation", |one| &one.state.quaternion),
        ("gyro", |one| &one.state.gyroscope),
        ("accelerometer", |one| &one.state.accelerometer),
    ];
    // The means leave such numbers out, so these are told first.
    for (name, part) in parts {
        let wrong = heard.iter().filter(|one| part(one).iter().any(|x| !x.is_finite())).count();
        if wrong > 0 {
            findings.push(Finding::fault(
                Check::Numbers,
                format!("the {name} of the inertial unit is not finite in {wrong} states"),
                "Switch the robot off and on; if the fault stays, the unit or its cable is defective",
            ));
        }
    }
    gravity(report, simulator, findings);
    gyro(report, findings);
    // Without an orientation there is nothing more to judge.
    let Some(attitude) = mean_attitude(heard) else {
        findings.push(Finding::fault(
            Check::Attitude,
            "the orientation is no unit quaternion",
            "Switch the robot off and on; check `messages` in the robot's file",
        ));
        return;
    };
    judge_attitude(report, attitude, findings);
}

fn gravity(report: &ImuReport, simulator: bool, findings: &mut Vec<Finding>) {
    let length = report.gravity.value;
    // Simulators may leave the accelerometer out.
    if length < 0.1 {
        let problem = "the accelerometer reads 0";
        let remedy =
            "Switch the robot off and on; without it preflight cannot see how the inertial unit is mounted";
        findings.push(match simulator {
            true => Finding::warning(Check::Gravity, problem, remedy),
            false => Finding::fault(Check::Gravity, problem, remedy),
        });
    } else if (length - 1.0).abs() < 0.1 {
        findings.push(Finding::fault(
            Check::Gravity,
            format!("the accelerometer reads {length:.2} at rest: its unit is g"),
            "Multiply it by 9.81; logs state m/s²",
        ));
    } else if (length - GRAVITY).abs() > OFF[0] {
        let problem = format!("the accelerometer reads {length:.2} m/s² at rest instead of {GRAVITY}");
        let remedy = "Hold the robot still and repeat; if the fault stays, calibrate the unit with the vendor's program";
        findings.push(match (length - GRAVITY).abs() > OFF[1] {
            true => Finding::fault(Check::Gravity, problem, remedy),
            false => Finding::warning(Check::Gravity, problem, remedy),
        });
    }
}

fn gyro(report: &ImuReport, findings: &mut Vec<Finding>) {
    for (axis, bias) in ["x", "y", "z"].iter().zip(&report.gyro_bias) {
        let size = bias.value.abs();
        // A robot that swings in its ropes has no bias.
        if size < BIAS[0] || size < 3.0 * bias.error {
            continue;
        }
        let problem =
            format!("the gyro reads {:.4} ± {:.4} rad/s about {axis} at rest", bias.value, bias.error);
        let remedy = "Calibrate it, subtract it, or fit it (gyro_bias_x, gyro_bias_y, gyro_bias_z; the prior is in preflight.toml)";
        findings.push(match size >= BIAS[1] {
            true => Finding::fault(Check::GyroBias, problem, remedy),
            false => Finding::warning(Check::GyroBias, problem, remedy),
        });
    }
}

/// The orientation as it would be if its components came in the order x, y, z, w.
fn reordered(q: Quat) -> Quat {
    [q[3], q[0], q[1], q[2]]
}

fn judge_attitude(report: &mut ImuReport, attitude: Quat, findings: &mut Vec<Finding>) {
    let pull = report.accelerometer;
    let weightless = report.gravity.value < 0.1;
    // Without an accelerometer there is nothing to compare with, so no check below may fail.
    let apart = |q: Quat| if weightless { 0.0 } else { angle(up(q), pull).to_degrees() };
    let [stated, other] = [attitude, reordered(attitude)].map(apart);
    // 1. The order of the components: another order fits clearly better.
    let swapped = !weightless && stated > TRIED && other < APART.min(SMALLER * stated);
    if swapped {
        findings.push(Finding::fault(
            Check::QuaternionOrder,
            format!(
                "the quaternion's components come in the order x, y, z, w: read in this order it agrees with the accelerometer to \
                 {other:.1}°, read as w, x, y, z only to {stated:.1}°"
            ),
            "Check `messages` in the robot's file; in logs state imu.order = \"xyzw\"",
        ));
        return;
    }
    // 2. The frame: orientation and accelerometer disagree.
    if !weightless && stated > APART {
        let level = angle(up(attitude), [0.0, 0.0, 1.0]).to_degrees() < LEANS;
        let opposite = angle(up(attitude), pull.map(|x| -x)).to_degrees() < APART;
        let conjugate = apart(inverse(attitude)) < SMALLER * stated;
        let problem = if opposite && level {
            "the orientation is level and the accelerometer reads the other sign: the unit is upside down behind a corrected \
             orientation, or it reads gravity instead of the proper acceleration"
                .to_owned()
        } else if conjugate && !level {
            format!(
                "the orientation turns the other way (world to body): it is {stated:.0}° off the accelerometer, and its inverse agrees"
            )
        } else {
            format!("orientation and accelerometer disagree by {stated:.0}°: their axes differ")
        };
        findings.push(Finding::fault(
            Check::Attitude,
            problem,
            "Bring both into the base's frame: x ahead, y to the left, z up; tilt the robot by hand (--tilt) to see which is wrong",
        ));
        return;
    }
    // 3. The mounting: both agree that another axis is up.
    let leans = angle(up(attitude), [0.0, 0.0, 1.0]).to_degrees();
    let [roll, pitch, yaw] = roll_pitch_yaw(attitude).map(f64::to_degrees);
    // The heading is unknown: only the vertical shows how the unit is mounted.
    let away = |[roll, pitch, yaw]: [f64; 3]| {
        let of_base = from_rpy(roll.to_radians(), pitch.to_radians(), yaw.to_radians());
        angle(up(of_base), up(attitude)).to_degrees()
    };
    let mounted = MOUNTINGS.into_iter().min_by(|a, b| away(*a).total_cmp(&away(*b))).unwrap_or_default();
    if leans > LEANS && away(mounted) < QUARTER && away(mounted) < leans {
        report.mounting = Some(mounted);
        findings.push(Finding::fault(
            Check::Mounting,
            format!(
                "orientation and accelerometer show that the robot leans by {leans:.0}°: if it hangs level, the inertial unit is \
                 mounted {}",
                // Within QUARTER of a mounting, quarter turns lean by 65° to 115° and upside down by 155° or more.
                if leans > 150.0 { "upside down" } else { "turned by a quarter turn" }
            ),
            format!(
                "Hang the robot level. If it is, state imu.mounting = {mounted:?} (roll, pitch, yaw) in logs, and check it with \
                 --tilt"
            ),
        ));
        return;
    }
    if leans > LEANS {
        findings.push(Finding::warning(
            Check::Mounting,
            format!("the robot leans by {leans:.0}° (roll {roll:.0}°, pitch {pitch:.0}°)"),
            "Hang it level, and repeat: some checks need that",
        ));
    }
    // Level with a heading of 180° is (0, 0, 0, 1); level with a heading of 0, in the other order, is the same four
    // numbers.
    if !weightless && other < TRIED && yaw.abs() > 180.0 - TRIED {
        findings.push(Finding::warning(
            Check::QuaternionOrder,
            "the heading is 180°; this also happens if the robot is level and its quaternion comes in the order x, y, z, w",
            "Turn the robot a little, or tilt it by hand (--tilt), and repeat",
        ));
    }
}
