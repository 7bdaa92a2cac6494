//! Recurrent layers over the steps of a rollout, and their derivatives: against the memory of a policy at work, central
//! differences, and PyTorch's (`tools/make_gradient_fixtures.py`).
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common::root;
use gaitfit_policy::network::{Cell, Recurrent, RecurrentShape, RecurrentWeights, SequenceTape, Sequences};

const STEPS: usize = 6;
const ROBOTS: usize = 3;
const CELLS: [Cell; 2] = [Cell::Lstm, Cell::Gru];
/// Step and robot of episodes that begin.
const BEGINS: [[usize; 2]; 3] = [[2, 1], [4, 2], [5, 2]];

/// The numbers of the fixture.
fn numbers(count: usize, c: f64) -> Vec<f64> {
    (0..count).map(|k| 0.6 * (1.3 * k as f64 + c).sin()).collect()
}

fn shape(cell: Cell) -> RecurrentShape {
    RecurrentShape { cell, inputs: 3, hidden: vec![4, 5] }
}

fn begins() -> Vec<bool> {
    (0..STEPS * ROBOTS).map(|row| BEGINS.contains(&[row / ROBOTS, row % ROBOTS])).collect()
}

/// The fixture's problem at some parameters.
struct Problem {
    shape: RecurrentShape,
    input: Vec<f64>,
    start: Vec<f64>,
    weight: Vec<f64>,
    begins: Vec<bool>,
}

impl Problem {
    fn new(cell: Cell) -> Self {
        let shape = shape(cell);
        Self {
            input: numbers(STEPS * ROBOTS * 3, 0.5),
            start: numbers(ROBOTS * shape.remembered(), 0.7),
            weight: numbers(STEPS * ROBOTS * 5, 0.9),
            begins: begins(),
            shape,
        }
    }

    fn sequences(&self) -> Sequences<'_, f64> {
        let Self { input, start, begins, .. } = self;
        Sequences { steps: STEPS, robots: ROBOTS, input, begins, start }
    }

    /// Σ w y + y²/2, the last step's outputs, and the gradient.
    fn solve(&self, parameters: &[f64]) -> (f64, Vec<f64>, Vec<f64>) {
        let weights = RecurrentWeights::new(self.shape.clone(), parameters);
        let mut tape = SequenceTape::default();
        tape.forward(&weights, &self.sequences());
        let (output, derivative) = tape.output();
        let mut loss = 0.0;
        for ((y, d), w) in output.iter().zip(derivative).zip(&self.weight) {
            loss += w * y + 0.5 * y * y;
            *d = w + y;
        }
        let last = output[output.len() - ROBOTS * 5..].to_vec();
        // What is there is added to.
        let mut gradient = vec![1.0; parameters.len()];
        tape.backward(&weights, &self.sequences(), &mut gradient);
        gradient.iter_mut().for_each(|g| *g -= 1.0);
        (loss, last, gradient)
    }
}

#[test]
fn derivatives_are_those_of_pytorchs_autograd() {
    let path = root().join("crates/gaitfit-policy/tests/fixtures/recurrent_gradients.json");
    let fixture: serde_json::Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    for cell in CELLS {
        let problem = Problem::new(cell);
        let (loss, last, gradient) = problem.solve(&numbers(problem.shape.parameters(), 0.2));
        let wanted = &fixture[cell.name()];
        let list = |name: &str| -> Vec<f64> {
            wanted[name].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
        };
        assert!((loss - wanted["loss"].as_f64().unwrap()).abs() < 1e-11);
        for (what, values, wanted) in
            [("output", &last, list("last_output")), ("gradient", &gradient, list("gradient"))]
        {
            assert_eq!(values.len(), wanted.len());
            let greatest = wanted.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            for (index, (value, wanted)) in values.iter().zip(&wanted).enumerate() {
                assert!(
                    (value - wanted).abs() < 1e-9 * greatest,
                    "{cell:?} {what} {index}: {value}, PyTorch has {wanted}"
                );
            }
        }
    }
}

#[test]
fn derivatives_are_central_differences() {
    for cell in CELLS {
        let problem = Problem::new(cell);
        let mut parameters = numbers(problem.shape.parameters(), 0.2);
        let (_, _, gradient) = problem.solve(&parameters);
        let greatest = gradient.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        assert!(greatest > 0.1);
        for index in 0..parameters.len() {
            let (at, h) = (parameters[index], 1e-6);
            let mut loss_at = |x: f64| {
                parameters[index] = x;
                problem.solve(&parameters).0
            };
            let difference = (loss_at(at + h) - loss_at(at - h)) / (2.0 * h);
            parameters[index] = at;
            let derivative = gradient[index];
            assert!(
                (difference - derivative).abs() < 1e-7 * greatest,
                "{cell:?} {index}: {derivative}, {difference}"
            );
        }
    }
}

#[test]
fn a_rollout_at_once_is_the_policys_memory_step_by_step() {
    for cell in CELLS {
        let recurrent = Recurrent::random(&shape(cell), 3, 0);
        let single = |values: Vec<f64>| -> Vec<f32> { values.into_iter().map(|x| x as f32).collect() };
        let input = single(numbers(2 * STEPS * ROBOTS * 3, 0.5));
        let (before, input) = input.split_at(STEPS * ROBOTS * 3);
        // A rollout before this one leaves something to remember.
        let (mut memory, mut output) = (recurrent.memory(ROBOTS), Vec::new());
        before.chunks_exact(ROBOTS * 3).for_each(|row| recurrent.step(ROBOTS, row, &mut memory, &mut output));
        let mut start = Vec::new();
        (0..ROBOTS).for_each(|robot| memory.append_row(robot, &mut start));
        assert_eq!(
            (start.len(), memory.width()),
            (ROBOTS * shape(cell).remembered(), shape(cell).remembered())
        );
        let begins = begins();
        let mut tape = SequenceTape::default();
        let sequences = Sequences { steps: STEPS, robots: ROBOTS, input, begins: &begins, start: &start };
        tape.forward(&RecurrentWeights::from(&recurrent), &sequences);
        let mut blank = recurrent.memory(ROBOTS);
        assert!(blank.set_numbers(&memory.numbers()) && blank == memory && !blank.set_numbers(&start[1..]));
        for (step, row) in input.chunks_exact(ROBOTS * 3).enumerate() {
            for robot in (0..ROBOTS).filter(|robot| begins[step * ROBOTS + robot]) {
                memory.begin(robot);
            }
            recurrent.step(ROBOTS, row, &mut memory, &mut output);
            let at_once = &tape.output().0[step * ROBOTS * 5..(step + 1) * ROBOTS * 5];
            for (a, b) in output.iter().zip(at_once) {
                assert!((a - b).abs() < 1e-6, "{cell:?}, step {step}: {a} {b}");
            }
        }
    }
}
