//! Loops over numbers in a row.
#![allow(unsafe_code, reason = "a function of a detected instruction set is entered by an unsafe call")]

use super::{dispatch::dispatched, scalar::Scalar};

dispatched! {

    /// sums += Σ over the rows of d: `rows × sums.len()`.
    fn add_column_sums(sums: &mut [T], d: &[T]) {
        for row in d.chunks_exact(sums.len()) {
            for (sum, &d) in sums.iter_mut().zip(row) {
                *sum += d;
            }
        }
    }

    /// sums += terms.
    fn add(sums: &mut [T], terms: &[T]) {
        for (sum, &term) in sums.iter_mut().zip(terms) {
            *sum += term;
        }
    }

    /// One step of Adam: `rates` = [1 − β₁, 1 − β₂, factor on the gradient, learning rate / (1 − β₁ᵗ), √(1 − β₂ᵗ), ε].
    fn descend(parameters: &mut [T], first: &mut [T], second: &mut [T], gradient: &[T], rates: [T; 6]) {
        let [share_1, share_2, factor, rate, correction, epsilon] = rates;
        let moments = first.iter_mut().zip(second);
        for ((parameter, (first, second)), &gradient) in parameters.iter_mut().zip(moments).zip(gradient) {
            let g = gradient * factor;
            *first += share_1 * (g - *first);
            *second += share_2 * (g * g - *second);
            *parameter = *parameter - rate * *first / (second.square_root() / correction + epsilon);
        }
    }
}
