//! Encoders that slip or hang, and single wrong readings.

use super::*;

/// The row in which joint 0 is fastest.
fn fastest(log: &Trajectory) -> usize {
    let speed = |row: &usize| log.velocity[2 * row].abs();
    (100..400).max_by(|a, b| speed(a).total_cmp(&speed(b))).unwrap()
}

/// The kind, joints, first row and message of the finding among the three that this file is about.
fn gross(log: &Trajectory) -> Option<(FindingKind, Vec<String>, usize, String)> {
    let kinds = [FindingKind::PositionJump, FindingKind::FrozenPosition, FindingKind::VelocitySpike];
    let mut found =
        check(log, &CheckSpec::default()).into_iter().filter(|finding| kinds.contains(&finding.kind));
    let one = found.next()?;
    assert_eq!((found.next(), one.severity), (None, Severity::Warning));
    Some((one.kind, one.joints, one.span.unwrap().start, one.message))
}

#[test]
fn an_encoder_that_slips_once_or_often_is_named() {
    let healthy = healthy();
    assert_eq!(gross(&healthy), None);
    let row = fastest(&healthy);
    let mut slipped = healthy.clone();
    slipped.position[2 * row..].iter_mut().step_by(2).for_each(|q| *q += 0.6);
    let (kind, joints, first, message) = gross(&slipped).unwrap();
    assert_eq!((kind, &joints[..], first), (FindingKind::PositionJump, &["j0".to_owned()][..], row - 1));
    assert!(message.contains("jumps 1 time(s)") && message.contains("rad of j0"), "{message}");

    let mut spiked = healthy.clone();
    (37..500).step_by(37).for_each(|row| spiked.position[2 * row + 1] += 0.6);
    let (kind, joints, ..) = gross(&spiked).unwrap();
    assert_eq!((kind, &joints[..]), (FindingKind::PositionJump, &["j1".to_owned()][..]));

    // Between rows that were lost, positions change as far as they like.
    let mut gap = slipped;
    gap.time[row..].iter_mut().for_each(|time| *time += 0.05);
    assert_eq!(gross(&gap), None);
}

#[test]
fn positions_that_stand_still_while_the_joint_moves_are_named() {
    let healthy = healthy();
    let row = fastest(&healthy);
    let rows = row - 5..row + 5;
    let mut stuck = healthy.clone();
    rows.clone().for_each(|at| stuck.position[2 * at] = healthy.position[2 * rows.start]);
    let (kind, joints, first, message) = gross(&stuck).unwrap();
    assert_eq!((kind, &joints[..], first), (FindingKind::FrozenPosition, &["j0".to_owned()][..], row - 5));
    assert!(message.contains("The encoder was not read"), "{message}");

    let mut held = healthy.clone();
    for at in rows.clone() {
        held.position.copy_within(2 * rows.start..2 * rows.start + 2, 2 * at);
        held.velocity.copy_within(2 * rows.start..2 * rows.start + 2, 2 * at);
    }
    let (kind, _, first, message) = gross(&held).unwrap();
    assert_eq!((kind, first), (FindingKind::FrozenPosition, row - 5));
    assert!(message.contains("the positions of all joints stand still"), "{message}");

    // A joint that rests may repeat its position.
    let mut rests = simulate(2, 5.0, |t, joint| if joint == 0 { wave(t, 0) } else { 0.5 }, 0.0, &[1]);
    rests.position.iter_mut().skip(1).step_by(2).for_each(|q| *q = 0.5);
    assert_eq!(gross(&rests), None);
}

#[test]
fn long_rests_with_noisy_velocities_wraps_and_low_rates_are_no_faults() {
    // Positions of three decimals, and velocities with a deviation of 0.1 rad/s.
    let mut rests = simulate(2, 60.0, |t, joint| wave(t.min(20.0), joint), 0.0, &[]);
    for (at, dq) in rests.velocity.iter_mut().enumerate() {
        *dq += 0.35 * ((at * 7919 % 1009) as f64 / 1009.0 - 0.5);
    }
    rests.position.iter_mut().for_each(|q| *q = (*q * 1e3).round() / 1e3);
    assert_eq!(gross(&rests), None);

    let mut wraps = healthy();
    let row = fastest(&wraps);
    wraps.position[2 * row..].iter_mut().step_by(2).for_each(|q| *q -= std::f64::consts::TAU);
    assert_eq!(gross(&wraps), None);

    let mut slow = healthy();
    slow.position[2 * row..].iter_mut().step_by(2).for_each(|q| *q += 0.6);
    assert!(gross(&slow).is_some());
    slow.time.iter_mut().for_each(|time| *time *= 10.0);
    assert_eq!(gross(&slow), None, "between rows of 20 Hz a servo finishes a step");
}

#[test]
fn a_velocity_of_one_sample_is_named() {
    let mut log = healthy();
    let row = fastest(&log);
    log.velocity[2 * row] = 300.0;
    let (kind, joints, first, message) = gross(&log).unwrap();
    assert_eq!((kind, &joints[..], first), (FindingKind::VelocitySpike, &["j0".to_owned()][..], row));
    assert!(message.contains("1 spike(s)") && message.contains("300 rad/s of j0"), "{message}");
}
