//! ROS 2 messages: definitions, CDR, and what of a message is a log's.

mod builtin;
mod cdr;
pub(crate) mod channel;
mod error;
mod limits;
mod message;
mod schema;
mod value;

pub(crate) use builtin::whole_definition;
pub use builtin::{is_known, known_types};
pub(crate) use channel::{Channel, Messages};
pub use error::MessageError;
