//! Recurrent layers: values by hand.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_policy::network::{Cell, Recurrent, RecurrentLayer};

/// One unit, one input, weights of 1 and biases of 0.
fn unit(cell: Cell) -> Recurrent {
    let gates = cell.gates();
    let layer = RecurrentLayer {
        inputs: 1,
        hidden: 1,
        weight_ih: vec![1.0; gates],
        weight_hh: vec![1.0; gates],
        bias_ih: vec![0.0; gates],
        bias_hh: vec![0.0; gates],
    };
    Recurrent { cell, layers: vec![layer] }
}

#[test]
fn one_unit_by_hand() {
    let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
    let run = |cell: Cell| {
        let unit = unit(cell);
        let (mut memory, mut output) = (unit.memory(1), Vec::new());
        [0.5f32, -1.0].map(|x| {
            unit.step(1, &[x], &mut memory, &mut output);
            f64::from(output[0])
        })
    };
    // All gates have the same sum s = x + h.
    let (mut c, mut h) = (0.0, 0.0f64);
    for (x, output) in [0.5, -1.0].into_iter().zip(run(Cell::Lstm)) {
        let s = x + h;
        c = sigmoid(s) * c + sigmoid(s) * s.tanh();
        h = sigmoid(s) * f64::tanh(c);
        assert!((h - output).abs() < 1e-6, "{h} {output}");
    }
    let mut h = 0.0f64;
    for (x, output) in [0.5, -1.0].into_iter().zip(run(Cell::Gru)) {
        let gate = sigmoid(x + h);
        h = (1.0 - gate) * (x + gate * h).tanh() + gate * h;
        assert!((h - output).abs() < 1e-6, "{h} {output}");
    }
}

#[test]
fn sizes_that_no_array_has_are_a_mistake() {
    assert_eq!(unit(Cell::Gru).mistake(), None);
    for hidden in [0, 2, usize::MAX] {
        let mut wrong = unit(Cell::Gru);
        wrong.layers[0].hidden = hidden;
        assert!(wrong.mistake().is_some(), "{hidden}");
    }
}
