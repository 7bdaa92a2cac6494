//! What the kernels of memories need of a multiprocessor, and how they lay out weights.

use crate::ppo::layout::TooWide;
use gaitfit_policy::network::RecurrentShape;

/// Robots of a block; `TEAM` of the text.
pub(super) const TEAM: usize = 8;
/// Bytes of shared memory that the kernels need for memories of these shapes.
fn shared(shape: &RecurrentShape) -> usize {
    let numbers = |layer: &gaitfit_policy::network::RecurrentSpan| {
        let wide = shape.cell.gates() * layer.hidden;
        (layer.inputs + layer.hidden).max(2 * layer.hidden + wide)
    };
    4 * TEAM * shape.layers().iter().map(numbers).max().unwrap_or(0)
}

/// Refuses memories that do not fit into a multiprocessor.
pub(in crate::ppo) fn check_shared(shapes: &[RecurrentShape; 2], available: usize) -> Result<(), TooWide> {
    for shape in shapes {
        let needed = shared(shape);
        if needed > available {
            let units: Vec<String> = shape.hidden.iter().map(ToString::to_string).collect();
            let network = format!("{} of {} units", shape.cell.name(), units.join(", "));
            return Err(TooWide { network, needed, rows: TEAM, available });
        }
    }
    Ok(())
}

/// Where each parameter lies in the copy with every matrix transposed.
pub(in crate::ppo) fn turns(shapes: &[RecurrentShape; 2]) -> Vec<u32> {
    let mut places = Vec::new();
    for shape in shapes {
        let offset = places.len();
        for layer in shape.layers() {
            let wide = shape.cell.gates() * layer.hidden;
            for (range, inputs) in layer.parts.into_iter().zip([layer.inputs, layer.hidden, 1, 1]) {
                let begin = offset + range.start;
                // Element (row, column) of a matrix with `wide` columns goes to (column, row). Biases have one row
                // and stay.
                places.extend((0..range.len()).map(|k| (begin + k % wide * inputs + k / wide) as u32));
            }
        }
    }
    places
}
