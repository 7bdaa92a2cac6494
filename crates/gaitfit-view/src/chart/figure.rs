//! One SVG: charts, texts and legends on a sheet of a fixed size.

use super::look::{Look, STYLE};
use super::path::coordinate;
use super::plot::Plot;
use crate::format::escape;
use std::fmt::Write;

/// A rectangle of a figure in user units, x to the right and y downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Its smallest x.
    pub left: f64,
    /// Its smallest y.
    pub top: f64,
    /// Its largest x.
    pub right: f64,
    /// Its largest y.
    pub bottom: f64,
}

/// Part of a text that lies at its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Its beginning.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// Width of a letter of the charts' small text, user units, on average.
const LETTER: f64 = 6.1;

/// An SVG that is being drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    label: String,
    width: f64,
    height: f64,
    body: String,
}

impl Figure {
    /// An empty sheet of a size in user units. `label` says to those who do not see it what it is.
    pub fn new(label: &str, width: f64, height: f64) -> Figure {
        Figure { label: label.to_string(), width, height, body: String::new() }
    }

    /// Draws axes and series so that the axes enclose `frame`; numbers and titles lie outside: 50 units at the left, 15
    /// below, 35 with a title there, and 20 above with a title there. Draws nothing and gives false when an axis has
    /// neither a range nor a value.
    pub fn plot(&mut self, plot: &Plot, frame: Frame) -> bool {
        let Some(axes) = plot.axes(frame) else { return false };
        axes.open(&mut self.body);
        for series in &plot.series {
            series.draw(&mut self.body, &axes, plot.points);
        }
        self.body.push_str("</g>");
        true
    }

    /// Writes small text; y is its base line.
    pub fn text(&mut self, x: f64, y: f64, anchor: Anchor, text: &str) {
        let class = match anchor {
            Anchor::Start => "t",
            Anchor::Middle => "t m",
            Anchor::End => "t e",
        };
        let (x, y) = (coordinate(x), coordinate(y));
        let _ = write!(self.body, r#"<text class="{class}" x="{x}" y="{y}">{}</text>"#, escape(text));
    }

    /// Writes a heading; y is its base line.
    pub fn heading(&mut self, x: f64, y: f64, text: &str) {
        let (x, y) = (coordinate(x), coordinate(y));
        let _ = write!(self.body, r#"<text class="h" x="{x}" y="{y}">{}</text>"#, escape(text));
    }

    /// Writes names beside strokes in the look of their lines, from `x` on; y is the texts' base line. What would
    /// reach beyond `right` is left out. Gives where the legend ends.
    pub fn legend(&mut self, x: f64, y: f64, right: f64, entries: &[(&str, Look)]) -> f64 {
        let mut x = x;
        for (name, look) in entries {
            // A long name would push the other entries out.
            let shown = shortened(name, 24);
            // A stroke of 18 units and a gap of 5.
            let end = x + 23.0 + text_width(&shown);
            // A legend that runs out of the figure would be cut in the middle of a name.
            if end > right {
                break;
            }
            // At half the height of small letters.
            let (from, stroke) = (coordinate(x), coordinate(y - 4.0));
            let _ = write!(self.body, r#"<path class="s {look}" d="M{from} {stroke}h18"/>"#);
            self.text(x + 23.0, y, Anchor::Start, &shown);
            x = end + 16.0;
        }
        x
    }

    /// Changes the height, e.g. once it is known how much was drawn.
    pub fn set_height(&mut self, height: f64) {
        self.height = height;
    }

    /// Whether nothing was drawn yet.
    pub fn is_empty(&self) -> bool {
        self.body.is_empty()
    }

    /// The element for a page that has [`STYLE`]; it takes the width that the page gives it.
    pub fn inline(&self) -> String {
        let Figure { width, height, body, .. } = self;
        format!(
            r#"<svg viewBox="0 0 {} {}" role="img" aria-label="{}">{body}</svg>"#,
            coordinate(*width),
            coordinate(*height),
            escape(&self.label)
        )
    }

    /// The text of an `.svg` file: style inside, white paper, nothing that is loaded from elsewhere. Colours are plain
    /// values, which programs understand that do not know CSS variables.
    pub fn standalone(&self) -> String {
        let (width, height) = (coordinate(self.width), coordinate(self.height));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
             height=\"{height}\" role=\"img\" aria-label=\"{label}\"><title>{label}</title><style>/*<![CDATA[*/\n\
             svg {{ font-family: \"DejaVu Sans\", Verdana, sans-serif; }}\n{}/*]]>*/</style>\
             <rect width=\"{width}\" height=\"{height}\" fill=\"{}\"/>{}</svg>\n",
            plain_style(),
            colour("--paper"),
            self.body,
            label = escape(&self.label),
        )
    }
}

/// About how wide small text is, user units.
pub(super) fn text_width(text: &str) -> f64 {
    LETTER * text.chars().count() as f64
}

/// At most `longest` characters of a text.
pub(super) fn shortened(text: &str, longest: usize) -> String {
    if text.chars().count() <= longest {
        return text.to_string();
    }
    // The ellipsis counts as one character.
    text.chars().take(longest.saturating_sub(1)).chain(['…']).collect()
}

/// The variables of light pages as `(name, value)`: the first block of the style sheet.
fn variables() -> impl Iterator<Item = (&'static str, &'static str)> {
    // The first block has the colours of light pages. Dark ones come later, and a file has white paper.
    let block =
        STYLE.split_once('{').and_then(|(_, rest)| rest.split_once('}')).map_or("", |(block, _)| block);
    block.split(';').filter_map(|line| line.split_once(':')).map(|(name, value)| (name.trim(), value.trim()))
}

fn colour(name: &str) -> &'static str {
    variables().find(|(known, _)| *known == name).map_or("white", |(_, value)| value)
}

/// The rules of the style sheet with the values of light pages in place of variables.
fn plain_style() -> String {
    // The rules of marks. The blocks before them define variables, which are replaced below.
    let rules = STYLE.lines().filter(|line| line.starts_with("svg ")).collect::<Vec<_>>().join("\n");
    variables().fold(rules, |rules, (name, value)| rules.replace(&format!("var({name})"), value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_needs_no_variables() {
        let style = plain_style();
        assert!(style.contains("stroke: #d55e00") && !style.contains("var("), "{style}");
        assert_eq!(colour("--paper"), "#ffffff");
    }
}
