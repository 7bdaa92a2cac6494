//! The page of `gaitfit runs --html`: what was run, the parameters of several fits side by side, and the learning curves of
//! several trainings in common charts.

use crate::chart::intervals::{Mark, Row as Drawn};
use crate::chart::{Axis, Look, Plot, Series};
use crate::fit::parameters::{Entry, Group, group};
use crate::format::{UNKNOWN, clean, clean_prose, duration, significant, with_spread};
use crate::page::{self, ShownLink};
use crate::{Link, ReportError};
use serde::Serialize;

/// Max number of runs in the list, so that the page has an end.
const MAX_RUNS: usize = 500;
/// Max number of fits that are compared: as many as there are colours.
const MAX_FITS: usize = 8;
/// Max number of parameters that are drawn.
const MAX_PARAMETERS: usize = 200;
/// Max number of trainings that are drawn: as many as there are colours.
const MAX_TRAININGS: usize = 8;
/// Max number of charts of learning curves.
const MAX_CHARTS: usize = 12;

/// Content of the page. Names are untrusted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunsReport {
    /// Heading, e.g. the folder of the runs.
    pub title: String,
    /// Time at which the page was made, as it is to be printed.
    pub created: String,
    /// The runs, in the order to list them.
    pub runs: Vec<Run>,
    /// Their fits; the page compares the last eight.
    pub fits: Vec<Fit>,
    /// Their trainings; the page draws the last eight.
    pub trainings: Vec<Training>,
}

/// A run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Run {
    /// Its name.
    pub name: String,
    /// Its page, relative to this one; empty: none.
    pub report: String,
    /// Command that computed it, e.g. `fit`.
    pub command: String,
    /// Time at which it began.
    pub begun: String,
    /// How long it took, s; NaN when unknown.
    pub wall_seconds: f64,
    /// The robot.
    pub robot: String,
    /// The result in a sentence.
    pub summary: String,
}

/// A fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fit {
    /// Name of its run.
    pub name: String,
    /// Name of its cost.
    pub cost_name: String,
    /// The cost of the robot before the fit, and after it.
    pub cost: Vec<f64>,
    /// The fitted parameters.
    pub parameters: Vec<Parameter>,
}

/// A fitted parameter.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Unit of value and interval; may be empty.
    pub unit: String,
    /// Value.
    pub value: f64,
    /// Its 95 % interval, where it has one.
    pub interval: Option<[f64; 2]>,
}

/// A training.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Training {
    /// Name of its run.
    pub name: String,
    /// Its learning curves, means over seeds.
    pub curves: Vec<Curve>,
}

/// A quantity over the iterations of a training.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Name; trainings share a chart where the names agree.
    pub name: String,
    /// Its unit; may be empty.
    pub unit: String,
    /// Iterations, ascending.
    pub iteration: Vec<f64>,
    /// Its values, one an iteration.
    pub value: Vec<f64>,
}

#[derive(Serialize)]
struct Page {
    title: String,
    created: String,
    runs: Vec<RunRow>,
    /// Runs that are not listed.
    left_out: usize,
    fits: Vec<FitHead>,
    groups: Vec<Group>,
    rows: Vec<ParameterRow>,
    trainings: Vec<Name>,
    charts: Vec<Chart>,
}

#[derive(Serialize)]
struct RunRow {
    link: Vec<ShownLink>,
    command: String,
    begun: String,
    time: String,
    robot: String,
    summary: String,
}

#[derive(Serialize)]
struct FitHead {
    name: String,
    look: Look,
    cost: String,
}

#[derive(Serialize)]
struct ParameterRow {
    name: String,
    unit: String,
    /// A cell a fit.
    cells: Vec<String>,
}

#[derive(Serialize)]
struct Name {
    name: String,
    look: Look,
}

#[derive(Serialize)]
struct Chart {
    name: String,
    svg: String,
}

/// Renders the page as UTF-8 HTML: one file that opens offline.
///
/// # Errors
/// [`ReportError::Template`] if the embedded template cannot be filled in.
pub fn runs_html(report: &RunsReport) -> Result<String, ReportError> {
    let fits = last(&report.fits, MAX_FITS);
    let trainings = last(&report.trainings, MAX_TRAININGS);
    let (groups, rows) = parameters(fits);
    let looks = |names: Vec<&String>| {
        let name = |(number, name): (usize, &String)| Name { name: clean(name), look: Look::color(number) };
        names.into_iter().enumerate().map(name).collect()
    };
    let page = Page {
        title: clean(&report.title),
        created: clean(&report.created),
        runs: report.runs.iter().take(MAX_RUNS).map(run).collect(),
        left_out: report.runs.len().saturating_sub(MAX_RUNS),
        fits: fits.iter().enumerate().map(head).collect(),
        groups,
        rows,
        trainings: looks(trainings.iter().map(|one| &one.name).collect()),
        charts: charts(trainings),
    };
    page::render(include_str!("runs.html"), page)
}

fn last<T>(items: &[T], count: usize) -> &[T] {
    &items[items.len().saturating_sub(count)..]
}

fn run(run: &Run) -> RunRow {
    RunRow {
        link: page::links(&[Link { text: run.name.clone(), path: run.report.clone() }]),
        command: clean(&run.command),
        begun: clean(&run.begun),
        time: if run.wall_seconds.is_finite() { duration(run.wall_seconds) } else { UNKNOWN.to_owned() },
        robot: clean(&run.robot),
        summary: clean_prose(&run.summary),
    }
}

