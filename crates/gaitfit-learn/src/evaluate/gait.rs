//! The gait of one robot: foot contacts, heights, speeds and torques over time.

use gaitfit_model::Shape;
use gaitfit_model::kinematics::{Frame, body_frames, lowest_point};
use gaitfit_model::rotation::{quat_of, to_heading, vec_of};
use gaitfit_policy::walker::FootGeoms;
use gaitfit_sim::Motion;
use serde::{Deserialize, Serialize};

use super::{Subject, power_spectrum};
use crate::player::Player;
use crate::task::{Cell, Ended, Environment, Foot, Task, TaskError};

/// Motion of one robot, a row a control period.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GaitRecord {
    /// Control period, s.
    pub dt: f64,
    /// Names of the feet.
    pub feet: Vec<String>,
    /// Names of the joints, model order.
    pub joints: Vec<String>,
    /// Names of those that slide.
    pub slides: Vec<String>,
    /// Whether each foot is on the ground; `steps × feet`.
    pub contact: Vec<bool>,
    /// Height of each foot's lowest point above the ground, m; `steps × feet`.
    pub foot_clearance: Vec<f64>,
    /// Command; `steps × 3`.
    pub command: Vec<f64>,
    /// Velocity: forward, left (m/s, heading frame), yaw rate (rad/s); `steps × 3`.
    pub velocity: Vec<f64>,
    /// Base position, m, and orientation, wxyz; `steps × 7`.
    pub base: Vec<f64>,
    /// Joint positions, rad (slides: m); `steps × joints`.
    pub joint_position: Vec<f64>,
    /// Motor torques at the end of each control period, N·m (slides: N); `steps × joints`.
    pub torque: Vec<f64>,
    /// Actions, policy order; `steps × joints`.
    pub action: Vec<f64>,
    /// Whether the robot fell; the record ends there.
    pub fell: bool,
}

/// A gait in a few numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GaitSummary {
    /// Share of time with exactly one gait group on the ground and the others off it.
    pub alternation: f64,
    /// Steps a second of one foot, Hz.
    pub step_frequency: f64,
    /// Share of time that a foot is on the ground.
    pub duty_factor: f64,
    /// Mean over swings of a foot's greatest height above where it lands, m.
    pub foot_lift: f64,
    /// Root-mean-square change of an action a step, per joint.
    pub action_rate: f64,
    /// Root-mean-square torque, N·m.
    pub torque: f64,
    /// Share of the torques' power above 10 Hz (at the control rate: up to half of it).
    pub torque_power_above_10_hz: f64,
}

/// Runs one robot through `commands` (seconds, command) and records it.
///
/// # Errors
/// A robot that cannot be, or the subject's `cancel`.
pub fn record_gait(subject: &Subject<'_>, commands: &[(f64, [f64; 3])]) -> Result<GaitRecord, TaskError> {
    record_gait_on(subject, None, commands)
}

/// As [`record_gait`], on a cell of generated ground.
///
/// # Errors
/// As [`record_gait`].
pub fn record_gait_on(
    subject: &Subject<'_>,
    cell: Option<Cell>,
    commands: &[(f64, [f64; 3])],
) -> Result<GaitRecord, TaskError> {
    let Subject { task, candidate, seed, .. } = *subject;
    // A robot's column is its number's.
    let number = cell.map_or(0, |cell| cell.column as u32);
    let mut environment = Environment::new(task, candidate, seed, number, 1)?;
    environment.hold_command(0, [0.0; 3]);
    if let Some(cell) = cell {
        environment.put_on_level(0, cell.level);
        // The robot was put elsewhere, so its motion is read again.
        environment.refresh();
    }
    let mut player = Player::new(subject, environment);
    let model = task.walker.batch.model();
    let slides = model.joints.iter().filter(|joint| !joint.kind.is_hinge());
    let mut record = GaitRecord {
        dt: task.walker.interface.control_dt,
        feet: task.settings.feet.clone(),
        joints: model.joints.iter().map(|joint| joint.name.clone()).collect(),
        slides: slides.map(|joint| joint.name.clone()).collect(),
        ..GaitRecord::default()
    };
    let mut clearance = Clearance::new(task);
    let mut step = 0;
    // One command follows the other without a new start.
    for &(seconds, command) in commands {
        player.environment.hold_command(0, command.map(|x| x as f32));
        for _ in 0..(seconds / record.dt).round() as u32 {
            step += 1;
            player.step(step)?;
            let environment = &player.environment;
            let motion = environment.motion();
            let feet = environment.feet(0);
            record.contact.extend(feet.iter().map(|foot| foot.touching));
            record.foot_clearance.extend(clearance.of_feet(task, feet, motion));
            record.command.extend(command);
            let velocity = to_heading(quat_of(&motion.base_quaternion), vec_of(&motion.base_linear));
            let yaw_rate = environment.yaw_rate(0);
            record.velocity.extend([velocity[0], velocity[1], yaw_rate].map(f64::from));
            let base = motion.base_position.iter().chain(&motion.base_quaternion);
            record.base.extend(base.map(|&x| f64::from(x)));
            record.joint_position.extend(motion.joint_position.iter().map(|&q| f64::from(q)));
            record.torque.extend(motion.torque.iter().map(|&torque| f64::from(torque)));
            record.action.extend(player.action.iter().map(|&action| f64::from(action)));
            // The record ends with the period of the fall: what follows is no gait.
            if player.ended[0] == Ended::Fall || player.ended[0] == Ended::Diverged {
                record.fell = true;
                return Ok(record);
            }
        }
    }
    Ok(record)
}

