//! Operators that look at several numbers of a robot: sums over axes, and functions of the numbers along an axis.

/// Reduction of the numbers that go to the same place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reduction {
    /// Σ x.
    Sum,
    /// Their mean.
    Mean,
    /// The largest; NaN if one is.
    Max,
    /// The smallest; NaN if one is.
    Min,
    /// Σ |x|.
    L1,
    /// √Σ x².
    L2,
    /// Σ x².
    SumSquare,
}

impl Reduction {
    /// Reduces the numbers of one robot: `to` is the place in `out` of each number of `input`, `each` how
    /// many go to a place. Sums in `f64`.
    pub fn apply(self, out: &mut [f32], input: &[f32], to: &[u32], each: usize) {
        let start = match self {
            Self::Max => f64::NEG_INFINITY,
            Self::Min => f64::INFINITY,
            _ => 0.0,
        };
        let mut sums = vec![start; out.len()];
        for (&x, &to) in input.iter().zip(to) {
            let (x, sum) = (f64::from(x), &mut sums[to as usize]);
            *sum = match self {
                Self::Sum | Self::Mean => *sum + x,
                Self::L1 => *sum + x.abs(),
                Self::L2 | Self::SumSquare => *sum + x * x,
                // A NaN is taken and stays, because no number compares as larger.
                Self::Max if x > *sum || x.is_nan() => x,
                Self::Min if x < *sum || x.is_nan() => x,
                Self::Max | Self::Min => *sum,
            };
        }
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = match self {
                Self::Mean => sum / each as f64,
                Self::L2 => sum.sqrt(),
                _ => sum,
            } as f32;
        }
    }
}

/// A function of the numbers along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Along {
    /// eˣ / Σ eˣ.
    Softmax,
    /// Its natural logarithm.
    LogSoftmax,
    /// Divided by Σ |x|.
    L1,
    /// Divided by √Σ x².
    L2,
    /// (x − mean) / √(variance + ε), the variance the population's.
    Norm(f32),
}

impl Along {
    /// Writes its values for one robot, for runs of `length` numbers that are `stride` apart.
    pub fn apply(self, out: &mut [f32], input: &[f32], length: usize, stride: usize) {
        // In `f64`, so that only the result is rounded.
        let mut run = vec![0.0; length];
        // Runs are interleaved: `stride` of them begin one beside the other in each block.
        for block in 0..input.len() / (length * stride) {
            for start in block * length * stride..block * length * stride + stride {
                for (number, x) in run.iter_mut().enumerate() {
                    *x = f64::from(input[start + number * stride]);
                }
                self.of(&mut run);
                for (number, &x) in run.iter().enumerate() {
                    out[start + number * stride] = x as f32;
                }
            }
        }
    }

    fn of(self, run: &mut [f64]) {
        let many = run.len() as f64;
        let sum = |run: &[f64], function: fn(f64) -> f64| run.iter().map(|&x| function(x)).sum::<f64>();
        let change = |run: &mut [f64], offset: f64, factor: f64| {
            run.iter_mut().for_each(|x| *x = (*x - offset) * factor);
        };
        match self {
            Self::Softmax | Self::LogSoftmax => {
                // Less the largest, no exponential overflows.
                let largest = run.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let log = sum(&run.iter().map(|x| x - largest).collect::<Vec<_>>(), f64::exp).ln() + largest;
                change(run, log, 1.0);
                if self == Self::Softmax {
                    run.iter_mut().for_each(|x| *x = x.exp());
                }
            }
            // Nothing divided by nothing is nothing, as onnxruntime has it.
            Self::L1 | Self::L2 => {
                let length = match self {
                    Self::L1 => sum(run, f64::abs),
                    _ => sum(run, |x| x * x).sqrt(),
                };
                change(run, 0.0, if length > 0.0 || length.is_nan() { 1.0 / length } else { 0.0 });
            }
            Self::Norm(epsilon) => {
                let mean = sum(run, |x| x) / many;
                let variance = run.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / many;
                change(run, mean, 1.0 / (variance + f64::from(epsilon)).sqrt());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_go_to_their_places() {
        let input = [3.0, 4.0, -6.0, 8.0];
        let cases = [
            (Reduction::Sum, [7.0, 2.0]),
            (Reduction::Mean, [3.5, 1.0]),
            (Reduction::Max, [4.0, 8.0]),
            (Reduction::Min, [3.0, -6.0]),
            (Reduction::L1, [7.0, 14.0]),
            (Reduction::L2, [5.0, 10.0]),
            (Reduction::SumSquare, [25.0, 100.0]),
        ];
        for (what, wanted) in cases {
            let mut out = [0.0; 2];
            what.apply(&mut out, &input, &[0, 0, 1, 1], 2);
            assert_eq!(out, wanted, "{what:?}");
        }
    }

    #[test]
    fn functions_along_an_axis_take_its_numbers_together() {
        // Two runs, one number apart each: (3, 4) and (0, 0).
        let input = [3.0, 0.0, 4.0, 0.0];
        let mut out = [9.0; 4];
        Along::L2.apply(&mut out, &input, 2, 2);
        assert_eq!(out, [0.6, 0.0, 0.8, 0.0]);
        Along::Norm(0.0).apply(&mut out, &[1.0, 3.0, 5.0, 1.0], 2, 1);
        assert_eq!(out, [-1.0, 1.0, 1.0, -1.0]);
        Along::Softmax.apply(&mut out, &[1000.0, 1000.0, 0.0, f32::ln(3.0)], 2, 1);
        assert!((out[0] - 0.5).abs() < 1e-6 && (out[3] - 0.75).abs() < 1e-6, "{out:?}");
        Along::LogSoftmax.apply(&mut out, &[0.0, 0.0, 0.0, 0.0], 4, 1);
        assert!((out[2] + 4f32.ln()).abs() < 1e-6);
    }
}
