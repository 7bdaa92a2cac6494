//! θ as pictures on one axis a unit and as a table, and two fits of it side by side.

use super::{Bound, Comparison, Parameter};
use crate::chart::Look;
use crate::chart::intervals::{self, Mark, Row};
use crate::format::{UNKNOWN, clean, clean_prose, round_number, with_spread};
use serde::Serialize;

/// Parameters shown at most; networks have thousands.
const MAX_PARAMETERS: usize = 200;

#[derive(Serialize)]
pub(crate) struct ParameterTable {
    groups: Vec<Group>,
    rows: Vec<ParameterRow>,
    at_bound: usize,
    /// Parameters that the logs determine, of those that were judged.
    identified: usize,
    judged: usize,
    total: usize,
    left_out: usize,
    has_published: bool,
    has_profile: bool,
    has_truth: bool,
    /// Whether any parameter is known not to be identified.
    has_open: bool,
    /// Distinct sources of the published ranges.
    sources: Vec<String>,
}

#[derive(Serialize)]
pub(crate) struct Group {
    unit: String,
    rows: Vec<Picture>,
    axis: String,
}

#[derive(Serialize)]
struct Picture {
    name: String,
    text: String,
    /// Empty where it is not known.
    truth: String,
    flagged: bool,
    svg: String,
}

#[derive(Serialize)]
struct ParameterRow {
    name: String,
    unit: String,
    value: String,
    /// Number after ±: the interval's longer side.
    half: String,
    profile: String,
    truth: String,
    lower: String,
    upper: String,
    start: String,
    published: String,
    notes: Vec<&'static str>,
}

#[derive(Serialize)]
pub(super) struct ComparisonTable {
    first: String,
    second: String,
    groups: Vec<Group>,
    rows: Vec<ComparisonRow>,
    agreeing: usize,
    judged: usize,
    reasons: Vec<String>,
}

#[derive(Serialize)]
struct ComparisonRow {
    name: String,
    unit: String,
    first: String,
    first_half: String,
    second: String,
    second_half: String,
    agrees: Option<bool>,
}

/// Tables and pictures; `None` without parameters.
pub(super) fn build(parameters: &[Parameter]) -> Option<ParameterTable> {
    let shown = &parameters[..parameters.len().min(MAX_PARAMETERS)];
    if shown.is_empty() {
        return None;
    }
    // A source is named once, however many parameters cite it.
    let mut sources: Vec<String> = Vec::new();
    for range in shown.iter().filter_map(|p| p.published.as_ref()) {
        let source = clean(&range.source);
        if !source.is_empty() && !sources.contains(&source) {
            sources.push(source);
        }
    }
    Some(ParameterTable {
        groups: group(shown.iter().map(entry).collect()),
        rows: shown.iter().map(table_row).collect(),
        // Counts are over all parameters, also those that are not shown.
        at_bound: parameters.iter().filter(|p| p.at_bound.is_some()).count(),
        identified: parameters.iter().filter(|p| p.identified == Some(true)).count(),
        judged: parameters.iter().filter(|p| p.identified.is_some()).count(),
        total: parameters.len(),
        left_out: parameters.len() - shown.len(),
        has_published: shown.iter().any(|p| p.published.is_some()),
        has_profile: shown.iter().any(|p| interval(p).is_some()),
        has_truth: shown.iter().any(|p| truth(p).is_some()),
        has_open: shown.iter().any(|p| p.identified == Some(false)),
        sources,
    })
}

/// A parameter before it has an axis.
pub(crate) struct Entry {
    pub unit: String,
    pub name: String,
    /// Text beside the picture.
    pub text: String,
    /// The true value, where it is known.
    pub truth: String,
    pub flagged: bool,
    pub row: Row,
}

