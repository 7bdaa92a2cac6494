//! Power spectra of joint signals.

use std::f64::consts::TAU;

/// Samples in a segment at most: 0.2 Hz apart at 50 Hz.
const SEGMENT: usize = 256;
/// Fewer samples have no spectrum worth the name.
const FEWEST: usize = 8;

/// One-sided power spectral density of `samples` at `rate_hz`: frequencies (Hz, without zero) and densities
/// (unit² / Hz), averaged over segments of up to 256 samples, half overlapping, each with its mean taken out and a
/// Hann window (Welch, "The use of fast Fourier transform for the estimation of power spectra", 1967). The sum over
/// frequencies times their distance is the signal's variance, but for the window.
///
/// Segments with numbers that are not finite are left out; without a whole segment of at least 8 samples both lists
/// are empty.
pub fn power_spectrum(samples: &[f64], rate_hz: f64) -> (Vec<f64>, Vec<f64>) {
    // An even length, so that the highest bin lies at half the rate.
    let length = samples.len().min(SEGMENT) / 2 * 2;
    if length < FEWEST {
        return (Vec::new(), Vec::new());
    }
    let half = length / 2;
    let turn = TAU / length as f64;
    let window: Vec<f64> = (0..length).map(|k| 0.5 - 0.5 * (turn * k as f64).cos()).collect();
    // A window takes power away; dividing by the sum of its squares gives it back (Welch 1967).
    let norm = rate_hz * window.iter().map(|w| w * w).sum::<f64>();
    let mut densities = vec![0.0; half];
    let mut segments = 0.0;
    for start in (0..=samples.len() - length).step_by(half) {
        let segment = &samples[start..start + length];
        if segment.iter().any(|x| !x.is_finite()) {
            continue;
        }
        segments += 1.0;
        let mean = segment.iter().sum::<f64>() / length as f64;
        for (density, bin) in densities.iter_mut().zip(1..) {
            let (mut real, mut imaginary) = (0.0, 0.0);
            for (k, (sample, weight)) in segment.iter().zip(&window).enumerate() {
                // Whole turns are taken off before the sine, which is exact for integers.
                let (sin, cos) = (turn * (k * bin % length) as f64).sin_cos();
                real += weight * (sample - mean) * cos;
                imaginary += weight * (sample - mean) * sin;
            }
            // Negative frequencies are folded onto positive ones; the highest has no mirror.
            let sides = if bin == half { 1.0 } else { 2.0 };
            *density += sides * (real * real + imaginary * imaginary) / norm;
        }
    }
    if segments == 0.0 {
        return (Vec::new(), Vec::new());
    }
    let frequencies = (1..=half).map(|bin| bin as f64 * rate_hz / length as f64).collect();
    (frequencies, densities.into_iter().map(|density| density / segments).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tone(rate: f64, frequency: f64, count: usize) -> Vec<f64> {
        (0..count).map(|k| 3.0 + 2.0 * (TAU * frequency * k as f64 / rate).sin()).collect()
    }

    #[test]
    fn a_sine_has_its_power_at_its_frequency() {
        // One segment, of 200 samples, and fourteen.
        for (rate, frequency, count) in [(50.0, 5.0, 200), (200.0, 25.0, 2000)] {
            let (frequencies, densities) = power_spectrum(&tone(rate, frequency, count), rate);
            let peak =
                (0..densities.len()).max_by(|&a, &b| densities[a].total_cmp(&densities[b])).unwrap_or(0);
            assert!((frequencies[peak] - frequency).abs() < 1e-9);
            assert_eq!(frequencies.last(), Some(&(0.5 * rate)));
            // Variance of the sine: 2²/2; the constant 3 does not count.
            let power: f64 = densities.iter().sum::<f64>() * frequencies[0];
            assert!((power - 2.0).abs() < 1e-6, "{power}");
            let beside: f64 = densities[peak + 2..].iter().sum::<f64>() * frequencies[0];
            assert!(beside < 1e-9, "{beside}");
        }
    }

    #[test]
    fn too_little_gives_nothing_and_holes_are_left_out() {
        assert!(power_spectrum(&[], 50.0).1.is_empty());
        assert!(power_spectrum(&[1.0; 7], 50.0).1.is_empty());
        assert!(power_spectrum(&[f64::NAN; 70], 50.0).1.is_empty());
        let mut holed = tone(50.0, 5.0, 1000);
        holed[900] = f64::NAN;
        let (frequencies, densities) = power_spectrum(&holed, 50.0);
        assert!(frequencies.len() == 128 && densities.iter().all(|density| density.is_finite()));
    }
}
