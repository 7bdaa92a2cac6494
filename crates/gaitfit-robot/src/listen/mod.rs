//! Listening to a robot's ROS 2 topics without ROS: messages as they come, over DDS.

mod names;

#[cfg(feature = "dds")]
mod dds;

#[cfg(feature = "dds")]
pub use dds::Listener;
pub use names::{MAX_TOPICS, Topic, topics};

/// Largest message that is taken, bytes: joints and an inertial unit have some kilobytes.
pub const MAX_MESSAGE: usize = 1 << 20;

/// A message that came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Heard {
    /// The number of its topic.
    pub topic: usize,
    /// Time of arrival, ns since 1970, on a clock that does not jump.
    pub ns: u64,
    /// Its CDR with the four bytes of its head.
    pub bytes: Vec<u8>,
}
