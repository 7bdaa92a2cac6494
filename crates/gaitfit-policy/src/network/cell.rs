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

/// The blocks of a row of gates, one a gate.
#[inline(always)]
fn blocks<T, const GATES: usize>(row: &[T], width: usize) -> [&[T]; GATES] {
    std::array::from_fn(|gate| &row[gate * width..(gate + 1) * width])
}

/// The same to write to; rows of three gates have an empty fourth block.
#[inline(always)]
fn blocks_mut<T>(row: &mut [T], width: usize) -> [&mut [T]; 4] {
    let (a, rest) = row.split_at_mut(width);
    let (b, rest) = rest.split_at_mut(width);
    let (c, d) = rest.split_at_mut(width);
    [a, b, c, d]
}

kernels! {
    pub(super) fn lstm<T: Scalar>(step: Step<'_, T>) {
        let width = step.bias_ih.len() / 4;
        let [bi, bf, bg, bo] = blocks(step.bias_ih, width);
        let [ci, cf, cg, co] = blocks(step.bias_hh, width);
        let rows = step.gates.chunks_exact_mut(4 * width).zip(step.of_output.chunks_exact(4 * width));
        let states = step.output.chunks_exact_mut(width).zip(step.cell.chunks_exact_mut(width));
        for (((gates, of_output), (output, cell)), before) in
            rows.zip(states).zip(step.cell_before.chunks_exact(width))
        {
            let [i, f, g, o] = blocks_mut(gates, width);
            let [hi, hf, hg, ho] = blocks::<T, 4>(of_output, width);
            for u in 0..width {
                i[u] = sigmoid::<T, FUSED>(i[u] + bi[u] + (hi[u] + ci[u]));
                f[u] = sigmoid::<T, FUSED>(f[u] + bf[u] + (hf[u] + cf[u]));
                g[u] = tanh::<T, FUSED>(g[u] + bg[u] + (hg[u] + cg[u]));
                o[u] = sigmoid::<T, FUSED>(o[u] + bo[u] + (ho[u] + co[u]));
                cell[u] = f[u] * before[u] + i[u] * g[u];
                output[u] = o[u] * tanh::<T, FUSED>(cell[u]);
            }
        }
    }

    pub(super) fn gru<T: Scalar>(step: Step<'_, T>) {
        let width = step.bias_ih.len() / 3;
        let [br, bz, bn] = blocks(step.bias_ih, width);
        let [cr, cz, cn] = blocks(step.bias_hh, width);
        let rows = step.gates.chunks_exact_mut(3 * width).zip(step.of_output.chunks_exact_mut(3 * width));
        let states = step.output.chunks_exact_mut(width).zip(step.output_before.chunks_exact(width));
        for ((gates, of_output), (output, before)) in rows.zip(states) {
            let [r, z, n, _] = blocks_mut(gates, width);
            let [hr, hz, hn, _] = blocks_mut(of_output, width);
            for u in 0..width {
                r[u] = sigmoid::<T, FUSED>(r[u] + br[u] + (hr[u] + cr[u]));
                z[u] = sigmoid::<T, FUSED>(z[u] + bz[u] + (hz[u] + cz[u]));
                hn[u] += cn[u];
                n[u] = tanh::<T, FUSED>(n[u] + bn[u] + r[u] * hn[u]);
                output[u] = (T::ONE - z[u]) * n[u] + z[u] * before[u];
            }
        }
    }

    pub(super) fn lstm_back<T: Scalar>(width: usize, back: Back<'_, T>) {
        let states = back.of_state.chunks_exact_mut(width).zip(back.of_cell.chunks_exact_mut(width));
        let cells = back.cell_before.chunks_exact(width).zip(back.cell.chunks_exact(width));
        for ((gates, (of_state, of_cell)), (before, cell)) in
            back.gates.chunks_exact_mut(4 * width).zip(states).zip(cells)
        {
            let [i, f, g, o] = blocks_mut(gates, width);
            for u in 0..width {
                let (iu, fu, gu, ou) = (i[u], f[u], g[u], o[u]);
                let t = tanh::<T, FUSED>(cell[u]);
                let d = of_state[u];
                let c = of_cell[u] + d * ou * (T::ONE - t * t);
                o[u] = d * t * ou * (T::ONE - ou);
                i[u] = c * gu * iu * (T::ONE - iu);
                f[u] = c * before[u] * fu * (T::ONE - fu);
                g[u] = c * iu * (T::ONE - gu * gu);
                of_cell[u] = c * fu;
                of_state[u] = T::ZERO;
            }
        }
    }

    pub(super) fn gru_back<T: Scalar>(width: usize, back: Back<'_, T>) {
        let rows = back.gates.chunks_exact_mut(3 * width).zip(back.of_output.chunks_exact_mut(3 * width));
        let states = back.of_state.chunks_exact_mut(width).zip(back.output_before.chunks_exact(width));
        for ((gates, of_output), (of_state, before)) in rows.zip(states) {
            let [r, z, n, _] = blocks_mut(gates, width);
            let [hr, hz, hn, _] = blocks_mut(of_output, width);
            for u in 0..width {
                let (ru, zu, nu, d) = (r[u], z[u], n[u], of_state[u]);
                let new = d * (T::ONE - zu) * (T::ONE - nu * nu);
                r[u] = new * hn[u] * ru * (T::ONE - ru);
                z[u] = d * (before[u] - nu) * zu * (T::ONE - zu);
                n[u] = new;
                hr[u] = r[u];
                hz[u] = z[u];
                hn[u] = new * ru;
                of_state[u] = d * zu;
            }
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
