//! The commands to show a policy with, and the picture of its gait.

#[cfg(feature = "report")]
mod picture;

#[cfg(feature = "report")]
pub use picture::picture;

use gaitfit_learn::task::CommandSettings;

/// Ten seconds (each part's length, s, and its command) that show what a policy can: standing, ahead, left, turning,
/// back, standing; as fast as it is asked for in training.
pub fn tour(command: &CommandSettings) -> [(f64, [f64; 3]); 6] {
    [
        (1.0, [0.0; 3]),
        (2.0, [command.x[1], 0.0, 0.0]),
        (2.0, [0.0, command.y[1], 0.0]),
        (2.0, [0.0, 0.0, command.yaw[1]]),
        (2.0, [command.x[0], 0.0, 0.0]),
        (1.0, [0.0; 3]),
    ]
}
