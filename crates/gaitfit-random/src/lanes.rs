//! Normals of many environments at once, compiled for several instruction sets and chosen at run time.
#![allow(unsafe_code, reason = "a function of a detected instruction set is entered by an unsafe call")]

use crate::Stream;

/// Environments side by side: the `f64` lanes of AVX-512.
const LANES: usize = 8;

/// Fills row r of `out`, `rows × width`, with the standard normals of draws 0, 1, … of `stream` at environment
/// `first + r`: the bits of [`Stream::fill_normals`], in a fraction of its time where the processor has wide vectors.
/// Environments wrap around at 2³².
///
/// # Panics
/// If `width` is 0 or `out` does not end with a whole row: an error of the caller.
pub fn fill_normal_rows(stream: Stream, first: u32, width: usize, out: &mut [f64]) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx512f,avx512dq,avx512vl")]
        fn avx512(stream: Stream, first: u32, width: usize, out: &mut [f64]) {
            fill(stream, first, width, out);
        }
        #[target_feature(enable = "avx2")]
        fn avx2(stream: Stream, first: u32, width: usize, out: &mut [f64]) {
            fill(stream, first, width, out);
        }
        if is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
        {
            // SAFETY: the three features that the function is compiled for were detected.
            return unsafe { avx512(stream, first, width, out) };
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: as above.
            return unsafe { avx2(stream, first, width, out) };
        }
    }
    fill(stream, first, width, out);
}

#[inline(always)]
fn fill(stream: Stream, first: u32, width: usize, out: &mut [f64]) {
    for (number, rows) in out.chunks_mut(LANES * width).enumerate() {
        let first = first.wrapping_add((number * LANES) as u32);
        for column in (0..width).step_by(2) {
            let (mut even, mut odd) = ([0.0; LANES], [0.0; LANES]);
            for lane in 0..LANES {
                let stream = stream.environment(first.wrapping_add(lane as u32));
                [even[lane], odd[lane]] = stream.normal_pair(column as u32 / 2);
            }
            for (lane, row) in rows.chunks_mut(width).enumerate() {
                row[column] = even[lane];
                if let Some(next) = row.get_mut(column + 1) {
                    *next = odd[lane];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Purpose;

    #[test]
    fn rows_are_the_streams_of_their_environments() {
        let stream = Stream::new(3, Purpose::TORQUE_NOISE).step(77);
        for (rows, width, first) in
            [(1, 1, 0), (8, 2, 5), (21, 12, u32::MAX - 9), (300, 7, 1 << 20), (0, 3, 1)]
        {
            let mut out = vec![f64::NAN; rows * width];
            fill_normal_rows(stream, first, width, &mut out);
            let mut portable = vec![f64::NAN; rows * width];
            fill(stream, first, width, &mut portable);
            for (row, out) in out.chunks(width).enumerate() {
                let mut want = vec![0.0; width];
                stream.environment(first.wrapping_add(row as u32)).fill_normals(0, &mut want);
                let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(out), bits(&want), "row {row} of {rows} × {width}");
                assert_eq!(bits(&portable[row * width..(row + 1) * width]), bits(&want));
            }
        }
    }

    /// Every recorded result rests on these.
    #[test]
    fn draws_keep_their_bits() {
        let mut out = [0.0; 3];
        fill_normal_rows(Stream::new(7, Purpose::TORQUE_NOISE).step(345), 12, 3, &mut out);
        assert_eq!(
            out.map(f64::to_bits),
            [0x3fe4_497a_d9ad_b720, 0xbfe0_6ab1_7684_d013, 0xbf9c_0dd7_1d2f_9648]
        );
    }
}
