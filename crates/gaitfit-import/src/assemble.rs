//! From joined columns to a trajectory.

use crate::ImportError;
use crate::join::Joined;
use crate::mapping::Mapping;
use crate::table::Source;
use gaitfit_log::column_names::{
    BASE_POSITION, BASE_QUATERNION, BASE_RATES, BASE_VELOCITY, COMMAND, MOTION, PROJECTED_GRAVITY,
    ROLL_PITCH_YAW,
};
use gaitfit_log::{
    BaseState, Finding, Gains, MotorColumns, Trajectory, fold, gains_of_columns, measured_rate,
    orientation_of_gravity, settle_angles, settle_imu,
};
use gaitfit_model::rotation::from_rpy;
use gaitfit_model::{shown, shown_number};
use indexmap::IndexMap;

/// Gains that differ by a smaller part are rounded.
const SAME_GAIN: f64 = 1e-3;

/// Joined columns as matrices.
struct Columns<'a> {
    joints: &'a [String],
    columns: &'a IndexMap<String, Vec<f64>>,
    samples: usize,
}

impl Columns<'_> {
    /// A column `prefix` of every joint; `left_out` gains those that only some have.
    fn of_joints(&self, prefix: &str, left_out: &mut Vec<String>) -> Option<Vec<f64>> {
        let present: Vec<&Vec<f64>> =
            self.joints.iter().filter_map(|joint| self.columns.get(&format!("{prefix}{joint}"))).collect();
        if present.len() == self.joints.len() {
            return Some(interleave(&present, self.samples));
        }
        if !present.is_empty() {
            left_out.push(format!(
                "{prefix}: only {} of {} joints have it",
                present.len(),
                self.joints.len()
            ));
        }
        None
    }

    /// The columns `names`, if all are there.
    fn group(&self, names: &[&str]) -> Option<Vec<f64>> {
        let present: Option<Vec<&Vec<f64>>> = names.iter().map(|name| self.columns.get(*name)).collect();
        present.map(|present| interleave(&present, self.samples))
    }

    /// The place in a motion; `left_out` gains it if it is not known at every sample, as a log must have it.
    fn motion(&self, left_out: &mut Vec<String>) -> Option<Vec<f64>> {
        let whole = self.group(&MOTION).filter(|motion| motion.iter().all(|value| value.is_finite()));
        if whole.is_none() && MOTION.iter().any(|name| self.columns.contains_key(*name)) {
            left_out.push(
                "motion_time and motion_heading: a log needs both, with a number at every sample".into(),
            );
        }
        whole
    }

    /// The base at the times `time`.
    fn base(&self, time: &[f64]) -> BaseState {
        let quaternion = self.group(&BASE_QUATERNION).map(|mut values| {
            // Blended quaternions are shorter.
            for quaternion in values.chunks_exact_mut(4) {
                let length = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
                // Another length is no effect of blending; it stays for the log's checks.
                if length > 0.5 && length < 2.0 {
                    quaternion.iter_mut().for_each(|part| *part /= length);
                }
            }
            values
        });
        let from_angles = || {
            let angles = self.group(&ROLL_PITCH_YAW)?;
            Some(angles.chunks_exact(3).flat_map(|rpy| from_rpy(rpy[0], rpy[1], rpy[2])).collect())
        };
        let rates = self.group(&BASE_RATES);
        let from_gravity = || {
            let gravity = self.group(&PROJECTED_GRAVITY)?;
            Some(orientation_of_gravity(time, &gravity, rates.as_deref()))
        };
        BaseState {
            position: self.group(&BASE_POSITION),
            // From the fullest to the poorest: gravity alone shows no heading.
            quaternion: quaternion.or_else(from_angles).or_else(from_gravity),
            linear_velocity: self.group(&BASE_VELOCITY),
            angular_velocity: rates.clone(),
        }
    }

    /// Gains, velocities and torques that motors were given besides targets.
    fn motors(&self) -> MotorColumns {
        let of_motors = |prefix: &str| of_all(prefix, self.joints, self.columns, self.samples);
        MotorColumns {
            kp: of_motors("kp_"),
            kd: of_motors("kd_"),
            target_velocity: of_motors("dqdes_"),
            feed_forward: of_motors("tauff_"),
        }
    }
}

/// Samples a second: as measured, or as stated where there are no times.
fn rate(time: &[f64], stated: Option<f64>) -> Result<f64, ImportError> {
    let measured = measured_rate(time);
    let problem = match (stated, measured) {
        (Some(stated), Some(measured)) if (stated / measured - 1.0).abs() > 0.01 => format!(
            "its times say {measured:.1} samples a second, not {stated}; a rate (`--rate`, `rate_hz`) is for recordings \
             without times: leave it out"
        ),
        (None, None) => "one sample says no rate; give `rate_hz` in a mapping file".to_owned(),
        (Some(rate), _) | (None, Some(rate)) => return Ok(rate),
    };
    Err(ImportError::Clock { stream: "the joined log".into(), problem })
}

