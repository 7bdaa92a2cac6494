//! The three products of a fully connected layer with what follows each, in one pass over memory.
//!
//! A block of rows times a panel of columns is added up in registers (Goto and van de Geijn 2008), a term after the
//! other in order. Written as loops over arrays of fixed size, which the compiler turns into vector code.
#![allow(unsafe_code, reason = "a function of a detected instruction set is entered by an unsafe call")]

use std::hint::black_box;

use super::{
    Activation,
    dispatch::{LANES, dispatched},
    panels::Panels,
    scalar::Scalar,
};

/// Rows of a block whose sums stay in registers.
const ROWS: usize = 6;
/// The same for a panel of one vector: more would leave the compiler short of registers, for the places of the rows.
const NARROW_ROWS: usize = 4;
/// Inputs of a block of a weight gradient.
const INPUTS: usize = 6;
/// Rows that a weight gradient adds up at a time: a panel of them fits the first-level cache.
const DEPTH: usize = 128;

/// Rows of a matrix, `stride` numbers apart.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a, T> {
    /// The numbers.
    pub(crate) data: &'a [T],
    /// From row to row.
    pub(crate) stride: usize,
}

impl<T> Rows<'_, T> {
    /// Those from row `row` on.
    #[inline(always)]
    fn from(self, row: usize) -> Self {
        Self { data: &self.data[row * self.stride..], ..self }
    }
}

/// Rows of a matrix to be written.
pub(crate) struct RowsMut<'a, T> {
    /// The numbers.
    pub(crate) data: &'a mut [T],
    /// From row to row.
    pub(crate) stride: usize,
}

dispatched! {
    /// y = f(x W + b) on `rows` rows, f the identity without an activation; `bias` as [`super::panels::Weights`] has it.
    /// Rows of y may be padded to whole [`LANES`], or not.
    fn forward(
        x: Rows<'_, T>,
        rows: usize,
        w: &Panels<T>,
        bias: &[T],
        activation: Option<Activation>,
        y: RowsMut<'_, T>,
    ) {
        let mut y = y;
        let mut first = 0;
        while PANEL > LANES && first + PANEL <= bias.len() {
            forward_panel::<T, FUSED, ROWS, PANEL>(x, rows, w, bias, activation, &mut y, first);
            first += PANEL;
        }
        while first < bias.len() {
            forward_panel::<T, FUSED, NARROW_ROWS, LANES>(x, rows, w, bias, activation, &mut y, first);
            first += LANES;
        }
    }

    /// d = (δ Wᵀ) ∘ f′(x) on `rows` rows, with δ the derivative by the layer's outputs and x its input, the output of
    /// the activation before; sums += Σ over the rows of d. Rows of x and d are padded to whole [`LANES`].
    fn backward(
        delta: Rows<'_, T>,
        rows: usize,
        transposed: &Panels<T>,
        x: Rows<'_, T>,
        activation: Activation,
        d: RowsMut<'_, T>,
        sums: &mut [T],
    ) {
        let mut d = d;
        let padded = transposed.columns.next_multiple_of(LANES);
        let mut first = 0;
        while PANEL > LANES && first + PANEL <= padded {
            backward_panel::<T, FUSED, ROWS, PANEL>(delta, rows, transposed, x, activation, &mut d, sums, first);
            first += PANEL;
        }
        while first < padded {
            backward_panel::<T, FUSED, NARROW_ROWS, LANES>(delta, rows, transposed, x, activation, &mut d, sums, first);
            first += LANES;
        }
    }

    /// gradient += aᵀ b over `rows` rows; the gradient is `widths[0] × widths[1]`, row-major. Rows of b are padded to
    /// whole [`LANES`].
    fn add_products(
        a: Rows<'_, T>,
        b: Rows<'_, T>,
        rows: usize,
        widths: [usize; 2],
        gradient: &mut [T],
    ) {
        let padded = widths[1].next_multiple_of(LANES);
        for row in (0..rows).step_by(DEPTH) {
            let depth = DEPTH.min(rows - row);
            let (a, b) = (a.from(row), b.from(row));
            let mut first = 0;
            while first + PANEL <= padded {
                add_panel::<T, FUSED, PANEL>(a, b, depth, widths, gradient, first);
                first += PANEL;
            }
            while first < padded {
                add_panel::<T, FUSED, LANES>(a, b, depth, widths, gradient, first);
                first += LANES;
            }
        }
    }
}

