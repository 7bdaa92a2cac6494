//! Horizontal bars with names and intervals, in groups that have a scale each.

use super::axes::Axis;
use super::figure::{Anchor, Figure, Frame, shortened, text_width};
use super::look::Look;
use super::plot::Plot;
use super::scale;
use super::series::{Corners, Series};

/// Width of the longest bar, user units.
const BARS: f64 = 420.0;
/// Height of a bar's line, user units.
const LINE: f64 = 20.0;
/// Height of a group's title, user units.
const TITLE: f64 = 30.0;
/// Max number of characters of a name.
const NAME: usize = 56;
/// Max number of characters of a value's text.
const TEXT: usize = 40;

/// One bar from zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Bar {
    /// Text to its left.
    pub name: String,
    /// Its length; NaN: none.
    pub value: f64,
    /// Half-width of the interval drawn over it; NaN: none.
    pub half_width: f64,
    /// Text to its right.
    pub text: String,
    /// Look of the bar.
    pub look: Look,
}

/// Bars of one unit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BarGroup {
    /// Quantity of the bars, with the unit.
    pub title: String,
    /// Bars from top to bottom.
    pub bars: Vec<Bar>,
}

/// All groups below one another. `label` says to those who do not see it what it is.
pub fn bar_figure(label: &str, groups: &[BarGroup]) -> Figure {
    let bars = || groups.iter().flat_map(|group| &group.bars);
    // SVG does not wrap or measure texts, so the room for names and values is estimated from their letters.
    let widest = |texts: Vec<String>| texts.iter().map(|text| text_width(text)).fold(0.0, f64::max);
    let names = widest(bars().map(|bar| shortened(&bar.name, NAME)).collect());
    let texts = widest(bars().map(|bar| shortened(&bar.text, TEXT)).collect());
    // The longest name of all groups, so that all bars begin at one x.
    let left = names + 20.0;
    let right = left + BARS;
    let mut figure = Figure::new(label, right + texts + 20.0, 0.0);
    let mut top = 6.0;
    for group in groups {
        figure.heading(10.0, top + 16.0, &group.title);
        top += TITLE;
        let bottom = top + LINE * group.bars.len() as f64;
        draw(&mut figure, &group.bars, Frame { left, top, right, bottom });
        top = bottom + 26.0;
    }
    // Without any group the sheet is still a valid picture.
    figure.set_height(top.max(20.0));
    figure
}

fn draw(figure: &mut Figure, bars: &[Bar], frame: Frame) {
    let interval = |bar: &Bar| {
        let half = if bar.half_width.is_finite() { bar.half_width } else { 0.0 };
        (bar.value - half, bar.value + half)
    };
    // Zero is always on the axis, because bars begin there.
    let ends = bars.iter().map(interval).flat_map(|(low, high)| [low, high]);
    let range = scale::extent(ends.chain([0.0])).filter(|(low, high)| low < high).unwrap_or((0.0, 1.0));
    // Lines are counted upwards from the axis.
    let line = |number: usize| (bars.len() - number) as f64 - 0.5;
    // Series borrow their numbers, so these vectors outlive the plot.
    let boxes: Vec<(Look, Corners)> = bars
        .iter()
        .enumerate()
        .filter(|(_, bar)| bar.value.is_finite())
        .map(|(i, bar)| {
            // Two thirds of the line's height; the rest is the gap between bars. A negative value has its bar to
            // the left of zero.
            (bar.look, [(bar.value.min(0.0), bar.value.max(0.0)), (line(i) - 0.32, line(i) + 0.32)])
        })
        .collect();
    let whiskers: Vec<([f64; 2], [f64; 2])> = bars
        .iter()
        .enumerate()
        .filter(|(_, bar)| bar.value.is_finite() && bar.half_width.is_finite())
        .map(|(i, bar)| ([interval(bar).0, interval(bar).1], [line(i); 2]))
        .collect();
    let drawn = boxes
        .iter()
        .map(|(look, corners)| Series::Boxes { look: *look, corners: std::slice::from_ref(corners) });
    let over = whiskers.iter().map(|(x, y)| Series::Line { name: "", look: Look::MEAN, x, y });
    // Drawn even where all bars are on one side, because every length is read from it.
    let zero = Series::Rule { look: Look::MEASURED.thin(), at: 0.0, upright: true };
    let plot = Plot {
        x: Axis { range: Some(range), ticks: 6, ..Axis::default() },
        y: Axis { range: Some((0.0, bars.len().max(1) as f64)), ticks: 0, ..Axis::default() },
        // Whiskers and the line at zero lie above the bars.
        series: drawn.chain(over).chain([zero]).collect(),
        ..Plot::default()
    };
    figure.plot(&plot, frame);
    // The plot's own scale, so that each text stands at the end of its bar.
    let scale = scale::Scale::linear(Some(range), frame.left, frame.right);
    for (i, bar) in bars.iter().enumerate() {
        // SVG places text by its base line, which is about 4 units below the middle of the letters.
        let base = frame.top + LINE * (i as f64 + 0.5) + 4.0;
        figure.text(frame.left - 8.0, base, Anchor::End, &shortened(&bar.name, NAME));
        // The text stands to the right of the bar, of its whisker, and of zero.
        let reach =
            [0.0, interval(bar).1].map(|end| if end.is_finite() { scale.at(end) } else { frame.left });
        figure.text(reach[0].max(reach[1]) + 6.0, base, Anchor::Start, &shortened(&bar.text, TEXT));
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn bars_are_as_long_as_their_values() {
        let bar = |value, half_width| Bar {
            name: "<a> \u{1b}".into(),
            value,
            half_width,
            text: String::new(),
            look: Look::color(0),
        };
        let group = BarGroup { title: "m".into(), bars: vec![bar(4.0, 1.0), bar(-1.0, f64::NAN)] };
        let svg = bar_figure("errors", &[group, BarGroup::default()]).standalone();
        let document = roxmltree::Document::parse(&svg).unwrap();
        let width = |number: usize| -> f64 {
            let path = document.descendants().filter(|n| n.attribute("class") == Some("f c0")).nth(number);
            let d = path.unwrap().attribute("d").unwrap().to_string();
            let ends: Vec<f64> =
                d[1..].split(['H', ' ', 'V', 'Z']).filter_map(|text| text.parse().ok()).collect();
            ends[2] - ends[0]
        };
        // The axis reaches from -1 to 5.
        assert!((width(0) - 4.0 / 6.0 * BARS).abs() < 0.1 && (width(1) - BARS / 6.0).abs() < 0.1, "{svg}");
        let texts: Vec<&str> = document.descendants().filter_map(|n| n.text()).collect();
        assert!(texts.contains(&"<a> "), "{texts:?}");
    }
}
