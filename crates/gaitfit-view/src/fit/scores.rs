//! The result in one line, and the fitted simulator beside everything it has to beat.

use super::signals::{unit_in_sentence, unit_of_positions};
use super::standing::{self, Verdict};
use super::{FitReport, Score};
use crate::chart::{extent, strip};
use crate::fit::held_out;
use crate::format::{UNKNOWN, clean, fixed, significant};
use serde::Serialize;

/// Headline and score table.
#[derive(Serialize)]
pub(super) struct Scores {
    /// How much better it predicts than the robot file, in a sentence; empty beside a doubt.
    gain: String,
    before: String,
    after: String,
    unit: &'static str,
    /// Unit of position errors.
    position_unit: &'static str,
    /// Meaning of the two numbers.
    meaning: String,
    /// Text above the numbers: that the search converged, where it is known to have.
    state: String,
    /// Sentences that set the result against nominal, the best baseline, its bounds, and the robot itself.
    verdicts: Vec<Verdict>,
    rows: Vec<ScoreRow>,
    /// Heading of the bars: what they measure.
    bars: String,
    cost_heading: String,
    cost: String,
    cost_before: String,
    has_fit: bool,
    has_validation: bool,
    has_cost: bool,
    /// Whether a doubt leaves nothing to praise.
    doubted: bool,
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

/// Number that the headline compares: the strictest that the fitted and the nominal simulator both have.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Yardstick {
    ValidationRmse,
    FitRmse,
    Cost,
}

impl Yardstick {
    fn of_report(report: &FitReport) -> Yardstick {
        // Only a number that both have can be compared.
        let known = |yardstick: Yardstick| {
            [Who::Fitted, Who::Nominal].iter().all(|who| yardstick.value(report, *who).is_finite())
        };
        [Yardstick::ValidationRmse, Yardstick::FitRmse].into_iter().find(|m| known(*m)).unwrap_or_else(|| {
            // A fit that diverged still has the errors of the others to be set against.
            let any = report.fitted.rmse_fit_rad.is_finite() || report.nominal.rmse_fit_rad.is_finite();
            if any && !known(Yardstick::Cost) { Yardstick::FitRmse } else { Yardstick::Cost }
        })
    }

    fn value(self, report: &FitReport, who: Who) -> f64 {
        let score = match who {
            Who::Fitted => &report.fitted,
            Who::Nominal => &report.nominal,
        };
        match self {
            Yardstick::Cost => cost(report, who),
            _ => self.number(score),
        }
    }

    fn number(self, score: &Score) -> f64 {
        match self {
            Yardstick::ValidationRmse => score.rmse_validation_rad,
            Yardstick::FitRmse => score.rmse_fit_rad,
            Yardstick::Cost => score.cost,
        }
    }

    /// Returns the noun for it in a sentence about the nominal simulator or a baseline.
    fn noun(self) -> &'static str {
        if self == Yardstick::Cost { "cost" } else { "error" }
    }
}

#[derive(Clone, Copy)]
enum Who {
    Fitted,
    Nominal,
}

/// The cost as the scores have it, or else the first fit.
fn cost(report: &FitReport, who: Who) -> f64 {
    let first = report.fits.first();
    let (scored, fallback) = match who {
        Who::Fitted => (report.fitted.cost, first.map(|fit| fit.fitted_cost)),
        Who::Nominal => (report.nominal.cost, first.map(|fit| fit.nominal_cost)),
    };
    if scored.is_finite() { scored } else { fallback.unwrap_or(f64::NAN) }
}

/// Returns a sentence if the nominal simulator is closer to the logs than the fitted one; else `None`.
pub(super) fn worse_than_nominal(report: &FitReport) -> Option<String> {
    let unit_of_errors = format!(" {}", unit_in_sentence(&report.traces));
    // The strictest first: logs that the fit did not see, then what it minimised.
    let measured = [
        (
            Yardstick::ValidationRmse,
            "position error on the logs that the fit did not see",
            unit_of_errors.as_str(),
        ),
        (Yardstick::Cost, "cost on the logs of the fit", ""),
        (Yardstick::FitRmse, "position error on the logs of the fit", unit_of_errors.as_str()),
    ];
    measured.into_iter().find_map(|(yardstick, what, unit)| {
        let (fitted, nominal) = (yardstick.value(report, Who::Fitted), yardstick.value(report, Who::Nominal));
        // A fit whose simulation diverged has a doubt of its own.
        (fitted > nominal && fitted.is_finite()).then(|| {
            format!(
                "The {what} is {}{unit} after the fit and {}{unit} before it. Do not use this fit.",
                significant(fitted, 3),
                significant(nominal, 3)
            )
        })
    })
}

