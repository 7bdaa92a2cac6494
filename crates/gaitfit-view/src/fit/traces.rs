//! One joint over time: target, measured, nominal and fitted position, and below it what the simulators miss.

use super::JointTrace;
use crate::chart::{Axis, Figure, Frame, Look, Plot, Series, extent};
use std::ops::Range;

/// Joints drawn at most on a page.
pub(crate) const MAX_JOINTS: usize = 64;
/// Points of all lines of all joints together, which keeps the page's size in bounds.
pub(crate) const POINT_BUDGET: usize = 110_000;

/// Size of a joint's drawing.
pub(crate) struct Size {
    pub width: f64,
    pub height: f64,
    /// Height of the residual panel, user units.
    pub residual: f64,
    /// Whether the residual's scale must hold the nominal simulator's too.
    pub nominal_residual: bool,
    /// About how many points a line may have.
    pub points: usize,
}

/// Simulated minus measured, rad (slides: m), over the samples both have.
pub(crate) fn residual(simulated: &[f64], measured: &[f64]) -> Vec<f64> {
    simulated.iter().zip(measured).map(|(s, m)| s - m).collect()
}

/// Samples of `seconds` around the worst fitted residual; all of them if the log is shorter.
pub(crate) fn worst_window(trace: &JointTrace, seconds: f64) -> Range<usize> {
    let count = trace.time_s.len();
    // The moment in which the fitted simulator is farthest from the robot shows best what it lacks.
    let missed = residual(&trace.fitted, &trace.measured);
    let finite = missed.iter().enumerate().filter(|(i, r)| *i < count && r.is_finite());
    let Some((worst, _)) = finite.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())) else {
        return 0..count;
    };
    let first_time = trace.time_s.first().copied().unwrap_or(0.0);
    let last_time = trace.time_s.last().copied().unwrap_or(0.0);
    // The worst sample in the middle, but for the ends of the log.
    let begin = (trace.time_s[worst] - seconds / 2.0).min(last_time - seconds).max(first_time);
    // Times ascend, so a binary search finds both ends.
    let from = trace.time_s.partition_point(|t| *t < begin);
    let to = trace.time_s.partition_point(|t| *t <= begin + seconds);
    if from < to { from..to } else { 0..count }
}

/// The chart of the samples in `range`; `None` without times or any series.
pub(crate) fn trace(trace: &JointTrace, range: Range<usize>, size: &Size) -> Option<String> {
    // A series may be missing or shorter than the times.
    let cut = |series: &[f64]| -> Vec<f64> {
        series.get(range.start.min(series.len())..range.end.min(series.len())).unwrap_or(&[]).to_vec()
    };
    let time = cut(&trace.time_s);
    let (measured, fitted) = (cut(&trace.measured), cut(&trace.fitted));
    let (nominal, target) = (cut(&trace.nominal), cut(&trace.target));
    let times = extent(time.iter().copied())?;
    let positions = measured.iter().chain(&fitted).chain(&nominal).chain(&target).copied();
    let values = extent(positions)?;
    let unit = trace.unit();
    let (position, error) = (format!("position ({unit})"), format!("simulated − measured ({unit})"));

    let (left, right) = (54.0, size.width - 8.0);
    let residual_bottom = size.height - 36.0;
    let residual_top = residual_bottom - size.residual;
    // A number of seconds is less than 70 units wide.
    let x_ticks = (size.width / 70.0) as usize;
    let simulated = !fitted.is_empty() || !nominal.is_empty();
    let time_axis = |ticks| Axis { title: "time (s)", range: Some(times), ticks, ..Axis::default() };
    let upper = Plot {
        // The numbers stand below the lower panel, which shares the axis.
        x: if simulated { Axis { title: "", ..time_axis(0) } } else { time_axis(x_ticks) },
        y: Axis { title: &position, range: Some(values), pad: 0.05, ticks: 4, ..Axis::default() },
        series: vec![
            Series::Step { name: "target", look: Look::TARGET, x: &time, y: &target },
            Series::Line { name: "nominal", look: Look::NOMINAL, x: &time, y: &nominal },
            Series::Line { name: "measured", look: Look::MEASURED, x: &time, y: &measured },
            Series::Line { name: "fitted", look: Look::FITTED, x: &time, y: &fitted },
        ],
        points: size.points,
    };
    let mut figure = Figure::new(&format!("{} over time", trace.joint), size.width, size.height);
    // The title of the lower panel stands between the two.
    let bottom = if simulated { residual_top - 30.0 } else { residual_bottom };
    figure.plot(&upper, Frame { left, top: 24.0, right, bottom });
    if !simulated {
        return Some(figure.inline());
    }

    let missed = residual(&fitted, &measured);
    let missed_before = residual(&nominal, &measured);
    // The nominal error may be far larger: it sets the scale only where that is asked for, or where it is
    // alone.
    let counted: &[f64] = if size.nominal_residual || missed.is_empty() { &missed_before } else { &[] };
    let largest = extent(missed.iter().chain(counted).map(|r| r.abs())).map_or(1.0, |(_, high)| high);
    let mut series = Vec::new();
    if !counted.is_empty() {
        series.push(Series::Line { name: "nominal", look: Look::NOMINAL, x: &time, y: &missed_before });
    }
    series.push(Series::Line { name: "fitted", look: Look::FITTED, x: &time, y: &missed });
    let lower = Plot {
        x: time_axis(x_ticks),
        y: Axis { title: &error, range: Some((-largest, largest)), pad: 0.08, ticks: 3, ..Axis::default() },
        series,
        points: size.points,
    };
    figure.plot(&lower, Frame { left, top: residual_top, right, bottom: residual_bottom });
    Some(figure.inline())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_holds_the_worst_sample() {
        let time_s: Vec<f64> = (0..1000).map(|i| i as f64 * 0.01).collect();
        let mut fitted = vec![0.0; 1000];
        fitted[990] = 1.0;
        fitted[3] = f64::NAN;
        let joint = JointTrace { time_s, fitted, measured: vec![0.0; 1000], ..JointTrace::default() };
        let window = worst_window(&joint, 4.0);
        assert!(window.contains(&990));
        assert!((400..=402).contains(&window.len()), "{window:?}");
        assert_eq!(worst_window(&JointTrace::default(), 4.0), 0..0);
    }
}