/// The trajectory of joined columns. Joints are those with positions; `assumed` and `left_out` gain what it took.
pub(crate) fn trajectory(
    joined: Joined,
    sources: &[Source],
    mapping: &Mapping,
    assumed: &mut Vec<String>,
    left_out: &mut Vec<String>,
    noticed: &mut Vec<Finding>,
) -> Result<Trajectory, ImportError> {
    let Joined { time: stamps, columns, lead, .. } = joined;
    let joints: Vec<String> =
        columns.keys().filter_map(|name| name.strip_prefix("q_")).map(str::to_owned).collect();
    without_position(&joints, &columns, sources, left_out)?;
    let start = stamps.first().copied().unwrap_or(0.0);
    // A stream that begins elsewhere than at 0 begins at 0 here.
    let time: Vec<f64> = stamps.iter().map(|time| time - start).collect();
    let all = Columns { joints: &joints, columns: &columns, samples: stamps.len() };
    let position = all.of_joints("q_", left_out).unwrap_or_default();
    let velocity = match all.of_joints("dq_", left_out) {
        Some(velocity) => velocity,
        None => {
            assumed.push(
                "velocities are not recorded; they are the central differences of the positions".into(),
            );
            derivative(&time, &position, joints.len())
        }
    };
    let mut target = all.of_joints("qdes_", left_out);
    let action = all.of_joints("act_", left_out);
    let base = all.base(&time);
    let rate_hz = rate(&time, mapping.rate_hz)?;
    // Gains that nobody stated may come from the columns; then velocities and torques can be folded into
    // targets.
    let mut gains = gains(&joints, sources, mapping, assumed)?;
    let motors = all.motors();
    noticed.extend(gains_of_columns(&motors, &time, &joints, &mut gains, &mut None));
    noticed.extend(fold(&motors, &joints, gains.as_ref(), target.as_mut()));
    let command = all.group(&COMMAND);
    let motion = all.motion(left_out);
    let has_quaternion = BASE_QUATERNION.iter().all(|name| columns.contains_key(*name));
    // Angles are needed again only if the orientation was made of them: their order or unit may be wrong.
    let angles = all.group(&ROLL_PITCH_YAW).filter(|_| !has_quaternion && mapping.imu.mounting.is_none());
    let velocities: Vec<&String> = sources.iter().flat_map(|source| &source.velocity_joints).collect();
    let mut trajectory = Trajectory {
        source: None,
        robot: mapping.robot.clone().or_else(|| sources.iter().find_map(|source| source.robot.clone())),
        velocity_joints: joints.iter().filter(|joint| velocities.contains(joint)).cloned().collect(),
        joints,
        time,
        rate_hz,
        position,
        velocity,
        target,
        action,
        command,
        motion,
        base: (base != BaseState::default()).then_some(base),
        gains,
        lead,
        simulated_step: sources.iter().find_map(|source| source.simulated_step),
        fell: sources.iter().any(|source| source.fell),
    };
    // Before the checks below, which rely on arrays of the right lengths.
    trajectory.validate()?;
    if let Some(angles) = angles {
        noticed.extend(settle_angles(&mut trajectory, &angles));
    }
    noticed.extend(settle_imu(&mut trajectory, &mapping.imu));
    Ok(trajectory)
}

/// Joints that have velocities, targets or actions but no positions: refused, or left out of a bag, whose topics may be of
/// several devices.
fn without_position(
    joints: &[String],
    columns: &IndexMap<String, Vec<f64>>,
    sources: &[Source],
    left_out: &mut Vec<String>,
) -> Result<(), ImportError> {
    let mut others: IndexMap<&str, &str> = IndexMap::new();
    // Any quantity of a joint shows that there is such a joint.
    for name in columns.keys() {
        for (prefix, what) in [("dq_", "a velocity"), ("qdes_", "a target"), ("act_", "an action")] {
            if let Some(joint) =
                name.strip_prefix(prefix).filter(|joint| !joints.iter().any(|own| own == joint))
            {
                others.entry(joint).or_insert(what);
            }
        }
    }
    let Some((joint, what)) = others.first() else { return Ok(()) };
    let is_bag = sources.iter().any(|source| source.messages);
    if !is_bag {
        let (joint, why) = (format!("joint {joint}"), format!("it has {what}"));
        return Err(ImportError::JointMissing { have: joints.len(), joint, why });
    }
    let names = others.keys().take(12).map(|joint| shown(joint)).collect::<Vec<_>>().join(", ");
    left_out.push(format!("{} joints without positions: {names}", others.len()));
    Ok(())
}