fn entry(parameter: &Parameter) -> Entry {
    let is_open = parameter.identified == Some(false);
    let flagged = parameter.at_bound.is_some() || is_open;
    let mark = Mark {
        value: parameter.value,
        // The interval is the box behind the dot.
        spread: f64::NAN,
        // Each run is a stroke of the picture; more of them would be one block.
        runs: parameter.per_run.iter().copied().take(100).collect(),
        look: match parameter.at_bound {
            // First: what the logs do not determine may rest anywhere, at a bound too.
            _ if is_open => Look::OPEN,
            Some(_) => Look::HIT,
            None => Look::FIRST,
        },
    };
    let row = Row {
        bounds: Some((parameter.lower, parameter.upper)),
        published: parameter.published.as_ref().map(|r| (r.lower, r.upper)),
        start: Some(parameter.start),
        profile: interval(parameter),
        truth: truth(parameter),
        marks: vec![mark],
    };
    let (value, half) = with_spread(parameter.value, half(parameter));
    let text = if half == UNKNOWN { value } else { format!("{value} ± {half}") };
    let truth = truth(parameter).map_or(String::new(), round_number);
    Entry { unit: clean(&parameter.unit), name: clean(&parameter.name), text, truth, flagged, row }
}

/// The longer side of a parameter's interval, which stands after ±; NaN where it was not measured. What runs of the
/// optimiser differ by says how well it searched, not what the logs leave open.
fn half(parameter: &Parameter) -> f64 {
    let side = |(low, high): (f64, f64)| (parameter.value - low).max(high - parameter.value).max(0.0);
    interval(parameter).map_or(f64::NAN, side)
}

/// The parameter's interval where both ends are known.
fn interval(parameter: &Parameter) -> Option<(f64, f64)> {
    parameter.interval.filter(|ends| ends.iter().all(|x| x.is_finite())).map(|[low, high]| (low, high))
}

fn truth(parameter: &Parameter) -> Option<f64> {
    parameter.truth.filter(|x| x.is_finite())
}

fn table_row(parameter: &Parameter) -> ParameterRow {
    let (value, half) = with_spread(parameter.value, half(parameter));
    let mut notes = Vec::new();
    match parameter.at_bound {
        Some(Bound::Lower) => notes.push("at the lower bound"),
        Some(Bound::Upper) => notes.push("at the upper bound"),
        None => {}
    }
    if parameter.identified == Some(false) {
        notes.push("not identified by these logs");
    }
    if let (Some(truth), Some((low, high))) = (truth(parameter), interval(parameter))
        && !(low..=high).contains(&truth)
    {
        notes.push("truth outside the interval");
    }
    if let Some(range) = &parameter.published
        // Comparisons with NaN are false, so an unknown value or end gives no note.
        && (parameter.value < range.lower || parameter.value > range.upper)
    {
        notes.push("outside the published range");
    }
    let range = |low, high| format!("{} … {}", round_number(low), round_number(high));
    ParameterRow {
        name: clean(&parameter.name),
        unit: clean(&parameter.unit),
        value,
        half,
        profile: interval(parameter).map_or(UNKNOWN.to_string(), |(low, high)| range(low, high)),
        truth: round_number(truth(parameter).unwrap_or(f64::NAN)),
        lower: round_number(parameter.lower),
        upper: round_number(parameter.upper),
        start: round_number(parameter.start),
        published: parameter.published.as_ref().map_or(UNKNOWN.to_string(), |r| range(r.lower, r.upper)),
        notes,
    }
}

/// Pictures of one unit share an axis; units come in order of appearance.
pub(crate) fn group(entries: Vec<Entry>) -> Vec<Group> {
    let mut by_unit: Vec<Vec<Entry>> = Vec::new();
    for entry in entries {
        // Every list begins with an entry, so it has a first one.
        match by_unit.iter_mut().find(|known| known[0].unit == entry.unit) {
            Some(known) => known.push(entry),
            None => by_unit.push(vec![entry]),
        }
    }
    let draw = |entries: Vec<Entry>| {
        let rows: Vec<Row> = entries.iter().map(|e| e.row.clone()).collect();
        // Lengths compare only on one axis, and only within a unit.
        let scale = intervals::shared_scale(&rows);
        let unit = entries[0].unit.clone();
        let picture = |e: Entry| Picture {
            svg: intervals::row(&e.row, &scale),
            name: e.name,
            text: e.text,
            truth: e.truth,
            flagged: e.flagged,
        };
        Group { unit, rows: entries.into_iter().map(picture).collect(), axis: intervals::axis(&scale) }
    };
    by_unit.into_iter().map(draw).collect()
}

