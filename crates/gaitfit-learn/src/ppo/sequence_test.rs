//! PPO's whole loss behind recurrent layers: its derivative by every parameter, in f64, against central differences of the
//! loss; and what makes up the groups that pass together.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_policy::network::{Cell, RecurrentWeights, Scalar, Weights};
use gaitfit_random::{Purpose, Stream};

use super::{
    MemorySettings, Samples, Settings, Widths,
    loss::{Constants, Sums, Targets},
    sequence::{SequenceWorker, groups},
    worker::{Place, Point},
};

const WIDTHS: Widths = Widths { observation: 5, critic_observation: 7, action: 3 };
const SIZES: [usize; 2] = [5, 4];
const ROWS: usize = SIZES[0] * SIZES[1];

fn normals(number: u32, size: usize, scale: f64) -> Vec<f64> {
    let stream = Stream::new(12, Purpose::BOOTSTRAP).environment(number);
    (0..size).map(|draw| scale * stream.normal(draw as u32)).collect()
}

fn settings(cell: Cell) -> Settings {
    Settings {
        actor_hidden: vec![6],
        critic_hidden: vec![],
        value_coefficient: 0.7,
        memory: Some(MemorySettings { cell, width: 4, layers: 2 }),
        ..Settings::default()
    }
}

/// Gradient and sums at `parameters`: the actor, its memory, the critic, its memory, ln σ.
fn gradient<T: Scalar>(settings: &Settings, parameters: &[f64], with_memory: [bool; 2]) -> (Vec<T>, Sums) {
    let convert = |numbers: &[f64]| numbers.iter().map(|&x| T::from_f64(x)).collect::<Vec<T>>();
    let (actor, critic) = settings.shapes(WIDTHS).unwrap();
    let shapes = settings.memories(WIDTHS).unwrap().unwrap();
    let parameters = convert(parameters);
    let sizes = [
        actor.parameters(),
        shapes[0].parameters(),
        critic.parameters(),
        shapes[1].parameters(),
        WIDTHS.action,
    ];
    let mut rest = &parameters[..];
    let [of_actor, of_actor_memory, of_critic, of_critic_memory, log_std] = sizes.map(|size| {
        let (part, others) = rest.split_at(size);
        rest = others;
        part
    });
    let old_log_std = convert(&[-0.1, 0.05, 0.2]);
    let memories = [(0, of_actor_memory), (1, of_critic_memory)].map(|(which, numbers): (usize, &[T])| {
        with_memory[which].then(|| RecurrentWeights::new(shapes[which].clone(), numbers))
    });
    let point = Point {
        actor: Weights::behind_another(&actor, of_actor),
        critic: Weights::behind_another(&critic, of_critic),
        memories,
        constants: Constants::new(settings, ROWS, log_std, &old_log_std),
    };
    let mut worker = SequenceWorker::<T>::new(&actor, &critic, SIZES[0]);
    worker.begins = (0..ROWS).map(|row| row == 6 || row == 13).collect();
    worker.targets = Targets {
        action: convert(&normals(3, ROWS * WIDTHS.action, 1.0)),
        mean: convert(&normals(4, ROWS * WIDTHS.action, 0.1)),
        log_probability: convert(&normals(9, ROWS, 0.5)).iter().map(|&x| x - T::from_f64(4.5)).collect(),
        advantage: convert(&normals(5, ROWS, 1.0)),
        value: convert(&normals(7, ROWS, 0.2)),
        returns: convert(&normals(8, ROWS, 0.3)),
    };
    let mut gradient = vec![T::ZERO; parameters.len()];
    let mut sums = Sums::default();
    let mut take = |number: u32, width: usize, remembered: usize| {
        worker.input = aligned_vec::AVec::from_slice(0, &convert(&normals(number, ROWS * width, 1.0)));
        worker.start = convert(&normals(number + 20, SIZES[1] * remembered, 0.5));
    };
    let (policy, rest) = gradient.split_at_mut(sizes[0] + sizes[1]);
    let (value, of_log_std) = rest.split_at_mut(sizes[2] + sizes[3]);
    take(1, if with_memory[0] { WIDTHS.observation } else { 4 }, shapes[0].remembered());
    worker.policy(&point, SIZES, policy, of_log_std, &mut sums);
    let mut take = |number: u32, width: usize, remembered: usize| {
        worker.input = aligned_vec::AVec::from_slice(0, &convert(&normals(number, ROWS * width, 1.0)));
        worker.start = convert(&normals(number + 20, SIZES[1] * remembered, 0.5));
    };
    take(2, if with_memory[1] { WIDTHS.critic_observation } else { 4 }, shapes[1].remembered());
    worker.value(&point, SIZES, value, &mut sums);
    (gradient, sums)
}

