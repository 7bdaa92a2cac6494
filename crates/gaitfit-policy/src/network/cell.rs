//! One step of LSTM and GRU units, and its derivatives, written out by hand.
//!
//! Gates lie in PyTorch's order (`nn.LSTM`: i, f, g, o; `nn.GRU`: r, z, n), with both of its bias vectors.
//! LSTM (Hochreiter, Schmidhuber 1997, with forget gates): c′ = σ(f) c + σ(i) tanh(g), h′ = σ(o) tanh(c′).
//! GRU (Cho et al. 2014, the reset gate behind the product): n = tanh(xₙ + σ(r) hₙ), h′ = (1 − σ(z)) n + σ(z) h.

use gaitfit_isa::kernels;

use super::scalar::Scalar;

/// Kind of a recurrent layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cell {
    /// Long short-term memory.
    Lstm,
    /// Gated recurrent unit.
    Gru,
}

impl Cell {
    /// Gates of a unit.
    pub fn gates(self) -> usize {
        match self {
            Self::Lstm => 4,
            Self::Gru => 3,
        }
    }

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lstm => "lstm",
            Self::Gru => "gru",
        }
    }

    /// Numbers that a unit remembers: its output, and an LSTM's cell.
    pub fn remembered(self) -> usize {
        match self {
            Self::Lstm => 2,
            Self::Gru => 1,
        }
    }
}

/// A step of one layer of H units, for some rows. `gates` and `of_output` are `rows × gates · H`, the rest `rows × H`.
pub(super) struct Step<'a, T> {
    /// The input's product with its weights, without bias. The step leaves the gates' values here.
    pub gates: &'a mut [T],
    /// The last output's product with its weights, without bias. A GRU leaves hₙ in the block of its gate n.
    pub of_output: &'a mut [T],
    /// Bias of the input's product, `gates · H`.
    pub bias_ih: &'a [T],
    /// Bias of the output's product, `gates · H`.
    pub bias_hh: &'a [T],
    /// Output before the step.
    pub output_before: &'a [T],
    /// Cell before the step; empty for a GRU.
    pub cell_before: &'a [T],
    /// Output after the step.
    pub output: &'a mut [T],
    /// Cell after the step; empty for a GRU.
    pub cell: &'a mut [T],
}

/// The way back through a [`Step`] whose numbers were kept.
pub(super) struct Back<'a, T> {
    /// Gates as the step left them; derivatives by the input's product afterwards.
    pub gates: &'a mut [T],
    /// For a GRU: what the step left, derivatives by the output's product afterwards. An LSTM has those of `gates`.
    pub of_output: &'a mut [T],
    /// As in the step.
    pub output_before: &'a [T],
    /// As in the step.
    pub cell_before: &'a [T],
    /// Cell after the step.
    pub cell: &'a [T],
    /// Derivative by the output after the step; afterwards the part by the output before that passes no weights.
    pub of_state: &'a mut [T],
    /// Derivative by the cell after the step; by the cell before afterwards.
    pub of_cell: &'a mut [T],
}

#[inline(always)]
fn sigmoid<T: Scalar, const FUSED: bool>(x: T) -> T {
    T::ONE / (T::ONE + (-x).exponential::<FUSED>())
}

#[inline(always)]
fn tanh<T: Scalar, const FUSED: bool>(x: T) -> T {
    x.hyperbolic_tangent::<FUSED>()
}

/// Units that are computed together, in registers: one vector of AVX-512 in `f32`.
const LANES: usize = 16;

/// The blocks of a row of gates, one a gate.
#[inline(always)]
fn blocks<T, const GATES: usize>(row: &[T], width: usize) -> [&[T]; GATES] {
    std::array::from_fn(|gate| &row[gate * width..(gate + 1) * width])
}

/// As [`blocks`], to write to; rows of three gates have an empty fourth block.
#[inline(always)]
fn blocks_mut<T>(row: &mut [T], width: usize) -> [&mut [T]; 4] {
    let (a, rest) = row.split_at_mut(width);
    let (b, rest) = rest.split_at_mut(width);
    let (c, d) = rest.split_at_mut(width);
    [a, b, c, d]
}

/// `N` numbers from `at` on. Copies do not alias what is written, so that loops over them become vectors.
#[inline(always)]
fn take<T: Scalar, const N: usize>(values: &[T], at: usize) -> [T; N] {
    let mut taken = [T::ZERO; N];
    taken.copy_from_slice(&values[at..at + N]);
    taken
}

#[inline(always)]
fn put<T: Copy, const N: usize>(values: &mut [T], at: usize, taken: [T; N]) {
    values[at..at + N].copy_from_slice(&taken);
}

/// Calls `$units::<…, N>` for all units of a row, `LANES` at a time and then one by one.
macro_rules! in_lanes {
    ($width:expr, $units:ident::<$scalar:ident, $fused:ident>($at:ident, $($argument:expr),*)) => {
        let mut $at = 0;
        while $at + LANES <= $width {
            $units::<$scalar, $fused, LANES>($at, $($argument),*);
            $at += LANES;
        }
        while $at < $width {
            $units::<$scalar, $fused, 1>($at, $($argument),*);
            $at += 1;
        }
    };
}

