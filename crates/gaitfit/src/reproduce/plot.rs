//! The plot: bars with 95 % intervals, ours beside the paper's.

use super::paper::Kind;
use super::results::{Results, Row, Walk, shown};
use crate::Error;
use gaitfit_view::loop_report::Estimate;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Width of a panel's bars at most, pixels.
const BARS: f64 = 420.0;
/// Left of the bars: names, pixels.
const NAMES: i32 = 300;
/// Right of the bars: values, pixels.
const VALUES: i32 = 150;
/// Height of a line, pixels.
const LINE: i32 = 20;
/// Height of a panel's title, pixels.
const TITLE: i32 = 34;

const OURS: RGBColor = RGBColor(30, 80, 160);
const PAPER: RGBColor = RGBColor(190, 190, 190);
const REFERENCE: RGBColor = RGBColor(200, 120, 40);

/// A bar.
struct Bar {
    name: String,
    value: Estimate,
    digits: usize,
    color: RGBColor,
}

/// A row of bars with one scale.
struct Panel {
    title: &'static str,
    bars: Vec<Bar>,
}

/// Draws the table as SVG.
///
/// # Errors
/// The drawing library's.
pub fn svg(results: &Results) -> Result<String, Error> {
    let panels = match results.kind {
        Kind::Identification => vec![errors(results)],
        Kind::Finetuning => vec![
            walks(results, "Summed reward on the target (higher is better)", 2, |walk| walk.reward),
            walks(results, "Linear velocity error, m/s", 4, |walk| walk.linear_velocity_error),
            walks(results, "Angular velocity error, rad/s", 4, |walk| walk.angular_velocity_error),
        ],
    };
    draw(&panels).map_err(|error| Error::failed(format!("cannot draw the plot: {error}")))
}

fn errors(results: &Results) -> Panel {
    let mut bars = Vec::new();
    for row in &results.rows {
        let value = row.mean_error_percent.unwrap_or_default();
        bars.push(Bar { name: row.cell.clone(), value, digits: 2, color: OURS });
        let paper = row.paper.mean_error_percent.unwrap_or(f64::NAN);
        let value = Estimate { mean: paper, ci95: f64::NAN };
        bars.push(Bar { name: "paper".to_owned(), value, digits: 2, color: PAPER });
    }
    Panel { title: "Mean parameter error, %", bars }
}

fn walks(results: &Results, title: &'static str, digits: usize, of: fn(&Walk) -> Estimate) -> Panel {
    let bar = |row: &Row| Bar {
        name: row.label(),
        value: row.walk.as_ref().map(of).unwrap_or_default(),
        digits,
        color: if row.modification.is_some() { OURS } else { REFERENCE },
    };
    Panel { title, bars: results.rows.iter().map(bar).collect() }
}

fn draw(panels: &[Panel]) -> Result<String, Box<dyn std::error::Error>> {
    let heights = panels.iter().map(|panel| TITLE + LINE * panel.bars.len() as i32);
    let size = (NAMES as u32 + BARS as u32 + VALUES as u32, heights.sum::<i32>() as u32 + 12);
    let mut svg = String::new();
    {
        let page = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        page.fill(&WHITE)?;
        let mut top = 0;
        for panel in panels {
            page.draw(&Text::new(panel.title, (8, top + 10), ("sans-serif", 15)))?;
            top += TITLE;
            top = bars(&page, panel, top)?;
        }
        page.present()?;
    }
    Ok(svg)
}

/// Draws a panel's bars from `top` on and gives where they end.
fn bars(
    page: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    panel: &Panel,
    top: i32,
) -> Result<i32, Box<dyn std::error::Error>> {
    let reach = |bar: &Bar, sign: f64| {
        let ci95 = if bar.value.ci95.is_finite() { bar.value.ci95 } else { 0.0 };
        Some(bar.value.mean + sign * ci95).filter(|end| end.is_finite())
    };
    let high = panel.bars.iter().filter_map(|bar| reach(bar, 1.0)).fold(0.0, f64::max);
    let low = panel.bars.iter().filter_map(|bar| reach(bar, -1.0)).fold(0.0, f64::min);
    let length = if high > low { high - low } else { 1.0 };
    let x = |value: f64| NAMES + (BARS * (value - low) / length).round() as i32;
    let names = ("sans-serif", 12).into_font().into_text_style(page).pos(Pos::new(HPos::Right, VPos::Center));
    let values = ("sans-serif", 12).into_font().into_text_style(page).pos(Pos::new(HPos::Left, VPos::Center));
    let mut y = top;
    for bar in &panel.bars {
        let middle = y + LINE / 2;
        page.draw(&Text::new(bar.name.clone(), (NAMES - 8, middle), names.clone()))?;
        let mut end = x(0.0);
        if bar.value.mean.is_finite() {
            let corners = [(x(0.0), y + 4), (x(bar.value.mean), y + LINE - 4)];
            page.draw(&Rectangle::new(corners, bar.color.filled()))?;
            end = end.max(x(bar.value.mean));
        }
        if let (Some(from), Some(to), true) = (reach(bar, -1.0), reach(bar, 1.0), bar.value.ci95.is_finite())
        {
            page.draw(&PathElement::new([(x(from), middle), (x(to), middle)], BLACK))?;
            end = end.max(x(to));
        }
        let value = shown(Some(bar.value), bar.digits);
        page.draw(&Text::new(value, (end + 6, middle), values.clone()))?;
        y += LINE;
    }
    page.draw(&PathElement::new([(x(0.0), top), (x(0.0), y)], BLACK))?;
    Ok(y)
}
