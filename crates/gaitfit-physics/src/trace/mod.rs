//! A scalar that records instead of computing, for code generators: what [`control_period`](crate::control_period)
//! computes, as a graph of operations.
//!
//! [`Traced`] is a [`Real`](crate::Real) whose every operation becomes a [`Node`] of a [`Graph`]. Equal operations of
//! equal operands become one node, and operands keep their order, so that equal limbs give equal graphs. Two kinds of
//! [`Region`] keep the structure that a flat list would lose:
//! - guarded regions: nodes that need not be computed where no lane needs them (see [`Real`](crate::Real));
//! - loops: nodes that are computed several times, with variables that one turn hands to the next.
//!
//! Heights of a field are a table of the graph; nodes read its entries by number. A function that is needed at many
//! places, such as a field's nearest point, is a graph of its own that nodes call.
//!
//! [`record_period`] records a control period and names its inputs: state, parameters, targets, memory, and the weights
//! of networks. [`record`] records anything else. [`Graph::evaluate`] computes a graph in `f64`, to test it.

mod evaluate;
mod graph;
mod period;
mod record;
mod scalar;

pub use graph::{Carried, Graph, Id, Node, Region, RegionKind, TraceError};
pub use period::{Input, Output, PeriodGraph, Report, record_period, record_period_with};
pub use record::{Loop, record};
pub use scalar::{Guard, Known, Traced};
