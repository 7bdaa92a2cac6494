//! The order in which samples are visited.

use gaitfit_random::{Purpose, Stream};

use super::{Samples, worker::Place};

/// Every sample of all tiles, in order.
pub(super) fn places(tiles: &[Samples]) -> Vec<Place> {
    let of_tile = |(tile, samples): (usize, &Samples)| {
        (0..samples.rows() as u32).map(move |row| Place { tile: tile as u32, row })
    };
    tiles.iter().enumerate().flat_map(of_tile).collect()
}

/// Shuffles (Durstenfeld 1964) by [`Purpose::SHUFFLE`] of `seed` at environment = `iteration`, step = `epoch`. An index
/// below n is the high half of word × n (Lemire 2019, without rejection: the bias is below n/2³²).
pub(super) fn shuffle(places: &mut [Place], seed: u64, iteration: u32, epoch: u32) {
    let stream = Stream::new(seed, Purpose::SHUFFLE).environment(iteration).step(epoch);
    let mut words = [0; 4];
    for (draw, last) in (1..places.len()).rev().enumerate() {
        if draw % 4 == 0 {
            words = stream.block((draw / 4) as u32);
        }
        let other = (u64::from(words[draw % 4]) * (last as u64 + 1)) >> 32;
        places.swap(last, other as usize);
    }
}
