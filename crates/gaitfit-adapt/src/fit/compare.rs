//! Two fits of one θ by different costs, side by side: do they agree, and if not, why.

use super::{CostOutcome, FitError, ParameterOutcome};
use serde::{Deserialize, Serialize};

/// One parameter as two fits see it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Value of the first fit.
    pub first: f64,
    /// The longer side of its interval; absent where it was not measured.
    #[serde(default)]
    pub first_half: Option<f64>,
    /// Value of the second fit.
    pub second: f64,
    /// The longer side of its interval.
    #[serde(default)]
    pub second_half: Option<f64>,
    /// Whether they differ by at most twice the larger spread over runs, or the larger half of an interval; `None` where
    /// neither is known.
    pub agrees: Option<bool>,
    /// Why they do not agree, measured: how much each cost minds the other's value.
    pub reason: Option<String>,
}

/// A rise of a cost below this part counts as not seeing the parameter.
const UNSEEN: f64 = 0.01;

/// Compares two fits of one θ. `first_cost` and `second_cost` evaluate candidates (`None`: diverged). Each is called once,
/// without candidates if no parameter disagrees. Else the first candidate has its fit's own values. The others are one for
/// each disagreeing parameter, in which only that parameter has the other fit's value. [`CostOutcome::best_cost`] does not
/// count, because it may be from other random draws.
pub fn compare(
    first: &CostOutcome,
    second: &CostOutcome,
    first_cost: impl FnOnce(&[Vec<f64>]) -> Result<Vec<Option<f64>>, FitError>,
    second_cost: impl FnOnce(&[Vec<f64>]) -> Result<Vec<Option<f64>>, FitError>,
) -> Result<Vec<Agreement>, FitError> {
    // Both fits are of one θ, so their parameters belong together by place.
    let pairs: Vec<(&ParameterOutcome, &ParameterOutcome)> =
        first.parameters.iter().zip(&second.parameters).collect();
    let verdict = |(a, b): &(&ParameterOutcome, &ParameterOutcome)| {
        // Two standard deviations over the seeds.
        let spreads = a.spread.into_iter().chain(b.spread).map(|spread| 2.0 * spread);
        // Without any spread or interval there is no verdict.
        let room = spreads.chain(a.half()).chain(b.half()).reduce(f64::max)?;
        Some((a.value - b.value).abs() <= room)
    };
    let verdicts: Vec<Option<bool>> = pairs.iter().map(verdict).collect();
    // Only parameters that disagree are simulated again.
    let apart: Vec<usize> = (0..pairs.len()).filter(|&index| verdicts[index] == Some(false)).collect();
    // Each candidate moves one parameter, so a rise of the cost belongs to it alone.
    let swapped = |outcome: &CostOutcome, other: &CostOutcome| -> Vec<Vec<f64>> {
        let swap = |&index: &usize| {
            let mut values = outcome.values();
            values[index] = other.parameters[index].value;
            values
        };
        let unchanged = (!apart.is_empty()).then(|| outcome.values());
        unchanged.into_iter().chain(apart.iter().map(swap)).collect()
    };
    let first_costs = first_cost(&swapped(first, second))?;
    let second_costs = second_cost(&swapped(second, first))?;

    // Every parameter gets its row; those that disagree also get a reason.
    let mut agreements = Vec::with_capacity(pairs.len());
    for (index, (a, b)) in pairs.iter().enumerate() {
        let reason = apart.iter().position(|&one| one == index).map(|at| {
            let rise = |costs: &[Option<f64>]| {
                // The fit's own values are the first candidate.
                let Some(before) = costs.first().copied().flatten() else { return Rise::Unknown };
                // An equal cost has no rise, also of 0.
                let rise = |cost: f64| if cost == before { 0.0 } else { cost / before - 1.0 };
                costs.get(at + 1).copied().flatten().map_or(Rise::Diverges, |cost| Rise::By(rise(cost)))
            };
            reason(first, rise(&first_costs), a, second, rise(&second_costs), b)
        });
        agreements.push(Agreement {
            name: a.name.clone(),
            unit: a.unit.clone(),
            first: a.value,
            first_half: a.half(),
            second: b.value,
            second_half: b.half(),
            agrees: verdicts[index],
            reason,
        });
    }
    Ok(agreements)
}

/// What the other fit's value does to a fit's cost.
#[derive(Clone, Copy, PartialEq)]
enum Rise {
    /// The cost rises by this part.
    By(f64),
    /// The simulation diverges.
    Diverges,
    /// The simulation of the fit's own values diverges, so there is nothing to rise from.
    Unknown,
}

