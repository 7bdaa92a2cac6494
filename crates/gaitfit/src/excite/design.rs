//! Choosing command sequences: those whose logs together leave the smallest spread.
//!
//! The information of logs adds up (Fisher 1922). The criterion is the geometric mean of the expected standard deviations,
//! which no unit changes. Sequences are taken one by one, each the one that helps most, and then exchanged while that helps
//! (Fedorov 1972, *Theory of Optimal Experiments*).

use nalgebra::DMatrix;

/// Part of the criterion by which an exchange must lower it.
const PROGRESS: f64 = 1e-6;
/// Most exchanges: each lowers the criterion, so there is an end to them.
const EXCHANGES: usize = 1000;
/// Added to the information's diagonal, in parts of it, so that what one log alone does not tell has a large spread.
const RIDGE: f64 = 1e-9;

/// Logarithm of the deviation that stands for that of an entry which the logs do not tell: they are told first.
const UNTOLD: f64 = 30.0;

/// Standard deviations to expect from logs with this information; infinite for what they do not tell.
pub(super) fn deviations(information: &DMatrix<f64>) -> Vec<f64> {
    let count = information.nrows();
    let scale = information.diagonal().map(|own| if own > 0.0 { 1.0 / own.sqrt() } else { 0.0 });
    let scaled = DMatrix::from_fn(count, count, |i, j| {
        let same = if i == j { RIDGE } else { 0.0 };
        information[(i, j)] * scale[i] * scale[j]
            + if scale[i] > 0.0 { same } else { f64::from(u8::from(i == j)) }
    });
    let Some(solved) = scaled.cholesky() else { return vec![f64::INFINITY; count] };
    let inverse = solved.inverse();
    let of =
        |i: usize| if scale[i] > 0.0 { inverse[(i, i)].max(0.0).sqrt() * scale[i] } else { f64::INFINITY };
    (0..count).map(of).collect()
}

/// Logarithm of the geometric mean of the deviations of the entries `of`; an entry that is not told counts as a huge one.
fn criterion(information: &DMatrix<f64>, of: &[usize]) -> f64 {
    let found = deviations(information);
    of.iter().map(|&entry| found[entry].ln().min(UNTOLD)).sum::<f64>() / of.len().max(1) as f64
}

/// The places of `count` of the `candidates` that together have the smallest criterion; none is taken twice. `stop`: whether
/// to leave off with what is chosen then.
pub(super) fn choose(
    candidates: &[DMatrix<f64>],
    count: usize,
    of: &[usize],
    stop: &dyn Fn() -> bool,
) -> Vec<usize> {
    let Some(first) = candidates.first() else { return Vec::new() };
    let mut chosen: Vec<usize> = Vec::new();
    let mut sum = DMatrix::zeros(first.nrows(), first.ncols());
    let best = |sum: &DMatrix<f64>, chosen: &[usize]| {
        let left = (0..candidates.len()).filter(|one| !chosen.contains(one) && !stop());
        left.map(|one| (criterion(&(sum + &candidates[one]), of), one)).min_by(|a, b| a.0.total_cmp(&b.0))
    };
    while chosen.len() < count {
        let Some((_, one)) = best(&sum, &chosen) else { break };
        sum += &candidates[one];
        chosen.push(one);
    }
    for _ in 0..EXCHANGES {
        let now = criterion(&sum, of);
        let swap = |place: usize| {
            let without = &sum - &candidates[chosen[place]];
            best(&without, &chosen).map(|(value, one)| (value, place, one))
        };
        let found = (0..chosen.len()).filter_map(swap).min_by(|a, b| a.0.total_cmp(&b.0));
        match found.filter(|(value, ..)| *value < now - PROGRESS) {
            Some((_, place, one)) => {
                sum += &candidates[one] - &candidates[chosen[place]];
                chosen[place] = one;
            }
            None => break,
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Information about two numbers.
    fn of(own: [f64; 2]) -> DMatrix<f64> {
        DMatrix::from_diagonal(&own.to_vec().into())
    }

    #[test]
    fn deviations_are_those_of_the_inverse() {
        let found = deviations(&DMatrix::from_row_slice(2, 2, &[4.0, 2.0, 2.0, 3.0]));
        assert!((found[0] - (3.0f64 / 8.0).sqrt()).abs() < 1e-6 && (found[1] - 0.5f64.sqrt()).abs() < 1e-6);
        let found = deviations(&of([4.0, 0.0]));
        assert!((found[0] - 0.5).abs() < 1e-6 && found[1] == f64::INFINITY);
    }

    #[test]
    fn what_tells_both_numbers_is_chosen() {
        // Alone 0 is best for the first number, 1 for the second; 3 tells little.
        let all = [of([10.0, 0.1]), of([0.1, 10.0]), of([9.0, 0.1]), of([1.0, 1.0])];
        let both = |which: &[usize]| {
            let mut chosen = choose(&all, 2, which, &|| false);
            chosen.sort_unstable();
            chosen
        };
        assert_eq!(both(&[0, 1]), [0, 1]);
        assert_eq!(both(&[0]), [0, 2]);
        assert_eq!(choose(&all, 9, &[0], &|| false).len(), 4);
        assert!(choose(&[], 2, &[0], &|| false).is_empty());
        assert!(choose(&all, 2, &[0], &|| true).is_empty());
    }

    #[test]
    fn exchanges_mend_what_greed_began() {
        // The first choice is the best single one; without it two others are better together.
        let all = [of([3.0, 3.0]), of([100.0, 0.01]), of([0.01, 100.0])];
        let mut chosen = choose(&all, 2, &[0, 1], &|| false);
        chosen.sort_unstable();
        assert_eq!(chosen, [1, 2]);
    }

    #[test]
    fn what_no_log_tells_does_not_hide_the_rest() {
        // The third number is told by none, the second by the last alone.
        let of = |own: [f64; 3]| DMatrix::from_diagonal(&own.to_vec().into());
        let all = [of([1.0, 0.0, 0.0]), of([9.0, 0.0, 0.0]), of([4.0, 0.0, 0.0]), of([1.0, 1.0, 0.0])];
        let mut chosen = choose(&all, 2, &[0, 1, 2], &|| false);
        chosen.sort_unstable();
        assert_eq!(chosen, [1, 3]);
    }
}
