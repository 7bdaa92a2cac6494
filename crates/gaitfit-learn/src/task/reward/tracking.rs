//! Following the command with a level base.

use crate::task::Moment;

/// exp(−|v − c|²/w²) of the horizontal velocity, heading frame.
pub fn linear_velocity(m: &Moment<'_>) -> f32 {
    let error = [m.velocity[0] - m.command[0], m.velocity[1] - m.command[1]];
    let width = m.task.settings.tracking_width as f32;
    (-(error[0] * error[0] + error[1] * error[1]) / (width * width)).exp()
}

/// exp(−(ω − c)²/w²) of the yaw rate.
pub fn yaw_rate(m: &Moment<'_>) -> f32 {
    let error = m.yaw_rate - m.command[2];
    let width = m.task.settings.yaw_tracking_width as f32;
    (-error * error / (width * width)).exp()
}

/// Square of the vertical velocity, m²/s².
pub fn vertical_velocity(m: &Moment<'_>) -> f32 {
    m.velocity[2] * m.velocity[2]
}

/// Squared angular velocity about the horizontal axes, rad²/s².
pub fn roll_pitch_rate(m: &Moment<'_>) -> f32 {
    let w = m.angular_velocity;
    w.iter().map(|x| x * x).sum::<f32>() - m.yaw_rate * m.yaw_rate
}

/// Squared sine of the angle between actual and wanted posture.
pub fn posture(m: &Moment<'_>) -> f32 {
    (1.0 - m.uprightness * m.uprightness).max(0.0)
}

/// exp(−(h − h*)²/(0.1 m)²) of the base's height.
pub fn height(m: &Moment<'_>) -> f32 {
    let error = (m.height - m.task.settings.height as f32) / 0.1;
    (-error * error).exp()
}

/// 1 in the step of a fall.
pub fn fall(m: &Moment<'_>) -> f32 {
    // A step pays by its duration, a fall is one event.
    if m.fallen { 1.0 / m.task.walker.interface.control_dt as f32 } else { 0.0 }
}
