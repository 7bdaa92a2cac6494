//! Small functions of a control step as CUDA text, recorded from the Rust that the CPU runs.
//!
//! Such a function is generic over [`gaitfit_physics::Real`], like the physics. The CPU runs it on `f32`; here it runs once
//! on [`Traced`] numbers, and the recording becomes straight-line text with the same operations in the same order.

use std::fmt::Write;

use gaitfit_physics::trace::{Graph, Id, Node, Traced, record};

use crate::words::single;

/// A parameter of a function: its name, and how many numbers it has; one number is passed by value.
pub(crate) type Parameter = (&'static str, usize);

/// The text of `DEVICE void name(parameters…, float* out)`, which writes the numbers that `body` gives. `body` gets those
/// of all parameters, one after the other. A body with loops, guards or functions that the text does not know becomes a
/// text that does not compile.
pub(crate) fn function<const N: usize>(
    name: &str,
    parameters: &[Parameter],
    body: impl FnOnce([Traced; N]) -> Vec<Traced>,
) -> String {
    let declared: Vec<String> = parameters
        .iter()
        .map(
            |(name, count)| {
                if *count == 1 { format!("float {name}") } else { format!("const float* {name}") }
            },
        )
        .collect();
    let inputs: Vec<String> = parameters.iter().flat_map(|&parameter| numbers(parameter)).collect();
    let head = format!("DEVICE void {name}({}, float* out) {{\n", declared.join(", "));
    let graph = match record(|| body(std::array::from_fn(|_| Traced::input()))) {
        Ok(graph) if graph.regions.is_empty() && graph.inputs == inputs.len() => graph,
        Ok(_) => return format!("#error {name} has regions, or other inputs than its parameters\n"),
        Err(error) => return format!("#error {name}: {error}\n"),
    };
    match lines(&graph, &inputs) {
        Some(lines) => format!("{head}{lines}}}\n"),
        None => format!("#error {name} has an operation that is not written\n"),
    }
}

fn numbers((name, count): Parameter) -> Vec<String> {
    match count {
        1 => vec![name.to_owned()],
        _ => (0..count).map(|k| format!("{name}[{k}]")).collect(),
    }
}

/// A line for each operation, then one for each output.
fn lines(graph: &Graph, inputs: &[String]) -> Option<String> {
    let mut text = String::new();
    for (number, node) in graph.nodes.iter().enumerate() {
        let n = |id: Id| format!("n{}", id.0);
        let value = match *node {
            Node::Input(input) => inputs.get(input as usize)?.clone(),
            Node::Constant(bits) => single(f64::from_bits(bits) as f32),
            Node::Add(a, b) => format!("{} + {}", n(a), n(b)),
            Node::Sub(a, b) => format!("{} - {}", n(a), n(b)),
            Node::Mul(a, b) => format!("{} * {}", n(a), n(b)),
            Node::Neg(a) => format!("-{}", n(a)),
            // As `f32` has it: rounded twice.
            Node::Fma(a, b, c) => format!("{} * {} + {}", n(a), n(b), n(c)),
            Node::Fnma(a, b, c) => format!("{} - {} * {}", n(c), n(a), n(b)),
            Node::Div(a, b) => format!("{} / {}", n(a), n(b)),
            Node::Sqrt(a) => format!("sqrtf({})", n(a)),
            Node::Min(a, b) => format!("{0} < {1} ? {0} : {1}", n(a), n(b)),
            Node::Max(a, b) => format!("{0} > {1} ? {0} : {1}", n(a), n(b)),
            Node::Abs(a) => format!("fabsf({})", n(a)),
            Node::Select(a, b, x, y) => format!("{} < {} ? {} : {}", n(a), n(b), n(x), n(y)),
            Node::Recip(_) | Node::Tanh(_) | Node::Sin(_) | Node::Cos(_) => return None,
            Node::Round(_) | Node::Gather(..) | Node::Call(..) => return None,
            Node::Unless(..) | Node::Merge(..) | Node::Variable(..) | Node::Result(..) => return None,
        };
        // Writing to a string does not fail.
        let _ = writeln!(text, "    const float n{number} = {value};");
    }
    for (place, id) in graph.outputs.iter().enumerate() {
        let _ = writeln!(text, "    out[{place}] = n{};", id.0);
    }
    Some(text)
}
