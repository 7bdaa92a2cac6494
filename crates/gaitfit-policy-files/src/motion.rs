//! The motion that a description names: a log, held to what a log of a motion must be.

use super::described::{Anchored, ReferenceSource};
use gaitfit_log::{CheckSpec, FindingKind, ReadOptions, Severity, allow, check, read_csv_report};
use gaitfit_policy::invalid;
use gaitfit_policy::{PolicyError, Reference};
use std::path::Path;

/// Findings that make another motion of a file. What a log of a robot must do besides, a motion need not: it may rest or lie.
const FORBID: [FindingKind; 8] = [
    FindingKind::Malformed,
    FindingKind::NonMonotonicTime,
    FindingKind::TimeGap,
    FindingKind::RateMismatch,
    FindingKind::NotFinite,
    FindingKind::SuspectUnit,
    FindingKind::VelocityMismatch,
    FindingKind::JumpsToZero,
];

impl ReferenceSource {
    /// The file's name, where there is one.
    pub(super) fn file(&self) -> Option<&str> {
        match self {
            Self::File(file) | Self::Anchored(Anchored { file, .. }) => Some(file),
            Self::Motion(_) => None,
        }
    }

    /// The motion of `joints`; files are relative to `folder`. `body`: the anchor's name, where the policy's file has it.
    pub(super) fn read(
        &self,
        folder: &Path,
        joints: &[String],
        body: Option<&str>,
    ) -> Result<Reference, PolicyError> {
        let (file, anchor, body) = match self {
            Self::Motion(reference) => return Ok(reference.clone()),
            Self::File(file) => (file, Vec::new(), body),
            // Who lists joints, or none, has looked where the anchor is.
            Self::Anchored(Anchored { file, anchor }) => {
                (file, anchor.clone().unwrap_or_default(), { if anchor.is_some() { None } else { body } })
            }
        };
        let path = folder.join(file);
        let inside = |source| PolicyError::In { path: path.clone(), source: Box::new(source) };
        // A file of settings beside it is, as a rule, the description that names this motion.
        let options = ReadOptions { sidecar: false, ..ReadOptions::default() };
        let (log, report) = read_csv_report(&path, &options)
            .map_err(|error| invalid(format!("the reference motion does not read: {error}")))?;
        let mut findings = report.findings();
        findings.extend(check(&log, &CheckSpec::default()));
        // The file's head may allow findings.
        allow(&mut findings, &report.allowed);
        let forbids = |severity, kind| severity == Severity::Error && FORBID.contains(&kind);
        if let Some(found) = findings.iter().find(|found| forbids(found.severity, found.kind)) {
            return Err(inside(invalid(format!(
                "this is no motion to follow: {found}. `gaitfit inspect` shows all findings; `# allow = [\"{}\"]` above the header \
                 uses it as it is",
                found.kind
            ))));
        }
        // Allowed faults may leave times that no even grid has.
        let log = match log.regular() {
            Ok(regular) => regular.trajectory,
            Err(error) => return Err(inside(invalid(error.to_string()))),
        };
        let mut reference =
            Reference::from_log(&log, joints, anchor).map_err(|error| inside(error.into()))?;
        reference.anchor_body = body.map(str::to_owned);
        reference.check(joints).map_err(|error| inside(error.into()))?;
        Ok(reference)
    }
}
