//! The exact 1-D Wasserstein-1 distance of two empirical distributions, and the sort it needs.

/// Bits of one radix pass: three passes cover 32 bits, and a histogram of 2,048 counts stays in the first-level
/// cache.
const PASS_BITS: u32 = 11;
const BUCKETS: usize = 1 << PASS_BITS;
/// Below this length the histograms cost more than a comparison sort.
const SMALL: usize = 256;

/// The order-preserving integer of a number: the sign bit is set for positive ones, all bits are flipped for
/// negative ones. −0 comes just below +0; the order is that of [`f32::total_cmp`].
#[inline]
pub(crate) fn key(value: f32) -> u32 {
    let bits = value.to_bits();
    bits ^ (((bits as i32 >> 31) as u32) | 0x8000_0000)
}

/// The inverse of [`key`].
#[inline]
pub(crate) fn value(key: u32) -> f32 {
    f32::from_bits(key ^ (((!key as i32 >> 31) as u32) | 0x8000_0000))
}

/// Sorts `values` ascending ([`f32::total_cmp`]) with a radix sort.
pub fn sort_f32(values: &mut [f32]) {
    let mut keys: Vec<u32> = values.iter().map(|value| key(*value)).collect();
    sort_keys(&mut keys, &mut Vec::new());
    for (slot, sorted) in values.iter_mut().zip(keys) {
        *slot = value(sorted);
    }
}

/// Least-significant-digit radix sort in three passes. `scratch` is working memory, reused between calls.
pub(crate) fn sort_keys(keys: &mut Vec<u32>, scratch: &mut Vec<u32>) {
    if keys.len() < SMALL {
        keys.sort_unstable();
        return;
    }
    // All three histograms in one pass over the keys.
    let mut counts = [[0_u32; BUCKETS]; 3];
    for key in keys.iter() {
        for (pass, count) in counts.iter_mut().enumerate() {
            count[digit(*key, pass)] += 1;
        }
    }
    scratch.resize(keys.len(), 0);
    for (pass, count) in counts.iter_mut().enumerate() {
        // A digit that all keys share moves nothing.
        if count[digit(keys[0], pass)] as usize == keys.len() {
            continue;
        }
        // Counts become the places at which each digit's keys begin.
        let mut start = 0;
        for slot in count.iter_mut() {
            (*slot, start) = (start, start + *slot);
        }
        for key in keys.iter() {
            let slot = &mut count[digit(*key, pass)];
            scratch[*slot as usize] = *key;
            *slot += 1;
        }
        // Each pass is stable, so the order of the lower digits survives.
        std::mem::swap(keys, scratch);
    }
}

#[inline]
fn digit(key: u32, pass: usize) -> usize {
    (key >> (PASS_BITS * pass as u32)) as usize % BUCKETS
}

/// ∫ |F(x) − G(x)| dx of the empirical distribution functions F and G of two samples, each sorted ascending
/// (`scipy.stats.wasserstein_distance`). Sample counts may differ; the result is exact but for the rounding of
/// the sum. NaN if a sample is empty.
///
/// Computed as ∫ |F⁻¹(t) − G⁻¹(t)| dt over t in [0, 1] (equal in one dimension; Peyré and Cuturi 2019, remark 2.30):
/// both inverses are constant between the merged steps i/n and j/m, which are compared as integers.
///
/// All is computed in `f64`, whichever of the two `a` has. The distance from `b` to `a` has the same bits.
pub fn wasserstein1<T: Copy + Into<f64>>(a: &[T], b: &[f64]) -> f64 {
    merge(a.len(), |i| a[i].into(), b)
}

/// [`wasserstein1`] of every column of two arrays, `rows × columns`, row-major, with samples in any order.
///
/// # Errors
/// The first column with a value that is not finite.
///
/// # Panics
/// If an array has no row: an error of the caller.
pub fn wasserstein1_of_columns(a: &[f64], b: &[f64], columns: usize) -> Result<Vec<f64>, usize> {
    let sorted = |values: &[f64], column: usize| {
        let mut values: Vec<f64> = values[column..].iter().step_by(columns).copied().collect();
        values.sort_unstable_by(f64::total_cmp);
        values
    };
    let finite = |values: &[f64], column: usize| {
        values[column..].iter().step_by(columns).all(|value| value.is_finite())
    };
    (0..columns)
        .map(|column| {
            let both = finite(a, column) && finite(b, column);
            both.then(|| wasserstein1(&sorted(a, column), &sorted(b, column))).ok_or(column)
        })
        .collect()
}

/// [`wasserstein1`] of a sample given as sorted keys.
pub(crate) fn wasserstein1_keys(keys: &[u32], b: &[f64]) -> f64 {
    merge(keys.len(), |i| f64::from(value(keys[i])), b)
}

