//! The result in a few numbers: the policy before and after, on the target.

use super::policies::{Cast, printed};
use super::tracking::COLUMNS;
use super::{Difference, LoopReport, drift};
use crate::Estimate;
use crate::format::{clean_prose, significant};
use crate::page::is_severe;
use serde::Serialize;

/// Numbers and sentences in large print.
#[derive(Serialize)]
pub(super) struct Headline {
    before: String,
    after: String,
    measured: String,
    numbers: Vec<Number>,
}

#[derive(Serialize)]
struct Number {
    what: &'static str,
    unit: &'static str,
    /// None with a single policy.
    before: Option<String>,
    after: String,
    change: Option<Change>,
}

/// How much better or worse, in words.
#[derive(Serialize)]
struct Change {
    text: String,
    /// Style-sheet class.
    class: &'static str,
}

pub(super) fn build(report: &LoopReport, cast: &Cast) -> Option<Headline> {
    let tracked =
        |policy: &str| report.tracking.iter().find(|t| t.policy == policy && t.simulator == cast.target);
    let drifted = |policy: &str| {
        let set = report.drift.iter().find(|d| d.policy == policy && d.simulator == cast.target)?;
        // The mean over commands has no interval: the commands were chosen, not drawn.
        Some(Estimate { mean: drift::summary(set).0, ci95: f64::NAN })
    };
    // A loop with one policy has nothing to compare: only its own numbers show.
    let is_pair = cast.before != cast.after;
    let pair = |d: &&Difference| {
        d.policy == cast.after && d.against == cast.before && d.simulator == cast.target && d.paired
    };
    let difference = report.differences.iter().find(pair);
    let errors = COLUMNS.iter().filter(|q| q.is_error).map(|q| {
        let measured = |policy| tracked(policy).map(q.of);
        // Differences on the same trajectories vary much less than the two means do.
        let apart = difference.map(|difference| (q.difference)(difference).ci95);
        number(q.name, q.unit, measured(cast.before).filter(|_| is_pair), measured(cast.after), apart)
    });
    let mean = drifted(cast.before).filter(|_| is_pair);
    let drift = number("Mean drift of constant commands", "m", mean, drifted(cast.after), None);
    let mut numbers: Vec<Number> = errors.chain([drift]).flatten().collect();
    if is_severe(&report.doubts) {
        // Nothing is praised beside a doubt.
        for change in numbers.iter_mut().filter_map(|number| number.change.as_mut()) {
            change.class = if change.class == "good" { "soft" } else { change.class };
        }
    }
    (!numbers.is_empty()).then(|| Headline {
        before: printed(cast.before, "the first policy"),
        after: printed(cast.after, "the last policy"),
        measured: match clean_prose(&report.measured) {
            text if text.is_empty() => format!("on {}", printed(cast.target, "the robot")),
            text => text,
        },
        numbers,
    })
}

fn number(
    what: &'static str,
    unit: &'static str,
    before: Option<Estimate>,
    after: Option<Estimate>,
    apart: Option<f64>,
) -> Option<Number> {
    let after = after.filter(|e| e.mean.is_finite())?;
    let before = before.filter(|e| e.mean.is_finite());
    Some(Number {
        what,
        unit,
        before: before.map(|e| significant(e.mean, 3)),
        after: significant(after.mean, 3),
        change: before.and_then(|before| change(before, after, apart)),
    })
}

/// The change of an error. Two means differ beyond doubt when they lie farther apart than the interval of their
/// difference: half-width `paired` where both means are of the same trajectories, √(c₁² + c₂²) for independent means with
/// half-widths c₁ and c₂.
fn change(before: Estimate, after: Estimate, paired: Option<f64>) -> Option<Change> {
    // An unknown interval counts as none.
    let known = |x: f64| if x.is_finite() { x } else { 0.0 };
    let apart = after.mean - before.mean;
    let half = paired.filter(|half| half.is_finite());
    if apart.abs() <= half.unwrap_or_else(|| known(before.ci95).hypot(known(after.ci95))) {
        return Some(Change { text: "no difference outside the 95 % intervals".into(), class: "soft" });
    }
    // There is no share of zero.
    if before.mean <= 0.0 {
        return (apart > 0.0).then(|| Change { text: "more".into(), class: "bad" });
    }
    let share = significant(100.0 * apart.abs() / before.mean, 2);
    Some(if apart < 0.0 {
        Change { text: format!("{share} % less"), class: "good" }
    } else {
        Change { text: format!("{share} % more"), class: "bad" }
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_change_within_the_intervals_is_none() {
        let estimate = |mean, ci95| Estimate { mean, ci95 };
        let said = |a, b| change(a, b, None).unwrap();
        let pairs = change(estimate(0.2, 0.03), estimate(0.17, 0.03), Some(0.01)).unwrap();
        assert_eq!((pairs.text.as_str(), pairs.class), ("15 % less", "good"));
        assert_eq!(said(estimate(0.2, 0.03), estimate(0.17, 0.03)).class, "soft");
        let better = said(estimate(0.2, 0.003), estimate(0.15, 0.004));
        assert_eq!((better.text.as_str(), better.class), ("25 % less", "good"));
        let worse = said(estimate(0.2, f64::NAN), estimate(0.3, 0.001));
        assert_eq!((worse.text.as_str(), worse.class), ("50 % more", "bad"));
        let fell = said(estimate(0.0, 0.0), estimate(0.1, 0.01));
        assert_eq!((fell.text.as_str(), fell.class), ("more", "bad"));
        assert_eq!(said(estimate(0.0, 0.0), estimate(0.0, 0.0)).class, "soft");
    }
}
