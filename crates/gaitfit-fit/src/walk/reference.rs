//! The place of a log in the motion that its policy follows.

use gaitfit_log::Trajectory;
use gaitfit_model::significant;
use gaitfit_policy::observation::{Layout, Sensed};
use gaitfit_policy::{Interface, MotionPlace, Quantity};

/// The place of sample `row`; the motion's beginning, unturned, if the log does not state it.
pub fn place(log: &Trajectory, row: usize) -> MotionPlace {
    let stated = log.motion.as_deref().and_then(|motion| motion.get(2 * row..2 * row + 2));
    stated.map_or_else(MotionPlace::default, |place| MotionPlace { time: place[0], heading: place[1] })
}

/// Makes sure that a log of a policy with a motion states its place in it. Without these columns the motion begins with the log,
/// turned to face as the robot then does. Joints are in the policy's order. Returns what was assumed or is doubtful, in words.
///
/// # Errors
/// A log without the base's orientation, or with holes in it, if the policy observes [`Quantity::ReferenceOrientation`]; a
/// sentence.
pub fn settle(log: &mut Trajectory, interface: &Interface, name: &str) -> Result<Option<String>, String> {
    let Some(reference) = &interface.reference else { return Ok(None) };
    let quaternions = log.base.as_ref().and_then(|base| base.quaternion.as_deref());
    let turned = interface.observation.iter().any(|term| term.quantity == Quantity::ReferenceOrientation);
    let holes =
        |quaternions: &[f64]| quaternions.chunks_exact(4).position(|q| q.iter().any(|x| !x.is_finite()));
    // A hole matters if the policy observes the orientation, and in the first row if the motion is turned to face
    // as it.
    match quaternions.map(holes) {
        None if turned => {
            return Err(format!(
                "the policy observes {}, and the log has no orientation of the base: record columns base_quat_w, base_quat_x, \
                 base_quat_y, base_quat_z.",
                Quantity::ReferenceOrientation.name()
            ));
        }
        Some(Some(row)) if turned || (row == 0 && log.motion.is_none()) => {
            return Err(format!(
                "the policy follows a motion, which is turned by the orientation of the base, and the log has no orientation at \
                 {} s: cut the log there.",
                log.time.get(row).copied().unwrap_or_default()
            ));
        }
        _ => {}
    }
    // Behind its end a motion stands still, so a log that begins there is doubtful.
    if log.motion.is_some() {
        let (time, rows) = (place(log, 0).time, reference.samples(interface.joints.len()));
        let end = rows.saturating_sub(1) as f64 / reference.rate_hz;
        return Ok((time > end).then(|| {
            format!(
                "{name}: it begins {} s after the beginning of a motion of {} s (column motion_time), where the motion stands \
                 still",
                significant(time, 4),
                significant(end, 4)
            )
        }));
    }
    let motion = assumed(log, interface);
    log.motion = motion;
    Ok(log.motion.is_some().then(|| {
        format!(
            "{name}: it does not state its place in the motion (columns motion_time, motion_heading); it is taken to begin with \
             the motion"
        )
    }))
}

/// The places of a log that begins with the motion, which faces then as the robot does; `None` for a log without samples.
fn assumed(log: &Trajectory, interface: &Interface) -> Option<Vec<f64>> {
    let mut sensed = Sensed::new(interface.joints.len());
    if let Some(quaternion) =
        log.base.as_ref().and_then(|base| base.quaternion.as_deref()?.first_chunk::<4>())
    {
        sensed.orientation = quaternion.map(|x| x as f32);
    }
    for (angle, &value) in sensed.joint_position.iter_mut().zip(&log.position) {
        *angle = value as f32;
    }
    let heading = Layout::new(interface, &interface.observation).motion_heading(&sensed);
    // Times in a motion count from its beginning, whatever the log's clock says.
    let first = *log.time.first()?;
    Some(log.time.iter().flat_map(|time| [time - first, heading]).collect())
}

