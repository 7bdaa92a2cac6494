//! Links to a robot: states come from it, commands go to it.

#[cfg(feature = "dds")]
mod dds;
#[cfg(feature = "dds")]
mod motion;
#[cfg(feature = "dds")]
mod ros2;
mod simulated;
#[cfg(feature = "dds")]
mod unitree;

use std::time::Duration;

use crate::command::Command;
use crate::state::Reading;

#[cfg(feature = "dds")]
pub use dds::Dds;
#[cfg(feature = "dds")]
pub(crate) use dds::failed;
#[cfg(feature = "dds")]
pub use motion::{MotionMode, MotionSwitcher};
pub use simulated::{Simulated, hanging_go2, simulation};

/// Time between two commands: a Go2 sends its states as often.
pub(crate) const TICK: Duration = Duration::from_millis(2);
/// How long to wait for a robot's first state.
pub(crate) const FIRST_STATE: Duration = Duration::from_secs(15);

/// A robot, real or simulated, at the other end.
pub trait Link {
    /// Hands over what has arrived since the last call, oldest first, each with how long ago it came. `now` is the time
    /// since the run began. Returns how many commands of other programs were seen.
    ///
    /// # Errors
    /// In words: the link broke.
    fn receive(&mut self, now: Duration, each: &mut dyn FnMut(Duration, &Reading)) -> Result<u64, String>;

    /// Sends a command.
    ///
    /// # Errors
    /// In words: the link broke.
    fn send(&mut self, command: &Command) -> Result<(), String>;

    /// Why no states are handed over though something is heard, in words: a part of them does not come, or is older than a
    /// state may be.
    fn lacks(&self) -> Option<String> {
        None
    }
}