fn parameters(settings: &Settings) -> Vec<f64> {
    let (actor, critic) = settings.shapes(WIDTHS).unwrap();
    let memories: usize =
        settings.memories(WIDTHS).unwrap().unwrap().iter().map(|shape| shape.parameters()).sum();
    let mut all = normals(0, actor.parameters() + critic.parameters() + memories, 0.5);
    all.extend([-0.2, 0.1, 0.3]);
    all
}

#[test]
fn gradient_through_time_is_that_of_central_differences() {
    for (cell, with_memory) in [
        (Cell::Gru, [true, true]),
        (Cell::Lstm, [true, true]),
        (Cell::Gru, [true, false]),
        (Cell::Lstm, [false, true]),
    ] {
        let settings = settings(cell);
        let mut parameters = parameters(&settings);
        let (analytic, sums) = gradient::<f64>(&settings, &parameters, with_memory);
        assert!(sums.clipped > 2.0 && sums.clipped < ROWS as f64, "{}", sums.clipped);
        let greatest = analytic.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        for index in 0..parameters.len() {
            let (at, h) = (parameters[index], 1e-6);
            let mut loss_at = |x: f64| {
                parameters[index] = x;
                let (_, sums) = gradient::<f64>(&settings, &parameters, with_memory);
                (sums.surrogate + settings.value_coefficient * sums.value) / ROWS as f64
            };
            let difference = (loss_at(at + h) - loss_at(at - h)) / (2.0 * h);
            parameters[index] = at;
            assert!(
                (difference - analytic[index]).abs() < 1e-7 * greatest,
                "{cell:?} {with_memory:?}, parameter {index}: {} by hand, {difference} by differences",
                analytic[index]
            );
        }
    }
}

#[test]
fn single_precision_gradient_through_time_is_that_of_double() {
    for cell in [Cell::Gru, Cell::Lstm] {
        let settings = settings(cell);
        let parameters = parameters(&settings);
        let (double, _) = gradient::<f64>(&settings, &parameters, [true; 2]);
        let (single, _) = gradient::<f32>(&settings, &parameters, [true; 2]);
        let greatest = double.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        for (single, double) in single.iter().zip(&double) {
            assert!((f64::from(*single) - double).abs() < 1e-5 * greatest, "{single} {double}");
        }
    }
}

#[test]
fn groups_hold_robots_of_as_many_steps_each_once() {
    let tiles = [Samples::new(24, 100, WIDTHS), Samples::new(24, 7, WIDTHS), Samples::new(5000, 3, WIDTHS)];
    let place = |tile: u32, row: u32| Place { tile, row };
    let places: Vec<Place> = (0..100)
        .map(|row| place(0, row))
        .chain((0..7).map(|row| place(1, row)))
        .chain((0..3).map(|row| place(2, row)))
        .collect();
    let cut: Vec<&[Place]> = groups(&tiles, &places).collect();
    // 1,024 rows are 42 robots of 24 steps; of 5,000 steps each passes alone.
    let sizes: Vec<usize> = cut.iter().map(|group| group.len()).collect();
    assert_eq!(sizes, [42, 42, 23, 1, 1, 1]);
    assert_eq!(cut.concat(), places);
    assert_eq!(groups(&tiles, &[]).count(), 0);
}
