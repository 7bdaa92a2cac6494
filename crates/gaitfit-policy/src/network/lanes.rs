//! Elementwise kernels of a layer, compiled for several instruction sets and chosen at run time.

use gaitfit_isa::kernels;

use super::{Activation, activation::SELU, erfc, scalar::Scalar};

/// Columns that are summed together, in registers: four vectors of AVX-512, eight of AVX2 in `f32`.
const COLUMNS: usize = 64;

/// d *= slope(h) and sums += Σ over the rows of d.
#[inline(always)]
fn multiply_and_sum<T: Scalar>(d: &mut [T], h: &[T], sums: &mut [T], slope: impl Fn(T) -> T) {
    let width = sums.len();
    let (blocks, rest) = sums.as_chunks_mut::<COLUMNS>();
    for (number, sums) in blocks.iter_mut().enumerate() {
        let first = number * COLUMNS;
        // A copy of fixed size can stay in registers through all rows.
        let mut held = *sums;
        for (d, h) in d.chunks_exact_mut(width).zip(h.chunks_exact(width)) {
            let columns = d[first..first + COLUMNS].iter_mut().zip(&h[first..first + COLUMNS]);
            for ((d, &h), sum) in columns.zip(&mut held) {
                *d *= slope(h);
                *sum += *d;
            }
        }
        *sums = held;
    }
    if rest.is_empty() {
        return;
    }
    // The columns beyond the last whole block.
    let first = width - rest.len();
    for (d, h) in d.chunks_exact_mut(width).zip(h.chunks_exact(width)) {
        for ((d, &h), sum) in d[first..].iter_mut().zip(&h[first..]).zip(&mut *rest) {
            *d *= slope(h);
            *sum += *d;
        }
    }
}

/// y = f(y + b) on every row of y.
#[inline(always)]
fn activate<T: Scalar>(y: &mut [T], bias: &[T], f: impl Fn(T) -> T) {
    for row in y.chunks_exact_mut(bias.len()) {
        for (y, &b) in row.iter_mut().zip(bias) {
            *y = f(*y + b);
        }
    }
}

/// α (eˣ − 1) below 0, x above, all times λ.
#[inline(always)]
fn elu<T: Scalar, const FUSED: bool>(x: T, alpha: T, lambda: T) -> T {
    // Both sides are computed: a choice between two numbers needs no branch, so lanes stay together.
    let below = alpha * (x.exponential::<FUSED>() - T::ONE);
    lambda * if x > T::ZERO { x } else { below }
}

/// x Φ(x), with the approximation of [`erfc`].
#[inline(always)]
fn gelu<T: Scalar, const FUSED: bool>(x: T) -> T {
    let number = T::from_f64;
    // The approximation holds from 0 on. The other side follows by symmetry, see below.
    let z = if x < T::ZERO { -x } else { x } * number(std::f64::consts::FRAC_1_SQRT_2);
    let t = T::ONE / (T::ONE + number(erfc::P) * z);
    let [first, rest @ ..] = erfc::COEFFICIENTS;
    let mut p = number(first);
    for coefficient in rest {
        p = p * t + number(coefficient);
    }
    // Φ(x) is 1 − erfc(z)/2 above 0 and erfc(z)/2 below, with z = abs(x)/√2.
    let half = number(0.5) * x * p * t * (-z * z).exponential::<FUSED>();
    if x > T::ZERO { x - half } else { half }
}

/// f of every number.
pub(crate) fn activate_all(numbers: &mut [f32], activation: Activation) {
    // The kernel adds a bias: with zeros it is the function alone.
    let zeros = [0.0; COLUMNS];
    // The numbers are cut into rows as wide as the zeros; what is left is one shorter row.
    let whole = numbers.len() / COLUMNS * COLUMNS;
    let (whole, rest) = numbers.split_at_mut(whole);
    add_bias_and_activate(whole, &zeros, activation);
    if !rest.is_empty() {
        add_bias_and_activate(rest, &zeros[..rest.len()], activation);
    }
}

/// Greatest width of a layer's output that leaves the vectors of matrix kernels half empty; [`multiply_narrow`] takes
/// these.
pub(crate) const NARROW: usize = 16;
/// Rows that [`multiply_narrow`] works on together, so that their sums do not wait for each other.
const ROWS: usize = 8;

