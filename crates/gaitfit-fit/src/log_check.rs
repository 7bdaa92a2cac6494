//! A finding that forbids using a log forbids it everywhere, unless someone allows it by name.

use crate::Error;
use gaitfit_log::{
    CheckSpec, Finding, FindingKind, ReadOptions, Severity, Trajectory, allow, check, read_csv_report,
};
use std::path::Path;

/// Findings about parts of a log that may be cut out of it, and about joints and lengths that the caller chooses.
pub(crate) const PARTS: [FindingKind; 7] = [
    FindingKind::TimeGap,
    FindingKind::Stuck,
    FindingKind::Lying,
    FindingKind::Fallen,
    FindingKind::Hanging,
    FindingKind::MissingJoint,
    FindingKind::TooShort,
];

/// Reads a log and refuses what its checks forbid; parts in which the robot falls, hangs or is stuck are the caller's
/// to cut. `allowed`: names of findings that do not forbid.
///
/// # Errors
/// A log that cannot be read or must not be used; a name that no finding has.
pub fn read(path: &Path, allowed: &[String]) -> Result<Trajectory, Error> {
    let kind = |name: &String| {
        FindingKind::named(name).ok_or_else(|| {
            Error::settings(format!(
                "allow: no finding is called `{name}`; `gaitfit inspect` prints their names"
            ))
        })
    };
    // Names are checked first, so that a misspelt name is reported before the log is read.
    let config: Vec<FindingKind> = allowed.iter().map(kind).collect::<Result<_, _>>()?;
    let (log, report) = read_csv_report(path, &ReadOptions::default()).map_err(Error::failed)?;
    let mut findings = report.findings();
    findings.extend(check(&log, &CheckSpec::default()));
    refuse(&self::allowed(findings, &config, &report.allowed), path, &PARTS)?;
    Ok(log)
}

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
    fn logs_are_read_unless_their_findings_forbid_it() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("log.csv");
        let mut text = "time,q_a,dq_a,qdes_a\n".to_owned();
        for i in 0..100 {
            let t = f64::from(i) / 50.0;
            text += &format!("{t},{q},{dq},{q}\n", q = 0.3 * (5.0 * t).sin(), dq = 1.5 * (5.0 * t).cos());
        }
        std::fs::write(&path, text)?;
        let error = read(&path, &[]).map_or_else(|error| error.to_string(), |_| String::new());
        assert!(error.contains("target-is-position"), "{error}");
        assert_eq!(read(&path, &["target-is-position".to_owned()])?.len(), 100);
        let error =
            read(&path, &["copies".to_owned()]).map_or_else(|error| error.to_string(), |_| String::new());
        assert!(error.contains("no finding is called `copies`"), "{error}");
        Ok(())
    }

    #[test]
    fn errors_refuse_unless_they_are_allowed_or_cut() {
        let findings = vec![
            finding(FindingKind::VelocityMismatch, Severity::Warning),
            finding(FindingKind::SuspectUnit, Severity::Error),
            finding(FindingKind::Fallen, Severity::Error),
        ];
        let path = Path::new("a.csv");
        let text = refuse(&findings, path, &[FindingKind::Fallen])
            .map_or_else(|error| error.to_string(), |()| String::new());
        assert!(
            text.starts_with("a.csv: suspect-unit: something is wrong. ")
                && text.contains("[\"suspect-unit\"]"),
            "{text}"
        );
        let permitted = allowed(findings, &[FindingKind::SuspectUnit], &[]);
        assert!(refuse(&permitted, path, &[FindingKind::Fallen]).is_ok());
        assert!(refuse(&permitted, path, &[]).is_err());
        assert!(refuse(&allowed(permitted, &[], &[FindingKind::Fallen]), path, &[]).is_ok());
    }
}
