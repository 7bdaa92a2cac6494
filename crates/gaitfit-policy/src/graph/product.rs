//! Products of matrices.

use super::Numbers;
use crate::network::{Matrix, multiply};

/// out = x w of `rows` robots, w a constant `inner × outer`: the last axis of x, whatever stands before it.
pub(super) fn by_constant(
    out: &mut [f32],
    rows: usize,
    x: Numbers<'_>,
    w: Numbers<'_>,
    [inner, outer]: [usize; 2],
) {
    let w = Matrix::row_major(w.all, inner, outer);
    if x.constant {
        // Once for all robots.
        let height = x.count / inner;
        let (first, others) = out.split_at_mut(height * outer);
        multiply(first, Matrix::row_major(x.all, height, inner), w, false);
        others.chunks_exact_mut(first.len()).for_each(|other| other.copy_from_slice(first));
        return;
    }
    // A robot's value has count / inner rows of the last axis; those of all robots lie one behind the other.
    multiply(out, Matrix::row_major(x.all, rows * (x.count / inner), inner), w, false);
}

/// out = a b of one robot: `many` products of `rows × inner` and `inner × outer`; of a factor that is not repeated there is
/// one matrix.
pub(super) fn of_both(
    out: &mut [f32],
    a: &[f32],
    b: &[f32],
    [many, rows, inner, outer]: [usize; 4],
    repeated: [bool; 2],
) {
    for number in 0..many {
        let from = |repeated: bool, size: usize| if repeated { number * size } else { 0 };
        let a = &a[from(repeated[0], rows * inner)..][..rows * inner];
        let b = &b[from(repeated[1], inner * outer)..][..inner * outer];
        let out = &mut out[number * rows * outer..][..rows * outer];
        multiply(out, Matrix::row_major(a, rows, inner), Matrix::row_major(b, inner, outer), false);
    }
}
