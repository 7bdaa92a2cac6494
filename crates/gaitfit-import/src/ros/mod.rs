//! ROS 2 messages: definitions, CDR, and what of a message is a log's.

mod builtin;
mod cdr;
pub(crate) mod channel;
mod message;
mod schema;
mod value;

pub(crate) use channel::{Channel, Messages};