fn reason(
    first: &CostOutcome,
    first_rise: Rise,
    a: &ParameterOutcome,
    second: &CostOutcome,
    second_rise: Rise,
    b: &ParameterOutcome,
) -> String {
    let said = |rise: Rise| match rise {
        // There is no percentage of 0.
        Rise::By(rise) if rise.is_infinite() => "from 0".to_owned(),
        Rise::By(rise) => format!("by {:+.1} %", 100.0 * rise),
        Rise::Diverges => "until the simulation diverges".to_owned(),
        Rise::Unknown => "by an unknown amount (the simulation of its own fit's values diverges)".to_owned(),
    };
    let mut text = format!(
        "{}: with the other fit's value, all else equal, the {} cost changes {} and the {} cost {}",
        a.name,
        first.cost,
        said(first_rise),
        second.cost,
        said(second_rise)
    );
    let blind = |rise: Rise| matches!(rise, Rise::By(rise) if rise.abs() < UNSEEN);
    // A cost that hardly changes does not see the parameter; the blame is on the blind one.
    let why = match (blind(first_rise), blind(second_rise)) {
        (true, true) => "neither cost determines it on these logs".to_owned(),
        (true, false) => format!("{} hardly sees it on these logs", first.cost),
        (false, true) => format!("{} hardly sees it on these logs", second.cost),
        (false, false) if [first_rise, second_rise].contains(&Rise::Unknown) => {
            "whether both costs see it is not known".to_owned()
        }
        (false, false) => {
            "both costs see it and want different values: what the model cannot express is weighed differently \
             with and without a time axis"
                .to_owned()
        }
    };
    text.push_str("; ");
    text.push_str(&why);
    for (outcome, parameter) in [(first, a), (second, b)] {
        if parameter.at_bound {
            text.push_str(&format!("; the {} value rests on a bound", outcome.cost));
        }
    }
    text.push('.');
    text
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn outcome(cost: &str, values: &[f64], spread: f64) -> CostOutcome {
        let parameter = |(index, &value): (usize, &f64)| ParameterOutcome {
            name: format!("p{index}"),
            value,
            uncorrected: None,
            unit: "-".into(),
            spread: Some(spread),
            lower: 0.0,
            upper: 1.0,
            start: 0.0,
            at_bound: false,
            per_run: vec![value],
            identification: None,
        };
        CostOutcome {
            cost: cost.into(),
            best_cost: 2.0,
            parameters: values.iter().enumerate().map(parameter).collect(),
            runs: Vec::new(),
            uncertainty: None,
            correction: None,
            regression: None,
            redrawn: None,
            unlike: None,
        }
    }

    #[test]
    fn within_two_spreads_agrees_and_beyond_says_what_each_cost_sees() {
        let first = outcome("matcho", &[0.5, 0.2], 0.01);
        let second = outcome("wass", &[0.519, 0.3], 0.01);
        let agreements = compare(
            &first,
            &second,
            |candidates| {
                assert_eq!(candidates, [vec![0.5, 0.2], vec![0.5, 0.3]]);
                // Under these draws the fit's own values cost more than in its search.
                Ok(vec![Some(4.0), Some(6.0)])
            },
            |candidates| {
                assert_eq!(candidates, [vec![0.519, 0.3], vec![0.519, 0.2]]);
                Ok(vec![Some(2.0), Some(2.001)])
            },
        )
        .unwrap();
        assert_eq!(agreements[0].agrees, Some(true));
        assert_eq!(agreements[0].reason, None);
        assert_eq!(agreements[1].agrees, Some(false));
        let reason = agreements[1].reason.as_deref().unwrap();
        assert!(reason.contains("+50.0 %") && reason.contains("wass hardly sees it"), "{reason}");
    }

    #[test]
    fn a_cost_of_0_has_no_percentage() {
        let (first, second) = (outcome("matcho", &[0.5, 0.2], 0.01), outcome("wass", &[0.5, 0.3], 0.01));
        let costs = |swapped: f64| move |_: &[Vec<f64>]| Ok(vec![Some(0.0), Some(swapped)]);
        let agreements = compare(&first, &second, costs(0.25), costs(0.0)).unwrap();
        let reason = agreements[1].reason.as_deref().unwrap();
        let wanted = "the matcho cost changes from 0 and the wass cost by +0.0 %; wass hardly sees it";
        assert!(reason.contains(wanted), "{reason}");
    }

    #[test]
    fn own_values_that_diverge_are_not_blamed_on_the_other_fit() {
        let (first, second) = (outcome("matcho", &[0.5, 0.2], 0.01), outcome("wass", &[0.5, 0.3], 0.01));
        let agreements =
            compare(&first, &second, |_| Ok(vec![None, Some(0.25)]), |_| Ok(vec![Some(1.0), None])).unwrap();
        let reason = agreements[1].reason.as_deref().unwrap();
        let wanted = "the matcho cost changes by an unknown amount (the simulation of its own fit's values diverges) \
                      and the wass cost until the simulation diverges; whether both costs see it is not known.";
        assert!(reason.contains(wanted), "{reason}");
    }
}