/// Changes the orientation of a log by `turn`. The motion of a log whose place was assumed is turned with it.
pub fn turn_unit(log: &mut Trajectory, interface: &Interface, turn: impl FnOnce(&mut Trajectory)) {
    let is_assumed = interface.reference.is_some() && log.motion.is_some() && {
        let (Some(assumed), Some(stated)) = (assumed(log, interface), &log.motion) else { return turn(log) };
        // A place that equals the assumed one was assumed by `settle`. 1e-6 is rounding.
        assumed.iter().zip(stated).all(|(a, b)| (a - b).abs() < 1e-6)
    };
    turn(log);
    if is_assumed {
        log.motion = assumed(log, interface);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_log::{BaseState, ImuSettings};
    use gaitfit_model::rotation::{from_rpy, heading};
    use gaitfit_policy::{Reference, Term};

    /// A policy of one joint that follows a motion of two seconds, and a log of it that faces `yaw`.
    fn interface(quantity: Quantity) -> Interface {
        let reference = Reference {
            rate_hz: 1.0,
            position: vec![0.0; 3],
            velocity: vec![0.0; 3],
            orientation: [1.0, 0.0, 0.0, 0.0].repeat(3),
            anchor: Vec::new(),
            anchor_body: None,
        };
        Interface {
            velocity_joints: Vec::new(),
            robot: String::new(),
            joints: vec!["knee".into()],
            default_pose: vec![0.0],
            action_scale: vec![1.0],
            action_clip: None,
            kp: vec![1.0],
            kd: vec![1.0],
            held: Vec::new(),
            control_dt: 0.02,
            gait_frequency: None,
            reference: Some(reference),
            history: gaitfit_policy::History::default(),
            observation: vec![Term::new(quantity)],
            critic_observation: Vec::new(),
        }
    }

    fn log(yaw: f64) -> Trajectory {
        let time: Vec<f64> = (0..100).map(|row| 0.02 * f64::from(row)).collect();
        let base = BaseState {
            quaternion: Some(from_rpy(0.0, 0.0, yaw).repeat(time.len())),
            ..BaseState::default()
        };
        let log = Trajectory::of_joints(vec!["knee".into()], 50.0, time, vec![0.1; 100], vec![0.0; 100]);
        Trajectory { base: Some(base), ..log }
    }

    #[test]
    fn a_motion_turns_with_the_unit_that_showed_its_heading() {
        let interface = interface(Quantity::ReferenceOrientation);
        let mut one = log(0.4);
        settle(&mut one, &interface, "a").unwrap();
        assert!((place(&one, 50).heading - 0.4).abs() < 1e-6);
        let settings = ImuSettings { mounting: Some([0.0, 0.0, 90.0]), ..ImuSettings::default() };
        let turn = |log: &mut Trajectory| settings.apply(log.base.as_mut().unwrap());
        turn_unit(&mut one, &interface, turn);
        let first: [f64; 4] = *one.base.as_ref().unwrap().quaternion.as_ref().unwrap().first_chunk().unwrap();
        assert!((heading(first) - 0.4).abs() > 1.0);
        assert!((place(&one, 50).heading - heading(first)).abs() < 1e-6);
        // A stated place is the recorder's.
        let mut stated = Trajectory { motion: Some([0.5, 0.1].repeat(100)), ..log(0.4) };
        turn_unit(&mut stated, &interface, turn);
        assert_eq!(place(&stated, 50).heading, 0.1);
    }

    #[test]
    fn a_robot_that_starts_leaning_has_its_motion_turned_with_it() {
        use crate::walk::fixtures;
        let scene = fixtures::scene();
        let plain = fixtures::logs(&scene, &fixtures::policy(&scene, 3), true).remove(0);
        for pitch in [0.1, 1.0] {
            let mut log = Trajectory { motion: Some([0.0, 0.8].repeat(plain.len())), ..plain.clone() };
            log.base.as_mut().unwrap().quaternion = Some(from_rpy(0.0, pitch, 0.8).repeat(plain.len()));
            let script = crate::walk::simulator::script(&scene.walker, &log);
            // The simulated robot faces along x, and so must the motion.
            let faces = heading(script.start.base_quaternion.map(f64::from));
            assert!(
                faces.abs() < 1e-6 && (script.turned_back - 0.8).abs() < 1e-6,
                "{pitch}: {}",
                script.turned_back
            );
        }
    }

    #[test]
    fn holes_in_the_orientation_and_times_after_the_motion_are_named() {
        let broken = |row: usize| {
            let mut log = log(0.0);
            log.base.as_mut().unwrap().quaternion.as_mut().unwrap()[4 * row] = f64::NAN;
            log
        };
        let turned = interface(Quantity::ReferenceOrientation);
        let plain = interface(Quantity::ReferencePhase);
        assert!(settle(&mut broken(0), &plain, "a").unwrap_err().contains("no orientation at 0 s"));
        assert!(settle(&mut broken(50), &turned, "a").unwrap_err().contains("no orientation at 1 s"));
        assert!(settle(&mut broken(50), &plain, "a").is_ok());
        let mut late = Trajectory { motion: Some([50.0, 0.0].repeat(100)), ..log(0.0) };
        let note = settle(&mut late, &plain, "a").unwrap().unwrap();
        assert!(note.contains("50 s after the beginning of a motion of 2 s"), "{note}");
    }
}
