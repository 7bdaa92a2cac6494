//! Limits of commands, and the reasons for sending damping instead.

mod limits;
mod reason;
mod watch;

pub use limits::Limits;
pub use reason::Reason;
pub use watch::{GuardSettings, Watch};
