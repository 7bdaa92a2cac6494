//! Layer norm (Ba, Kiros, Hinton 2016), for inference.

/// y = (x − mean) / √(variance + ε) ∘ weight + bias over a row, the variance the population's.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerNorm {
    /// Factor of each number.
    pub weight: Vec<f32>,
    /// Offset of each number.
    pub bias: Vec<f32>,
    /// ε, added to the variance.
    pub epsilon: f32,
}

impl LayerNorm {
    /// PyTorch's default for ε.
    pub const EPSILON: f32 = 1e-5;

    /// Normalises and scales each row of `rows`; the bias is left to what follows. Sums in `f64`.
    pub(super) fn apply(&self, rows: &mut [f32]) {
        let width = self.weight.len();
        // A norm of no numbers would cut rows of no width, which chunks refuse.
        for row in rows.chunks_exact_mut(width.max(1)) {
            let mean = row.iter().map(|&x| f64::from(x)).sum::<f64>() / width as f64;
            let variance = row.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum::<f64>() / width as f64;
            let factor = 1.0 / (variance + f64::from(self.epsilon)).sqrt();
            for (x, &weight) in row.iter_mut().zip(&self.weight) {
                *x = ((f64::from(*x) - mean) * factor) as f32 * weight;
            }
        }
    }
}
