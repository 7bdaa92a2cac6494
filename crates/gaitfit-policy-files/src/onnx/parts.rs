//! Nodes that cut a row into parts: an actor that gives mean and standard deviation in one row acts with the first half.

use super::attributes::Attributes;
use super::constant::Constant;
use super::graph::{Walk, is_last};
use super::moves::range;
use super::node_error::{NodeError, misfit, unread};
use super::proto::Node;
use std::collections::{HashMap, HashSet};
use std::ops::Range;

/// Parts of what the layers give now.
#[derive(Default)]
pub(super) struct Parts {
    /// Range of the row's numbers that each value has, by its name.
    ranges: HashMap<String, Range<usize>>,
    /// Values that the graph's outputs are computed from.
    needed: HashSet<String>,
    /// Values that are made of parts that no output needs.
    unneeded: HashSet<String>,
}

impl Parts {
    /// Finds the values that `outputs` are computed from. Nodes are in the order in which they run.
    pub fn need(&mut self, nodes: &[Node], outputs: &[String]) {
        self.needed = outputs.iter().cloned().collect();
        // Backwards, everything that reads a value is known before the node that gives it.
        for node in nodes.iter().rev() {
            if node.output.iter().any(|name| self.needed.contains(name)) {
                self.needed.extend(node.input.iter().cloned());
            }
        }
    }

    /// Whether the node works on a part that no output needs; its outputs then are such values too.
    pub fn is_unneeded(&mut self, node: &Node) -> bool {
        // A node that also serves an output must be read, whatever else it takes.
        let wanted = node.output.iter().any(|name| self.needed.contains(name));
        let cut = |name: &String| self.ranges.contains_key(name) || self.unneeded.contains(name);
        let unneeded = !wanted && node.input.iter().any(cut);
        if unneeded {
            self.unneeded.extend(node.output.iter().cloned());
        }
        unneeded
    }

    /// Forgets the parts: the layers give something else now.
    pub fn clear(&mut self) {
        self.unneeded
            .extend(self.ranges.drain().map(|(name, _)| name).filter(|name| !self.needed.contains(name)));
    }
}

impl Walk {
    /// Whether the node only cuts rows. Its outputs then are parts.
    ///
    /// # Errors
    /// A cut that is not known before the graph runs.
    pub(super) fn cuts(&mut self, node: &Node, attributes: &Attributes) -> Result<bool, NodeError> {
        if node.input.first() != Some(&self.head) || !matches!(node.op_type.as_str(), "Split" | "Slice") {
            return Ok(false);
        }
        let Some(width) = self.chain.width().filter(|_| !self.chain.is_empty()) else {
            return Err(unread(
                "it cuts the observation into parts; only actors that see all of it in one network are read",
            ));
        };
        let ranges = if node.op_type == "Split" {
            split(node, attributes, width, self.axes, |name| self.constants.get(name))?
        } else {
            vec![slice(node, width, self.axes, |name| self.constants.get(name))?]
        };
        if ranges.len() != node.output.len() || ranges.iter().any(Range::is_empty) {
            return Err(misfit(format!("it does not cut {width} numbers into {} parts", node.output.len())));
        }
        self.parts.ranges.extend(node.output.iter().cloned().zip(ranges));
        Ok(true)
    }

    /// Leaves only the part `name` of what the layers give, if it is one.
    ///
    /// # Errors
    /// A layer of which no part can be taken.
    pub(super) fn take_part(&mut self, name: &str) -> Result<(), NodeError> {
        let Some(range) = self.parts.ranges.remove(name) else { return Ok(()) };
        self.chain.select(range)?;
        self.head = name.to_owned();
        self.parts.clear();
        Ok(())
    }
}

/// Refuses a cut along another axis than that of a row's numbers, the last one.
fn of_numbers(axis: i64, axes: usize) -> Result<(), NodeError> {
    if is_last(axis, axes) { Ok(()) } else { Err(unread("it cuts between rows, not a row")) }
}

/// The parts of a `Split`.
fn split<'a>(
    node: &Node,
    attributes: &Attributes,
    width: usize,
    axes: usize,
    constant: impl Fn(&str) -> Option<&'a Constant>,
) -> Result<Vec<Range<usize>>, NodeError> {
    of_numbers(attributes.integer("axis", 0), axes)?;
    let given = node.input.get(1).filter(|name| !name.is_empty());
    let sizes: Vec<usize> = match (given, attributes.list("split")) {
        (Some(name), _) => {
            let sizes = constant(name).ok_or(NodeError::NotConstant("its sizes are not constants"))?;
            sizes.values.iter().map(|&size| size as usize).collect()
        }
        // A negative size becomes an empty part, which the caller refuses.
        (None, Some(sizes)) => sizes.iter().map(|&size| usize::try_from(size).unwrap_or(0)).collect(),
        // Even parts, the last the rest.
        (None, None) => {
            let count = node.output.len().max(1);
            let size = width.div_ceil(count);
            (0..count).map(|number| size.min(width.saturating_sub(number * size))).collect()
        }
    };
    let mut end = 0_usize;
    let mut ranges = Vec::new();
    for size in sizes {
        let start = end;
        // Sizes come from a file: a sum that saturates is not the width, and is refused below.
        end = end.saturating_add(size);
        ranges.push(start..end);
    }
    if end != width {
        return Err(misfit(format!("its parts have {end} numbers, the layer before it gives {width}")));
    }
    Ok(ranges)
}

/// The part of a `Slice`.
fn slice<'a>(
    node: &Node,
    width: usize,
    axes: usize,
    constant: impl Fn(&str) -> Option<&'a Constant>,
) -> Result<Range<usize>, NodeError> {
    let number = |place: usize| {
        let name = node.input.get(place).filter(|name| !name.is_empty())?;
        Some(
            constant(name)
                .and_then(Constant::as_scalar)
                .ok_or(NodeError::NotConstant("its limits are not single constants")),
        )
    };
    let (Some(start), Some(end)) = (number(1), number(2)) else {
        return Err(unread("its limits are not inputs of it; export with operator set 10 or later"));
    };
    // ONNX slices the first axis where no axis is given, and that is the axis of robots.
    of_numbers(number(3).transpose()?.map_or(0, |axis| axis as i64), axes)?;
    if number(4).transpose()?.is_some_and(|step| step != 1.0) {
        return Err(unread("it takes steps; only whole parts are read"));
    }
    Ok(range(start?, end?, width))
}