#[inline(always)]
fn merge(n: usize, a: impl Fn(usize) -> f64, b: &[f64]) -> f64 {
    if n == 0 || b.is_empty() {
        return f64::NAN;
    }
    if n == b.len() {
        // Four fixed partial sums: the additions overlap, and the result does not depend on the machine.
        let mut sums = [0.0; 4];
        for (i, other) in b.iter().enumerate() {
            sums[i % 4] += (a(i) - other).abs();
        }
        return ((sums[0] + sums[1]) + (sums[2] + sums[3])) / n as f64;
    }
    // t runs over 0..n·m; a's step i ends at (i + 1)·m and b's step j at (j + 1)·n.
    // The product of two counts of samples can need more than 32 bits.
    let (n_wide, m_wide) = (n as u64, b.len() as u64);
    let (mut i, mut j, mut t, mut sum) = (0, 0, 0_u64, 0.0);
    // Both quantile functions are staircases. Between two ends of steps their distance is constant.
    let (mut end_a, mut end_b) = (m_wide, n_wide);
    while i < n && j < b.len() {
        let end = end_a.min(end_b);
        sum += (end - t) as f64 * (a(i) - b[j]).abs();
        t = end;
        // Where two steps end together, both indices advance, so that no empty piece is left.
        let (step_a, step_b) = (u64::from(end_a == end), u64::from(end_b == end));
        i += step_a as usize;
        j += step_b as usize;
        end_a += step_a * m_wide;
        end_b += step_b * n_wide;
    }
    sum / (n_wide as f64 * m_wide as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaitfit_random::{Purpose, Stream};

    #[test]
    fn columns_are_compared_one_by_one_and_the_first_bad_one_is_named() {
        // Columns {1, 0} and {5, 5} against {2, 0, 1} and {6, 4, 5}.
        let (a, mut b) = ([1.0, 5.0, 0.0, 5.0], [2.0, 6.0, 0.0, 4.0, 1.0, 5.0]);
        let distances = wasserstein1_of_columns(&a, &b, 2).expect("all values are finite");
        assert!(
            (distances[0] - 0.5).abs() < 1e-15 && (distances[1] - 2.0 / 3.0).abs() < 1e-15,
            "{distances:?}"
        );
        b[3] = f64::NAN;
        assert_eq!(wasserstein1_of_columns(&a, &b, 2), Err(1));
    }

    #[test]
    fn radix_sort_agrees_with_the_standard_sort() {
        for (n, spread) in [(0, 1.0), (1, 1.0), (255, 1e3), (256, 1e-3), (5_000, 30.0), (3_000, 1e30)] {
            let stream = Stream::new(n, Purpose(99));
            let mut values: Vec<f32> = (0..n as u32).map(|i| (stream.normal(i) * spread) as f32).collect();
            // Ties, signed zeros and infinities.
            for i in 0..values.len() / 7 {
                values[7 * i] = [0.0, -0.0, 1.5, f32::INFINITY, f32::NEG_INFINITY, f32::MIN_POSITIVE][i % 6];
            }
            let mut expected = values.clone();
            expected.sort_by(f32::total_cmp);
            sort_f32(&mut values);
            assert!(values.iter().zip(&expected).all(|(a, b)| a.to_bits() == b.to_bits()), "n = {n}");
        }
        let mut same = vec![2.5_f32; 1000];
        sort_f32(&mut same);
        assert_eq!(same, vec![2.5; 1000]);
    }

    /// By hand: {0, 1} against {0, 1, 2}. Inverses on thirds and halves of [0, 1]: |0−0|·⅓ + |0−1|·⅙ + |1−1|·⅙ +
    /// |1−2|·⅓ = ½.
    #[test]
    fn unequal_counts_by_hand() {
        assert!((wasserstein1(&[0.0, 1.0], &[0.0, 1.0, 2.0]) - 0.5).abs() < 1e-15);
        assert_eq!(wasserstein1(&[1.0], &[-1.0, 1.0, 4.0]), 5.0 / 3.0);
        assert!(wasserstein1(&[0.0_f32; 0], &[1.0]).is_nan());
    }

    /// Numbers that f32 does not tell apart; the two sides exchanged give the same bits.
    #[test]
    fn doubles_are_compared_as_doubles_and_both_ways_alike() {
        let large = |offsets: &[f64]| offsets.iter().map(|x| 1e9 + x).collect::<Vec<_>>();
        assert_eq!(wasserstein1(&large(&[0.0, 1.0, 2.0]), &large(&[1.0, 2.0, 3.0])), 1.0);
        let stream = Stream::new(6, Purpose(99));
        let mut all: Vec<Vec<f64>> =
            [301, 500].map(|n| (0..n).map(|i| stream.normal(i + n) * 1e-9 + 1.0).collect()).into();
        all.iter_mut().for_each(|values| values.sort_by(f64::total_cmp));
        let [a, b] = [&all[0], &all[1]];
        assert_eq!(wasserstein1(a, b).to_bits(), wasserstein1(b, a).to_bits());
        assert!(wasserstein1(a, b) > 0.0);
    }

    /// A shift by c costs |c|, whatever the counts; repeating a sample changes nothing.
    #[test]
    fn shift_and_repetition() {
        let stream = Stream::new(5, Purpose(99));
        let mut a: Vec<f32> = (0..300).map(|i| stream.normal(i) as f32).collect();
        sort_f32(&mut a);
        let thrice: Vec<f64> = a.iter().flat_map(|x| [f64::from(*x) + 0.75; 3]).collect();
        assert!((wasserstein1(&a, &thrice) - 0.75).abs() < 1e-14);
    }
}