/// Up to `ROWS` rows of `multiply_narrow`, with the columns of w and b made up to `NARROW`.
#[inline(always)]
fn multiply_rows<T: Scalar, const FUSED: bool>(
    y: &mut [T],
    x: [&[T]; ROWS],
    w: &[[T; NARROW]],
    bias: [T; NARROW],
    width: usize,
) {
    let mut sums = [[T::ZERO; NARROW]; ROWS];
    for (k, w) in w.iter().enumerate() {
        for (sums, x) in sums.iter_mut().zip(x) {
            for (sum, &w) in sums.iter_mut().zip(w) {
                *sum = x[k].multiply_add::<FUSED>(w, *sum);
            }
        }
    }
    // The bias comes last, as in layers that gemm computes.
    for (y, sums) in y.chunks_exact_mut(width).zip(sums) {
        for ((y, sum), bias) in y.iter_mut().zip(sums).zip(bias) {
            *y = sum + bias;
        }
    }
}

// AVX-512 and AVX2 return the same bits, the baseline others in the last place.
kernels! {
    /// y = x w + b with up to [`NARROW`] columns, fewer than matrix kernels are made for: y is `rows × bias.len()`, w
    /// `inputs × bias.len()`. Each number is summed in the order of the inputs.
    pub fn multiply_narrow<T: Scalar>(y: &mut [T], x: &[T], w: &[T], bias: &[T]) {
        let width = bias.len();
        let inputs = w.len() / width;
        assert_eq!(x.len() * width, y.len() * inputs, "rows of a matrix product differ");
        // Zeros beyond the last column fill whole vectors; their sums are not written.
        let mut wide = vec![[T::ZERO; NARROW]; inputs];
        for (wide, w) in wide.iter_mut().zip(w.chunks_exact(width)) {
            wide[..width].copy_from_slice(w);
        }
        let mut wide_bias = [T::ZERO; NARROW];
        wide_bias[..width].copy_from_slice(bias);
        for (y, x) in y.chunks_mut(ROWS * width).zip(x.chunks(ROWS * inputs)) {
            // A last group of fewer rows computes its last one again.
            let last = y.len() / width - 1;
            let rows = std::array::from_fn(|row| &x[row.min(last) * inputs..][..inputs]);
            multiply_rows::<T, FUSED>(y, rows, &wide, wide_bias, width);
        }
    }

    /// y += b on every row of y: `rows × bias.len()`.
    pub fn add_bias<T: Scalar>(y: &mut [T], bias: &[T]) {
        for row in y.chunks_exact_mut(bias.len()) {
            for (y, &b) in row.iter_mut().zip(bias) {
                *y += b;
            }
        }
    }

    /// y = f(y + b) on every row of y: `rows × bias.len()`.
    pub fn add_bias_and_activate<T: Scalar>(y: &mut [T], bias: &[T], activation: Activation) {
        match activation {
            Activation::Elu => {
                for row in y.chunks_exact_mut(bias.len()) {
                    for (y, &b) in row.iter_mut().zip(bias) {
                        let x = *y + b;
                        let below = x.exponential::<FUSED>() - T::ONE;
                        *y = if x > T::ZERO { x } else { below };
                    }
                }
            }
            Activation::Relu => {
                for row in y.chunks_exact_mut(bias.len()) {
                    for (y, &b) in row.iter_mut().zip(bias) {
                        let x = *y + b;
                        // A NaN fails the comparison and stays.
                        *y = if x < T::ZERO { T::ZERO } else { x };
                    }
                }
            }
            Activation::Tanh => {
                for row in y.chunks_exact_mut(bias.len()) {
                    for (y, &b) in row.iter_mut().zip(bias) {
                        *y = (*y + b).hyperbolic_tangent::<FUSED>();
                    }
                }
            }
            Activation::EluOf(alpha) => {
                let alpha = T::from_f64(f64::from(alpha));
                activate(y, bias, |x| elu::<T, FUSED>(x, alpha, T::ONE));
            }
            Activation::LeakyRelu(slope) => {
                let slope = T::from_f64(f64::from(slope));
                activate(y, bias, |x| if x > T::ZERO { x } else { slope * x });
            }
            Activation::Selu => {
                let [alpha, lambda] = SELU.map(T::from_f64);
                activate(y, bias, |x| elu::<T, FUSED>(x, alpha, lambda));
            }
            Activation::Silu => activate(y, bias, |x| x / (T::ONE + (-x).exponential::<FUSED>())),
            Activation::Gelu => activate(y, bias, gelu::<T, FUSED>),
            Activation::GeluTanh => {
                // √(2/π), and the cubic coefficient of Hendrycks and Gimpel's approximation.
                let [root, cubic, half] = [0.797_884_560_802_865_4, 0.044_715, 0.5].map(T::from_f64);
                activate(y, bias, |x| {
                    let inner = root * (x + cubic * x * x * x);
                    half * x * (T::ONE + inner.hyperbolic_tangent::<FUSED>())
                });
            }
        }
    }

    /// y = f(y), and the derivative f′ there, of every number.
    pub fn activate_with_slopes<T: Scalar>(y: &mut [T], slopes: &mut [T], activation: Activation) {
        let each = y.iter_mut().zip(slopes);
        match activation {
            Activation::Elu | Activation::EluOf(_) | Activation::Selu => {
                let [alpha, lambda] = match activation {
                    Activation::Selu => SELU.map(T::from_f64),
                    // `Elu` has no parameter, and its α is 1.
                    _ => [T::from_f64(f64::from(activation.parameter().unwrap_or(1.0))), T::ONE],
                };
                for (y, slope) in each {
                    let x = *y;
                    let power = x.exponential::<FUSED>();
                    *slope = lambda * if x > T::ZERO { T::ONE } else { alpha * power };
                    *y = elu::<T, FUSED>(x, alpha, lambda);
                }
            }
            Activation::Relu | Activation::LeakyRelu(_) => {
                // `Relu` has no parameter, and its slope below 0 is 0.
                let below = T::from_f64(f64::from(activation.parameter().unwrap_or(0.0)));
                for (y, slope) in each {
                    *slope = if *y > T::ZERO { T::ONE } else { below };
                    *y = if *y > T::ZERO { *y } else { below * *y };
                }
            }
            Activation::Tanh => {
                for (y, slope) in each {
                    let h = (*y).hyperbolic_tangent::<FUSED>();
                    (*slope, *y) = (T::ONE - h * h, h);
                }
            }
            Activation::Silu => {
                for (y, slope) in each {
                    let (x, below) = (*y, T::ONE + (-*y).exponential::<FUSED>());
                    let share = T::ONE / below;
                    // With `share` = σ(x) the derivative of x σ(x) is σ (1 + x (1 − σ)).
                    *slope = share * (T::ONE + x * (T::ONE - share));
                    *y = x / below;
                }
            }
            Activation::Gelu => {
                // φ(0), the density of the normal distribution at 0.
                let [density, half] = [0.398_942_280_401_432_7, 0.5].map(T::from_f64);
                for (y, slope) in each {
                    let x = *y;
                    let power = (-half * x * x).exponential::<FUSED>();
                    *y = gelu::<T, FUSED>(x);
                    // Φ(x) = gelu(x) / x.
                    let share = if x == T::ZERO { half } else { *y / x };
                    *slope = share + x * density * power;
                }
            }
            Activation::GeluTanh => {
                // √(2/π) and the cubic coefficient, as in `add_bias_and_activate`.
                let [root, cubic, half, three] = [0.797_884_560_802_865_4, 0.044_715, 0.5, 3.0].map(T::from_f64);
                for (y, slope) in each {
                    let x = *y;
                    let t = (root * (x + cubic * x * x * x)).hyperbolic_tangent::<FUSED>();
                    let inner = root * (T::ONE + three * cubic * x * x);
                    *slope = half * (T::ONE + t) + half * x * (T::ONE - t * t) * inner;
                    *y = half * x * (T::ONE + t);
                }
            }
        }
    }

    /// d *= f′ and sums += Σ over the rows of d; d and the layer's output h = f(x) are `rows × sums.len()`. By h,
    /// ELU′ = h + α below 0 and tanh′ = 1 − h². Where f′ does not follow from h, `h` holds f′.
    pub fn multiply_by_derivative<T: Scalar>(d: &mut [T], h: &[T], sums: &mut [T], activation: Activation) {
        match activation {
            Activation::Elu => multiply_and_sum(d, h, sums, |h| if h > T::ZERO { T::ONE } else { h + T::ONE }),
            Activation::Relu => multiply_and_sum(d, h, sums, |h| if h > T::ZERO { T::ONE } else { T::ZERO }),
            Activation::Tanh => multiply_and_sum(d, h, sums, |h| T::ONE - h * h),
            Activation::EluOf(alpha) => {
                let alpha = T::from_f64(f64::from(alpha));
                multiply_and_sum(d, h, sums, |h| if h > T::ZERO { T::ONE } else { h + alpha });
            }
            Activation::LeakyRelu(slope) => {
                let slope = T::from_f64(f64::from(slope));
                multiply_and_sum(d, h, sums, |h| if h > T::ZERO { T::ONE } else { slope });
            }
            Activation::Selu => {
                let [alpha, lambda] = SELU.map(T::from_f64);
                multiply_and_sum(d, h, sums, |h| if h > T::ZERO { lambda } else { h + lambda * alpha });
            }
            // Their derivatives do not follow from their outputs: `h` holds the derivatives of `activate_with_slopes`.
            Activation::Silu | Activation::Gelu | Activation::GeluTanh => multiply_and_sum(d, h, sums, |h| h),
        }
    }

    /// sums += Σ over the rows of d: `rows × sums.len()`.
    pub fn add_column_sums<T: Scalar>(sums: &mut [T], d: &[T]) {
        for row in d.chunks_exact(sums.len()) {
            for (sum, &d) in sums.iter_mut().zip(row) {
                *sum += d;
            }
        }
    }

    /// sums += terms.
    pub fn add<T: Scalar>(sums: &mut [T], terms: &[T]) {
        for (sum, &term) in sums.iter_mut().zip(terms) {
            *sum += term;
        }
    }

    /// One step of Adam: `rates` = [1 − β₁, 1 − β₂, factor on the gradient, learning rate / (1 − β₁ᵗ), √(1 − β₂ᵗ), ε].
    pub fn descend<T: Scalar>(parameters: &mut [T], first: &mut [T], second: &mut [T], gradient: &[T], rates: [T; 6]) {
        let [share_1, share_2, factor, rate, correction, epsilon] = rates;
        let moments = first.iter_mut().zip(second);
        for ((parameter, (first, second)), &gradient) in parameters.iter_mut().zip(moments).zip(gradient) {
            // Kingma and Ba (2015), Algorithm 1: both corrections for the moments' start at zero are in
            // `rates`.
            let g = gradient * factor;
            *first += share_1 * (g - *first);
            *second += share_2 * (g * g - *second);
            *parameter = *parameter - rate * *first / (second.square_root() / correction + epsilon);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Functions are those of layers without slopes, and slopes are their derivatives.
    #[test]
    fn slopes_are_the_derivatives_of_activations() {
        let numbers: Vec<f64> = (-40..=40).map(|k| 0.11 * f64::from(k) + 0.003).collect();
        for activation in [
            Activation::Elu,
            Activation::EluOf(0.7),
            Activation::Selu,
            Activation::Relu,
            Activation::LeakyRelu(0.2),
            Activation::Tanh,
            Activation::Silu,
            Activation::Gelu,
            Activation::GeluTanh,
        ] {
            let at = |shift: f64| {
                let mut y: Vec<f64> = numbers.iter().map(|x| x + shift).collect();
                let zeros = vec![0.0; y.len()];
                add_bias_and_activate(&mut y, &zeros, activation);
                y
            };
            let (mut y, mut slopes) = (numbers.clone(), vec![0.0; numbers.len()]);
            activate_with_slopes(&mut y, &mut slopes, activation);
            assert_eq!(y, at(0.0), "{activation}");
            let step = 1e-5;
            for ((above, below), slope) in at(step).iter().zip(&at(-step)).zip(&slopes) {
                // The approximation of erfc in GELU has a derivative of its own.
                let near = if activation == Activation::Gelu { 3e-6 } else { 1e-8 };
                assert!(((above - below) / (2.0 * step) - slope).abs() < near, "{activation}: {slope}");
            }
        }
        let (mut zero, mut slope) = ([0.0f32], [0.0f32]);
        activate_with_slopes(&mut zero, &mut slope, Activation::Gelu);
        assert_eq!((zero, slope), ([0.0], [0.5]));
    }
}
