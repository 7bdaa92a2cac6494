//! One recorded run of one robot.

use serde::Serialize;
use std::path::PathBuf;

/// Joint signals of one robot over time. All matrices are row-major, one row a sample, one column a joint
/// in the order of `joints`.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// Where it was read from, if from a file.
    pub source: Option<PathBuf>,
    /// Robot name, if the log says it.
    pub robot: Option<String>,
    /// Joint names in column order, for example `FL_hip`.
    pub joints: Vec<String>,
    /// Sample times, s, finite; `len` samples. As recorded: strictly increasing unless the checks say
    /// otherwise.
    pub time: Vec<f64>,
    /// Nominal sample rate, Hz.
    pub rate_hz: f64,
    /// Joint positions, rad; `len × joints`.
    pub position: Vec<f64>,
    /// Joint velocities, rad/s; `len × joints`.
    pub velocity: Vec<f64>,
    /// Joint position targets of the PD controller, rad; of `velocity_joints` velocities, rad/s; `len × joints`; may be
    /// absent.
    pub target: Option<Vec<f64>>,
    /// Names of the joints whose targets are velocities, rad/s, such as wheels.
    pub velocity_joints: Vec<String>,
    /// Policy actions (unitless); `len × joints`; may be absent.
    pub action: Option<Vec<f64>>,
    /// Commands: vx (m/s), vy (m/s), yaw rate (rad/s); `len × 3`; may be absent.
    pub command: Option<Vec<f64>>,
    /// Where the robot is in the motion that its policy follows: time since the motion's beginning (s), and the angle about
    /// the vertical by which the motion was turned to face as the robot did (rad); `len × 2`; may be absent.
    pub motion: Option<Vec<f64>>,
    /// Base state, where a log has it (simulated robots, motion capture); may be absent.
    pub base: Option<BaseState>,
    /// PD gains in force while recording, one a joint; may be absent.
    pub gains: Option<Gains>,
    /// How long after its row's time each target (or action) was sent, where the log knows it; absent: at the row's time.
    pub lead: Option<Lead>,
    /// Physics step, s, of the simulator that made the log; absent of a real robot's. Such steps are semi-implicit: positions
    /// advance by the new velocity, so a velocity is the mean over the step before its row and belongs half a step earlier.
    pub simulated_step: Option<f64>,
    /// The recording ends because the robot fell. A log that continues after the fall shows the fall and need not state it.
    pub fell: bool,
}

/// How long after the time of its row a controller's message was stamped. A control loop reads a state, computes, and
/// publishes a target that answers it: the target is in the state's row, and its own time is the row's plus this.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Lead {
    /// The middle one, s. Negative: the message was stamped before the state.
    pub seconds: f64,
    /// Half of the range that holds nine of ten, s.
    pub spread: f64,
}

/// PD gains of the recording, one entry a joint in the trajectory's joint order.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    /// Position gain, N·m/rad.
    pub kp: Vec<f64>,
    /// Velocity gain, N·m·s/rad.
    pub kd: Vec<f64>,
}

/// Base pose and velocity, one row a sample. Parts a log lacks are absent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BaseState {
    /// Position, m, world frame; `len × 3`.
    pub position: Option<Vec<f64>>,
    /// Orientation, wxyz; `len × 4`.
    pub quaternion: Option<Vec<f64>>,
    /// Linear velocity, m/s, world frame; `len × 3`.
    pub linear_velocity: Option<Vec<f64>>,
    /// Angular velocity, rad/s, body frame; `len × 3`.
    pub angular_velocity: Option<Vec<f64>>,
}

impl Trajectory {
    /// A log of joints alone: `time` in s, `position` in rad and `velocity` in rad/s, `len × joints`. All that may be absent
    /// is absent.
    pub fn of_joints(
        joints: Vec<String>,
        rate_hz: f64,
        time: Vec<f64>,
        position: Vec<f64>,
        velocity: Vec<f64>,
    ) -> Self {
        Self {
            source: None,
            robot: None,
            joints,
            time,
            rate_hz,
            position,
            velocity,
            target: None,
            velocity_joints: Vec::new(),
            action: None,
            command: None,
            motion: None,
            base: None,
            gains: None,
            lead: None,
            simulated_step: None,
            fell: false,
        }
    }

    /// Known lag of velocities behind positions, s: half a physics step in a simulator's log, 0 in a robot's.
    pub fn known_lag(&self) -> f64 {
        self.simulated_step.map_or(0.0, |step| step / 2.0)
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Column of the joint called `name`.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint == name)
    }
}
