//! Matrix products on slices: the one door to the kernels of the `gemm` crates.
#![allow(unsafe_code, reason = "gemm takes raw pointers; every index it can reach is checked here first")]

use super::scalar::Scalar;

/// Widest product for which gemm need not copy `b`. Up to here reading it in place was as fast or faster; from 1,024
/// on, where rows a power of two apart crowd each other out of the cache, it took 13 to 22 % longer.
const WIDEST_IN_PLACE: usize = 512;
/// gemm's setting for that, the greatest it knows and its own.
const IN_PLACE: usize = 256;
const COPIED: usize = 8;

/// Tells gemm whether to copy the second factor of a product with `columns`. The setting is the whole process's: a thread
/// that changes it meanwhile costs time, never a bit of the result.
fn choose_packing(columns: usize) {
    let wanted = if columns <= WIDEST_IN_PLACE { IN_PLACE } else { COPIED };
    if gemm_common::gemm::get_lhs_packing_threshold_single_thread() != wanted {
        gemm_common::gemm::set_lhs_packing_threshold_single_thread(wanted);
    }
}

/// A matrix in a slice: element (i, j) at `i · row_stride + j · column_stride`.
#[derive(Clone, Copy)]
pub(crate) struct Matrix<'a, T> {
    data: &'a [T],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a, T> Matrix<'a, T> {
    /// The first `rows × columns` elements of `data`, row-major.
    pub(crate) fn row_major(data: &'a [T], rows: usize, columns: usize) -> Self {
        Self { data, rows, columns, row_stride: columns, column_stride: 1 }
    }

    /// The transpose, of the same elements.
    pub(crate) fn transposed(self) -> Self {
        let Self { data, rows, columns, row_stride, column_stride } = self;
        Self { data, rows: columns, columns: rows, row_stride: column_stride, column_stride: row_stride }
    }

    /// Number of elements of `data` that the matrix reaches over.
    fn extent(&self) -> usize {
        if self.rows == 0 || self.columns == 0 {
            return 0;
        }
        (self.rows - 1) * self.row_stride + (self.columns - 1) * self.column_stride + 1
    }
}

/// out = a b, or out += a b if `accumulate`; out is row-major, `a.rows × b.columns`. Runs on the calling thread, in
/// an order of summation that depends on the sizes, the strides and the processor alone. Fastest where `b` and `out` are
/// row-major, begin with a cache line and have rows of whole ones: then no vector lies across two lines, and gemm need
/// not copy `b`.
///
/// # Panics
/// If the sizes do not fit or a slice is too short: an error of the caller.
pub(crate) fn multiply<T: Scalar>(out: &mut [T], a: Matrix<'_, T>, b: Matrix<'_, T>, accumulate: bool) {
    let (m, k, n) = (a.rows, a.columns, b.columns);
    assert_eq!(k, b.rows, "inner sizes of a matrix product differ");
    assert!(a.extent() <= a.data.len() && b.extent() <= b.data.len(), "a factor is shorter than its size");
    assert!(m * n <= out.len(), "the product is shorter than its size");
    if m == 0 || n == 0 {
        return;
    }
    choose_packing(n);
    // The kernels want a destination whose columns are at least as far apart as its rows: outᵀ = bᵀ aᵀ.
    let (m, n, dst_columns, dst_rows, a, b) = if n > 1 {
        (n, m, n as isize, 1, b.transposed(), a.transposed())
    } else {
        (m, n, 1, n as isize, a, b)
    };
    // SAFETY: the three assertions above bound every index i · row_stride + j · column_stride that the kernel forms for
    // i < rows and j < columns; `out` is borrowed mutably, so it overlaps neither factor; no stride exceeds a slice's
    // length, so isize holds it.
    unsafe {
        T::product()(
            m,
            n,
            k,
            out.as_mut_ptr(),
            dst_columns,
            dst_rows,
            accumulate,
            a.data.as_ptr(),
            a.column_stride as isize,
            a.row_stride as isize,
            b.data.as_ptr(),
            b.column_stride as isize,
            b.row_stride as isize,
            T::ONE,
            T::ONE,
            false,
            false,
            false,
            gemm_common::Parallelism::None,
        );
    }
}
