//! Policies and simulators of a report, with their order and colours.

use super::LoopReport;
use crate::format::clean;

/// Policies and simulators told apart at most.
const MAX_ROWS: usize = 16;

/// Names in the order of their first appearance, and which of them the headline sets side by side.
pub(super) struct Cast<'a> {
    pub policies: Vec<&'a str>,
    pub simulators: Vec<&'a str>,
    pub before: &'a str,
    pub after: &'a str,
    pub target: &'a str,
}

impl<'a> Cast<'a> {
    pub fn new(report: &'a LoopReport) -> Cast<'a> {
        let tracked = report.tracking.iter().map(|t| (t.policy.as_str(), t.simulator.as_str()));
        let drifted = report.drift.iter().map(|d| (d.policy.as_str(), d.simulator.as_str()));
        let (mut policies, mut simulators) = (Vec::new(), Vec::new());
        for (policy, simulator) in tracked.chain(drifted) {
            for (list, name) in [(&mut policies, policy), (&mut simulators, simulator)] {
                if list.len() < MAX_ROWS && !list.contains(&name) {
                    list.push(name);
                }
            }
        }
        let chosen = |name: &'a str, default: Option<&&'a str>| {
            if name.is_empty() { default.copied().unwrap_or("") } else { name }
        };
        Cast {
            before: chosen(&report.before, policies.first()),
            after: chosen(&report.after, policies.last()),
            target: chosen(&report.target, simulators.first()),
            policies,
            simulators,
        }
    }

    /// Number of the policy's colour: 0 before, 1 after, the others from 2.
    pub fn color(&self, policy: &str) -> usize {
        // Fixed colours, so that before and after look the same in all charts of the page.
        if policy == self.before {
            return 0;
        }
        if policy == self.after {
            return 1;
        }
        let others = self.policies.iter().filter(|p| **p != self.before && **p != self.after);
        // Eight colours, of which two are taken.
        2 + others.take_while(|p| **p != policy).count() % 6
    }
}

/// A name as it is printed, also when nobody gave one.
pub(super) fn printed(name: &str, fallback: &str) -> String {
    if name.is_empty() { fallback.to_string() } else { clean(name) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loop_report::Tracking;

    #[test]
    fn references_have_colours_of_their_own() {
        let tracking = |policy: &str| Tracking { policy: policy.into(), ..Tracking::default() };
        let report = LoopReport {
            before: "a".into(),
            after: "c".into(),
            tracking: ["a", "b", "c", "truth"].map(tracking).to_vec(),
            ..LoopReport::default()
        };
        let cast = Cast::new(&report);
        assert_eq!(["a", "b", "c", "truth"].map(|p| cast.color(p)), [0, 2, 1, 3]);
        let unnamed = LoopReport { before: String::new(), after: String::new(), ..report };
        let cast = Cast::new(&unnamed);
        assert_eq!((cast.before, cast.after), ("a", "truth"));
    }
}
