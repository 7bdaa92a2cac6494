//! ROS 2 messages: definitions, CDR, and what of a message is a log's.

mod builtin;
mod cdr;
pub(crate) mod channel;
mod error;
mod message;
mod schema;
mod value;

pub(crate) use channel::{Channel, Messages};
pub use error::MessageError;
