//! Masses and centres of mass of single links.

use super::*;
use gaitfit_physics::JointParameter;

/// What is changed: every link of the robot, by its own numbers.
fn changed(model: &Model, random: &mut Random) -> Robot {
    let mut robot = Robot::nominal(model);
    robot.link_mass.iter_mut().for_each(|x| *x = random.uniform(0.5, 2.0));
    for parameter in &JointParameter::LINKS[1..] {
        robot.joints_mut(*parameter).iter_mut().for_each(|x| *x = random.uniform(-0.03, 0.03));
    }
    robot
}

/// The same robot as a file would say it, so that all that is tested against MuJoCo holds for it.
#[test]
fn a_robot_with_other_links_is_that_of_a_file_with_other_bodies() {
    let mut random = Random(12);
    for name in ["go2", "humanoid", "arm"] {
        for model in [robot(name), clamped(name)] {
            let changed = changed(&model, &mut random);
            let mut other = model.clone();
            let (mut moved, mut turned) = (0, 0);
            for (body, change) in other.bodies.iter_mut().zip(changed.body_changes(&model)) {
                body.mass *= change.factor;
                body.inertia.iter_mut().for_each(|one| *one *= change.factor);
                (0..3).for_each(|k| body.ipos[k] += change.shift[k]);
                moved += usize::from(change.factor != 1.0);
                turned += usize::from(change.shift != [0.0; 3]);
            }
            assert!(moved > 3 && turned == moved, "{moved} bodies of {name}");
            let flat = |params: &Params<f64>| {
                let mut all = Vec::new();
                params.visit(|slot, &number| {
                    let of_joints =
                        matches!(slot.owner, gaitfit_physics::Owner::Joint(_)) && slot.name != "weight";
                    all.extend((!of_joints).then_some(number));
                });
                all
            };
            let found = flat(&changed.params(&model).unwrap());
            let wanted = flat(&Robot::nominal(&other).params(&other).unwrap());
            assert!(relative(&found, &wanted) < 1e-12, "{name}: {}", relative(&found, &wanted));
            assert!(relative(&found, &flat(&Robot::nominal(&model).params(&model).unwrap())) > 1e-2);
            // Of joint j's link, and no other.
            let mut one = Robot::nominal(&model);
            one.link_mass[1] = 1.5;
            let (before, after) =
                (Robot::nominal(&model).params(&model).unwrap(), one.params(&model).unwrap());
            for (link, (before, after)) in before.links.iter().zip(&after.links).enumerate() {
                let factor = if link == 2 { 1.5 } else { 1.0 };
                assert!((after.mass - factor * before.mass).abs() <= 1e-12 * before.mass);
                assert!(after.com == before.com || link == 2);
            }
        }
    }
}

#[test]
fn mirrored_legs_share_a_shift_sideways() {
    let model = robot("go2");
    let mut shifted = Robot::nominal(&model);
    shifted.link_com_y.fill(0.01);
    let body = |joint: &str| model.joints[model.find_joint(joint).unwrap()].body;
    for changes in [shifted.body_changes(&model), shifted.body_changes(&clamped("go2"))] {
        for (joint, side) in [("FL_thigh_joint", 1.0), ("FR_thigh_joint", -1.0), ("RR_calf_joint", -1.0)] {
            assert!((changes[body(joint)].shift[1] - side * 0.01).abs() < 1e-15, "{joint}");
        }
    }
}

/// Eigenvalues λ of an inertia about the centre of mass: each less than the sum of the two others, which is
/// tr(I)/2 − λ > 0.
#[test]
fn every_link_is_one_that_there_can_be() {
    let model = robot("humanoid");
    let mut random = Random(4);
    for _ in 0..20 {
        let robot = changed(&model, &mut random);
        // A body with several hinges has links without mass within.
        for link in robot.params(&model).unwrap().links.into_iter().filter(|link| link.mass > 0.0) {
            let [xx, yy, zz, xy, xz, yz] = link.inertia;
            let half = 0.5 * (xx + yy + zz);
            let (a, b, c) = (half - xx, half - yy, half - zz);
            // Of tr(I)/2 − I by Sylvester, with room for rounding.
            let minor = a * b - xy * xy;
            let whole = a * (b * c - yz * yz) + xy * (-xy * c - yz * xz) - xz * (xy * yz + b * xz);
            assert!(link.mass > 0.0 && a > 0.0 && minor > 0.0 && whole > -1e-12 * half.powi(3), "{link:?}");
        }
    }
    for (parameter, value, word) in [
        (JointParameter::LinkMass, 0.0, "0.001"),
        (JointParameter::LinkMass, f64::INFINITY, "finite"),
        (JointParameter::LinkComX, f64::NEG_INFINITY, "finite"),
        (JointParameter::LinkComZ, f64::NAN, "a number"),
        (JointParameter::Kp, f64::INFINITY, "finite"),
        (JointParameter::Stiffness, f64::NEG_INFINITY, "finite"),
    ] {
        let mut robot = Robot::nominal(&model);
        robot.joints_mut(parameter)[2] = value;
        let error = robot.params(&model).unwrap_err().to_string();
        assert!(error.contains(parameter.name()) && error.contains(word), "{error}");
    }
    let wrong = |name: &str, change: fn(&mut Robot)| {
        let mut robot = Robot::nominal(&model);
        change(&mut robot);
        let error = robot.params(&model).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("finite"), "{error}");
    };
    wrong("base_mass", |robot| robot.base_mass = f64::INFINITY);
    wrong("base_com", |robot| robot.base_com[1] = f64::NAN);
    wrong("payload_position", |robot| robot.payload_position[2] = f64::INFINITY);
}
