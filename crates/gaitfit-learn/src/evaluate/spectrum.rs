//! Power spectra of joint signals.

/// One-sided power spectral density of `samples` at `rate_hz`: frequencies (Hz) and densities (unit² / Hz), by one
/// Hann window over all samples after taking away their mean (Welch 1967, a single segment). Its sum times the
/// frequency step is the signal's variance, but for the window. Direct evaluation: for hundreds of samples.
pub fn power_spectrum(samples: &[f64], rate_hz: f64) -> (Vec<f64>, Vec<f64>) {
    let n = samples.len();
    if n < 4 {
        return (Vec::new(), Vec::new());
    }
    let mean = samples.iter().sum::<f64>() / n as f64;
    let turn = std::f64::consts::TAU / n as f64;
    let window: Vec<f64> = (0..n).map(|k| 0.5 - 0.5 * (turn * k as f64).cos()).collect();
    let norm = rate_hz * window.iter().map(|w| w * w).sum::<f64>();
    let mut frequencies = Vec::with_capacity(n / 2);
    let mut densities = Vec::with_capacity(n / 2);
    for bin in 1..=n / 2 {
        let (mut real, mut imaginary) = (0.0, 0.0);
        for (k, (sample, weight)) in samples.iter().zip(&window).enumerate() {
            let (sin, cos) = (turn * (k * bin % n) as f64).sin_cos();
            real += weight * (sample - mean) * cos;
            imaginary += weight * (sample - mean) * sin;
        }
        let twice = if 2 * bin == n { 1.0 } else { 2.0 };
        frequencies.push(bin as f64 * rate_hz / n as f64);
        densities.push(twice * (real * real + imaginary * imaginary) / norm);
    }
    (frequencies, densities)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_has_its_power_at_its_frequency() {
        let rate = 50.0;
        let wave = |k: usize| 3.0 + 2.0 * (std::f64::consts::TAU * 5.0 * k as f64 / rate).sin();
        let samples: Vec<f64> = (0..400).map(wave).collect();
        let (frequencies, densities) = power_spectrum(&samples, rate);
        let peak = (0..densities.len()).max_by(|&a, &b| densities[a].total_cmp(&densities[b])).unwrap_or(0);
        assert!((frequencies[peak] - 5.0).abs() < 1e-9);
        // Variance of the sine: 2²/2.
        let power: f64 = densities.iter().sum::<f64>() * rate / 400.0;
        assert!((power - 2.0).abs() < 1e-3, "{power}");
    }
}
