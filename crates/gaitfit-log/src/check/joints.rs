//! Are the log's joints the robot's?

use super::{CheckSpec, FindingKind, Findings, Severity};
use crate::names::names;
use gaitfit_model::shown;
use std::collections::HashSet;

pub(super) fn check(findings: &mut Findings, spec: &CheckSpec) {
    let Some(expected) = &spec.joints else { return };
    let log = findings.log;
    let (recorded, wanted): (HashSet<&String>, HashSet<&String>) =
        (log.joints.iter().collect(), expected.iter().collect());
    let missing: Vec<&String> = expected.iter().filter(|name| !recorded.contains(name)).collect();
    let extra: Vec<usize> =
        (0..log.joints.len()).filter(|&joint| !wanted.contains(&log.joints[joint])).collect();
    for name in &missing {
        let similar = extra
            .iter()
            .map(|&joint| &log.joints[joint])
            .find(|have| name.contains(*have) || have.contains(*name));
        let message = match similar {
            Some(have) => format!(
                "the robot's joint {} is not in the log, whose {} may be it: rename the columns",
                shown(name),
                shown(have)
            ),
            None => format!(
                "the robot's joint {} is not in the log; record it, or use a robot model without it",
                shown(name)
            ),
        };
        findings.list.push(super::Finding {
            kind: FindingKind::MissingJoint,
            severity: Severity::Error,
            joints: vec![name.to_string()],
            span: None,
            message,
        });
    }
    if !extra.is_empty() {
        let message = format!(
            "the robot lacks {} of the log; is this another robot's log? Otherwise remove these columns",
            findings.names(&extra)
        );
        findings.add(FindingKind::ExtraJoint, Severity::Error, &extra, None, message);
    }
    if missing.is_empty() && extra.is_empty() && *expected != log.joints {
        let message = format!(
            "the log has {}, the robot {}; joints are matched by name, so only code that goes by number is at risk",
            names(log.joints.iter().map(String::as_str)),
            names(expected.iter().map(String::as_str))
        );
        findings.add(FindingKind::JointOrder, Severity::Note, &[], None, message);
    }
}
