//! Tests of the robot side of costs.

use super::*;

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(ToString::to_string).collect()
}

fn recorded(position: &[f64], velocity: &[f64]) -> Recorded {
    Recorded { position: position.to_vec(), velocity: velocity.to_vec(), ..Recorded::default() }
}

#[test]
fn scale_maps_the_counted_range_to_two_and_names_constants() {
    let runs = [
        recorded(&[9.0, 1.0, 0.0, 1.0, 3.0, 1.0], &[0.0, 5.0, 1.0, 6.0, 2.0, 8.0]),
        recorded(&[9.0, 1.0, -1.0, 1.0], &[0.0, 0.0, 0.0, 7.0]),
    ];
    let reference = Reference::new(names(&["hip", "calf"]), &runs, 1).unwrap();
    let hip = &reference.dimensions(Signal::Position).unwrap()[0];
    assert_eq!((hip.min, hip.max, hip.scale), (-1.0, 3.0, Some(0.5)));
    assert_eq!(hip.sorted(), [-1.0, 0.0, 3.0]);
    assert_eq!(reference.constant(), [(Signal::Position, "calf")]);
    assert_eq!((reference.samples(0), reference.samples(1), reference.samples(2)), (3, 2, 0));
    assert!(!reference.has(Signal::Action));
}

#[test]
fn angles_that_are_left_out_are_not_constant_and_speeds_stay() {
    let joints = names(&["hip", "wheel"]);
    let run = recorded(&[0.0, 5.0, 1.0, 9.0], &[0.0, 4.0, 1.0, 6.0]);
    let reference = Reference::new(joints.clone(), &[run], 0).unwrap().without_angles(&joints[1..]);
    let scales =
        |signal| reference.dimensions(signal).unwrap().iter().map(|one| one.scale).collect::<Vec<_>>();
    assert_eq!(scales(Signal::Position), [Some(2.0), None]);
    assert_eq!(scales(Signal::Velocity), [Some(2.0), Some(1.0)]);
    assert!(reference.constant().is_empty());
    let rmse = crate::cost::position_rmse(&reference, 0, &[0.5, 100.0, 1.0, 200.0]).unwrap();
    assert_eq!((rmse.total, rmse.per_joint[0]), (0.125_f64.sqrt(), 0.125_f64.sqrt()));
    assert!(rmse.per_joint[1].is_nan());
}

#[test]
fn bad_references_are_named() {
    let joints = names(&["hip", "calf"]);
    let nan = recorded(&[0.0, 1.0, 2.0, 3.0], &[0.0, 1.0, 2.0, f64::NAN]);
    let error = Reference::new(joints.clone(), &[nan], 0).unwrap_err();
    assert_eq!(
        error,
        CostError::ReferenceNotFinite {
            signal: Signal::Velocity,
            of: "joint calf".into(),
            recording: 0,
            sample: 1
        }
    );
    let short = recorded(&[0.0, 1.0], &[0.0, 1.0]);
    assert!(matches!(Reference::new(joints.clone(), &[short], 1), Err(CostError::EmptyReference(_))));
    let ragged = recorded(&[0.0, 1.0, 2.0], &[0.0, 1.0, 2.0]);
    assert!(matches!(Reference::new(joints.clone(), &[ragged], 0), Err(CostError::Shape { .. })));
    assert!(matches!(Reference::new(joints, &[], 0), Err(CostError::EmptyReference(_))));
}

#[test]
fn trajectories_are_reordered_by_name() {
    let (position, velocity) = (vec![1.0, 2.0, 3.0, 4.0], vec![5.0, 6.0, 7.0, 8.0]);
    let trajectory = Trajectory {
        action: Some(vec![0.1, 0.2, 0.3, 0.4]),
        ..Trajectory::of_joints(names(&["calf", "hip"]), 50.0, vec![0.0, 0.02], position, velocity)
    };
    let recorded = Recorded::from_trajectory(&trajectory, &names(&["hip", "calf"]), 0).unwrap();
    assert_eq!(recorded.position, [2.0, 1.0, 4.0, 3.0]);
    assert_eq!(recorded.action.unwrap(), [0.2, 0.1, 0.4, 0.3]);
    let error = Recorded::from_trajectory(&trajectory, &names(&["knee"]), 4).unwrap_err();
    assert!(error.to_string().contains("recording 4 has no joint knee"));
}
