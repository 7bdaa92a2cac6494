//! The plot: bars with 95 % intervals, ours beside the paper's.

use super::paper::Kind;
use super::results::{Results, Row, Walk, shown};
use gaitfit_view::Estimate;
use gaitfit_view::chart::{Bar, BarGroup, Look, bar_figure};

/// Draws the table as SVG.
pub fn svg(results: &Results) -> String {
    let groups = match results.kind {
        Kind::Identification => vec![errors(results)],
        Kind::Finetuning => vec![
            walks(results, "Summed reward on the target (higher is better)", 2, |walk| walk.reward),
            walks(results, "Linear velocity error, m/s", 4, |walk| walk.linear_velocity_error),
            walks(results, "Angular velocity error, rad/s", 4, |walk| walk.angular_velocity_error),
        ],
    };
    bar_figure(&results.title, &groups).standalone()
}

fn bar(name: String, value: Estimate, digits: usize, look: Look) -> Bar {
    Bar { name, value: value.mean, half_width: value.ci95, text: shown(Some(value), digits), look }
}

fn errors(results: &Results) -> BarGroup {
    let mut bars = Vec::new();
    for row in &results.rows {
        let value = row.mean_error_percent.unwrap_or_default();
        bars.push(bar(row.cell.clone(), value, 2, Look::color(0)));
        // NaN draws no bar and keeps the row, so that rows of all cells align.
        let paper = row.paper.mean_error_percent.unwrap_or(f64::NAN);
        bars.push(bar("paper".to_owned(), Estimate { mean: paper, ci95: f64::NAN }, 2, Look::AREA));
    }
    BarGroup { title: "Mean parameter error, %".to_owned(), bars }
}

fn walks(results: &Results, title: &str, digits: usize, of: fn(&Walk) -> Estimate) -> BarGroup {
    let drawn = |row: &Row| {
        // References have another colour than fits.
        let look = if row.modification.is_some() { Look::color(0) } else { Look::color(1) };
        bar(row.label(), row.walk.as_ref().map(of).unwrap_or_default(), digits, look)
    };
    BarGroup { title: title.to_owned(), bars: results.rows.iter().map(drawn).collect() }
}
