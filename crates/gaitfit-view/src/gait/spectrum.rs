//! Power spectral density of joint torques by Welch's method.

use super::TorqueSpectrum;
use std::f64::consts::TAU;

/// Samples a segment at most: 0.2 Hz apart at 50 Hz.
const SEGMENT: usize = 256;

impl TorqueSpectrum {
    /// Averages the spectra of the joints of one group; `torques` has one list of samples (N·m) a joint, taken
    /// `rate_hz` times a second. Segments of up to 256 samples, half overlapping, with a Hann window and their mean
    /// taken out (Welch, "The use of fast Fourier transform for the estimation of power spectra", 1967). The sum over
    /// frequencies times their distance is the torque's variance, N²m².
    ///
    /// Segments with numbers that are not finite are left out; without a whole segment of at least 8 samples the
    /// spectrum is empty.
    pub fn from_samples(group: &str, rate_hz: f64, torques: &[Vec<f64>]) -> TorqueSpectrum {
        let shortest = torques.iter().map(Vec::len).min().unwrap_or(0);
        let length = shortest.min(SEGMENT) / 2 * 2;
        let mut spectrum = TorqueSpectrum { group: group.to_string(), ..TorqueSpectrum::default() };
        if length < 8 || !rate_hz.is_finite() || rate_hz <= 0.0 {
            return spectrum;
        }
        let window: Vec<f64> =
            (0..length).map(|i| 0.5 - 0.5 * (TAU * i as f64 / length as f64).cos()).collect();
        let (sine, cosine): (Vec<f64>, Vec<f64>) =
            (0..length).map(|i| (TAU * i as f64 / length as f64).sin_cos()).unzip();
        let norm = rate_hz * window.iter().map(|w| w * w).sum::<f64>();
        let half = length / 2;
        let mut density = vec![0.0; half + 1];
        let mut segments = 0;
        for joint in torques {
            for start in (0..=joint.len() - length).step_by(half) {
                let segment = &joint[start..start + length];
                if segment.iter().any(|x| !x.is_finite()) {
                    continue;
                }
                segments += 1;
                let mean = segment.iter().sum::<f64>() / length as f64;
                let windowed: Vec<f64> = segment.iter().zip(&window).map(|(x, w)| (x - mean) * w).collect();
                for (k, power) in density.iter_mut().enumerate() {
                    let (mut re, mut im) = (0.0, 0.0);
                    for (i, x) in windowed.iter().enumerate() {
                        let turn = i * k % length;
                        re += x * cosine[turn];
                        im += x * sine[turn];
                    }
                    // Negative frequencies are folded onto positive ones; zero and the highest have no mirror.
                    let sides = if k == 0 || k == half { 1.0 } else { 2.0 };
                    *power += sides * (re * re + im * im) / norm;
                }
            }
        }
        if segments > 0 {
            spectrum.frequency_hz = (0..=half).map(|k| k as f64 * rate_hz / length as f64).collect();
            spectrum.density = density.iter().map(|p| p / segments as f64).collect();
        }
        spectrum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tone(rate: f64, frequency: f64, amplitude: f64, count: usize) -> Vec<f64> {
        (0..count).map(|i| 3.0 + amplitude * (TAU * frequency * i as f64 / rate).sin()).collect()
    }

    #[test]
    fn a_tone_has_its_variance_at_its_frequency() {
        let joints = [tone(200.0, 25.0, 2.0, 2000), tone(200.0, 25.0, 4.0, 2000)];
        let spectrum = TorqueSpectrum::from_samples("hip", 200.0, &joints);
        let step = spectrum.frequency_hz[1];
        assert_eq!(*spectrum.frequency_hz.last().unwrap_or(&0.0), 100.0);
        let peak =
            (0..spectrum.density.len()).max_by(|a, b| spectrum.density[*a].total_cmp(&spectrum.density[*b]));
        assert_eq!(peak.map(|k| spectrum.frequency_hz[k]), Some(25.0));
        // Mean of 2²/2 and 4²/2; a constant torque of 3 N·m does not count.
        let variance: f64 = spectrum.density.iter().sum::<f64>() * step;
        assert!((variance - 5.0).abs() < 1e-6, "{variance}");
        let beside: f64 = spectrum.density[40..].iter().sum::<f64>() * step;
        assert!(beside < 1e-9, "{beside}");
    }

    #[test]
    fn too_little_gives_an_empty_spectrum() {
        assert!(TorqueSpectrum::from_samples("hip", 50.0, &[]).density.is_empty());
        assert!(TorqueSpectrum::from_samples("hip", 50.0, &[vec![1.0; 7]]).density.is_empty());
        assert!(TorqueSpectrum::from_samples("hip", f64::NAN, &[vec![1.0; 70]]).density.is_empty());
        assert!(TorqueSpectrum::from_samples("hip", 50.0, &[vec![f64::NAN; 70]]).density.is_empty());
        let mut holed = tone(50.0, 5.0, 1.0, 1000);
        holed[900] = f64::NAN;
        let spectrum = TorqueSpectrum::from_samples("hip", 50.0, &[holed]);
        assert!(spectrum.density.iter().all(|p| p.is_finite()) && spectrum.density.len() == 129);
    }
}
