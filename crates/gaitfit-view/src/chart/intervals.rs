//! Dots with intervals on a shared axis: values of one unit with their spread, bounds and published ranges.

use super::look::Look;
use super::path::{coordinate, percent};
use super::scale::{self, Scale};
use std::fmt::Write;

/// Ends of the axis, percent of the width; the margin keeps dots and labels whole.
const ENDS: (f64, f64) = (3.0, 97.0);

/// Numbers of one row, all in one unit; numbers that are not finite are not drawn.
#[derive(Clone, Debug, Default)]
pub(crate) struct Row {
    /// Search bounds.
    pub bounds: Option<(f64, f64)>,
    /// Published range.
    pub published: Option<(f64, f64)>,
    /// Where the search began.
    pub start: Option<f64>,
    /// An interval about the marks, e.g. within which a cost cannot tell values apart.
    pub profile: Option<(f64, f64)>,
    /// The value to be found.
    pub truth: Option<f64>,
    pub marks: Vec<Mark>,
}

/// A value with its spread.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mark {
    pub value: f64,
    /// Half-width of the interval.
    pub spread: f64,
    /// Values of single runs, drawn as short strokes.
    pub runs: Vec<f64>,
    /// Look of the mark.
    pub look: Look,
}

/// The axis that holds what matters of the rows: values, spreads, truths and published ranges always; starts, bounds
/// and profile intervals when they are near enough not to squeeze the values.
pub(crate) fn shared_scale(rows: &[Row]) -> Scale {
    // Values that must be on the axis; then those that may be, if they are near.
    let core = rows.iter().flat_map(|r| {
        let marks = r.marks.iter().flat_map(|m| {
            let spread = if m.spread.is_finite() { m.spread } else { 0.0 };
            [m.value - spread, m.value + spread].into_iter().chain(m.runs.iter().copied())
        });
        marks.chain(r.published.into_iter().flat_map(|(a, b)| [a, b])).chain(r.truth)
    });
    let bounds = || rows.iter().filter_map(|r| r.bounds).flat_map(|(a, b)| [a, b]);
    let mut hull = scale::extent(core).or_else(|| scale::extent(bounds()));
    if let Some((low, high)) = hull {
        // A single value has no length: then only what equals it but for rounding is near.
        let length = (high - low).max(1e-12 * high.abs());
        let near = |factor: f64| move |x: &f64| *x >= low - factor * length && *x <= high + factor * length;
        // A start or an interval at most two lengths away is worth a longer axis; what is farther away would
        // squeeze the values. A bound must be nearer, because its track can run out of the picture.
        let starts = rows.iter().filter_map(|r| r.start).filter(near(2.0));
        let profiles = rows.iter().filter_map(|r| r.profile).flat_map(|(a, b)| [a, b]).filter(near(2.0));
        hull = scale::extent(starts.chain(profiles).chain(bounds().filter(near(1.0))).chain([low, high]));
    }
    Scale::linear(hull.map(wide), ENDS.0, ENDS.1)
}

/// An axis of errors or shares: it begins at zero and holds no values below.
pub(crate) fn scale_from_zero(rows: &[Row]) -> Scale {
    let (_, high) = shared_scale(rows).domain();
    Scale::linear(Some((0.0, high)), ENDS.0, ENDS.1)
}

/// An axis that is not so short that its ticks say nothing: at least a tenth of its values' size.
fn wide((low, high): (f64, f64)) -> (f64, f64) {
    // On a shorter axis the labels of neighbouring ticks would differ in their last digits only.
    let missing = 0.1 * low.abs().max(high.abs()) - (high - low);
    if missing > 0.0 { (low - 0.5 * missing, high + 0.5 * missing) } else { (low, high) }
}

