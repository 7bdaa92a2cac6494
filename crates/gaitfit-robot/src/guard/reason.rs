//! Reasons for damping, in words for the person beside the robot.

/// The reason for damping, or for not arming a robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Reason {
    /// Nothing was heard from the robot.
    #[error(
        "no state of the robot has arrived; check cable, network interface and domain, and whether the robot is switched on"
    )]
    NoState,
    /// A part of the state does not come.
    #[error(
        "the robot's state is not complete: {0}; check that its driver runs, and the topics in the robot's file"
    )]
    Lacks(String),
    /// The last state is old.
    #[error("the robot's last state is {0:.0} ms old; check the cable and how busy this computer is")]
    StaleState(f64),
    /// A state came damaged.
    #[error("a state of the robot has a wrong checksum: it was damaged, or sent by another program")]
    WrongChecksum,
    /// A number of the state is not finite.
    #[error("the robot's state has a number that is not finite ({0}); switch the robot off and on")]
    StateNotFinite(&'static str),
    /// A state has another number of joints.
    #[error("a state has {0} joints, another number than the robot: it is of another robot")]
    OtherRobot(usize),
    /// The inertial unit's orientation is none.
    #[error(
        "the orientation of the robot's inertial unit is no unit quaternion; switch the robot off and on"
    )]
    NoOrientation,
    /// A joint is where the robot's joints cannot be.
    #[error(
        "joint {joint} is at {angle:.2} rad, outside its range; look at the leg, or the joints are in another order"
    )]
    OutOfRange {
        /// The joint.
        joint: String,
        /// Its angle, rad.
        angle: f32,
    },
    /// A joint moved further than it can.
    #[error(
        "joint {joint} jumped by {angle:.2} rad from one state to the next: an encoder fails, or the joints changed order"
    )]
    Jump {
        /// The joint.
        joint: String,
        /// The change, rad.
        angle: f32,
    },
    /// A joint is too fast.
    #[error("joint {joint} turns at {speed:.1} rad/s, faster than its motor can")]
    TooFast {
        /// The joint.
        joint: String,
        /// Its velocity, rad/s.
        speed: f32,
    },
    /// A joint is not where its target is.
    #[error("joint {joint} is {angle:.2} rad from its target: it does not follow")]
    Astray {
        /// The joint.
        joint: String,
        /// Its angle less the target, rad.
        angle: f32,
    },
    /// The robot leans.
    #[error("the robot leans by {0:.0} degrees; it is falling, or was lifted")]
    Tilt(f32),
    /// A motor is hot.
    #[error("motor {joint} is at {degrees} °C; let it cool")]
    Hot {
        /// The joint.
        joint: String,
        /// Its temperature, °C.
        degrees: i16,
    },
    /// The battery is nearly empty.
    #[error("the battery is at {0} %; charge it")]
    Battery(u8),
    /// The battery is not reported though it must be.
    #[error("the robot reports no battery; a robot does, and simulators take a domain other than 0")]
    NoBattery,
    /// The policy's output is no number.
    #[error("the policy's output is not finite; inspect the policy and run it in a simulator first")]
    PolicyNotFinite,
    /// The policy's output is late.
    #[error("the policy's last output is {0:.0} ms old; this computer is too busy or too slow for it")]
    LatePolicy(f64),
    /// The loop that sends commands was late.
    #[error("the loop that sends commands was {0:.0} ms late; this computer is too busy")]
    LateLoop(f64),
    /// Another program commands the robot.
    #[error(
        "another program sends commands to the robot's motors: stop it, and switch off the robot's own walking (motion service) \
         in the vendor's app or with its SDK (MotionSwitcherClient.ReleaseMode)"
    )]
    SecondController,
    /// The person beside it said so.
    #[error("stopped by hand: B on the robot's remote, or Esc on the keyboard")]
    Operator,
    /// The program was asked to end.
    #[error("the program was asked to end (Ctrl-C or a signal)")]
    Signal,
    /// A signal of this name came.
    #[error("the program was asked to end ({0})")]
    Named(&'static str),
    /// The terminal went away.
    #[error("the terminal went away")]
    TerminalLost,
    /// The log cannot be kept.
    #[error("the log cannot be kept: {0}")]
    Log(String),
    /// The link broke.
    #[error("the link to the robot broke: {0}")]
    Link(String),
}
