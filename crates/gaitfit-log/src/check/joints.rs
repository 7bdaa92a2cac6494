//! Are the log's joints the robot's?

use super::{CheckSpec, FindingKind, Findings, Severity};

pub(super) fn check(findings: &mut Findings, spec: &CheckSpec) {
    let Some(expected) = &spec.joints else { return };
    let log = findings.log;
    let missing: Vec<&String> = expected.iter().filter(|name| log.joint(name).is_none()).collect();
    let extra: Vec<usize> =
        (0..log.joints.len()).filter(|&joint| !expected.contains(&log.joints[joint])).collect();
    for name in &missing {
        let similar = extra
            .iter()
            .map(|&joint| &log.joints[joint])
            .find(|have| name.contains(*have) || have.contains(*name));
        let message = match similar {
            Some(have) => format!(
                "the robot's joint {name} is not in the log, whose {have} may be it: rename the columns"
            ),
            None => format!(
                "the robot's joint {name} is not in the log; record it, or use a robot model without it"
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
            "the robot has no {}; is this another robot's log? Otherwise remove these columns",
            findings.names(&extra)
        );
        findings.add(FindingKind::ExtraJoint, Severity::Error, &extra, None, message);
    }
    if missing.is_empty() && extra.is_empty() && *expected != log.joints {
        let message = format!(
            "the log has {}, the robot {}; joints are matched by name, so only code that goes by number is at risk",
            log.joints.join(", "),
            expected.join(", ")
        );
        findings.add(FindingKind::JointOrder, Severity::Note, &[], None, message);
    }
}
