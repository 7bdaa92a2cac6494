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
    // A joint under a longer or shorter name is likely the same one.
    let similar = |name: &&&String| {
        extra
            .iter()
            .map(|&joint| &log.joints[joint])
            .find(|have| name.contains(*have) || have.contains(**name))
    };
    for (name, have) in missing.iter().filter_map(|name| Some((name, similar(&name)?))) {
        let message = format!(
            "the robot's joint {} is not in the log, whose {} may be it: rename the columns",
            shown(name),
            shown(have)
        );
        findings.list.push(super::Finding {
            kind: FindingKind::MissingJoint,
            severity: Severity::Error,
            joints: vec![name.to_string()],
            span: None,
            message,
        });
    }
    // Arms and heads that a policy holds still are often not recorded.
    let unrecorded: Vec<&String> = missing.iter().filter(|name| similar(name).is_none()).copied().collect();
    if !unrecorded.is_empty() {
        let one = unrecorded.len() == 1;
        let message = format!(
            "the log lacks the robot's {} {}, which {} taken to rest; if {} moved, record {}",
            if one { "joint" } else { "joints" },
            names(unrecorded.iter().map(|name| name.as_str())),
            if one { "is" } else { "are" },
            if one { "it" } else { "they" },
            if one { "it" } else { "them" },
        );
        findings.list.push(super::Finding {
            kind: FindingKind::MissingJoint,
            severity: Severity::Warning,
            joints: unrecorded.into_iter().cloned().collect(),
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
    // The same joints in another order.
    if missing.is_empty() && extra.is_empty() && *expected != log.joints {
        let message = format!(
            "the log has {}, the robot {}; joints are matched by name, so only code that goes by number is at risk",
            names(log.joints.iter().map(String::as_str)),
            names(expected.iter().map(String::as_str))
        );
        findings.add(FindingKind::JointOrder, Severity::Note, &[], None, message);
    }
}
