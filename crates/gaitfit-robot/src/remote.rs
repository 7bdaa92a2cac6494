//! The robot's own remote, as its state has it: 40 bytes, of which the vendor's SDK (unitree_sdk2_python, `utils/joystick.py`)
//! reads buttons and sticks.

/// How far a stick may be from its middle and count as there; sticks do not come back quite to it.
const DEAD_ZONE: f32 = 0.1;

/// Buttons and sticks of the remote.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Remote {
    /// Left stick, −1 to 1, positive to the right and ahead.
    pub left: [f32; 2],
    /// Right stick, the same.
    pub right: [f32; 2],
    /// Button A.
    pub a: bool,
    /// Button B.
    pub b: bool,
}

impl Remote {
    /// Reads the state's bytes. A stick whose number is not finite counts as being in its middle.
    pub fn read(bytes: &[u8; 40]) -> Self {
        let axis = |at: usize| {
            let value = f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
            if value.is_finite() { value.clamp(-1.0, 1.0) } else { 0.0 }
        };
        // Byte 3, from the lowest bit: A, B, X, Y, up, right, down, left.
        let pressed = |bit: u8| bytes[3] & (1 << bit) != 0;
        // Left x and y, right x and y: the vendor's places are not in this order.
        Self { left: [axis(4), axis(20)], right: [axis(8), axis(12)], a: pressed(0), b: pressed(1) }
    }

    /// The command of the sticks within `ranges` (forward, left, m/s, yaw rate, rad/s): the left one walks, the right one
    /// turns.
    pub fn command(&self, ranges: &[[f32; 2]; 3]) -> [f32; 3] {
        let [aside, ahead] = self.left;
        // Sticks count to the right; the robot's y axis and a positive turn are to the left.
        let sticks = [ahead, -aside, -self.right[0]].map(beyond_dead_zone);
        std::array::from_fn(|part| scaled(sticks[part], ranges[part]))
    }
}

/// A stick's way beyond its dead zone, −1 to 1.
fn beyond_dead_zone(stick: f32) -> f32 {
    // The rest is stretched, so that the command begins at 0 and reaches 1 at the end of the way.
    ((stick.abs() - DEAD_ZONE) / (1.0 - DEAD_ZONE)).max(0.0).copysign(stick)
}

/// A part of the way (−1 to 1) to the end of a range that lies on that side of 0.
pub(crate) fn scaled(part: f32, [low, high]: [f32; 2]) -> f32 {
    if part < 0.0 { -part * low.min(0.0) } else { part * high.max(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGES: [[f32; 2]; 3] = [[-0.5, 1.0], [-0.4, 0.4], [-1.0, 1.0]];

    /// Bytes as the vendor's `Joystick.combine` puts them together.
    fn bytes(lx: f32, ly: f32, rx: f32, ry: f32, buttons: u8) -> [u8; 40] {
        let mut bytes = [0; 40];
        bytes[3] = buttons;
        for (at, axis) in [(4, lx), (8, rx), (12, ry), (20, ly)] {
            bytes[at..at + 4].copy_from_slice(&axis.to_le_bytes());
        }
        bytes
    }

    #[test]
    fn sticks_are_scaled_to_the_ranges_and_their_middle_is_wide() {
        let command = |lx, ly, rx| Remote::read(&bytes(lx, ly, rx, 0.7, 0)).command(&RANGES);
        assert_eq!(command(0.0, 1.0, 0.0), [1.0, 0.0, 0.0]);
        assert_eq!(command(0.0, -1.0, 0.0), [-0.5, 0.0, 0.0]);
        // To the right is negative: the robot's y axis points to the left, and so does a positive turn.
        assert_eq!(command(1.0, 0.0, 1.0), [0.0, -0.4, -1.0]);
        assert_eq!(command(0.09, -0.09, 0.1), [0.0; 3]);
        let half = command(0.0, 0.55, 0.0)[0];
        assert!((half - 0.5).abs() < 1e-6, "{half}");
        assert_eq!(command(f32::NAN, f32::INFINITY, -9.0), [0.0, 0.0, 1.0]);
    }

    #[test]
    fn buttons_are_where_the_sdk_has_them() {
        let read = |buttons| Remote::read(&bytes(0.0, 0.0, 0.0, 0.0, buttons));
        assert!(read(1).a && !read(1).b && read(2).b && !read(2).a);
        // X, Y and the arrows do nothing.
        assert_eq!(read(0xFC), Remote::default());
    }
}
