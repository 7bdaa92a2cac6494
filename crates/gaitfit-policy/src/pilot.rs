//! A policy on one robot, real or simulated: step by step, without a simulator.

use gaitfit_physics::Real;

use crate::network::{Memory, Scratch};
use crate::observation::{LastAction, Layout, Past, Sensed};
use crate::{Interface, InterfaceError, MotionPlace, Policy};

/// Target of a joint, rad (rad/s where the target is a velocity, and the pose 0): `pose + scale · clamp(action, ± clip)`; not a number for such an action. Kernels are
/// written from this.
pub fn target<R: Real>(pose: R, scale: R, clip: R, action: R) -> R {
    // Comparisons with NaN are false, so both choices pass it on.
    let above = R::select_lt(action, -clip, -clip, action);
    pose + scale * R::select_lt(clip, above, clip, above)
}

/// A policy on one robot, with all that it remembers from step to step. The code that trains policies writes its observations.
pub struct Pilot<'a> {
    policy: &'a Policy,
    layout: Layout,
    past: Past,
    last_action: LastAction,
    memory: Memory,
    scratch: Scratch,
    observation: Vec<f32>,
    action: Vec<f32>,
    targets: Vec<f32>,
    /// Steps since the beginning.
    steps: u32,
    /// Angle by which the motion that the policy follows is turned to face as the robot did at the beginning, rad.
    heading: f64,
}

impl<'a> Pilot<'a> {
    /// `policy`, which passes [`Policy::check`], at the beginning of an episode.
    ///
    /// # Errors
    /// A policy that observes what a robot does not measure.
    pub fn new(policy: &'a Policy) -> Result<Self, InterfaceError> {
        let interface = &policy.interface;
        if let Some(quantity) = interface.unmeasured() {
            return Err(InterfaceError(format!(
                "observation has {}, which a robot does not measure; train one without it",
                quantity.name()
            )));
        }
        let layout = Layout::new(interface, &interface.observation);
        let joints = interface.joints.len();
        Ok(Self {
            policy,
            past: Past::new(&layout, 1),
            last_action: LastAction::new(1, joints),
            memory: policy.memory(1),
            scratch: Scratch::default(),
            observation: vec![0.0; layout.width()],
            action: vec![0.0; joints],
            targets: vec![0.0; joints],
            steps: 0,
            heading: 0.0,
            layout,
        })
    }

    /// Begins an episode.
    pub fn begin(&mut self) {
        self.past.begin(0);
        self.last_action.begin(0);
        self.memory = self.policy.memory(1);
        self.steps = 0;
    }

    /// One control period. `sensed` needs base, joints and command; last action, gait clock and the place in a motion are filled
    /// in here. Returns action and targets (rad; rad/s for [`Interface::velocity_joints`]), policy order.
    ///
    /// # Panics
    /// If `sensed` is of another number of joints: an error of the caller.
    pub fn step(&mut self, sensed: &mut Sensed) -> (&[f32], &[f32]) {
        let interface = &self.policy.interface;
        sensed.last_action.copy_from_slice(self.last_action.row(0));
        sensed.clock = clock(interface, self.steps);
        // The motion runs by control periods and not by a clock: a late step skips nothing of it.
        sensed.motion =
            MotionPlace { time: f64::from(self.steps) * interface.control_dt, heading: self.heading };
        // The motion is turned once, at the beginning: later differences of heading are errors that the
        // policy corrects.
        if self.steps == 0 {
            self.heading = self.layout.motion_heading(sensed);
            sensed.motion.heading = self.heading;
        }
        self.layout.write(sensed, self.past.row(0), |_, _| (), &mut self.observation);
        self.past.take(&self.observation);
        self.policy.act_with(1, &self.observation, &mut self.memory, &mut self.action, &mut self.scratch);
        for (index, (to, &action)) in self.targets.iter_mut().zip(&self.action).enumerate() {
            let clip = interface.clip(index).min(f64::from(f32::MAX)) as f32;
            *to = target(
                interface.default_pose[index] as f32,
                interface.action_scale[index] as f32,
                clip,
                action,
            );
        }
        self.last_action.take(&self.action);
        self.steps += 1;
        (&self.action, &self.targets)
    }
}

/// Phase of the gait clock, 0 to 1, `steps` control periods after an episode's start; 0 without a clock.
pub fn clock(interface: &Interface, steps: u32) -> f32 {
    let Some(frequency) = interface.gait_frequency else { return 0.0 };
    // In `f64`: after an hour at 2 Hz `f32` would round the phase to 5e-4.
    (f64::from(steps) * interface.control_dt * frequency).fract() as f32
}
