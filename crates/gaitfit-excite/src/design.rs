//! Choosing command sequences: those whose logs together leave the smallest spread.
//!
//! What logs tell adds up (Fisher 1922), and to what was recorded before. The criterion is the geometric mean of the expected
//! standard deviations, which no unit changes. Sequences are taken one by one, each the one that helps most, and then
//! exchanged while that helps (Fedorov 1972, *Theory of Optimal Experiments*).

use super::information::Information;

/// Smallest decrease of the criterion by an exchange. The criterion is a logarithm, so this is a share of the
/// deviations.
const PROGRESS: f64 = 1e-6;
/// Max number of exchanges. Each lowers the criterion, so they end by themselves; this bounds the time.
const EXCHANGES: usize = 1000;
/// Logarithm of the deviation that stands for an entry that the logs do not identify, in place of infinity: a sum
/// must show how many there are, so that sequences that identify one more win.
const UNIDENTIFIED: f64 = 30.0;

/// Logarithm of the geometric mean of the deviations of `entries`; an entry that is not identified counts as a huge one.
fn criterion(information: &Information, entries: &[usize]) -> f64 {
    let deviations = information.deviations();
    entries.iter().map(|&entry| deviations[entry].ln().min(UNIDENTIFIED)).sum::<f64>()
        / entries.len().max(1) as f64
}

/// The places of `count` of the `candidates` that together, and with the logs `known`, have the smallest criterion; none is
/// taken twice. `stop`: whether to leave off with what is chosen then.
pub(super) fn choose(
    known: &Information,
    candidates: &[Information],
    count: usize,
    entries: &[usize],
    stop: &dyn Fn() -> bool,
) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    let mut sum = known.clone();
    let with = |sum: &Information, one: usize| {
        let mut sum = sum.clone();
        sum.add(&candidates[one], 1.0);
        sum
    };
    let best = |sum: &Information, chosen: &[usize]| {
        let left = (0..candidates.len()).filter(|one| !chosen.contains(one) && !stop());
        left.map(|one| (criterion(&with(sum, one), entries), one)).min_by(|a, b| a.0.total_cmp(&b.0))
    };
    // Greedy first: one motion after the other, each the best beside those before.
    while chosen.len() < count {
        let Some((_, one)) = best(&sum, &chosen) else { break };
        sum.add(&candidates[one], 1.0);
        chosen.push(one);
    }
    // The information of all chosen motions without one, summed anew. Subtracting it from the total would leave rounding
    // errors where it alone identifies a parameter.
    let but = |chosen: &[usize], place: Option<usize>| {
        let others = chosen.iter().enumerate().filter(|(at, _)| Some(*at) != place);
        others.fold(known.clone(), |sum, (_, &one)| with(&sum, one))
    };
    // Then exchanges: what was best early may be worth less beside the later ones.
    for _ in 0..EXCHANGES {
        let now = criterion(&but(&chosen, None), entries);
        let swap =
            |place: usize| best(&but(&chosen, Some(place)), &chosen).map(|(value, one)| (value, place, one));
        let exchange = (0..chosen.len()).filter_map(swap).min_by(|a, b| a.0.total_cmp(&b.0));
        match exchange.filter(|(value, ..)| *value < now - PROGRESS) {
            Some((_, place, one)) => chosen[place] = one,
            None => break,
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    /// Information about numbers that do not depend on each other.
    fn diagonal<const N: usize>(numbers: [f64; N]) -> Information {
        Information::from_curvature(DMatrix::from_diagonal(&numbers.to_vec().into()))
    }

    /// The choice, in order.
    fn chosen<const N: usize>(
        known: [f64; N],
        all: &[Information],
        count: usize,
        which: &[usize],
    ) -> Vec<usize> {
        let mut chosen = choose(&diagonal(known), all, count, which, &|| false);
        chosen.sort_unstable();
        chosen
    }

    #[test]
    fn a_log_that_identifies_both_numbers_is_chosen() {
        // Alone 0 is best for the first number, 1 for the second; 3 identifies little.
        let all = [diagonal([10.0, 0.1]), diagonal([0.1, 10.0]), diagonal([9.0, 0.1]), diagonal([1.0, 1.0])];
        assert_eq!(chosen([0.0; 2], &all, 2, &[0, 1]), [0, 1]);
        assert_eq!(chosen([0.0; 2], &all, 2, &[0]), [0, 2]);
        assert_eq!(chosen([0.0; 2], &all, 9, &[0]).len(), 4);
        assert!(choose(&Information::nothing(2), &[], 2, &[0], &|| false).is_empty());
        assert!(choose(&Information::nothing(2), &all, 2, &[0], &|| true).is_empty());
    }

    #[test]
    fn what_is_known_already_is_not_asked_for_again() {
        let all = [diagonal([10.0, 0.1]), diagonal([0.1, 10.0]), diagonal([9.0, 0.1]), diagonal([0.1, 9.0])];
        assert_eq!(chosen([100.0, 0.0], &all, 2, &[0, 1]), [1, 3]);
        assert_eq!(chosen([0.0, 100.0], &all, 2, &[0, 1]), [0, 2]);
    }

    #[test]
    fn exchanges_mend_what_greed_began() {
        // The first choice is the best single one; without it two others are better together.
        let all = [diagonal([3.0, 3.0]), diagonal([100.0, 0.01]), diagonal([0.01, 100.0])];
        assert_eq!(chosen([0.0; 2], &all, 2, &[0, 1]), [1, 2]);
    }

    #[test]
    fn a_number_that_no_log_identifies_does_not_hide_the_rest() {
        // The third number is told by none, the second by the last alone.
        let all = [
            diagonal([1.0, 0.0, 0.0]),
            diagonal([9.0, 0.0, 0.0]),
            diagonal([4.0, 0.0, 0.0]),
            diagonal([1.0, 1.0, 0.0]),
        ];
        assert_eq!(chosen([0.0; 3], &all, 2, &[0, 1, 2]), [1, 3]);
    }
}