/// Heights of feet of any shape.
struct Clearance {
    /// Geoms of each foot, by index in the model.
    geoms: Vec<Vec<usize>>,
    angles: Vec<f64>,
}

impl Clearance {
    fn new(task: &Task) -> Self {
        let contacts = task.walker.batch.contact_geoms();
        let geoms = |foot: &FootGeoms| foot.geoms.iter().map(|&place| contacts[place]).collect();
        Self { geoms: task.foot_geoms().iter().map(geoms).collect(), angles: Vec::new() }
    }

    /// Height of each foot's lowest point above the ground under it, m.
    fn of_feet(&mut self, task: &Task, feet: &[Foot], motion: &Motion) -> Vec<f64> {
        let model = task.walker.model();
        // The motion reports the centre of a foot. For a single sphere this is enough; the lowest point of
        // other shapes depends on their orientation and needs forward kinematics.
        let sphere = |geoms: &[usize]| match geoms {
            [geom] => match model.geoms[*geom].shape {
                Shape::Sphere { radius } => Some(radius),
                _ => None,
            },
            _ => None,
        };
        self.angles.clear();
        self.angles.extend(motion.joint_position.iter().map(|&angle| f64::from(angle)));
        let base = Frame {
            position: std::array::from_fn(|k| f64::from(motion.base_position[k])),
            quaternion: std::array::from_fn(|k| f64::from(motion.base_quaternion[k])),
        };
        // Computed at the first foot that needs them, and shared by all.
        let mut frames = None;
        let height = |(geoms, foot): (&Vec<usize>, &Foot)| match sphere(geoms) {
            Some(radius) => f64::from(foot.height) - radius,
            None => {
                let frames = frames.get_or_insert_with(|| body_frames(model, &base, &self.angles));
                let lowest =
                    |&geom: &usize| lowest_point(&model.geoms[geom], &frames[model.geoms[geom].body]);
                let ground = f64::from(task.walker.ground_under(foot.place));
                geoms.iter().map(lowest).fold(f64::INFINITY, f64::min) - ground
            }
        };
        self.geoms.iter().zip(feet).map(height).collect()
    }
}

impl GaitRecord {
    /// Control periods recorded.
    pub fn steps(&self) -> usize {
        self.contact.len() / self.feet.len().max(1)
    }

    /// Mean power spectrum of the torques of the joints that `wanted` picks: frequencies, Hz, and densities,
    /// N²·m²/Hz.
    pub fn torque_spectrum(&self, wanted: impl Fn(&str) -> bool) -> (Vec<f64>, Vec<f64>) {
        let joints = self.joints.len();
        let mut frequencies = Vec::new();
        let mut sum: Vec<f64> = Vec::new();
        let mut count = 0.0;
        for j in (0..joints).filter(|&j| wanted(&self.joints[j])) {
            // Rows hold one torque a joint, so a joint's signal is every `joints`-th number.
            let signal: Vec<f64> = self.torque.iter().skip(j).step_by(joints).copied().collect();
            let (at, densities) = power_spectrum(&signal, 1.0 / self.dt);
            // Too short, or not finite: the mean is over the other joints.
            if densities.is_empty() {
                continue;
            }
            sum.resize(densities.len(), 0.0);
            sum.iter_mut().zip(&densities).for_each(|(sum, density)| *sum += density);
            frequencies = at;
            count += 1.0;
        }
        sum.iter_mut().for_each(|density| *density /= f64::max(count, 1.0));
        (frequencies, sum)
    }