/// Rows `row..row + R` of `x`, of `depth` numbers; past the last of `rows` rows that one again.
#[inline(always)]
fn block<T, const R: usize>(x: Rows<'_, T>, row: usize, rows: usize, depth: usize) -> [&[T]; R] {
    let mut block = [&[][..]; R];
    for r in 0..R {
        let start = (row + r).min(rows - 1) * x.stride;
        block[r] = &x.data[start..start + depth];
    }
    block
}

/// Sums of a block. At the beginning of a cache line: a vector across two takes two reads.
#[repr(align(64))]
struct Block<T, const R: usize, const W: usize>([[T; W]; R]);

impl<T: Scalar, const R: usize, const W: usize> Block<T, R, W> {
    #[inline(always)]
    fn zeros() -> Self {
        // The compiler would call `memset` for zeros that it knew, and reading back what that wrote takes longer than
        // all the rest of a short sum.
        Self([[black_box(T::ZERO); W]; R])
    }
}

/// Σ over k of x[r][k] w[k][c].
#[inline(always)]
fn product<T: Scalar, const FUSED: bool, const R: usize, const W: usize>(
    x: [&[T]; R],
    w: &[[T; W]],
) -> Block<T, R, W> {
    let mut sums = Block::zeros();
    let mut rows = [&[][..]; R];
    for r in 0..R {
        rows[r] = &x[r][..w.len()];
    }
    for k in 0..w.len() {
        for r in 0..R {
            let x = rows[r][k];
            for c in 0..W {
                sums.0[r][c] = x.multiply_add::<FUSED>(w[k][c], sums.0[r][c]);
            }
        }
    }
    sums
}

/// Σ over `rows` rows of a[r] b[c].
#[inline(always)]
fn outer_product<T: Scalar, const FUSED: bool, const R: usize, const W: usize>(
    a: Rows<'_, T>,
    b: Rows<'_, T>,
    rows: usize,
) -> Block<T, R, W> {
    let mut sums = Block::zeros();
    for (a, b) in a.data.chunks(a.stride).zip(b.data.chunks(b.stride)).take(rows) {
        let (Some(a), Some(b)) = (a.first_chunk::<R>(), b.first_chunk::<W>()) else { break };
        for r in 0..R {
            for c in 0..W {
                sums.0[r][c] = a[r].multiply_add::<FUSED>(b[c], sums.0[r][c]);
            }
        }
    }
    sums
}

#[inline(always)]
fn forward_panel<T: Scalar, const FUSED: bool, const R: usize, const W: usize>(
    x: Rows<'_, T>,
    rows: usize,
    w: &Panels<T>,
    bias: &[T],
    activation: Option<Activation>,
    y: &mut RowsMut<'_, T>,
    first: usize,
) {
    let panel = w.panel::<W>(first);
    let Some(bias) = bias[first..].first_chunk::<W>() else { return };
    for row in (0..rows).step_by(R) {
        let sums = product::<T, FUSED, R, W>(block(x, row, rows, w.depth), panel);
        for r in 0..R.min(rows - row) {
            let y = &mut y.data[(row + r) * y.stride + first..];
            match y.first_chunk_mut::<W>() {
                Some(y) if first + W <= w.columns => activate::<T, FUSED, W>(&sums.0[r], bias, activation, y),
                _ => {
                    let mut whole = [T::ZERO; W];
                    activate::<T, FUSED, W>(&sums.0[r], bias, activation, &mut whole);
                    y[..w.columns - first].copy_from_slice(&whole[..w.columns - first]);
                }
            }
        }
    }
}

/// y = f(sums + bias).
#[inline(always)]
fn activate<T: Scalar, const FUSED: bool, const W: usize>(
    sums: &[T; W],
    bias: &[T; W],
    activation: Option<Activation>,
    y: &mut [T; W],
) {
    match activation {
        None => {
            for c in 0..W {
                y[c] = sums[c] + bias[c];
            }
        }
        Some(Activation::Elu) => {
            for c in 0..W {
                y[c] = (sums[c] + bias[c]).elu::<FUSED>();
            }
        }
        Some(Activation::Relu) => {
            for c in 0..W {
                // A NaN fails the comparison and stays.
                let x = sums[c] + bias[c];
                y[c] = if x < T::ZERO { T::ZERO } else { x };
            }
        }
        Some(Activation::Tanh) => {
            for c in 0..W {
                y[c] = (sums[c] + bias[c]).hyperbolic_tangent::<FUSED>();
            }
        }
    }
}