#[inline(always)]
fn lstm_units<T: Scalar, const FUSED: bool, const N: usize>(
    at: usize,
    x: &mut [&mut [T]; 4],
    h: &[&[T]; 4],
    [bias_ih, bias_hh]: [&[&[T]; 4]; 2],
    before: &[T],
    [output, cell]: [&mut [T]; 2],
) {
    let all = |blocks: &[&[T]; 4]| blocks.map(|block| take::<T, N>(block, at));
    let (b, c, of_output) = (all(bias_ih), all(bias_hh), all(h));
    let mut gates = x.each_ref().map(|block| take::<T, N>(block, at));
    for (gate, values) in gates.iter_mut().enumerate() {
        for u in 0..N {
            let sum = values[u] + b[gate][u] + (of_output[gate][u] + c[gate][u]);
            // Gate 2 is g, the candidate for the cell; the others are weights between 0 and 1.
            values[u] = if gate == 2 { tanh::<T, FUSED>(sum) } else { sigmoid::<T, FUSED>(sum) };
        }
    }
    let before = take::<T, N>(before, at);
    let (mut now, mut out) = ([T::ZERO; N], [T::ZERO; N]);
    for u in 0..N {
        now[u] = gates[1][u] * before[u] + gates[0][u] * gates[2][u];
        out[u] = gates[3][u] * tanh::<T, FUSED>(now[u]);
    }
    x.iter_mut().zip(gates).for_each(|(block, values)| put(block, at, values));
    put(output, at, out);
    put(cell, at, now);
}

#[inline(always)]
fn gru_units<T: Scalar, const FUSED: bool, const N: usize>(
    at: usize,
    x: &mut [&mut [T]; 4],
    h: &mut [&mut [T]; 4],
    [bias_ih, bias_hh]: [&[&[T]; 3]; 2],
    before: &[T],
    output: &mut [T],
) {
    let all = |blocks: &[&[T]; 3]| blocks.map(|block| take::<T, N>(block, at));
    let ([br, bz, bn], [cr, cz, cn]) = (all(bias_ih), all(bias_hh));
    let [mut r, mut z, mut n] = [0, 1, 2].map(|gate| take::<T, N>(x[gate], at));
    let [hr, hz, mut hn] = [0, 1, 2].map(|gate| take::<T, N>(h[gate], at));
    let before = take::<T, N>(before, at);
    let mut out = [T::ZERO; N];
    for u in 0..N {
        r[u] = sigmoid::<T, FUSED>(r[u] + br[u] + (hr[u] + cr[u]));
        z[u] = sigmoid::<T, FUSED>(z[u] + bz[u] + (hz[u] + cz[u]));
        // Kept with its bias: the derivative of the reset gate needs it.
        hn[u] += cn[u];
        n[u] = tanh::<T, FUSED>(n[u] + bn[u] + r[u] * hn[u]);
        out[u] = (T::ONE - z[u]) * n[u] + z[u] * before[u];
    }
    x.iter_mut().zip([r, z, n]).for_each(|(block, values)| put(block, at, values));
    put(h[2], at, hn);
    put(output, at, out);
}

#[inline(always)]
fn lstm_back_units<T: Scalar, const FUSED: bool, const N: usize>(
    at: usize,
    x: &mut [&mut [T]; 4],
    [before, cell]: [&[T]; 2],
    [of_state, of_cell]: [&mut [T]; 2],
) {
    // The step left the values of the gates here, after their functions.
    let [mut i, mut f, mut g, mut o] = x.each_ref().map(|block| take::<T, N>(block, at));
    let (before, cell) = (take::<T, N>(before, at), take::<T, N>(cell, at));
    let (pull, mut carried) = (take::<T, N>(of_state, at), take::<T, N>(of_cell, at));
    for u in 0..N {
        let (iu, fu, gu, ou) = (i[u], f[u], g[u], o[u]);
        let t = tanh::<T, FUSED>(cell[u]);
        // ∂loss/∂c′: from the steps after this one and through h′ = σ(o) tanh(c′). Derivatives of the
        // functions follow from their values: σ′ = σ (1 − σ), tanh′ = 1 − tanh².
        let c = carried[u] + pull[u] * ou * (T::ONE - t * t);
        o[u] = pull[u] * t * ou * (T::ONE - ou);
        i[u] = c * gu * iu * (T::ONE - iu);
        f[u] = c * before[u] * fu * (T::ONE - fu);
        g[u] = c * iu * (T::ONE - gu * gu);
        // Through the forget gate to the cell before.
        carried[u] = c * fu;
    }
    x.iter_mut().zip([i, f, g, o]).for_each(|(block, values)| put(block, at, values));
    put(of_cell, at, carried);
    // An LSTM's output reaches the next step through the weights alone, whose part the caller adds.
    put(of_state, at, [T::ZERO; N]);
}

