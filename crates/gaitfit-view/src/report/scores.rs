//! The result in one line, and the fitted simulator beside everything it has to beat.

use super::{AdaptReport, Score};
use crate::charts::{bars, scale};
use crate::format::{UNKNOWN, clean, fixed, significant};
use serde::Serialize;

/// Headline and score table.
#[derive(Serialize)]
pub(super) struct Scores {
    before: String,
    after: String,
    /// What the two numbers are.
    meaning: &'static str,
    /// Sentences that set the result against nominal, the best baseline and the noise floor.
    verdicts: Vec<Verdict>,
    rows: Vec<ScoreRow>,
    /// Heading of the bars: what they measure.
    measured_on: &'static str,
    noise_floor: Option<String>,
    cost_heading: String,
    cost: String,
    cost_before: String,
    has_fit: bool,
    has_validation: bool,
}

#[derive(Serialize)]
struct Verdict {
    text: String,
    good: bool,
}

#[derive(Serialize)]
struct ScoreRow {
    name: String,
    is_fit: bool,
    bar: String,
    headline: String,
    fit: String,
    validation: String,
    cost: String,
}

pub(super) fn build(report: &AdaptReport) -> Scores {
    let on_validation = report.fitted.rmse_validation_rad.is_finite();
    let rmse = |s: &Score| if on_validation { s.rmse_validation_rad } else { s.rmse_fit_rad };
    let all = || std::iter::once(&report.nominal).chain(&report.baselines).chain([&report.fitted]);
    let largest = scale::extent(all().map(rmse).chain(report.noise_floor_rad)).map_or(1.0, |(_, high)| high);
    // Four decimals line up under one another; values they would round away keep their digits instead.
    let plain = all().map(rmse).filter(|x| x.is_finite()).all(|x| (0.001..100.0).contains(&x));
    let row = |score: &Score, is_fit: bool| ScoreRow {
        name: name_of(score, if is_fit { "fitted simulator" } else { "nominal simulator" }),
        is_fit,
        bar: bars::bar(rmse(score), largest, report.noise_floor_rad, is_fit),
        headline: if plain { fixed(rmse(score), 4) } else { significant(rmse(score), 2) },
        fit: significant(score.rmse_fit_rad, 3),
        validation: significant(score.rmse_validation_rad, 3),
        cost: significant(score.cost, 4),
    };
    // The longest bar first, the fit last: the eye runs down to it.
    let mut others: Vec<&Score> = std::iter::once(&report.nominal).chain(&report.baselines).collect();
    others.retain(|s| rmse(s).is_finite() || s.cost.is_finite() || !s.name.is_empty());
    others.sort_by(|a, b| descending(rmse(a), rmse(b)));
    let mut rows: Vec<ScoreRow> = others.iter().map(|s| row(s, false)).collect();
    rows.push(row(&report.fitted, true));

    let fitted = rmse(&report.fitted);
    let mut verdicts = Vec::new();
    verdicts.extend(verdict(fitted, rmse(&report.nominal), "the nominal simulator's error"));
    let best =
        report.baselines.iter().filter(|s| rmse(s).is_finite()).min_by(|a, b| rmse(a).total_cmp(&rmse(b)));
    if let Some(best) = best {
        let what = format!("that of the best baseline, {}", name_of(best, "unnamed"));
        verdicts.extend(verdict(fitted, rmse(best), &what));
    }
    if let Some(floor) = report.noise_floor_rad.filter(|f| f.is_finite() && *f > 0.0)
        && fitted.is_finite()
    {
        let text = format!(
            "{}× the {} rad by which repeated recordings of one command differ",
            significant(fitted / floor, 2),
            significant(floor, 2)
        );
        verdicts.push(Verdict { text, good: true });
    }
    let unit =
        if report.cost_unit.is_empty() { String::new() } else { format!(" ({})", clean(&report.cost_unit)) };
    Scores {
        before: significant(rmse(&report.nominal), 3),
        after: significant(fitted, 3),
        meaning: if on_validation {
            "Free-running joint position RMSE, nominal → fitted, on logs the fit did not see"
        } else {
            "Free-running joint position RMSE, nominal → fitted, on the logs the fit used"
        },
        verdicts,
        rows,
        measured_on: if on_validation { "validation logs" } else { "fit logs" },
        noise_floor: report.noise_floor_rad.filter(|f| f.is_finite()).map(|f| significant(f, 2)),
        cost_heading: format!("{} cost{unit}", clean(&report.cost_name)).trim_start().to_string(),
        cost: significant(report.fitted.cost, 4),
        cost_before: significant(report.nominal.cost, 4),
        has_fit: all().any(|s| s.rmse_fit_rad.is_finite()),
        has_validation: all().any(|s| s.rmse_validation_rad.is_finite()),
    }
}

fn name_of(score: &Score, fallback: &str) -> String {
    if score.name.is_empty() { fallback.to_string() } else { clean(&score.name) }
}

fn descending(a: f64, b: f64) -> std::cmp::Ordering {
    let key = |x: f64| if x.is_finite() { x } else { f64::INFINITY };
    key(b).total_cmp(&key(a))
}

/// How `ours` compares with `theirs`, said without a sign to misread.
fn verdict(ours: f64, theirs: f64, what: &str) -> Option<Verdict> {
    if !(ours.is_finite() && theirs.is_finite() && theirs > 0.0) {
        return None;
    }
    let good = ours <= theirs;
    let share = significant(100.0 * ours / theirs, 2);
    let share = if share == UNKNOWN { return None } else { share };
    let text = if good { format!("{share} % of {what}") } else { format!("worse: {share} % of {what}") };
    Some(Verdict { text, good })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_worse_fit_is_called_worse() {
        let score = |rmse: f64| Score { rmse_fit_rad: rmse, ..Score::default() };
        let mut report = AdaptReport { fitted: score(0.02), nominal: score(0.08), ..AdaptReport::default() };
        report.baselines = vec![Score { name: "delay".into(), ..score(0.01) }];
        let scores = build(&report);
        assert_eq!(scores.verdicts[0].text, "25 % of the nominal simulator's error");
        assert_eq!(scores.verdicts[1].text, "worse: 200 % of that of the best baseline, delay");
        assert!(scores.verdicts[0].good && !scores.verdicts[1].good);
        assert_eq!((scores.before.as_str(), scores.after.as_str()), ("0.0800", "0.0200"));
    }
}
