//! Observations: rows of numbers as an interface lays them out.
//!
//! There is one writer, [`Layout::write`]. Training, evaluation, collection, [`crate::follow`] and the reading of logs
//! all fill a [`Sensed`] and call it.

mod last_action;
mod layout;
mod past;

pub use crate::quantity::Sensed;
pub use last_action::LastAction;
pub use layout::{Layout, Slot};
pub use past::Past;