#[inline(always)]
fn gru_back_units<T: Scalar, const FUSED: bool, const N: usize>(
    at: usize,
    x: &mut [&mut [T]; 4],
    h: &mut [&mut [T]; 4],
    before: &[T],
    of_state: &mut [T],
) {
    let [mut r, mut z, mut n] = [0, 1, 2].map(|gate| take::<T, N>(x[gate], at));
    let (mut hn, before, mut pull) =
        (take::<T, N>(h[2], at), take::<T, N>(before, at), take::<T, N>(of_state, at));
    for u in 0..N {
        let (ru, zu, nu, d) = (r[u], z[u], n[u], pull[u]);
        // `new` is ∂loss/∂ of the argument of n. A GRU's reset gate acts on hₙ, which gets a derivative of
        // its own.
        let new = d * (T::ONE - zu) * (T::ONE - nu * nu);
        r[u] = new * hn[u] * ru * (T::ONE - ru);
        z[u] = d * (before[u] - nu) * zu * (T::ONE - zu);
        n[u] = new;
        hn[u] = new * ru;
        // The share of the old output that is kept passes no weights.
        pull[u] = d * zu;
    }
    x.iter_mut().zip([r, z, n]).for_each(|(block, values)| put(block, at, values));
    // In r and z both products are summed as they are; in n the reset gate stands between.
    h.iter_mut().zip([r, z, hn]).for_each(|(block, values)| put(block, at, values));
    put(of_state, at, pull);
}

kernels! {
    pub(super) fn lstm<T: Scalar>(step: Step<'_, T>) {
        let width = step.bias_ih.len() / 4;
        let (bias_ih, bias_hh) = (blocks::<T, 4>(step.bias_ih, width), blocks::<T, 4>(step.bias_hh, width));
        let rows = step.gates.chunks_exact_mut(4 * width).zip(step.of_output.chunks_exact(4 * width));
        let states = step.output.chunks_exact_mut(width).zip(step.cell.chunks_exact_mut(width));
        for (((gates, of_output), (output, cell)), before) in
            rows.zip(states).zip(step.cell_before.chunks_exact(width))
        {
            let (mut x, h) = (blocks_mut(gates, width), blocks::<T, 4>(of_output, width));
            in_lanes!(width, lstm_units::<T, FUSED>(at, &mut x, &h, [&bias_ih, &bias_hh], before, [output, cell]));
        }
    }

    pub(super) fn gru<T: Scalar>(step: Step<'_, T>) {
        let width = step.bias_ih.len() / 3;
        let (bias_ih, bias_hh) = (blocks::<T, 3>(step.bias_ih, width), blocks::<T, 3>(step.bias_hh, width));
        let rows = step.gates.chunks_exact_mut(3 * width).zip(step.of_output.chunks_exact_mut(3 * width));
        let states = step.output.chunks_exact_mut(width).zip(step.output_before.chunks_exact(width));
        for ((gates, of_output), (output, before)) in rows.zip(states) {
            let (mut x, mut h) = (blocks_mut(gates, width), blocks_mut(of_output, width));
            in_lanes!(width, gru_units::<T, FUSED>(at, &mut x, &mut h, [&bias_ih, &bias_hh], before, output));
        }
    }

    pub(super) fn lstm_back<T: Scalar>(width: usize, back: Back<'_, T>) {
        let states = back.of_state.chunks_exact_mut(width).zip(back.of_cell.chunks_exact_mut(width));
        let cells = back.cell_before.chunks_exact(width).zip(back.cell.chunks_exact(width));
        for ((gates, (of_state, of_cell)), (before, cell)) in
            back.gates.chunks_exact_mut(4 * width).zip(states).zip(cells)
        {
            let mut x = blocks_mut(gates, width);
            in_lanes!(width, lstm_back_units::<T, FUSED>(at, &mut x, [before, cell], [of_state, of_cell]));
        }
    }

    pub(super) fn gru_back<T: Scalar>(width: usize, back: Back<'_, T>) {
        let rows = back.gates.chunks_exact_mut(3 * width).zip(back.of_output.chunks_exact_mut(3 * width));
        let states = back.of_state.chunks_exact_mut(width).zip(back.output_before.chunks_exact(width));
        for ((gates, of_output), (of_state, before)) in rows.zip(states) {
            let (mut x, mut h) = (blocks_mut(gates, width), blocks_mut(of_output, width));
            in_lanes!(width, gru_back_units::<T, FUSED>(at, &mut x, &mut h, before, of_state));
        }
    }
}

impl<T: Scalar> Step<'_, T> {
    /// Computes it.
    pub fn take(self, cell: Cell) {
        match cell {
            Cell::Lstm => lstm(self),
            Cell::Gru => gru(self),
        }
    }
}

impl<T: Scalar> Back<'_, T> {
    /// Computes it, for layers of `width` units.
    pub fn take(self, cell: Cell, width: usize) {
        match cell {
            Cell::Lstm => lstm_back(width, self),
            Cell::Gru => gru_back(width, self),
        }
    }
}
