//! One joint over time: target, measured, nominal and fitted position, and below it what the simulators miss.

use super::panel::{self, Panel};
use super::scale::{self, Scale};
use crate::report::JointTrace;
use std::ops::Range;

/// How a joint is drawn.
pub(crate) struct Look {
    pub width: f64,
    pub height: f64,
    /// Height of the residual panel, user units.
    pub residual: f64,
    /// Whether the residual's scale must hold the nominal simulator's too.
    pub nominal_residual: bool,
    /// About how many points a line may have.
    pub points: usize,
}

/// Simulated minus measured, rad, over the samples both have.
pub(crate) fn residual(simulated: &[f64], measured: &[f64]) -> Vec<f64> {
    simulated.iter().zip(measured).map(|(s, m)| s - m).collect()
}

/// Samples of `seconds` around the worst fitted residual; all of them if the log is shorter.
pub(crate) fn worst_window(trace: &JointTrace, seconds: f64) -> Range<usize> {
    let count = trace.time_s.len();
    let missed = residual(&trace.fitted, &trace.measured);
    let finite = missed.iter().enumerate().filter(|(i, r)| *i < count && r.is_finite());
    let Some((worst, _)) = finite.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())) else {
        return 0..count;
    };
    let first_time = trace.time_s.first().copied().unwrap_or(0.0);
    let last_time = trace.time_s.last().copied().unwrap_or(0.0);
    let begin = (trace.time_s[worst] - seconds / 2.0).min(last_time - seconds).max(first_time);
    let from = trace.time_s.partition_point(|t| *t < begin);
    let to = trace.time_s.partition_point(|t| *t <= begin + seconds);
    if from < to { from..to } else { 0..count }
}

/// The chart of the samples in `range`; `None` without times or any series.
pub(crate) fn trace(trace: &JointTrace, range: Range<usize>, look: &Look) -> Option<String> {
    let cut = |series: &[f64]| -> Vec<f64> {
        series.get(range.start.min(series.len())..range.end.min(series.len())).unwrap_or(&[]).to_vec()
    };
    let time = cut(&trace.time_s);
    let (measured, fitted) = (cut(&trace.measured), cut(&trace.fitted));
    let (nominal, target) = (cut(&trace.nominal), cut(&trace.target));
    let times = scale::extent(time.iter().copied())?;
    let all = measured.iter().chain(&fitted).chain(&nominal).chain(&target).copied();
    let values = scale::extent(all)?;

    let (left, right, top) = (52.0, look.width - 8.0, 24.0);
    let residual_bottom = look.height - 36.0;
    let residual_top = residual_bottom - look.residual;
    let bottom = residual_top - 30.0;
    let x = Scale::linear(Some(times), left, right);
    let x_ticks = (look.width / 70.0) as usize;
    let upper = Panel {
        x,
        y: Scale::linear(Some(values), bottom, top).padded(0.05),
        left,
        right,
        top,
        bottom,
        x_title: "",
        y_title: "position (rad)",
        x_ticks,
        y_ticks: 4,
    };
    let mut svg = panel::open_svg(look.width, look.height, &format!("{} over time", trace.joint));
    upper.open(&mut svg);
    let (step_time, step_target) = held(&time, &target);
    upper.series(&mut svg, "target", "target", &step_time, &step_target, 2 * look.points);
    upper.series(&mut svg, "nominal", "nominal", &time, &nominal, look.points);
    upper.series(&mut svg, "measured", "measured", &time, &measured, look.points);
    upper.series(&mut svg, "fitted", "fitted", &time, &fitted, look.points);
    panel::close(&mut svg);

    let missed = residual(&fitted, &measured);
    let missed_before = residual(&nominal, &measured);
    let counted: &[f64] = if look.nominal_residual || missed.is_empty() { &missed_before } else { &[] };
    let largest = scale::extent(missed.iter().chain(counted).map(|r| r.abs())).map_or(1.0, |(_, high)| high);
    let lower = Panel {
        x,
        y: Scale::linear(Some((-largest, largest)), residual_bottom, residual_top).padded(0.08),
        left,
        right,
        top: residual_top,
        bottom: residual_bottom,
        x_title: "time (s)",
        y_title: "simulated − measured (rad)",
        x_ticks,
        y_ticks: 4,
    };
    lower.open(&mut svg);
    if !counted.is_empty() {
        lower.series(&mut svg, "nominal", "nominal", &time, &missed_before, look.points);
    }
    lower.series(&mut svg, "fitted", "fitted", &time, &missed, look.points);
    panel::close(&mut svg);
    svg.push_str("</svg>");
    Some(svg)
}

/// A value held until the next sample, as corner points; runs of one value keep their ends only.
fn held(time: &[f64], value: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut times, mut values) = (Vec::new(), Vec::new());
    let count = time.len().min(value.len());
    for i in 0..count {
        let changed = i == 0 || value[i] != value[i - 1];
        if changed && i > 0 {
            times.push(time[i]);
            values.push(value[i - 1]);
        }
        if changed || i + 1 == count {
            times.push(time[i]);
            values.push(value[i]);
        }
    }
    (times, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_held_target_has_corners() {
        let (t, v) = held(&[0.0, 1.0, 2.0, 3.0], &[5.0, 5.0, 7.0, 7.0]);
        assert_eq!(t, [0.0, 2.0, 2.0, 3.0]);
        assert_eq!(v, [5.0, 5.0, 7.0, 7.0]);
    }

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
