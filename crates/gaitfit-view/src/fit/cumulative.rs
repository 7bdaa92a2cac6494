//! Cumulative distributions laid over one another: the area between two of them is their Wasserstein-1 distance.

use crate::chart::{Axis, Look, Plot, Series, extent};

/// One curve: values at equal steps of probability from zero to one.
pub(super) struct Quantiles<'a> {
    pub label: &'a str,
    pub look: Look,
    pub values: &'a [f64],
}

/// Points of a curve at most: one a percent.
const POINTS: usize = 101;
/// Share of samples at either end that may lie beyond the axis.
const TAIL: f64 = 0.005;
/// How much farther than the first curve the others may stretch the axis, in lengths of it.
const STRETCH: f64 = 0.4;

/// The chart; its axis holds the first curve that is there, and of the others what lies near. `None` without any.
pub(super) fn cumulative(title: &str, x_title: &str, curves: &[Quantiles]) -> Option<String> {
    let ends = |q: &Quantiles| {
        // Quantiles are sorted, so the tails are the first and the last of them.
        let cut = (TAIL * q.values.len() as f64) as usize;
        extent(q.values.iter().copied().skip(cut).take(q.values.len().saturating_sub(2 * cut)))
    };
    let (low, high) = curves.iter().find_map(ends)?;
    // A joint that stands still has a curve of no length, and the others must still get some room.
    let reach = STRETCH * (high - low).max(1e-9);
    let (from, to) = curves.iter().filter_map(ends).fold((low, high), |(a, b), (low_end, high_end)| {
        // Each end moves outwards to the farthest curve, but at most by `reach`.
        (a.min(low_end.max(low - reach)), b.max(high_end.min(high + reach)))
    });
    let points: Vec<(Vec<f64>, Vec<f64>)> = curves
        .iter()
        .map(|curve| {
            let last = curve.values.len().saturating_sub(1);
            // One value makes no curve, and it would divide by zero below.
            let count = if last == 0 { 0 } else { POINTS.min(last + 1) };
            (0..count)
                .map(|i| {
                    // Even ranks, the first and the last among them.
                    let at = i * last / (count - 1).max(1);
                    (curve.values[at], 100.0 * at as f64 / last as f64)
                })
                // What lies beyond the axis would run along its ends.
                .map(|(x, y)| if (from..=to).contains(&x) { (x, y) } else { (f64::NAN, y) })
                .unzip()
        })
        .collect();
    let plot = Plot {
        x: Axis { title: x_title, range: Some((from, to)), ticks: 4, ..Axis::default() },
        y: Axis { title: "% below", range: Some((0.0, 100.0)), ticks: 4, ..Axis::default() },
        series: curves
            .iter()
            .zip(&points)
            .map(|(curve, (x, y))| Series::Line { name: curve.label, look: curve.look, x, y })
            .collect(),
        // More than the curves have, so that they are not thinned a second time.
        points: 2 * POINTS,
    };
    plot.figure(title, 300.0, 180.0).map(|figure| figure.inline())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn far_simulators_do_not_squeeze_the_log() {
        let values = |scale: f64| (0..=200).map(|i| scale * (i as f64 / 100.0 - 1.0)).collect::<Vec<f64>>();
        let (log, wild) = (values(1.0), values(100.0));
        let curve = |values| Quantiles { label: "", look: Look::FITTED, values };
        let svg = cumulative("t", "x", &[curve(&log), curve(&wild)]).unwrap();
        let (_, rest) = svg.split_once("data-x=\"").unwrap();
        let ends: Vec<f64> = rest.split('"').next().unwrap().split(' ').map(|x| x.parse().unwrap()).collect();
        assert!(ends[0] > -2.0 && ends[0] < -1.0 && ends[1] < 2.0 && ends[1] > 1.0, "{ends:?}");
        assert!(cumulative("t", "x", &[curve(&[]), curve(&[f64::NAN; 3])]).is_none());
    }
}
