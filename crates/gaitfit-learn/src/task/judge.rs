//! Rewards of a tile's robots for a control period, and the ends of their episodes.

use gaitfit_model::rotation::{quat_of, vec_of};
use gaitfit_policy::walker::touching;

use super::expression::program::LANES;
use super::moment::BaseMoment;
use super::{Environment, Moment};

/// State of an episode after a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ended {
    /// It continues.
    #[default]
    No,
    /// The robot fell.
    Fall,
    /// Time is up.
    TimeOut,
    /// A number is not finite, or a speed is higher than a robot can have.
    Diverged,
}

/// A base that is faster than this, m/s or rad/s, is a simulation that came apart; in the next steps its numbers would
/// overflow.
pub const FASTEST_BASE: f32 = 1e3;
/// A joint that is faster than this, rad/s, is such a simulation too.
pub const FASTEST_JOINT: f32 = 1e4;

impl Environment<'_> {
    /// Writes what each environment was paid for the control period under `actions`, which has just passed, and whether
    /// its episode ended.
    pub(super) fn judge(&mut self, actions: &[f32], paid: &mut [f32], ended: &mut [Ended]) {
        let terms = self.task.rewards.terms().len();
        let joints = self.task.walker.joints.len();
        // Taken out, because the moments borrow the whole environment.
        let mut scratch = std::mem::take(&mut self.scratch);
        let mut values = vec![0.0; LANES * terms];
        self.broken_term = None;
        // As many robots at a time as the program of rewards computes together.
        for first in (0..self.count()).step_by(LANES) {
            let robots = first..self.count().min(first + LANES);
            let action = |index: usize| &actions[index * joints..(index + 1) * joints];
            let moments: Vec<Moment<'_>> =
                robots.clone().map(|index| self.moment(index, action(index))).collect();
            let whole: Vec<bool> = robots.clone().map(|index| self.is_whole(index)).collect();
            self.task.rewards.pay(&moments, &whole, &mut scratch, &mut values);
            // The moments borrow the environment, which `settle` changes.
            let error =
                |moment: &Moment<'_>| BaseMoment::errors(moment.velocity, moment.yaw_rate, moment.command);
            let reached: Vec<_> =
                moments.iter().map(|moment| (moment.velocity, moment.fallen, error(moment))).collect();
            for (place, (index, (velocity, fallen, error))) in robots.zip(reached).enumerate() {
                let values = &values[place * terms..(place + 1) * terms];
                self.errors[index] = error;
                (paid[index], ended[index]) = match whole[place] {
                    true => self.settle(index, velocity, fallen, values),
                    false => (0.0, Ended::Diverged),
                };
            }
        }
        self.scratch = scratch;
    }

    /// Whether the numbers of environment `index` are finite and its speeds are ones that a robot can have.
    fn is_whole(&self, index: usize) -> bool {
        let motion = &self.motion;
        let joints = self.task.start_pose.len();
        let three = 3 * index..3 * (index + 1);
        let mut base = motion.base_linear[three.clone()].iter().chain(&motion.base_angular[three.clone()]);
        // NaN fails the comparisons too.
        base.all(|x| x.abs() <= FASTEST_BASE)
            && motion.joint_velocity[joints * index..joints * (index + 1)]
                .iter()
                .all(|x| x.abs() <= FASTEST_JOINT)
            && motion.base_quaternion[4 * index..4 * (index + 1)].iter().all(|x| x.is_finite())
            && self.height(index).is_finite()
    }

    /// Height of a base's origin above the ground under it, m.
    fn height(&self, index: usize) -> f32 {
        let base = vec_of(&self.motion.base_position[3 * index..]);
        base[2] - self.task.walker.ground_under(base)
    }

    /// Velocity, posture and command of the base of environment `index`, as rewards name them.
    pub(super) fn base(&self, index: usize) -> BaseMoment<f32> {
        let motion = &self.motion;
        let (_, _, posture) = self.task.walker.fall_limits();
        BaseMoment::new(
            quat_of(&motion.base_quaternion[4 * index..]),
            vec_of(&motion.base_linear[3 * index..]),
            vec_of(&motion.base_angular[3 * index..]),
            self.command[index],
            posture,
        )
    }

    fn moment<'a>(&'a self, index: usize, action: &'a [f32]) -> Moment<'a> {
        let (task, motion) = (self.task, &self.motion);
        let joints = task.start_pose.len();
        let row = joints * index..joints * (index + 1);
        let geoms = task.walker.batch.contact_geoms().len();
        let base = self.base(index);
        Moment {
            task,
            command: self.command[index],
            walking: base.walking != 0.0,
            velocity: base.velocity,
            angular_velocity: vec_of(&motion.base_angular[3 * index..]),
            yaw_rate: base.yaw_rate,
            gravity: base.gravity,
            uprightness: base.uprightness,
            height: self.height(index),
            joint_position: &motion.joint_position[row.clone()],
            joint_velocity: &motion.joint_velocity[row.clone()],
            joint_acceleration: &motion.joint_acceleration[row.clone()],
            torque: &motion.torque[row.clone()],
            target: &self.targets[row],
            action,
            last_action: self.last_action.row(index),
            feet: self.feet(index),
            body_contacts: touching(
                &motion.normal_force[geoms * index..geoms * (index + 1)],
                &task.body_geoms,
            ),
            clock: self.clock(index),
            fallen: task.walker.fallen(motion, index),
        }
    }

    /// Returns the pay of environment `index`, whose numbers are whole, and whether its episode ended.
    /// `values`: its reward terms.
    fn settle(&mut self, index: usize, velocity: [f32; 3], fallen: bool, values: &[f32]) -> (f32, Ended) {
        let task = self.task;
        let command = self.command[index];
        // Before any return: the way counts also in a step that ends the episode.
        if let Some(way) = self.ways.get_mut(index) {
            way.advance(command, velocity, task.walker.interface.control_dt as f32);
        }
        let sum: f32 = values.iter().sum();
        if !sum.is_finite() {
            // A sum may overflow although all its terms are finite. Then no term is named.
            let term = values.iter().position(|value| !value.is_finite());
            self.broken_term = self.broken_term.or(term.map(|term| (index, term)));
            return (0.0, Ended::Diverged);
        }
        for (total, &value) in self.terms.iter_mut().zip(values) {
            *total += f64::from(value);
        }
        let ended = if fallen {
            Ended::Fall
        // Leaving the ground counts as a time-out: the critic's value stands for the reward that is cut off.
        } else if self.steps[index] >= task.episode_steps()
            || task.is_outside(vec_of(&self.motion.base_position[3 * index..]))
        {
            Ended::TimeOut
        } else {
            Ended::No
        };
        (sum, ended)
    }
}
