//! A finding that forbids using a log forbids it everywhere, unless someone allows it by name.

use crate::Error;
use gaitfit_log::{Finding, FindingKind, Severity, allow};
use std::path::Path;

/// `findings` with those that the configuration or the log allows as warnings.
pub fn allowed(mut findings: Vec<Finding>, config: &[FindingKind], log: &[FindingKind]) -> Vec<Finding> {
    allow(&mut findings, config);
    allow(&mut findings, log);
    findings
}

/// Refuses a log with findings that are errors; those of the kinds `but` concern parts that are left out.
///
/// # Errors
/// The first such finding, its name, and how to allow it.
pub fn refuse(findings: &[Finding], path: &Path, but: &[FindingKind]) -> Result<(), Error> {
    let forbids = |finding: &&Finding| finding.severity == Severity::Error && !but.contains(&finding.kind);
    let Some(finding) = findings.iter().find(forbids) else { return Ok(()) };
    let others = findings.iter().filter(forbids).count() - 1;
    let more = match others {
        0 => String::new(),
        1 => " (and one finding more)".to_owned(),
        more => format!(" (and {more} findings more)"),
    };
    Err(Error::failed(format!(
        "{}: {}: {}{more}. `gaitfit inspect` shows the log: cut or repair it. If it is right as it is, allow = [\"{}\"] in the \
         configuration uses it.",
        path.display(),
        finding.kind,
        finding.message.trim_end_matches('.'),
        finding.kind
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finding(kind: FindingKind, severity: Severity) -> Finding {
        Finding { kind, severity, joints: Vec::new(), span: None, message: "something is wrong".into() }
    }

    #[test]
    fn errors_refuse_unless_they_are_allowed_or_cut() {
        let all = vec![
            finding(FindingKind::VelocityMismatch, Severity::Warning),
            finding(FindingKind::SuspectUnit, Severity::Error),
            finding(FindingKind::Fallen, Severity::Error),
        ];
        let path = Path::new("a.csv");
        let text = refuse(&all, path, &[FindingKind::Fallen])
            .map_or_else(|error| error.to_string(), |()| String::new());
        assert!(
            text.starts_with("a.csv: suspect-unit: something is wrong. ")
                && text.contains("[\"suspect-unit\"]"),
            "{text}"
        );
        let permitted = allowed(all, &[FindingKind::SuspectUnit], &[]);
        assert!(refuse(&permitted, path, &[FindingKind::Fallen]).is_ok());
        assert!(refuse(&permitted, path, &[]).is_err());
        assert!(refuse(&allowed(permitted, &[], &[FindingKind::Fallen]), path, &[]).is_ok());
    }
}