#[inline(always)]
fn backward_panel<T: Scalar, const FUSED: bool, const R: usize, const W: usize>(
    delta: Rows<'_, T>,
    rows: usize,
    transposed: &Panels<T>,
    x: Rows<'_, T>,
    activation: Activation,
    d: &mut RowsMut<'_, T>,
    sums: &mut [T],
    first: usize,
) {
    let panel = transposed.panel::<W>(first);
    let mut column_sums = [T::ZERO; W];
    for row in (0..rows).step_by(R) {
        let products = product::<T, FUSED, R, W>(block(delta, row, rows, transposed.depth), panel);
        for r in 0..R.min(rows - row) {
            let place = |stride: usize| (row + r) * stride + first;
            let Some(x) = x.data[place(x.stride)..].first_chunk::<W>() else { return };
            let Some(d) = d.data[place(d.stride)..].first_chunk_mut::<W>() else { return };
            for c in 0..W {
                // By the output h = f(x): ELU′ = h + 1 below 0 and tanh′ = 1 − h².
                let slope = match activation {
                    Activation::Elu => {
                        if x[c] > T::ZERO {
                            T::ONE
                        } else {
                            x[c] + T::ONE
                        }
                    }
                    Activation::Relu => {
                        if x[c] > T::ZERO {
                            T::ONE
                        } else {
                            T::ZERO
                        }
                    }
                    Activation::Tanh => T::ONE - x[c] * x[c],
                };
                d[c] = products.0[r][c] * slope;
                column_sums[c] += d[c];
            }
        }
    }
    for (sum, &column) in sums[first..].iter_mut().zip(&column_sums) {
        *sum += column;
    }
}

#[inline(always)]
fn add_panel<T: Scalar, const FUSED: bool, const W: usize>(
    a: Rows<'_, T>,
    b: Rows<'_, T>,
    rows: usize,
    widths: [usize; 2],
    gradient: &mut [T],
    first: usize,
) {
    let mut input = 0;
    while input + INPUTS <= widths[0] {
        add_block::<T, FUSED, INPUTS, W>(a, b, rows, widths[1], gradient, [input, first]);
        input += INPUTS;
    }
    while input + 2 <= widths[0] {
        add_block::<T, FUSED, 2, W>(a, b, rows, widths[1], gradient, [input, first]);
        input += 2;
    }
    if input < widths[0] {
        add_block::<T, FUSED, 1, W>(a, b, rows, widths[1], gradient, [input, first]);
    }
}

