//! Who says where a robot goes while it walks.

use std::sync::{Arc, Mutex, PoisonError};

use super::script::Script;
use crate::remote::scaled;
use crate::state::RobotState;

/// The command at one moment, and the walk that it belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Order {
    /// Forward, left, m/s, and yaw rate, rad/s.
    pub command: [f32; 3],
    /// The walk that is recorded, and when it began, s; `None` between two.
    pub walk: Option<(usize, f64)>,
}

/// Who says where a robot goes.
pub trait Commands {
    /// What is wanted `time` after the robot began to walk, s, while it is in `state`; `None` once it is to come to rest and
    /// lie down. It is asked once a control period, and not again after `None`.
    fn at(&mut self, time: f64, state: &RobotState) -> Option<Order>;
}

impl Commands for &Script {
    fn at(&mut self, time: f64, _: &RobotState) -> Option<Order> {
        Some(Order { command: Script::at(self, time)?, walk: self.walk_at(time) })
    }
}

/// Ranges of commands: forward, left, m/s, and yaw rate, rad/s.
pub type Ranges = [[f32; 2]; 3];

/// All that is commanded by hand is one walk.
const ONE_WALK: Option<(usize, f64)> = Some((0, 0.0));

/// The robot's own remote, within ranges: the left stick walks, the right one turns, A lies it down. (B damps, whoever
/// commands: the guard sees to it.)
#[derive(Clone, Copy, Debug)]
pub struct ByRemote(pub Ranges);

impl Commands for ByRemote {
    fn at(&mut self, _: f64, state: &RobotState) -> Option<Order> {
        let remote = &state.remote;
        (!remote.a).then(|| Order { command: remote.command(&self.0), walk: ONE_WALK })
    }
}

/// A key that was pressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// A step faster ahead, or slower back.
    Ahead,
    /// A step faster back, or slower ahead.
    Back,
    /// A step to the left.
    Left,
    /// A step to the right.
    Right,
    /// A step of turning to the left.
    TurnLeft,
    /// A step of turning to the right.
    TurnRight,
    /// All to 0.
    Halt,
    /// The walk is over.
    LieDown,
}

/// Steps from standing to the end of a range.
const STEPS: i8 = 10;

/// The command that the keys have added up to.
#[derive(Clone, Debug)]
pub struct Steering {
    ranges: Ranges,
    steps: Arc<Mutex<([i8; 3], bool)>>,
}

impl Steering {
    /// Standing, within ranges.
    pub fn new(ranges: Ranges) -> Self {
        Self { ranges, steps: Arc::default() }
    }

    /// A key was pressed. The command from now on.
    pub fn press(&self, key: Key) -> [f32; 3] {
        let mut steps = self.steps.lock().unwrap_or_else(PoisonError::into_inner);
        let (part, by) = match key {
            Key::Ahead => (0, 1),
            Key::Back => (0, -1),
            Key::Left => (1, 1),
            Key::Right => (1, -1),
            Key::TurnLeft => (2, 1),
            Key::TurnRight => (2, -1),
            Key::Halt | Key::LieDown => {
                steps.0 = [0; 3];
                // Nothing takes lying down back.
                steps.1 |= key == Key::LieDown;
                return [0.0; 3];
            }
        };
        // Whole steps are kept and not sums of speeds, so that as many presses back lead to exactly 0.
        steps.0[part] = (steps.0[part] + by).clamp(-STEPS, STEPS);
        self.command(steps.0)
    }

    fn command(&self, steps: [i8; 3]) -> [f32; 3] {
        std::array::from_fn(|part| scaled(f32::from(steps[part]) / f32::from(STEPS), self.ranges[part]))
    }
}

impl Commands for Steering {
    fn at(&mut self, _: f64, _: &RobotState) -> Option<Order> {
        let (steps, over) = *self.steps.lock().unwrap_or_else(PoisonError::into_inner);
        (!over).then(|| Order { command: self.command(steps), walk: ONE_WALK })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::remote::Remote;
    use crate::state::tests::standing;

    const RANGES: Ranges = [[-0.5, 1.0], [-0.4, 0.4], [0.0, 1.0]];

    #[test]
    fn keys_step_within_the_ranges_and_lying_down_is_for_good() {
        let mut steering = Steering::new(RANGES);
        let keys = steering.clone();
        let now = |steering: &mut Steering| steering.at(0.0, &standing()).map(|order| order.command);
        assert_eq!(keys.press(Key::Ahead), [0.1, 0.0, 0.0]);
        assert_eq!(now(&mut steering), Some([0.1, 0.0, 0.0]));
        (0..30).for_each(|_| assert!(keys.press(Key::Ahead)[0] <= 1.0));
        assert_eq!(now(&mut steering), Some([1.0, 0.0, 0.0]));
        (0..30).for_each(|_| assert!(keys.press(Key::Back)[0] >= -0.5));
        for _ in 0..4 {
            keys.press(Key::Right);
        }
        assert_eq!(keys.press(Key::Right), [-0.5, -0.2, 0.0]);
        // A range without that side.
        assert_eq!(keys.press(Key::TurnRight)[2], 0.0);
        assert_eq!((keys.press(Key::Halt), now(&mut steering)), ([0.0; 3], Some([0.0; 3])));
        keys.press(Key::LieDown);
        keys.press(Key::Ahead);
        assert_eq!(now(&mut steering), None);
    }

    #[test]
    fn the_remote_walks_and_lies_down() {
        let mut state = standing();
        state.remote = Remote { left: [0.0, 1.0], ..Remote::default() };
        let order = ByRemote(RANGES).at(3.0, &state).unwrap();
        assert_eq!((order.command, order.walk), ([1.0, 0.0, 0.0], Some((0, 0.0))));
        state.remote.a = true;
        assert_eq!(ByRemote(RANGES).at(3.0, &state), None);
    }
}
