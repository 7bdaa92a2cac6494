//! Grounds of the first fit's values, in sentences: bounds, identification, and logs that were not fitted.

use super::{Bound, FitReport, Parameter};
use crate::format::{clean, clean_prose};
use serde::Serialize;

/// A sentence of the verdict, and whether it is good news.
#[derive(Serialize)]
pub(super) struct Verdict {
    pub text: String,
    pub good: bool,
}

/// Parameters named in a sentence at most.
const NAMED: usize = 5;

/// The sentences, each with whether it speaks for the fit.
pub(super) fn verdicts(report: &FitReport) -> Vec<Verdict> {
    let parameters = report.fits.first().map_or(&[][..], |fit| &fit.parameters);
    let mut verdicts = Vec::new();
    if !parameters.is_empty() {
        let total = parameters.len();
        verdicts.push(match names(parameters, rests) {
            None => good("no parameter rests on a bound of its search"),
            Some((count, names)) => {
                let rest = if count == 1 { "rests on a bound of its" } else { "rest on bounds of their" };
                bad(format!("{count} of {total} parameters {rest} search: {names}"))
            }
        });
        let judged = parameters.iter().filter(|p| p.identified.is_some()).count();
        match names(parameters, |p| p.identified == Some(false)) {
            Some((count, names)) => {
                verdicts
                    .push(bad(format!("the logs do not identify {count} of {total} parameters: {names}")));
            }
            // Praise needs a judgement of every parameter.
            None if judged == total => verdicts.push(good("the logs identify all parameters")),
            None => {}
        }
    }
    if let Some(held) = report.held_out.as_ref().filter(|held| !held.sentence.is_empty()) {
        let text = clean_prose(&held.sentence);
        verdicts.push(Verdict { text, good: held.explained != Some(false) });
    }
    verdicts
}

fn good(text: &str) -> Verdict {
    Verdict { text: text.into(), good: true }
}

fn bad(text: String) -> Verdict {
    Verdict { text, good: false }
}

/// Whether a value would have gone on but for a bound. 0 is an end of many quantities and no such bound, except of friction
/// and delay, of which every real robot has some, where the logs exclude more.
fn rests(parameter: &Parameter) -> bool {
    match parameter.at_bound {
        Some(Bound::Upper) => true,
        Some(Bound::Lower) => parameter.lower != 0.0 || wants_nothing(parameter),
        None => false,
    }
}

/// An interval below this part of the bounds excludes more than 0.
const TIGHT: f64 = 0.05;

/// Whether friction or a delay is 0 with an interval that excludes more, and is not known to be 0.
fn wants_nothing(parameter: &Parameter) -> bool {
    let real = ["frictionloss", "delay"].iter().any(|kind| parameter.name.starts_with(kind));
    // The value is at its lower bound 0, so the upper end alone tells what the logs exclude.
    let tight = |[_, upper]: [f64; 2]| upper < TIGHT * parameter.upper;
    real && parameter.truth != Some(0.0) && parameter.interval.is_some_and(tight)
}

/// How many parameters are so, and the first of their names; `None` if none is.
fn names(parameters: &[Parameter], is_so: impl Fn(&Parameter) -> bool) -> Option<(usize, String)> {
    let names: Vec<String> = parameters.iter().filter(|p| is_so(p)).map(|p| clean(&p.name)).collect();
    let mut named = names[..names.len().min(NAMED)].join(", ");
    if names.len() > NAMED {
        named.push_str(&format!(" and {} more", names.len() - NAMED));
    }
    (!names.is_empty()).then_some((names.len(), named))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::Fit;
    use crate::fit::HeldOut;

    #[test]
    fn what_speaks_against_a_fit_is_named() {
        let parameter = |name: &str, lower, at_bound, identified| Parameter {
            name: name.into(),
            lower,
            at_bound,
            identified,
            ..Parameter::default()
        };
        let said_of = |parameters: Vec<Parameter>, held_out| {
            let fits = vec![Fit { parameters, ..Fit::default() }];
            let said = verdicts(&FitReport { fits, held_out, ..FitReport::default() });
            said.into_iter().map(|one| (one.text, one.good)).collect::<Vec<_>>()
        };
        let sound = said_of(vec![parameter("a", 0.0, Some(Bound::Lower), Some(true))], None);
        let wanted = ["no parameter rests on a bound of its search", "the logs identify all parameters"];
        assert_eq!(sound, wanted.map(|text| (text.to_string(), true)));
        let nothing = Parameter {
            interval: Some([0.0, 0.01]),
            upper: 2.0,
            ..parameter("frictionloss_hip", 0.0, Some(Bound::Lower), Some(true))
        };
        let said = said_of(vec![nothing.clone()], None);
        assert!(!said[0].1 && said[0].0.contains("1 of 1 parameters rests on a bound"), "{said:?}");
        let known = said_of(vec![Parameter { truth: Some(0.0), ..nothing }], None);
        assert!(known[0].1, "a robot without friction: {known:?}");
        let floor = HeldOut { sentence: "Worse.".into(), explained: Some(false), ..HeldOut::default() };
        let doubtful = said_of(
            vec![
                parameter("a", 1.0, Some(Bound::Lower), Some(false)),
                parameter("b", 0.0, Some(Bound::Upper), None),
            ],
            Some(floor),
        );
        let wanted = [
            "2 of 2 parameters rest on bounds of their search: a, b",
            "the logs do not identify 1 of 2 parameters: a",
            "Worse.",
        ];
        assert_eq!(doubtful, wanted.map(|text| (text.to_string(), false)));
    }
}
