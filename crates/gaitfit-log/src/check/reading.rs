//! Findings of the reader.

use super::{Finding, FindingKind, Severity};
use crate::{ConvertedTime, EvenRows, ReadReport};

impl ReadReport {
    /// Notes about the reading, in the form of the checks' findings.
    pub fn findings(&self) -> Vec<Finding> {
        let note = |ConvertedTime { unit, because }: &ConvertedTime| Finding {
            kind: FindingKind::TimeUnit,
            severity: Severity::Note,
            joints: Vec::new(),
            span: None,
            message: format!("the time column is in {unit} ({because}); it was converted to seconds"),
        };
        let even = |even: &EvenRows| Finding {
            kind: FindingKind::CoarseTime,
            severity: Severity::Warning,
            joints: Vec::new(),
            span: None,
            message: even.to_string(),
        };
        let converted = self.converted_time.iter().map(note);
        converted.chain(self.even_rows.iter().map(even)).chain(self.noticed.iter().cloned()).collect()
    }
}