/// The headline; with a severe doubt (`doubted`) nothing is praised.
pub(super) fn build(report: &FitReport, doubted: bool) -> Scores {
    let yardstick = Yardstick::of_report(report);
    let (fitted, nominal) = (yardstick.value(report, Who::Fitted), yardstick.value(report, Who::Nominal));
    // The first fit is the result; others are beside it for comparison.
    let first = report.fits.first();
    let cost_name = first.map_or(String::new(), |fit| clean(&fit.cost_name));
    let position_unit = unit_of_positions(&report.traces);
    let cost_heading = format!("{cost_name} cost").trim_start().to_string();
    let rows = rows(report, yardstick);
    let all = || [&report.nominal, &report.fitted].into_iter().chain(&report.baselines);
    Scores {
        gain: if doubted { String::new() } else { gain(report, yardstick, nominal / fitted) },
        before: significant(nominal, 3),
        after: significant(fitted, 3),
        unit: if yardstick == Yardstick::Cost { "" } else { unit_in_sentence(&report.traces) },
        position_unit,
        meaning: match yardstick {
            Yardstick::ValidationRmse => {
                "RMS error of the joint positions, nominal → fitted, on logs that the fit did \
                                        not see. The simulators run freely: nothing resets them"
                    .into()
            }
            Yardstick::FitRmse => {
                "RMS error of the joint positions, nominal → fitted, on the logs that the fit used. \
                                 The simulators run freely: nothing resets them"
                    .into()
            }
            Yardstick::Cost => {
                let name = if cost_name.is_empty() { String::new() } else { format!(" {cost_name}") };
                format!(
                    "The cost{name} that the fit minimises, nominal → fitted, on the logs that the fit used"
                )
            }
        },
        state: state(report),
        verdicts: verdicts(report, yardstick).into_iter().chain(standing::verdicts(report)).collect(),
        rows,
        bars: match yardstick {
            Yardstick::ValidationRmse => {
                format!("Position error on the validation logs (RMS, {position_unit})")
            }
            Yardstick::FitRmse => format!("Position error on the fitted logs (RMS, {position_unit})"),
            Yardstick::Cost => cost_heading.clone(),
        },
        cost_heading,
        cost: significant(cost(report, Who::Fitted), 4),
        cost_before: significant(cost(report, Who::Nominal), 4),
        has_fit: all().any(|s| s.rmse_fit_rad.is_finite()),
        has_validation: all().any(|s| s.rmse_validation_rad.is_finite()),
        has_cost: cost(report, Who::Fitted).is_finite() || all().any(|s| s.cost.is_finite()),
        doubted,
    }
}

/// Returns the gain of the fit on logs that it did not see, or else on its own.
fn gain(report: &FitReport, yardstick: Yardstick, ratio: f64) -> String {
    if let Some(gain) = report.held_out.as_ref().and_then(held_out::gain) {
        return held_out::gain_text(gain, "walks");
    }
    let digits = if ratio < 10.0 { 1 } else { 0 };
    match yardstick {
        // Less than a tenth is not worth a sentence. Beyond 1e9 the fitted error is 0 but for rounding.
        _ if !(1.1..1e9).contains(&ratio) => String::new(),
        Yardstick::ValidationRmse => held_out::gain_text(ratio, "motions"),
        Yardstick::FitRmse => {
            format!("Predicts the motion that was fitted {ratio:.digits$} times better than the robot file")
        }
        Yardstick::Cost => String::new(),
    }
}

