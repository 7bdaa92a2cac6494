//! Random choice of each minibatch's samples.

use std::ops::Range;

use gaitfit_random::{Purpose, Stream};

use super::worker::Place;

/// Samples of minibatch `number` of `minibatches`, as a range of what [`deal`] returns: equal but for rounding.
pub(super) fn range(samples: usize, minibatches: usize, number: usize) -> Range<usize> {
    number * samples / minibatches..(number + 1) * samples / minibatches
}

/// Deals every sample of all tiles, of which each has as many as `tiles` says, to one of `minibatches`, one after the other in the result; each split into sets of
/// these sizes is as likely as any other. Within a minibatch the samples keep their order, so that memory is read
/// forwards.
///
/// A pack with each minibatch's number on as many cards as it has samples is shuffled (Durstenfeld 1964) by
/// [`Purpose::SHUFFLE`] of `seed` at environment = `iteration`, step = `epoch`. An index below n is the high half of
/// word × n (Lemire 2019, without rejection: the bias is below n/2³²).
pub(super) fn deal(tiles: &[usize], minibatches: usize, seed: u64, iteration: u32, epoch: u32) -> Vec<Place> {
    let samples = tiles.iter().sum();
    // The next free place of each minibatch in the result.
    let mut next: Vec<usize> =
        (0..minibatches).map(|number| range(samples, minibatches, number).start).collect();
    let mut cards = Vec::with_capacity(samples);
    for number in 0..minibatches {
        cards.extend(range(samples, minibatches, number).map(|_| number as u32));
    }
    let stream = Stream::new(seed, Purpose::SHUFFLE).environment(iteration).step(epoch);
    let mut words = [0; 4];
    // Four words come in a block, so one call of the generator serves four draws.
    for (draw, last) in (1..samples).rev().enumerate() {
        if draw % 4 == 0 {
            words = stream.block((draw / 4) as u32);
        }
        // One of the `last + 1` cards that are left, so a card may also stay where it is.
        let other = (u64::from(words[draw % 4]) * (last as u64 + 1)) >> 32;
        cards.swap(last, other as usize);
    }
    // Samples are visited in their own order, and each goes to the next free place of its minibatch.
    let mut places = vec![Place { tile: 0, row: 0 }; samples];
    let mut cards = cards.into_iter();
    for (tile, &rows) in tiles.iter().enumerate() {
        for (row, card) in (0..rows).zip(&mut cards) {
            let slot = &mut next[card as usize];
            places[*slot] = Place { tile: tile as u32, row: row as u32 };
            *slot += 1;
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;
    #[test]
    fn every_sample_is_dealt_once_and_no_minibatch_is_favoured() {
        let tiles = [70, 33];
        let mut dealt = vec![[0; 4]; 103];
        for epoch in 0..2000 {
            let places = deal(&tiles, 4, 5, 0, epoch);
            let mut seen = [false; 103];
            for number in 0..4 {
                for place in &places[range(103, 4, number)] {
                    let sample = place.tile as usize * 70 + place.row as usize;
                    assert!(!std::mem::replace(&mut seen[sample], true));
                    dealt[sample][number] += 1;
                }
            }
            assert!(seen.iter().all(|&seen| seen));
        }
        // 2000 draws of probability about 1/4: standard deviation 19.4.
        assert!(dealt.iter().flatten().all(|&count: &i32| (count - 500).abs() < 100));
    }
}
