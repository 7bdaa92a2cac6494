//! Cumulative distributions laid over one another: the area between two of them is their Wasserstein-1 distance.

use super::panel::{self, Panel};
use super::scale::{self, Scale};

/// One curve: values at equal steps of probability from zero to one.
pub(crate) struct Quantiles<'a> {
    pub label: &'a str,
    /// Style-sheet class.
    pub class: &'static str,
    pub values: &'a [f64],
}

/// Points of a curve at most.
const POINTS: usize = 101;
/// Share of samples at either end that may lie beyond the axis.
const TAIL: f64 = 0.005;
/// How much farther than the first curve the others may stretch the axis, in lengths of it.
const STRETCH: f64 = 0.4;

/// The chart; its axis holds the first curve that is there, and of the others what lies near. `None` without any.
pub(crate) fn cumulative(title: &str, x_title: &str, curves: &[Quantiles]) -> Option<String> {
    let (left, right, top, bottom) = (40.0, 292.0, 12.0, 132.0);
    let ends = |q: &Quantiles| {
        let cut = (TAIL * q.values.len() as f64) as usize;
        scale::extent(q.values.iter().copied().skip(cut).take(q.values.len().saturating_sub(2 * cut)))
    };
    let (low, high) = curves.iter().find_map(ends)?;
    let reach = STRETCH * (high - low).max(1e-9);
    let (from, to) = curves.iter().filter_map(ends).fold((low, high), |(a, b), (low_end, high_end)| {
        (a.min(low_end.max(low - reach)), b.max(high_end.min(high + reach)))
    });
    let chart = Panel {
        x: Scale::linear(Some((from, to)), left, right),
        y: Scale::linear(Some((0.0, 100.0)), bottom, top),
        left,
        right,
        top,
        bottom,
        x_title,
        y_title: "",
        x_ticks: 4,
        y_ticks: 4,
    };
    let mut svg = panel::open_svg(300.0, 168.0, title);
    chart.open(&mut svg);
    for curve in curves.iter().filter(|c| c.values.len() > 1) {
        let last = curve.values.len() - 1;
        let points = POINTS.min(last + 1);
        let (x, y): (Vec<f64>, Vec<f64>) = (0..points)
            .map(|i| {
                let at = i * last / (points - 1).max(1);
                (curve.values[at], 100.0 * at as f64 / last as f64)
            })
            // What lies beyond the axis would run along its ends.
            .map(|(x, y)| if (from..=to).contains(&x) { (x, y) } else { (f64::NAN, y) })
            .unzip();
        chart.series(&mut svg, curve.label, curve.class, &x, &y, 2 * POINTS);
    }
    panel::close(&mut svg);
    svg.push_str("</svg>");
    Some(svg)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn far_simulators_do_not_squeeze_the_log() {
        let values = |scale: f64| (0..=200).map(|i| scale * (i as f64 / 100.0 - 1.0)).collect::<Vec<f64>>();
        let (log, wild) = (values(1.0), values(100.0));
        let curve = |values| Quantiles { label: "", class: "fitted", values };
        let svg = cumulative("t", "x", &[curve(&log), curve(&wild)]).unwrap();
        let (_, rest) = svg.split_once("data-x=\"").unwrap();
        let ends: Vec<f64> = rest.split('"').next().unwrap().split(' ').map(|x| x.parse().unwrap()).collect();
        assert!(ends[0] > -2.0 && ends[0] < -1.0 && ends[1] < 2.0 && ends[1] > 1.0, "{ends:?}");
        assert!(cumulative("t", "x", &[curve(&[]), curve(&[f64::NAN; 3])]).is_none());
    }
}