fn head((number, fit): (usize, &Fit)) -> FitHead {
    let number_of = |place: usize| significant(fit.cost.get(place).copied().unwrap_or(f64::NAN), 3);
    FitHead {
        name: clean(&fit.name),
        look: Look::color(number),
        cost: format!("{} {} → {}", clean(&fit.cost_name), number_of(0), number_of(1)),
    }
}

/// The parameters of all fits, in the order in which names first appear: pictures, and a table.
fn parameters(fits: &[Fit]) -> (Vec<Group>, Vec<ParameterRow>) {
    let mut names: Vec<(&str, &str)> = Vec::new();
    for one in fits.iter().flat_map(|fit| &fit.parameters) {
        // Numbers of different units do not share a row, even under one name.
        let key = (one.name.as_str(), one.unit.as_str());
        if names.len() < MAX_PARAMETERS && !names.contains(&key) {
            names.push(key);
        }
    }
    let (mut entries, mut rows) = (Vec::new(), Vec::new());
    for (name, unit) in names {
        let same =
            |fit: &Fit| fit.parameters.iter().find(|one| one.name == name && one.unit == unit).cloned();
        // One place for each fit, so that a column of the table stays with its fit.
        let estimates: Vec<Option<Parameter>> = fits.iter().map(same).collect();
        let mark = |(number, one): (usize, &Option<Parameter>)| {
            let one = one.as_ref()?;
            Some(Mark { value: one.value, spread: half(one), runs: Vec::new(), look: Look::color(number) })
        };
        let marks: Vec<Mark> = estimates.iter().enumerate().filter_map(mark).collect();
        let apart = apart(&estimates);
        // Nothing is said where fewer than two fits have an interval.
        let text = match apart {
            Some(true) => "differ",
            Some(false) => "agree",
            None => "",
        };
        entries.push(Entry {
            unit: axis(name, unit),
            name: clean(name),
            text: text.to_owned(),
            truth: String::new(),
            flagged: apart == Some(true),
            row: Drawn { marks, ..Drawn::default() },
        });
        let cell = |one: &Option<Parameter>| match one {
            None => UNKNOWN.to_owned(),
            Some(one) => match with_spread(one.value, half(one)) {
                (value, half) if half == UNKNOWN => value,
                (value, half) => format!("{value} ± {half}"),
            },
        };
        let cells = estimates.iter().map(cell).collect();
        rows.push(ParameterRow { name: clean(name), unit: clean(unit), cells });
    }
    (group(entries), rows)
}

/// The name of the axis of a parameter: values of one kind and unit share it.
fn axis(name: &str, unit: &str) -> String {
    // Names are a kind and a joint or group, such as `armature_hip`.
    let kind = clean(name.split(['_', '.']).next().unwrap_or(name));
    if unit.is_empty() { kind } else { format!("{kind} ({})", clean(unit)) }
}

/// Whether two of the fits' intervals do not overlap; `None` of fewer than two intervals.
fn apart(estimates: &[Option<Parameter>]) -> Option<bool> {
    // An end that is no number says nothing of where the interval lies.
    let known = |ends: &[f64; 2]| !ends.iter().any(|end| end.is_nan());
    let intervals: Vec<[f64; 2]> =
        estimates.iter().flatten().filter_map(|one| one.interval.filter(known)).collect();
    // Intervals on a line all share a point if and only if the largest lower end is not above the smallest upper
    // end. Otherwise these two belong to intervals that are apart.
    let low = intervals.iter().map(|[low, _]| *low).fold(f64::NEG_INFINITY, f64::max);
    let high = intervals.iter().map(|[_, high]| *high).fold(f64::INFINITY, f64::min);
    (intervals.len() > 1).then_some(low > high)
}

/// The longer side of a parameter's interval; NaN without one.
fn half(parameter: &Parameter) -> f64 {
    let finite = |ends: &[f64; 2]| ends.iter().all(|x| x.is_finite());
    let side = |[low, high]: [f64; 2]| (parameter.value - low).max(high - parameter.value).max(0.0);
    parameter.interval.filter(finite).map_or(f64::NAN, side)
}

impl Training {
    fn curve(&self, name: &str) -> Option<&Curve> {
        self.curves.iter().find(|curve| curve.name == name)
    }
}

/// A chart a quantity, with a line a training.
fn charts(trainings: &[Training]) -> Vec<Chart> {
    let mut names: Vec<(&str, &str)> = Vec::new();
    for curve in trainings.iter().flat_map(|training| &training.curves) {
        // The unit of the first curve of a name stands at its axis.
        if names.len() < MAX_CHARTS && !names.iter().any(|(name, _)| *name == curve.name) {
            names.push((&curve.name, &curve.unit));
        }
    }
    let chart = |(name, unit): (&str, &str)| {
        let line = |(number, training)| {
            let curve = Training::curve(training, name)?;
            Some((Look::color(number), clean(&training.name), curve))
        };
        let lines: Vec<(Look, String, &Curve)> = trainings.iter().enumerate().filter_map(line).collect();
        let series = lines
            .iter()
            .map(|(look, name, curve)| Series::Line {
                name,
                look: *look,
                x: &curve.iteration,
                y: &curve.value,
            })
            .collect();
        let plot = Plot {
            x: Axis { title: "iteration", ticks: 6, ..Axis::default() },
            // A little room, so that extremes do not lie on the frame.
            y: Axis { title: unit, pad: 0.04, ticks: 5, ..Axis::default() },
            series,
            // The figure is 560 units wide, so more points would not show.
            points: 500,
        };
        let svg = plot.figure(&format!("{name} over iterations"), 560.0, 300.0)?.inline();
        Some(Chart { name: clean(name), svg })
    };
    names.into_iter().filter_map(chart).collect()
}
