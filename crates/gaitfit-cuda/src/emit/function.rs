//! Functions that a program calls at many places, as text.

use std::fmt::Write as _;

use gaitfit_physics::trace::Graph;

use super::op::{Node, Op};
use super::simplify::Nodes;
use super::text::{computed, table_name};

/// Name of a function in the text.
pub(super) fn function_name(number: usize) -> String {
    format!("function_{number}")
}

/// Name of the array that holds a table of a function.
fn function_table_name(function: usize, table: usize) -> String {
    format!("{}_{}", function_name(function), table_name(table))
}

/// The tables of a recording and of its functions, by the names of their arrays in the text.
pub fn tables(graph: &Graph) -> Vec<(String, &[f64])> {
    let of_program = graph.tables.iter().enumerate().map(|(number, table)| (table_name(number), &table[..]));
    let of_functions = graph.functions.iter().enumerate().flat_map(|(function, graph)| {
        let named = move |number| function_table_name(function, number);
        graph.tables.iter().enumerate().map(move |(number, table)| (named(number), &table[..]))
    });
    of_program.chain(of_functions).collect()
}

/// The text of function number `number`; its recording has three inputs, four outputs and no regions.
pub(super) fn text(number: usize, graph: &Graph) -> String {
    // Simplified on the way; `made` leads from the recording's nodes to the simplified ones.
    let mut nodes = Nodes::default();
    let mut made: Vec<u32> = Vec::with_capacity(graph.nodes.len());
    for &node in &graph.nodes {
        let Node { op, mut args } = node.into();
        args.iter_mut().take(op.arity()).for_each(|operand| *operand = made[*operand as usize]);
        made.push(nodes.make(op, args));
    }
    let mut text = String::new();
    for (table, values) in graph.tables.iter().enumerate() {
        let name = function_table_name(number, table);
        // Writing to a string does not fail.
        let _ = writeln!(text, "__device__ float {name}[{}];", values.len().max(1));
    }
    let _ = writeln!(text, "FUNCTION({}) {{", function_name(number));
    // Constants and inputs are written where they are used; other nodes have a variable.
    let operand = |node: u32| match nodes.nodes[node as usize].op {
        Op::Constant(bits) => format!("K({})", super::op::literal(f64::from_bits(bits))),
        Op::Input(input) => format!("i{input}"),
        _ => format!("f{node}"),
    };
    for (index, node) in nodes.nodes.iter().enumerate() {
        let operands: Vec<String> = node.operands().iter().map(|&node| operand(node)).collect();
        let table = |table: usize| function_table_name(number, table);
        let value = match node.op {
            Op::Neg => Some(format!("-{}", operands[0])),
            op => computed(op, &operands, table),
        };
        if let Some(value) = value {
            let _ = writeln!(text, "  const R f{index} = {value};");
        }
    }
    let outputs: Vec<String> = graph.outputs.iter().map(|id| operand(made[id.0 as usize])).collect();
    let _ = writeln!(text, "  return {{{}}};\n}}", outputs.join(", "));
    text
}