    /// The gait in numbers, over the periods whose command asks for movement. `groups`: gait group of each foot.
    pub fn summary(&self, groups: &[Option<usize>]) -> GaitSummary {
        let feet = self.feet.len();
        let walking: Vec<usize> = (0..self.steps())
            // 0.01 is 0.1²: up to this norm a command means standing, as for rewards.
            .filter(|step| self.command[3 * step..3 * step + 3].iter().map(|c| c * c).sum::<f64>() > 0.01)
            .collect();
        let (mut alternating, mut on_ground, mut gait_feet, mut landings) = (0.0, 0.0, 0.0, 0.0);
        let mut lifts = Vec::new();
        for &step in &walking {
            let row = &self.contact[step * feet..(step + 1) * feet];
            let mut full = 0;
            let mut mixed = false;
            let max = groups.iter().flatten().max().map_or(0, |max| max + 1);
            for group in 0..max {
                let members = || row.iter().zip(groups).filter(|(_, g)| **g == Some(group)).map(|(c, _)| *c);
                // All feet of the group are on the ground; only some are, so groups do not alternate; or none is, as in
                // a group without feet.
                match (members().all(|c| c), members().any(|c| c)) {
                    (true, true) => full += 1,
                    (false, true) => mixed = true,
                    (_, false) => {}
                }
            }
            alternating += if full == 1 && !mixed { 1.0 } else { 0.0 };
            for foot in (0..feet).filter(|&foot| groups[foot].is_some()) {
                // `gait_feet` counts feet times periods. Landings over it give the step rate of one foot, contacts
                // its duty factor.
                gait_feet += 1.0;
                on_ground += if row[foot] { 1.0 } else { 0.0 };
                // The step in which the foot was on the ground before. A record may begin with feet in the air: coming
                // down for the first time is no step.
                let stood = || (0..step).rev().find(|&before| self.contact[before * feet + foot]);
                if let Some(stood) = row[foot].then(stood).flatten().filter(|stood| stood + 1 < step) {
                    landings += 1.0;
                    let height = |step: usize| self.foot_clearance[step * feet + foot];
                    // The swing has one step at least, the one before the landing.
                    let top = (stood + 1..step).map(height).fold(f64::MIN, f64::max);
                    // Above the landing and not above 0: a foot in contact sinks a little into the ground.
                    lifts.push(top - height(step));
                }
            }
        }
        let mean_square =
            |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>() / values.len().max(1) as f64;
        let joints = self.joints.len();
        let changes: Vec<f64> =
            // The two sequences are shifted by one step: each change is that of one joint.
            self.action.iter().skip(joints).zip(&self.action).map(|(now, before)| now - before).collect();
        let (frequencies, densities) = self.torque_spectrum(|_| true);
        let power: f64 = densities.iter().sum();
        let fast: f64 =
            frequencies.iter().zip(&densities).filter(|(f, _)| **f > 10.0).map(|(_, density)| density).sum();
        let steps = f64::max(walking.len() as f64, 1.0);
        GaitSummary {
            alternation: alternating / steps,
            // A record without walking has neither landings nor feet to count: 0 over one period.
            step_frequency: landings / f64::max(gait_feet * self.dt, self.dt),
            duty_factor: on_ground / f64::max(gait_feet, 1.0),
            foot_lift: lifts.iter().fold(0.0, |sum, lift| sum + lift) / f64::max(lifts.len() as f64, 1.0),
            action_rate: mean_square(&changes).sqrt(),
            torque: mean_square(&self.torque).sqrt(),
            torque_power_above_10_hz: if power > 0.0 { fast / power } else { 0.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_foot_that_comes_down_for_the_first_time_has_not_stepped() {
        let record = GaitRecord {
            dt: 0.02,
            feet: vec!["left".to_owned()],
            contact: vec![false, true, true, false, false, true],
            foot_clearance: vec![0.5, 0.0, 0.0, 0.02, 0.03, 0.01],
            command: [1.0, 0.0, 0.0].repeat(6),
            ..GaitRecord::default()
        };
        let summary = record.summary(&[Some(0)]);
        assert!((summary.step_frequency - 1.0 / 0.12).abs() < 1e-9, "{summary:?}");
        assert!((summary.foot_lift - 0.02).abs() < 1e-12, "{summary:?}");
    }

    #[test]
    fn a_group_without_feet_is_on_no_ground() {
        let record = GaitRecord {
            dt: 0.02,
            feet: vec!["left".to_owned(), "right".to_owned()],
            contact: vec![true, false, false, true],
            foot_clearance: vec![0.0; 4],
            command: [1.0, 0.0, 0.0].repeat(2),
            ..GaitRecord::default()
        };
        for groups in [[Some(0), Some(1)], [Some(0), Some(2)]] {
            let summary = record.summary(&groups);
            assert_eq!((summary.alternation, summary.duty_factor), (1.0, 0.5), "{groups:?}");
        }
    }
}
