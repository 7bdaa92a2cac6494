//! What reading a log found worth knowing.

use super::{Finding, FindingKind, Severity};
use crate::{ConvertedTime, ReadReport};

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
        self.converted_time.iter().map(note).chain(self.noticed.iter().cloned()).collect()
    }
}