#[inline(always)]
fn add_block<T: Scalar, const FUSED: bool, const R: usize, const W: usize>(
    a: Rows<'_, T>,
    b: Rows<'_, T>,
    rows: usize,
    width: usize,
    gradient: &mut [T],
    [input, first]: [usize; 2],
) {
    let sums = outer_product::<T, FUSED, R, W>(
        Rows { data: &a.data[input..], ..a },
        Rows { data: &b.data[first..], ..b },
        rows,
    );
    for r in 0..R {
        let gradient = &mut gradient[(input + r) * width + first..(input + r + 1) * width];
        match gradient.first_chunk_mut::<W>() {
            Some(gradient) => {
                for c in 0..W {
                    gradient[c] += sums.0[r][c];
                }
            }
            None => gradient.iter_mut().zip(sums.0[r]).for_each(|(gradient, sum)| *gradient += sum),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{Shape, Weights, dispatch::stride};

    /// Rows that fill neither the last block of sums nor the last part of a weight gradient.
    const COUNT: usize = DEPTH + ROWS + 1;

    fn noise(seed: usize, count: usize) -> Vec<f64> {
        (0..count).map(|i| ((i + seed) * 7919 % 1999) as f64 / 1000.0 - 1.0).collect()
    }

    /// `rows` of `columns` in rows that are padded.
    fn padded<T: Scalar>(numbers: &[f64], columns: usize) -> Vec<T> {
        let pad = |row: &[f64]| {
            (0..stride(columns)).map(|c| T::from_f64(row.get(c).copied().unwrap_or(0.0))).collect::<Vec<_>>()
        };
        numbers.chunks(columns).flat_map(pad).collect()
    }

    /// Panels of every width, with and without padding, against sums of products.
    fn check<T: Scalar>(tolerance: f64) {
        for [inputs, outputs] in [[5, 3], [45, 64], [130, 70], [64, 1]] {
            let shape = Shape { inputs, hidden: vec![outputs], outputs: 1, activation: Activation::Elu };
            let layer = &shape.layers()[0];
            let numbers = noise(1, shape.parameters());
            let parameters: Vec<T> = numbers.iter().map(|&x| T::from_f64(x)).collect();
            let weights = Weights::new(&shape, &parameters, true);
            let w = |i: usize, j: usize| numbers[layer.weight.start + i * outputs + j];
            let (x, delta) = (noise(2, COUNT * inputs), noise(3, COUNT * outputs));
            let (x_rows, delta_rows) = (padded::<T>(&x, inputs), padded::<T>(&delta, outputs));
            let close = |got: T, want: f64, what: &str| {
                let error = (got.to_f64() - want).abs();
                assert!(
                    error < tolerance * (1.0 + want.abs()),
                    "{what}, {inputs} to {outputs}: {got:?}, not {want}"
                );
            };
            let x_view = Rows { data: &x_rows, stride: stride(inputs) };
            let delta_view = Rows { data: &delta_rows, stride: stride(outputs) };

            let mut y = vec![T::ZERO; COUNT * outputs];
            let (panels, bias) = (&weights.layers[0], &weights.biases[0]);
            forward(
                x_view,
                COUNT,
                &panels[0],
                bias,
                Some(Activation::Elu),
                RowsMut { data: &mut y, stride: outputs },
            );
            for (row, y) in y.chunks(outputs).enumerate() {
                for (j, &y) in y.iter().enumerate() {
                    let sum: f64 = (0..inputs).map(|i| x[row * inputs + i] * w(i, j)).sum();
                    let sum = sum + numbers[layer.bias.start + j];
                    close(y, if sum > 0.0 { sum } else { sum.exp_m1() }, "output");
                }
            }

            for activation in [Activation::Elu, Activation::Relu, Activation::Tanh] {
                let mut d = vec![T::ZERO; COUNT * stride(inputs)];
                let mut sums = vec![T::ONE; inputs];
                let to = RowsMut { data: &mut d, stride: stride(inputs) };
                backward(delta_view, COUNT, &panels[1], x_view, activation, to, &mut sums);
                let mut want_sums = vec![1.0; inputs];
                for (row, d) in d.chunks(stride(inputs)).enumerate() {
                    for i in 0..inputs {
                        let h = x[row * inputs + i];
                        let slope = match activation {
                            Activation::Elu => {
                                if h > 0.0 {
                                    1.0
                                } else {
                                    h + 1.0
                                }
                            }
                            Activation::Relu => {
                                if h > 0.0 {
                                    1.0
                                } else {
                                    0.0
                                }
                            }
                            Activation::Tanh => 1.0 - h * h,
                        };
                        let product: f64 = (0..outputs).map(|j| delta[row * outputs + j] * w(i, j)).sum();
                        close(d[i], product * slope, "derivative");
                        want_sums[i] += product * slope;
                    }
                }
                sums.iter().zip(want_sums).for_each(|(&sum, want)| close(sum, want, "sum of derivatives"));
            }

            let mut gradient = vec![T::ONE; inputs * outputs];
            add_products(x_view, delta_view, COUNT, [inputs, outputs], &mut gradient);
            for (at, &gradient) in gradient.iter().enumerate() {
                let (i, j) = (at / outputs, at % outputs);
                let sum: f64 = (0..COUNT).map(|row| x[row * inputs + i] * delta[row * outputs + j]).sum();
                close(gradient, 1.0 + sum, "gradient");
            }
        }
    }

    #[test]
    fn products_are_sums_of_products() {
        check::<f64>(1e-12);
        check::<f32>(1e-4);
    }
}
