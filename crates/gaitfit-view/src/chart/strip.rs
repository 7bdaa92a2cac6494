//! A bar from zero that stretches with the page's column, for scores where shorter is better.

use super::path::percent;
use super::scale::Scale;
use std::fmt::Write;

/// The right-hand end of the longest bar, percent of the width.
const END: f64 = 98.0;

/// One bar's picture, its length in proportion to `value` of `largest`; highlighted in the colour of fits. A value that
/// is not finite has no bar.
pub(crate) fn bar(value: f64, largest: f64, highlighted: bool) -> String {
    // From zero, so that the lengths of bars compare.
    let scale = Scale::linear(Some((0.0, largest)), 0.0, END);
    let mut svg = String::from(r#"<svg class="strip bar" width="100%" height="22" aria-hidden="true">"#);
    if value.is_finite() {
        let class = if highlighted { "f fitted" } else { "f target" };
        // A bar too short to see still shows that there is a value.
        let width = scale.at(value.max(0.0)).clamp(0.3, 100.0);
        let _ = write!(
            svg,
            r#"<rect class="{class}" x="0" y="3" width="{}" height="16" rx="2"/>"#,
            percent(width)
        );
    }
    svg.push_str("</svg>");
    svg
}
