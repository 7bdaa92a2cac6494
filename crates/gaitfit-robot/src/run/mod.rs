//! A run: two loops, what they tell each other, the logs and the measurements.
//!
//! [`Sender`] takes states and sends commands, 500 times a second; [`Controller`] runs the policy at its own rate. Both do
//! one turn for a time that is given, so that a test runs them without a clock; [`live`] runs them on the clock.

mod board;
mod commands;
mod controller;
mod delay;
mod jitter;
mod live;
mod record;
mod script;
mod sender;
mod suits;
mod trials;
mod view;

pub use board::Board;
pub use commands::{ByRemote, Commands, Key, Order, Ranges, Steering};
pub use controller::Controller;
pub use delay::{Delay, Trace};
pub use jitter::{Jitter, Lateness};
pub use live::{Live, Summary, live, real_time};
pub use record::{Acted, RUN, Recorder, WALK, WHOLE};
pub use script::{MAX_WALK_SECONDS, Script};
pub use sender::Sender;
pub use suits::suits;
pub use trials::{COMMAND, DIRECTIONS, Next, SPEEDS, Trial, Trials, trials};
