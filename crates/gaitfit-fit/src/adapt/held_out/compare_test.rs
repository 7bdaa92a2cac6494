//! Tests of blocks, halves and the floor of a comparison with logs that were not fitted.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;
use gaitfit_adapt::cost::{Wass, Weights};

/// Blocks of a joint that moves with some deviation about a place.
fn blocks_of(seed: u64, deviation: f64, place: f64) -> Vec<Predicted> {
    let stream = Stream::new(seed, Purpose(99));
    let block = |block: u32| {
        let values = (0..25).map(|k| (place + deviation * stream.step(block).normal(k)) as f32).collect();
        Predicted { position: values, velocity: vec![1.0; 25], ..Predicted::default() }
    };
    (0..96).map(block).collect()
}

fn cost(blocks: &[Predicted]) -> Box<dyn Cost> {
    let wide = |values: &[f32]| values.iter().map(|&x| f64::from(x)).collect();
    let recorded: Vec<Recorded> = blocks
        .iter()
        .map(|block| Recorded {
            position: wide(&block.position),
            velocity: wide(&block.velocity),
            ..Recorded::default()
        })
        .collect();
    let reference = Arc::new(Reference::new(vec!["hip".to_owned()], &recorded, 0).unwrap());
    Box::new(Wass::new(reference, Weights::POSITION).unwrap())
}

#[test]
fn the_floor_holds_a_simulator_that_moves_as_the_robot_does_and_no_other() {
    let mut inside = 0;
    for seed in 0..20 {
        let recorded_blocks = blocks_of(seed, 0.1, 0.0);
        let cost = cost(&recorded_blocks);
        let judge = |simulated: &[Predicted]| {
            let logs: Vec<usize> = (0..96).map(|block| block / 6).collect();
            let (floor, drawn) = floor(cost.as_ref(), &recorded_blocks, &[simulated.to_vec()], &logs);
            assert_eq!(drawn.len(), DRAWS as usize);
            floor.unwrap()
        };
        let alike = judge(&blocks_of(seed + 100, 0.1, 0.0));
        inside += usize::from(alike.cost.unwrap() <= alike.mean + alike.range95);
        let wrong = judge(&blocks_of(seed + 100, 0.1, 0.05));
        assert_eq!(wrong.mean, alike.mean);
        // Several simulations have the mean of their costs, up to the halves that each is compared with.
        let logs: Vec<usize> = (0..96).map(|block| block / 6).collect();
        let walks = [blocks_of(seed + 100, 0.1, 0.0), blocks_of(seed + 100, 0.1, 0.05)];
        let both = floor(cost.as_ref(), &recorded_blocks, &walks, &logs).0.unwrap().cost.unwrap();
        let expected = 0.5 * (alike.cost.unwrap() + wrong.cost.unwrap());
        assert!((both / expected - 1.0).abs() < 0.02, "{both} for {expected}");
        // Pooled, the simulations of one robot have less noise than each alone.
        let draws: Vec<_> = (0..8).map(|draw| blocks_of(1000 * (draw + 1) + seed, 0.1, 0.0)).collect();
        let all: Vec<usize> = (0..96).collect();
        let each: Vec<f64> =
            draws.iter().map(|walk| chosen_blocks(cost.as_ref(), walk, &all).unwrap().total).collect();
        let together = pooled(cost.as_ref(), &draws).unwrap().total;
        assert!(together < each.iter().sum::<f64>() / 8.0, "{together} of {each:?}");
        assert!(wrong.cost.unwrap() > wrong.mean + wrong.range95, "{wrong:?}");
    }
    assert!(inside >= 18, "{inside} of 20 are explained");
}

#[test]
fn blocks_cover_what_counts_and_know_of_falls() {
    let blocks = blocks([10, 23, 4].into_iter(), 3, 5);
    let ends: Vec<_> = blocks.iter().map(|block| (block.log, block.start, block.end)).collect();
    assert_eq!(ends, [(0, 3, 10), (1, 3, 8), (1, 8, 13), (1, 13, 18), (1, 18, 23)]);
    assert_eq!(compared(&blocks, [2.0, 5.0, 0.25].into_iter()), (2, 7.0), "the third log is too short");
    let walk = Predicted {
        position: (0..46).map(|x| x as f32).collect(),
        velocity: vec![0.0; 46],
        fell_at: Some(10),
        ..Predicted::default()
    };
    let block = blocks[2].cut(&walk, 2);
    assert_eq!((block.position[0], block.position.len(), block.fell_at), (16.0, 10, Some(2)));
    assert_eq!((blocks[1].cut(&walk, 2).fell_at, blocks[3].cut(&walk, 2).fell_at), (None, Some(0)));
}

#[test]
fn draws_are_permutations_that_differ() {
    let mut one = shuffled(0, 9);
    assert_ne!(one, shuffled(1, 9));
    one.sort_unstable();
    assert_eq!(one, (0..9).collect::<Vec<_>>());
    assert!(shuffled(0, 0).is_empty());
}

#[test]
fn halves_have_as_much_of_each_log() {
    let logs = [0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2];
    let (one, other) = halves(3, &logs);
    let count = |half: &[usize], log: usize| half.iter().filter(|&&block| logs[block] == log).count();
    assert_eq!([0, 1, 2].map(|log| count(&one, log) + count(&other, log)), [4, 3, 5]);
    for log in 0..3 {
        assert!(count(&one, log).abs_diff(count(&other, log)) <= 1, "{one:?} {other:?}");
    }
    assert_ne!(halves(4, &logs), (one, other));
}
