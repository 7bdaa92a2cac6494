//! Estimates from walks without a simulation as numbers that a fit can have.

use super::findings::SwingFindings;
use gaitfit_adapt::{JointParameter, RobotNumber};
use gaitfit_log::Estimate;
use gaitfit_swing::SwingReport;

/// An estimate from logs without a simulation, of a number that a fit can have.
#[derive(Clone, Debug, PartialEq)]
pub struct SwingNumber {
    /// The name of its kind, [`JointParameter::name`] or [`RobotNumber::name`].
    pub kind: &'static str,
    /// The joints, by the robot's names; empty: all, or a number of the whole robot.
    pub joints: Vec<String>,
    /// Value and standard error, in the parameter's unit.
    pub estimate: Estimate,
    /// Rise of the value where the motors' strength rises by 1.
    pub by_strength: f64,
    /// Fall of the value where the friction under load rises by 1.
    pub by_load: f64,
}

/// Max error of an estimate of the motors' strength; with a larger one it adds nothing to the usual range.
const SURE_STRENGTH: f64 = 0.1;

/// The numbers of a report, converted to a simulation with physics steps of `step` s. In semi-implicit steps targets act half
/// a step early, so the delay of the simulation is longer.
pub fn numbers(report: &SwingReport, step: f64) -> Vec<SwingNumber> {
    let mut numbers = Vec::new();
    for group in &report.groups {
        let kinds = [JointParameter::FrictionLoss, JointParameter::Damping, JointParameter::Armature];
        let estimates = [group.friction, group.damping, group.armature];
        let slopes = group.by_strength.into_iter().zip(group.by_load);
        for ((kind, estimate), (by_strength, by_load)) in kinds.into_iter().zip(estimates).zip(slopes) {
            numbers.push(SwingNumber {
                kind: kind.name(),
                joints: group.joints.clone(),
                estimate,
                by_strength,
                by_load,
            });
        }
    }
    numbers.push(SwingNumber {
        kind: JointParameter::Delay.name(),
        joints: Vec::new(),
        estimate: delay(report, step),
        by_strength: report.delay_by_strength,
        by_load: 0.0,
    });
    // A strength that is hardly known would be a prior of no use.
    if report.strength.error < SURE_STRENGTH {
        numbers.push(SwingNumber {
            kind: JointParameter::TorqueScale.name(),
            joints: Vec::new(),
            estimate: report.strength,
            by_strength: 0.0,
            by_load: 0.0,
        });
    }
    numbers
}

/// The delay in a simulation with physics steps of `step` s. No target acts before it is sent: a delay below 0 is an error of
/// at least that size. Logs of simulators with long steps, and of fast joints at 50 Hz, show such delays.
fn delay(report: &SwingReport, step: f64) -> Estimate {
    let Estimate { value, error } = report.delay;
    let value = value + step / 2.0;
    // `value.min(0.0)` is how far it lies below 0, or 0.
    Estimate { value: value.max(0.0), error: error.hypot(value.min(0.0)) }
}

/// Min standard error of a tilt, rad: on simulated robots whose unit was late and whose encoders were coarse, the estimate
/// was off by up to 0.002 rad, with standard errors of 0.0002 to 0.0007 rad.
const MIN_TILT_ERROR: f64 = 0.003;

/// Min standard error of a lag of velocities, s: on simulated walks at 50 Hz the estimate was up to 1.8 ms too large.
const MIN_LAG_ERROR: f64 = 2e-3;

/// The errors of sensors that a fit can have among its parameters, converted to a simulation with physics steps of `step` s.
/// In a semi-implicit step, velocities belong to a time half a step before the positions.
pub fn sensor_numbers(findings: &SwingFindings, step: Option<f64>) -> Vec<SwingNumber> {
    let number = |kind: RobotNumber, estimate: &Estimate| SwingNumber {
        kind: kind.name(),
        joints: Vec::new(),
        estimate: *estimate,
        by_strength: 0.0,
        by_load: 0.0,
    };
    let careful = |tilt: Estimate| Estimate { error: tilt.error.max(MIN_TILT_ERROR), ..tilt };
    let tilt = findings.tilt().into_iter().flatten().map(careful);
    let tilt = [RobotNumber::ImuRoll, RobotNumber::ImuPitch].into_iter().zip(tilt);
    let bias = [RobotNumber::GyroBiasX, RobotNumber::GyroBiasY, RobotNumber::GyroBiasZ];
    let bias = bias.into_iter().zip(findings.sensors.gyro_bias.iter().flatten().copied());
    let sensor_lag = |lag: Estimate, step: f64| Estimate {
        // The simulation has half a step of lag by itself, so a sensor's part is less. No sensor reads the
        // future.
        value: (lag.value - step / 2.0).max(0.0),
        error: lag.error.max(MIN_LAG_ERROR),
    };
    let lag = findings
        .sensors
        .velocity_lag
        .zip(step)
        .map(|(lag, step)| (RobotNumber::VelocityLag, sensor_lag(lag, step)));
    tilt.chain(bias).chain(lag).map(|(kind, estimate)| number(kind, &estimate)).collect()
}

/// The name of a parameter as a key of TOML: in quotes if it has other characters than bare keys have.
pub fn prior_key(name: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    match !name.is_empty() && name.chars().all(plain) {
        true => name.to_owned(),
        // Escapes of TOML's basic strings are those of JSON, which leaves DEL as it is. TOML does not allow it.
        false => serde_json::Value::from(name).to_string().replace('\u{7f}', "\\u007f"),
    }
}

/// The numbers as the table `[prior]` of a fit with physics steps of `step` s. Numbers of sensors are comments, because no fit
/// has them by default. The user must leave out the lines of parameters that the fit does not change.
pub fn prior_toml(findings: &SwingFindings, report: &SwingReport, step: f64) -> String {
    let mut text = format!("[prior] # by legs in the air, for physics steps of {} ms\n", 1e3 * step);
    let mut line = |kind: JointParameter, group: &str, one: Estimate, slope: f64, by_load: f64| {
        let Estimate { value, error } = one;
        let name = match group {
            "" => kind.name().to_owned(),
            _ => prior_key(&format!("{}_{group}", kind.name())),
        };
        // A prior needs a deviation above 0 in five decimals.
        let error = error.max(1e-5);
        let load = if by_load == 0.0 { String::new() } else { format!(", by_load = {by_load:.5}") };
        text += &format!(
            "{name} = {{ value = {value:.5}, deviation = {error:.5}, by_strength = {slope:.5}{load} }}\n"
        );
    };
    // `by_strength` and `by_load` have the order friction, damping, armature. The lines have another one.
    for group in &report.groups {
        line(
            JointParameter::FrictionLoss,
            &group.group,
            group.friction,
            group.by_strength[0],
            group.by_load[0],
        );
        line(JointParameter::Armature, &group.group, group.armature, group.by_strength[2], group.by_load[2]);
        line(JointParameter::Damping, &group.group, group.damping, group.by_strength[1], group.by_load[1]);
    }
    line(JointParameter::Delay, "", delay(report, step), report.delay_by_strength, 0.0);
    for SwingNumber { kind, estimate: Estimate { value, error }, .. } in sensor_numbers(findings, Some(step))
    {
        text += &format!("# {kind} = {{ value = {value:.5}, deviation = {:.5} }}\n", error.max(1e-5));
    }
    text
}
