//! Costs from their pieces, as a simulator on a GPU computes them, against costs from the signals.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_adapt::Signals;
use gaitfit_adapt::cost::{
    Cost, Pieces, Recorded, Reference, Signal, TimeAligned, Wass, Weights, sort_f32, wasserstein1,
};
use gaitfit_random::{Purpose, Stream};
use std::sync::Arc;

const SKIP: usize = 3;
const LENGTHS: [usize; 3] = [40, 31, 40];
const JOINTS: usize = 2;

fn draws(number: u32, count: usize) -> Vec<f64> {
    let stream = Stream::new(4, Purpose::BOOTSTRAP).environment(number);
    (0..count).map(|i| stream.normal(i as u32)).collect()
}

fn reference() -> Arc<Reference> {
    let recorded = |(number, &length): (usize, &usize)| Recorded {
        position: draws(10 * number as u32, length * JOINTS),
        velocity: draws(10 * number as u32 + 1, length * JOINTS),
        action: Some(draws(10 * number as u32 + 2, length * JOINTS)),
        base_position: Some(draws(10 * number as u32 + 3, length * 3)),
        // It stays at one height: that dimension is left out.
        base_velocity: Some(
            draws(10 * number as u32 + 4, length * 3)
                .chunks_exact(3)
                .flat_map(|row| [row[0], row[1], 0.25])
                .collect(),
        ),
    };
    let all: Vec<Recorded> = LENGTHS.iter().enumerate().map(recorded).collect();
    Arc::new(Reference::new(vec!["a".into(), "b".into()], &all, SKIP).unwrap())
}

/// Matrices of a simulated recording in the order of [`Signal::ALL`].
fn simulated(recording: usize) -> Vec<Vec<f32>> {
    let of = |signal: Signal| {
        let count = LENGTHS[recording] * signal.width(JOINTS);
        let numbers = draws(100 + 10 * recording as u32 + signal as u32, count);
        numbers.into_iter().map(|x| (1.2 * x + 0.1) as f32).collect()
    };
    Signal::ALL.iter().map(|&signal| of(signal)).collect()
}

/// The cost from signals, and from pieces; recording `r` falls at `falls[r]`.
fn both(cost: &dyn Cost, falls: [Option<usize>; 3]) -> (f64, f64) {
    let mut accumulator = cost.begin();
    let (mut lost, mut ends) = (0, Vec::new());
    for (recording, fell_at) in falls.into_iter().enumerate() {
        let all = simulated(recording);
        let signals = Signals {
            position: &all[0],
            velocity: &all[1],
            action: Some(&all[2]),
            base_position: Some(&all[3]),
            base_velocity: Some(&all[4]),
            fell_at,
        };
        accumulator.add(recording, signals).unwrap();
        let end = fell_at.unwrap_or(LENGTHS[recording]).max(SKIP);
        lost += LENGTHS[recording] - end;
        ends.push(end);
    }
    let pieces = cost.pieces().unwrap();
    let reference = pieces.compared().reference;
    let counts = |recording: usize, signal: Signal, column: usize| -> Vec<f32> {
        let width = signal.width(JOINTS);
        let rows = &simulated(recording)[signal as usize][SKIP * width..ends[recording] * width];
        rows.iter().skip(column).step_by(width).copied().collect()
    };
    let piece = |signal: Signal, column: usize| match pieces {
        Pieces::Distances(_) => {
            let mut pool: Vec<f32> = (0..3).flat_map(|r| counts(r, signal, column)).collect();
            sort_f32(&mut pool);
            wasserstein1(&pool, reference.dimensions(signal).unwrap()[column].sorted())
        }
        Pieces::Squares(_) => (0..3)
            .map(|recording| {
                let width = signal.width(JOINTS);
                let measured = reference.recorded(signal, recording).unwrap().iter();
                let measured = measured.skip(column).step_by(width);
                let of = |(x, y): (f32, &f64)| (f64::from(x) - y) * (f64::from(x) - y);
                counts(recording, signal, column).into_iter().zip(measured).map(of).sum::<f64>()
            })
            .sum(),
    };
    (accumulator.finish().unwrap().total, pieces.total(lost, piece))
}

#[test]
fn costs_from_pieces_are_the_costs() {
    let reference = reference();
    let weights = Weights { velocity: 0.5, ..Weights::from_reference(&reference) };
    let costs: [Box<dyn Cost>; 3] = [
        Box::new(Wass::new(reference.clone(), weights).unwrap()),
        Box::new(TimeAligned::match_o(reference.clone(), weights).unwrap()),
        Box::new(TimeAligned::match_s(reference.clone(), Weights::PRIVILEGED, None).unwrap()),
    ];
    for cost in &costs {
        let whole = both(cost.as_ref(), [None; 3]);
        // A fall in midst of a recording, and one before anything counts.
        let fallen = both(cost.as_ref(), [Some(20), None, Some(1)]);
        // Nothing is left to compare.
        let nothing = both(cost.as_ref(), [Some(0), Some(2), Some(3)]);
        for (from_signals, from_pieces) in [whole, fallen, nothing] {
            assert_eq!(from_signals, from_pieces, "{}", cost.name());
        }
        let all = (nothing.0 - cost.lost()).abs() < 1e-12;
        assert!(fallen.0 > whole.0 && all, "{}: {nothing:?}", cost.name());
    }
}

#[test]
fn samples_that_the_robot_loses_too_are_free() {
    let steady = reference();
    let weights = Weights::from_reference(&steady);
    let cost = |fall_rate: f64| {
        let reference = Reference::clone(&steady).with_fall_rate(fall_rate);
        Wass::new(Arc::new(reference), weights).unwrap()
    };
    // A robot that falls in half of its recordings loses a quarter of its samples. Here fewer are lost, then more.
    for (falls, free) in [([Some(LENGTHS[0] - 2), None, None], true), ([None, Some(SKIP), Some(SKIP)], false)]
    {
        let (charged, rare) = (both(&cost(0.0), falls), both(&cost(0.5), falls));
        assert_eq!((charged.0, rare.0), (charged.1, rare.1), "the same from pieces");
        assert!(rare.0 < charged.0);
        let all = both(&cost(1.0), falls);
        assert_eq!(rare.0 == all.0, free, "all losses are free: {rare:?} {all:?}");
    }
    // Nothing else changes, and nothing left to compare still costs the most.
    assert_eq!(both(&cost(0.5), [None; 3]), both(&cost(0.0), [None; 3]));
    let nothing = both(&cost(0.5), [Some(0); 3]);
    assert!((nothing.0 - cost(0.5).lost()).abs() < 1e-12, "{nothing:?}");
    assert_ne!(cost(0.5).pieces().unwrap().compared().reference.fingerprint(), steady.fingerprint());
}
