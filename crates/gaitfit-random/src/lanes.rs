//! Draws of many environments at once, compiled for several instruction sets and chosen at run time.

use gaitfit_isa::kernels;

use crate::Stream;

/// Environments side by side: the 64-bit lanes of AVX-512.
const LANES: usize = 8;

// Every set returns the same bits.
kernels! {
    /// Fills row r of `out`, `rows × width`, with the standard normals of draws 0, 1, … of `stream` at environment
    /// `first + r`: the bits of [`Stream::fill_normals`], in a fraction of its time where the processor has wide
    /// vectors. Environments wrap around at 2³².
    ///
    /// # Panics
    /// If `width` is 0 or `out` does not end with a whole row: an error of the caller.
    pub fn fill_normal_rows(stream: Stream, first: u32, width: usize, out: &mut [f64]) {
        for (number, rows) in out.chunks_mut(LANES * width).enumerate() {
            let first = first.wrapping_add((number * LANES) as u32);
            for column in (0..width).step_by(2) {
                let (mut even, mut odd) = ([0.0; LANES], [0.0; LANES]);
                for lane in 0..LANES {
                    let stream = stream.environment(first.wrapping_add(lane as u32));
                    [even[lane], odd[lane]] = stream.normal_pair(column as u32 / 2);
                }
                // The last block may have fewer rows than lanes. The numbers of the other lanes are drawn and dropped.
                for (lane, row) in rows.chunks_mut(width).enumerate() {
                    row[column] = even[lane];
                    // An odd width leaves the second normal of the last pair unused.
                    if let Some(next) = row.get_mut(column + 1) {
                        *next = odd[lane];
                    }
                }
            }
        }
    }

    /// Fills row r of `out`, `rows × blocks.len()`, with these blocks of `stream` at environment `first + r`: the bits
    /// of [`Stream::block`]. Environments wrap around at 2³². Without blocks `out` stays as it is.
    ///
    /// # Panics
    /// If there are blocks and `out` does not end with a whole row: an error of the caller.
    pub fn fill_block_rows(stream: Stream, first: u32, blocks: &[u32], out: &mut [[u32; 4]]) {
        for (number, rows) in out.chunks_mut(LANES * blocks.len().max(1)).enumerate() {
            let first = first.wrapping_add((number * LANES) as u32);
            for (column, &block) in blocks.iter().enumerate() {
                let mut words = [[0; LANES]; 4];
                for lane in 0..LANES {
                    let block = stream.environment(first.wrapping_add(lane as u32)).block(block);
                    for (words, word) in words.iter_mut().zip(block) {
                        words[lane] = word;
                    }
                }
                // As above, lanes beyond the last row are not written.
                for (lane, row) in rows.chunks_mut(blocks.len()).enumerate() {
                    row[column] = [words[0][lane], words[1][lane], words[2][lane], words[3][lane]];
                }
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use gaitfit_isa::{Isa, with_isa};

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
            for isa in Isa::found() {
                let mut same = vec![f64::NAN; rows * width];
                with_isa(isa, || fill_normal_rows(stream, first, width, &mut same)).unwrap();
                assert_eq!(out, same, "{isa:?}");
            }
            for (row, out) in out.chunks(width).enumerate() {
                let mut want = vec![0.0; width];
                stream.environment(first.wrapping_add(row as u32)).fill_normals(0, &mut want);
                let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(out), bits(&want), "row {row} of {rows} × {width}");
            }
        }
    }

    #[test]
    fn rows_of_blocks_are_the_streams_of_their_environments() {
        let stream = Stream::new(5, Purpose::OBSERVATION_NOISE).step(9);
        for (rows, blocks, first) in [
            (1, &[3][..], 0),
            (8, &[0, 4, 8], 5),
            (21, &[7, 1], u32::MAX - 9),
            (300, &[2], 1 << 20),
            (0, &[1], 1),
        ] {
            let mut out = vec![[0; 4]; rows * blocks.len()];
            fill_block_rows(stream, first, blocks, &mut out);
            for isa in Isa::found() {
                let mut same = vec![[0; 4]; rows * blocks.len()];
                with_isa(isa, || fill_block_rows(stream, first, blocks, &mut same)).unwrap();
                assert_eq!(out, same, "{isa:?}");
            }
            for (row, out) in out.chunks(blocks.len()).enumerate() {
                let stream = stream.environment(first.wrapping_add(row as u32));
                let want: Vec<[u32; 4]> = blocks.iter().map(|&block| stream.block(block)).collect();
                assert_eq!(out, want, "row {row} of {rows}");
            }
        }
        fill_block_rows(stream, 0, &[], &mut []);
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