/// Columns side by side: one row a sample.
fn interleave(columns: &[&Vec<f64>], samples: usize) -> Vec<f64> {
    (0..samples).flat_map(|sample| columns.iter().map(move |column| column[sample])).collect()
}

/// Central differences, one-sided at the ends.
fn derivative(time: &[f64], position: &[f64], width: usize) -> Vec<f64> {
    let last = time.len().saturating_sub(1);
    let mut out = Vec::with_capacity(position.len());
    for sample in 0..time.len() {
        let (before, after) = (sample.saturating_sub(1), (sample + 1).min(last));
        let span = time[after] - time[before];
        for joint in 0..width {
            let change = position[after * width + joint] - position[before * width + joint];
            // A single sample has no span.
            out.push(if span > 0.0 { change / span } else { 0.0 });
        }
    }
    out
}

/// The gains that the mapping or else the files state. If the mapping replaces other gains, a sentence in `assumed` says so.
fn gains(
    joints: &[String],
    sources: &[Source],
    mapping: &Mapping,
    assumed: &mut Vec<String>,
) -> Result<Option<Gains>, ImportError> {
    let problem = |problem: String| ImportError::Mapping { problem };
    match (&mapping.kp, &mapping.kd) {
        (Some(kp), Some(kd)) => {
            let kp = kp.resolve("kp", joints).map_err(problem)?;
            let kd = kd.resolve("kd", joints).map_err(problem)?;
            let gains = Gains { kp, kd };
            // Gains of the files that do not fit do not matter here.
            let of_files = gains_of_files(joints, sources).ok().flatten();
            assumed.extend(of_files.and_then(|(files, place)| replaced(joints, &gains, &files, &place)));
            Ok(Some(gains))
        }
        (None, None) => Ok(gains_of_files(joints, sources)?.map(|(gains, _)| gains)),
        _ => Err(problem("kp and kd: give both or none".into())),
    }
}

/// Says that a mapping states other gains than the recording, of the first joint whose gains differ.
fn replaced(joints: &[String], mapping: &Gains, files: &Gains, place: &str) -> Option<String> {
    [("kp", &mapping.kp, &files.kp), ("kd", &mapping.kd, &files.kd)].into_iter().find_map(
        |(what, mapping, files)| {
            let mut pairs = joints.iter().zip(mapping.iter().zip(files));
            let (joint, (stated, own)) =
                pairs.find(|(_, (stated, own))| (*stated - *own).abs() > SAME_GAIN * own.abs())?;
            Some(format!(
                "{what} of {} is {}, as the mapping states, not {} as {place} states",
                shown(joint),
                shown_number(*stated),
                shown_number(*own)
            ))
        },
    )
}

/// Gains that files state, and where.
fn gains_of_files(joints: &[String], sources: &[Source]) -> Result<Option<(Gains, String)>, ImportError> {
    let problem = |problem: String| ImportError::Mapping { problem };
    // Gains that comments of a file state come before those of arrays.
    for source in sources {
        let (Some((kp, at_kp)), Some((kd, at_kd))) = (&source.stated.kp, &source.stated.kd) else { continue };
        let kp = kp.resolve("kp", joints).map_err(|wrong| problem(format!("{at_kp}: {wrong}")))?;
        let kd = kd.resolve("kd", joints).map_err(|wrong| problem(format!("{at_kd}: {wrong}")))?;
        return Ok(Some((Gains { kp, kd }, at_kp.clone())));
    }
    let usable = |gains: &Vec<f64>| gains.iter().all(|gain| gain.is_finite() && *gain >= 0.0);
    for source in sources {
        let Some((kp, kd)) = &source.gains else { continue };
        // One number is that of all joints; any other count must be that of the joints.
        let spread = |gains: &Vec<f64>| match gains.as_slice() {
            [one] => Some(vec![*one; joints.len()]),
            all => (all.len() == joints.len()).then(|| all.to_vec()),
        };
        if let (Some(kp), Some(kd)) = (spread(kp).filter(usable), spread(kd).filter(usable)) {
            return Ok(Some((Gains { kp, kd }, "the recording".to_owned())));
        }
    }
    Ok(None)
}

/// What the joints' columns called `prefix` hold, one row a sample; empty unless all joints have one.
fn of_all(prefix: &str, joints: &[String], columns: &IndexMap<String, Vec<f64>>, samples: usize) -> Vec<f64> {
    let series: Vec<&Vec<f64>> =
        joints.iter().filter_map(|joint| columns.get(&format!("{prefix}{joint}"))).collect();
    if series.len() == joints.len() { interleave(&series, samples) } else { Vec::new() }
}