/// Every predictor, the longest bar first and the fit last: the eye runs down to it.
fn rows(report: &FitReport, yardstick: Yardstick) -> Vec<ScoreRow> {
    let nominal = Score { cost: cost(report, Who::Nominal), ..report.nominal.clone() };
    let fitted = Score { cost: cost(report, Who::Fitted), ..report.fitted.clone() };
    let value = |score: &Score| yardstick.number(score);
    let all = || std::iter::once(&nominal).chain(&report.baselines).chain([&fitted]);
    let largest = extent(all().map(value)).map_or(1.0, |(_, high)| high);
    // Four decimals line up under one another; values they would round away keep their digits instead.
    let plain = all().map(value).filter(|x| x.is_finite()).all(|x| (0.001..100.0).contains(&x));
    let row = |score: &Score, is_fit: bool| ScoreRow {
        name: name_of(score, if is_fit { "fitted simulator" } else { "nominal simulator" }),
        is_fit,
        bar: strip::bar(value(score), largest, is_fit),
        headline: if plain { fixed(value(score), 4) } else { significant(value(score), 2) },
        fit: significant(score.rmse_fit_rad, 3),
        validation: significant(score.rmse_validation_rad, 3),
        cost: significant(score.cost, 4),
    };
    let mut others: Vec<&Score> = std::iter::once(&nominal).chain(&report.baselines).collect();
    // A predictor with neither a number nor a name says nothing.
    others.retain(|s| value(s).is_finite() || s.cost.is_finite() || !s.name.is_empty());
    others.sort_by(|a, b| descending(value(a), value(b)));
    let mut rows: Vec<ScoreRow> = others.iter().map(|s| row(s, false)).collect();
    // The others are sorted with the worst first, so the fit stands beside the best of them.
    rows.push(row(&fitted, true));
    rows
}

/// Says that the search converged, but not beside a doubt, where it would sound like praise.
fn state(report: &FitReport) -> String {
    let doubted = report.doubts.iter().any(|doubt| doubt.kind.is_severe());
    if report.converged == Some(true) && !doubted { "The search converged".into() } else { String::new() }
}

fn verdicts(report: &FitReport, yardstick: Yardstick) -> Vec<Verdict> {
    let (fitted, nominal) = (yardstick.value(report, Who::Fitted), yardstick.value(report, Who::Nominal));
    let noun = yardstick.noun();
    let mut verdicts = Vec::new();
    verdicts.extend(verdict(fitted, nominal, &format!("the nominal simulator's {noun}")));
    let known = report.baselines.iter().filter(|s| yardstick.number(s).is_finite());
    if let Some(best) = known.min_by(|a, b| yardstick.number(a).total_cmp(&yardstick.number(b))) {
        let what = format!("the {noun} of the best baseline, {}", name_of(best, "unnamed"));
        verdicts.extend(verdict(fitted, yardstick.number(best), &what));
    }
    verdicts
}

fn name_of(score: &Score, fallback: &str) -> String {
    if score.name.is_empty() { fallback.to_string() } else { clean(&score.name) }
}

fn descending(a: f64, b: f64) -> std::cmp::Ordering {
    // What is not known counts as the worst.
    let key = |x: f64| if x.is_finite() { x } else { f64::INFINITY };
    key(b).total_cmp(&key(a))
}

/// Compares `ours` with `theirs` in words, without a sign to misread.
fn verdict(ours: f64, theirs: f64, what: &str) -> Option<Verdict> {
    // There is no share of zero or of an unknown number.
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
    use crate::fit::Fit;

    #[test]
    fn a_worse_fit_is_called_worse() {
        let score = |rmse: f64| Score { rmse_fit_rad: rmse, ..Score::default() };
        let mut report = FitReport { fitted: score(0.02), nominal: score(0.08), ..FitReport::default() };
        report.baselines = vec![Score { name: "delay".into(), ..score(0.01) }];
        let scores = build(&report, false);
        assert_eq!(scores.verdicts[0].text, "25 % of the nominal simulator's error");
        assert_eq!(scores.verdicts[1].text, "worse: 200 % of the error of the best baseline, delay");
        assert!(scores.verdicts[0].good && !scores.verdicts[1].good);
        assert_eq!((scores.before.as_str(), scores.after.as_str()), ("0.0800", "0.0200"));
        assert!(worse_than_nominal(&report).is_none());
        report.fitted.rmse_fit_rad = 0.09;
        assert!(worse_than_nominal(&report).is_some_and(|text| text.contains("0.0900 rad after the fit")));
    }

    #[test]
    fn a_fit_without_errors_is_judged_by_its_cost() {
        let fit = Fit { cost_name: "Wass".into(), nominal_cost: 1.5, fitted_cost: 0.3, ..Fit::default() };
        let mut report = FitReport { fits: vec![fit], ..FitReport::default() };
        let scores = build(&report, false);
        assert_eq!((scores.before.as_str(), scores.after.as_str()), ("1.50", "0.300"));
        assert_eq!(scores.verdicts[0].text, "20 % of the nominal simulator's cost");
        assert!(worse_than_nominal(&report).is_none());
        report.fits[0].fitted_cost = 1.6;
        assert!(worse_than_nominal(&report).is_some());
    }
}
