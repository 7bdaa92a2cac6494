//! Estimates from legs in the air, beside the values of a fit of walking logs.

use super::method::Method;
use super::parameter::Parameter;
use super::setup::Setup;
use crate::log::Log;
use crate::walk::swing::{
    Beside, Fitted, SwingFindings, SwingNumber, SwingSettings, beside, numbers, sensor_numbers,
};
use crate::watch::{Event, Watch};
use gaitfit_adapt::{JointParameter, Theta};
use gaitfit_log::{Estimate, Gains};
use std::ops::ControlFlow;

/// Findings in the fitted logs without a simulation; absent for a clamped robot. If `watch` stops the work, they are incomplete.
pub fn findings(method: &Method, logs: &[Log], watch: &Watch<'_>) -> Option<SwingFindings> {
    let walking = method.walking()?;
    let interface = &walking.task.walker.interface;
    let settings = SwingSettings { threads: walking.threads, ..SwingSettings::default() };
    let gains = Gains { kp: interface.kp.clone(), kd: interface.kd.clone() };
    // Its progress is not shown: a search that runs at the same time shows its own.
    let stop = |_: Event<'_>| if watch.stop() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    Some(SwingFindings::of_logs(method.model(), logs, &gains, &settings, &Watch::new(&stop)))
}

/// Factor on the standard errors of estimates that could not be corrected for torque noise. Uncorrected estimates of eight
/// simulated robots were up to 3.9 standard errors off.
const NOT_CORRECTED: f64 = 2.0;

/// The estimates from legs in the air, if there are any, and those of sensors, converted to the fit's simulation.
pub fn numbers_of(method: &Method, findings: &SwingFindings) -> Vec<SwingNumber> {
    let best = findings.best().zip(targets_step(method));
    let mut joints = best.map_or_else(Vec::new, |(report, step)| numbers(report, step));
    if findings.corrected.is_none() {
        joints.iter_mut().for_each(|one| one.estimate.error *= NOT_CORRECTED);
    }
    joints.into_iter().chain(sensor_numbers(findings, targets_step(method))).collect()
}

/// Targets act half of this step early in the fit's simulation, s. It is the step of the robot for which the simulation stands,
/// or the simulation's own.
fn targets_step(method: &Method) -> Option<f64> {
    let stands_for = method.walking().and_then(|walking| walking.task.walker.batch.options().emulated_step);
    stands_for.or(method.physics_step())
}

/// The fit's values beside the estimates from swings.
pub fn compared(
    setup: &Setup,
    findings: &SwingFindings,
    theta: &Theta,
    parameters: &[Parameter],
) -> Vec<Beside> {
    let best = findings.best().zip(targets_step(&setup.method));
    let Some((report, step)) = best else { return Vec::new() };
    let fitted = |parameter: &Parameter| {
        let entry = theta.entries().iter().find(|entry| entry.name == parameter.found.name)?;
        let value = parameter.found.value;
        let (name, unit) = (entry.name.as_str(), entry.unit.as_str());
        Some(Fitted {
            name,
            kind: entry.kind,
            unit,
            joints: &entry.joints,
            value,
            interval: parameter.interval,
        })
    };
    // With one strength for all joints its error carries over; with several no single one belongs to the report.
    let strengths = theta.entries().iter().filter(|entry| entry.kind == JointParameter::TorqueScale.name());
    let mut known = strengths.filter_map(|entry| parameters.iter().find(|one| one.found.name == entry.name));
    let strength = match (known.next(), known.next()) {
        (Some(one), None) => Estimate { value: one.found.value, error: one.error() },
        _ => Estimate { value: 1.0, error: 0.0 },
    };
    beside(report, step, strength, parameters.iter().filter_map(fitted))
}
