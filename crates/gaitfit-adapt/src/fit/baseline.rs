//! Predictors that need no simulator: what a fit has to beat.

use super::Predicted;

/// The position target of one log.
#[derive(Clone, Copy, Debug)]
pub struct TargetSignal<'a> {
    /// Position targets, rad; `samples × joints`, row-major; sample `i` is held until sample `i + 1`.
    pub target: &'a [f64],
    /// Joints.
    pub joints: usize,
    /// Sample period, s.
    pub dt: f64,
}

/// Predicts that every joint is where its target was `delay` seconds ago (0: echo of the target). Between
/// samples the target is interpolated linearly; before the first sample it stood still. Velocities are central
/// differences of the predicted positions.
pub fn delayed(signal: TargetSignal<'_>, delay: f64) -> Predicted {
    let TargetSignal { target, joints, dt } = signal;
    // Without a whole sample there is nothing to predict.
    if joints == 0 || target.len() < joints {
        return Predicted::default();
    }
    let samples = target.len() / joints;
    let shift = delay / dt;
    let mut position = Vec::with_capacity(target.len());
    for sample in 0..samples {
        // The clamp holds the first target before the log, and the last one behind it.
        let at = (sample as f64 - shift).clamp(0.0, (samples - 1) as f64);
        let (before, part) = (at as usize, at.fract());
        let after = (before + 1).min(samples - 1);
        for joint in 0..joints {
            let (a, b) = (target[before * joints + joint], target[after * joints + joint]);
            position.push((a + part * (b - a)) as f32);
        }
    }
    let mut velocity = Vec::with_capacity(target.len());
    for sample in 0..samples {
        // At both ends the difference is one-sided.
        let (before, after) = (sample.saturating_sub(1), (sample + 1).min(samples - 1));
        // With a single sample both ends are the same, and the difference is 0 whatever the span.
        let span = ((after - before).max(1) as f64 * dt) as f32;
        for joint in 0..joints {
            velocity.push((position[after * joints + joint] - position[before * joints + joint]) / span);
        }
    }
    Predicted { position, velocity, ..Predicted::default() }
}

/// The delay in `[0, longest]` s that minimises `error`: a grid of `step` s, refined around its best point to a
/// twentieth of a step.
pub fn best_delay(longest: f64, step: f64, mut error: impl FnMut(f64) -> f64) -> f64 {
    let mut best = (f64::INFINITY, 0.0);
    let mut look = |delay: f64, best: &mut (f64, f64)| {
        let value = error(delay);
        if value < best.0 {
            *best = (value, delay);
        }
    };
    for i in 0..=(longest / step).ceil() as usize {
        // The last step of the grid may go beyond the longest delay.
        look((i as f64 * step).min(longest), &mut best);
    }
    let centre = best.1;
    // Twenty steps further are the neighbours in the grid, which were looked at.
    for i in -19_i32..=19 {
        look((centre + f64::from(i) * step / 20.0).clamp(0.0, longest), &mut best);
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep() -> Vec<f64> {
        (0..400).flat_map(|i| [(f64::from(i) * 0.03).sin(), f64::from(i) * 0.01]).collect()
    }

    #[test]
    fn no_delay_echoes_the_target_and_its_slope() {
        let target = sweep();
        let echo = delayed(TargetSignal { target: &target, joints: 2, dt: 0.005 }, 0.0);
        assert!(echo.position.iter().zip(&target).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-6));
        assert!((echo.velocity[2 * 100 + 1] - 2.0).abs() < 1e-3, "{}", echo.velocity[201]);
    }

    #[test]
    fn the_best_delay_finds_a_shift_between_samples() {
        let target = sweep();
        let signal = TargetSignal { target: &target, joints: 2, dt: 0.005 };
        let measured = delayed(signal, 0.0372).position;
        let delay = best_delay(0.2, 0.005, |delay| {
            let predicted = delayed(signal, delay).position;
            predicted.iter().zip(&measured).map(|(a, b)| f64::from((a - b) * (a - b))).sum()
        });
        assert!((delay - 0.0372).abs() < 2e-4, "{delay}");
    }
}
