//! What legs in the air say, beside the values of a fit of walking logs.

use super::parameter::Parameter;
use super::setup::Setup;
use crate::walk::swing::{Beside, Fitted, SwingFindings, SwingSettings, beside};
use gaitfit_adapt::Theta;
use gaitfit_log::Gains;

/// What the fitted logs say without a simulation; absent for a clamped robot.
pub fn findings(setup: &Setup) -> Option<SwingFindings> {
    let walking = setup.method.walking()?;
    let interface = &walking.task.walker.interface;
    let gains = Gains { kp: interface.kp.clone(), kd: interface.kd.clone() };
    Some(SwingFindings::of_logs(setup.method.model(), &setup.fit.logs, &gains, &SwingSettings::default()))
}

/// The fit's values beside what swings say of them.
pub fn compared(
    setup: &Setup,
    findings: &SwingFindings,
    theta: &Theta,
    parameters: &[Parameter],
) -> Vec<Beside> {
    let (Some(report), Some(walking)) = (&findings.swings, setup.method.walking()) else { return Vec::new() };
    let step = walking.task.walker.interface.control_dt / walking.task.settings.substeps.max(1) as f64;
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
    beside(report, step, parameters.iter().filter_map(fitted))
}