pub(super) fn compare(comparison: &Comparison) -> Option<ComparisonTable> {
    let entries = &comparison.entries[..comparison.entries.len().min(MAX_PARAMETERS)];
    if entries.is_empty() {
        return None;
    }
    let mark = |value, spread, look| Mark { value, spread, runs: Vec::new(), look };
    let drawn = entries
        .iter()
        .map(|e| {
            // The first fit above the second, in the colours of the two columns.
            let marks =
                vec![mark(e.first, e.first_half, Look::FIRST), mark(e.second, e.second_half, Look::SECOND)];
            let text = match e.agrees {
                Some(true) => "agrees",
                Some(false) => "differs",
                None => UNKNOWN,
            };
            let row = Row { marks, ..Row::default() };
            let (unit, name) = (clean(&e.unit), clean(&e.name));
            let (text, truth) = (text.to_string(), String::new());
            Entry { unit, name, text, truth, flagged: e.agrees == Some(false), row }
        })
        .collect();
    let rows = entries
        .iter()
        .map(|e| {
            let (first, first_half) = with_spread(e.first, e.first_half);
            let (second, second_half) = with_spread(e.second, e.second_half);
            let (name, unit) = (clean(&e.name), clean(&e.unit));
            ComparisonRow { name, unit, first, first_half, second, second_half, agrees: e.agrees }
        })
        .collect();
    Some(ComparisonTable {
        first: clean(&comparison.first),
        second: clean(&comparison.second),
        groups: group(drawn),
        rows,
        // Over all entries, also those that are not shown.
        agreeing: comparison.entries.iter().filter(|e| e.agrees == Some(true)).count(),
        judged: comparison.entries.iter().filter(|e| e.agrees.is_some()).count(),
        reasons: comparison.reasons.iter().take(100).map(|r| clean_prose(r)).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::PublishedRange;

    #[test]
    fn what_is_wrong_with_a_value_is_said() {
        let parameter = Parameter {
            value: 0.5,
            upper: 0.5,
            at_bound: Some(Bound::Upper),
            identified: Some(false),
            published: Some(PublishedRange { lower: 0.1, upper: 0.2, source: "x".into() }),
            truth: Some(0.15),
            ..Parameter::default()
        };
        let row = table_row(&parameter);
        assert_eq!(
            row.notes,
            ["at the upper bound", "not identified by these logs", "outside the published range"]
        );
        assert_eq!((row.half.as_str(), row.lower.as_str()), ("–", "–"));
        assert_eq!((row.profile.as_str(), row.truth.as_str()), ("–", "0.15"));
    }

    #[test]
    fn what_stands_after_plus_minus_is_the_interval_and_not_the_spread_over_runs() {
        let parameter = Parameter {
            value: 0.24786,
            spread: 0.000051,
            interval: Some([0.2387, 0.2541]),
            ..Parameter::default()
        };
        assert_eq!(entry(&parameter).text, "0.2479 ± 0.0092");
        assert_eq!(table_row(&parameter).half, "0.0092");
        let unmeasured = Parameter { interval: None, ..parameter };
        assert_eq!(entry(&unmeasured).text, "0.2479");
    }

    #[test]
    fn units_share_an_axis() {
        let parameter = |unit: &str| Parameter { unit: unit.into(), value: 1.0, ..Parameter::default() };
        let parameters = ["N·m", "s", "N·m"].map(parameter);
        let table = build(&parameters);
        let sizes: Vec<usize> = table.iter().flat_map(|t| &t.groups).map(|g| g.rows.len()).collect();
        assert_eq!(sizes, [2, 1]);
    }
}
