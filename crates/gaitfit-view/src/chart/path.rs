//! Long series as short SVG paths.

use std::fmt::Write;

/// A coordinate with at most two decimals, without trailing zeros.
pub(crate) fn coordinate(x: f64) -> String {
    // A user unit is about a pixel: more decimals would only make pages larger.
    let text = format!("{:.2}", if x.is_finite() { x } else { 0.0 });
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_string() } else { text.to_string() }
}

/// A position in percent of the width.
pub(crate) fn percent(x: f64) -> String {
    format!("{}%", coordinate(x))
}

/// Indices that keep the look of `y` in at most about `points` points: the smallest and the largest value of each
/// of `points / 2` equal stretches, so that no spike is lost, and the ends. A stretch with gaps (NaN) also keeps the
/// first of them.
pub(crate) fn thin(y: &[f64], points: usize) -> Vec<usize> {
    if y.len() <= points.max(4) {
        return (0..y.len()).collect();
    }
    // Two points from each stretch.
    let buckets = (points / 2).max(2);
    let mut kept = vec![0];
    for bucket in 0..buckets {
        let (from, to) = (bucket * y.len() / buckets, (bucket + 1) * y.len() / buckets);
        let finite = || (from..to).filter(|i| y[*i].is_finite());
        // Lowest and highest of each stretch, as a line of pixels covers no more.
        let low = finite().min_by(|a, b| y[*a].total_cmp(&y[*b]));
        let high = finite().max_by(|a, b| y[*a].total_cmp(&y[*b]));
        // A gap may be shorter than the stretch; without its index a line would cross it.
        let gap = (from..to).find(|i| !y[*i].is_finite());
        let mut of_stretch: Vec<usize> = [low, high, gap].into_iter().flatten().collect();
        of_stretch.sort_unstable();
        kept.extend(of_stretch);
    }
    kept.push(y.len() - 1);
    // A stretch with one number has it as lowest and as highest. The indices ascend, so equal ones are neighbours.
    kept.dedup();
    kept
}

/// A line through the points; a point that is not finite breaks it.
pub(crate) fn line(points: impl IntoIterator<Item = (f64, f64)>) -> String {
    let mut path = String::new();
    let mut pen_down = false;
    for (x, y) in points {
        if x.is_finite() && y.is_finite() {
            // A lone point between two gaps becomes a move without a line, which draws nothing.
            let command = if pen_down { 'L' } else { 'M' };
            let _ = write!(path, "{command}{} {}", coordinate(x), coordinate(y));
            pen_down = true;
        } else {
            pen_down = false;
        }
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_spikes_and_ends() {
        let mut y = vec![0.0; 10_000];
        y[1234] = 5.0;
        y[7777] = -3.0;
        let kept = thin(&y, 100);
        assert!(kept.len() <= 104);
        assert!(kept.contains(&1234) && kept.contains(&7777) && kept.contains(&9999) && kept[0] == 0);
        assert!(kept.windows(2).all(|w| w[0] < w[1]));
        assert_eq!(thin(&[1.0, f64::NAN], 100), [0, 1]);
        assert!(thin(&vec![f64::NAN; 1000], 10).len() <= 8);
    }

    #[test]
    fn a_gap_shorter_than_a_stretch_stays() {
        let mut y: Vec<f64> = (0..1000).map(f64::from).collect();
        y[150] = f64::NAN;
        let kept = thin(&y, 20);
        let parts = line(kept.iter().map(|&at| (at as f64, y[at]))).matches('M').count();
        assert_eq!((kept.contains(&150), parts), (true, 2));
    }

    #[test]
    fn a_gap_lifts_the_pen() {
        let points = [(0.0, 1.0), (1.0, 2.504), (2.0, f64::NAN), (3.0, -0.001)];
        assert_eq!(line(points), "M0 1L1 2.5M3 0");
    }
}