/// One row's picture on the shared axis.
pub(crate) fn row(row: &Row, scale: &Scale) -> String {
    let (low, high) = scale.domain();
    // 12 units for each mark, so that dots of 4.5 units do not touch. A single mark has room for its strokes.
    let height = if row.marks.len() > 1 { 6.0 + 12.0 * row.marks.len() as f64 } else { 24.0 };
    let middle = height / 2.0;
    let mut svg = format!(r#"<svg class="strip" width="100%" height="{height}" aria-hidden="true">"#);
    // What comes first lies below: grid, bounds, ranges, truth, start, then the marks.
    for tick in scale.ticks(6) {
        let x = percent(scale.at(tick.value));
        let _ = write!(svg, r#"<line class="grid" x1="{x}" x2="{x}" y1="0" y2="{height}"/>"#);
    }
    if let Some((a, b)) = row.bounds.filter(|(a, b)| a.is_finite() && b.is_finite()) {
        let (from, to) = (edge(a, low, 0.0, scale), edge(b, high, 100.0, scale));
        let (y, width) = (coordinate(middle - 3.0), percent((to - from).max(0.0)));
        let _ =
            write!(svg, r#"<rect class="track" x="{}" y="{y}" width="{width}" height="6"/>"#, percent(from));
        // A bound beyond the axis has no cap: its track runs to the edge of the picture.
        for bound in [a, b].into_iter().filter(|x| inside(*x, low, high)) {
            let x = percent(scale.at(bound));
            let (y1, y2) = (coordinate(middle - 8.0), coordinate(middle + 8.0));
            let _ = write!(svg, r#"<line class="cap" x1="{x}" x2="{x}" y1="{y1}" y2="{y2}"/>"#);
        }
    }
    for (range, class) in [(row.published, "published"), (row.profile, "profile")] {
        let Some((a, b)) = range.filter(|(a, b)| a.is_finite() && b.is_finite()) else { continue };
        let (from, to) = (edge(a, low, 0.0, scale), edge(b, high, 100.0, scale));
        // The smallest width keeps a very narrow range visible.
        let (y, width) = (coordinate(middle - 8.0), percent((to - from).max(0.4)));
        let _ = write!(
            svg,
            r#"<rect class="{class}" x="{}" y="{y}" width="{width}" height="16"/>"#,
            percent(from)
        );
    }
    if let Some(truth) = row.truth.filter(|x| inside(*x, low, high)) {
        let x = percent(scale.at(truth));
        let _ = write!(svg, r#"<line class="truth" x1="{x}" x2="{x}" y1="0" y2="{height}"/>"#);
    }
    if let Some(start) = row.start.filter(|x| inside(*x, low, high)) {
        let x = percent(scale.at(start));
        let _ = write!(svg, r#"<circle class="start" cx="{x}" cy="{}" r="4"/>"#, coordinate(middle));
    }
    for (i, mark) in row.marks.iter().enumerate() {
        // 9 units leave room for the strokes of 7 above the first mark.
        let y = if row.marks.len() > 1 { 9.0 + 12.0 * i as f64 } else { middle };
        draw_mark(&mut svg, mark, scale, y);
    }
    svg.push_str("</svg>");
    svg
}

/// The axis below the rows.
pub(crate) fn axis(scale: &Scale) -> String {
    let mut svg = String::from(r#"<svg class="strip ticks" width="100%" height="20" aria-hidden="true">"#);
    for tick in scale.ticks(6) {
        let x = percent(scale.at(tick.value));
        let _ = write!(svg, r#"<text class="t m" x="{x}" y="14">{}</text>"#, tick.label);
    }
    svg.push_str("</svg>");
    svg
}

fn draw_mark(svg: &mut String, mark: &Mark, scale: &Scale, y: f64) {
    let look = mark.look;
    if !mark.value.is_finite() {
        return;
    }
    let cy = coordinate(y);
    if mark.spread.is_finite() {
        let (x1, x2) =
            (percent(scale.at(mark.value - mark.spread)), percent(scale.at(mark.value + mark.spread)));
        let _ = write!(svg, r#"<line class="s spread {look}" x1="{x1}" x2="{x2}" y1="{cy}" y2="{cy}"/>"#);
    }
    let (y1, y2) = (coordinate(y - 7.0), coordinate(y + 7.0));
    for run in mark.runs.iter().filter(|x| x.is_finite()) {
        let x = percent(scale.at(*run));
        let _ = write!(svg, r#"<line class="s run {look}" x1="{x}" x2="{x}" y1="{y1}" y2="{y2}"/>"#);
    }
    let _ = write!(
        svg,
        r#"<circle class="f dot {look}" cx="{}" cy="{cy}" r="4.5"/>"#,
        percent(scale.at(mark.value))
    );
}

fn inside(x: f64, low: f64, high: f64) -> bool {
    // An end of the axis is often one of the values and may differ from it by rounding.
    let slack = 1e-9 * (high - low);
    x >= low - slack && x <= high + slack
}

/// Where a bound's track ends: at the bound if it is on the axis, else at the edge of the picture.
fn edge(bound: f64, end: f64, beyond: f64, scale: &Scale) -> f64 {
    // `beyond` is the edge of the picture in percent: 0 is the left one.
    let is_outside = if beyond == 0.0 { bound < end } else { bound > end };
    if is_outside { beyond } else { scale.at(bound) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_bounds_do_not_squeeze_the_values() {
        let narrow = Row {
            bounds: Some((0.0, 100.0)),
            marks: vec![Mark { value: 0.1, spread: 0.02, runs: vec![0.09, 0.13], ..Mark::default() }],
            ..Row::default()
        };
        let (low, high) = shared_scale(&[narrow]).domain();
        assert!(low > -0.2 && high < 0.3, "{low} {high}");
        let wide = Row {
            bounds: Some((0.0, 0.5)),
            marks: vec![Mark { value: 0.1, ..Mark::default() }, Mark { value: 0.4, ..Mark::default() }],
            ..Row::default()
        };
        assert_eq!(shared_scale(&[wide]).domain(), (0.0, 0.5));
    }
}
