//! What a joint's motor can do at its speed, and its friction at rest and in motion, against their formulas.

use super::*;
use gaitfit_physics::Period;
use gaitfit_physics::in_f64::control_period;

const KP: f64 = 50.0;
const KD: f64 = 1.5;

/// Torques and their falls with velocity at the start of a control period of one step: a joint a row of
/// `(target, velocity, no-load speed, stall torque, torque limit)`.
fn drives(rows: &[(f64, f64, f64, f64, f64)], implicit: bool) -> Vec<Drive<f64>> {
    let model = clamped("go2");
    let settings = Settings { implicit_actuators: implicit, ..converged(&model) };
    let tree = compile::<f64>(&model, &settings).unwrap();
    let joints = tree.joints();
    let mut robot = Robot::nominal(&model);
    (robot.kp, robot.kd) = (vec![KP; joints], vec![KD; joints]);
    let mut state = State::new(&tree);
    let mut targets = vec![0.0; joints];
    for (j, &(target, velocity, speed, stall, limit)) in rows.iter().enumerate() {
        (targets[j], state.qvel[j]) = (target, velocity);
        (robot.no_load_speed[j], robot.stall_torque[j], robot.torque_limit[j]) = (speed, stall, limit);
    }
    let mut drives = vec![Drive::zero(); joints];
    control_period(&mut Period {
        tree: &tree,
        params: &robot.params(&model).unwrap(),
        targets: &mut targets,
        disturbance: &[],
        modifications: &[],
        memory: &mut [],
        substeps: 1,
        state: &mut state,
        work: &mut Work::new(&tree),
        drives: &mut drives,
    });
    drives
}

/// Isaac Lab's `DCMotor._clip_effort`.
fn dc_motor(effort: f64, velocity: f64, speed: f64, stall: f64, limit: f64) -> f64 {
    let most = (stall * (1.0 - velocity / speed)).clamp(0.0, limit);
    let least = (stall * (-1.0 - velocity / speed)).clamp(-limit, 0.0);
    effort.clamp(least, most)
}

#[test]
fn a_motors_torque_falls_with_its_speed() {
    let mut random = Random(5);
    let (mut on_the_line, mut free, mut held, mut spent) = (0, 0, 0, 0);
    for _ in 0..40 {
        let row = |random: &mut Random| {
            let (target, velocity) = (random.uniform(-1.0, 1.0), random.uniform(-20.0, 20.0));
            (
                target,
                velocity,
                random.uniform(5.0, 25.0),
                random.uniform(15.0, 45.0),
                random.uniform(10.0, 25.0),
            )
        };
        let rows: Vec<_> = (0..12).map(|_| row(&mut random)).collect();
        let by = 1e-6;
        let moved =
            |by: f64| drives(&rows.iter().map(|r| (r.0, r.1 + by, r.2, r.3, r.4)).collect::<Vec<_>>(), true);
        let (found, up, down) = (drives(&rows, true), moved(by), moved(-by));
        for (j, &(target, velocity, speed, stall, limit)) in rows.iter().enumerate() {
            let effort = KP * target - KD * velocity;
            let wanted = dc_motor(effort, velocity, speed, stall, limit);
            assert!(
                (found[j].torque - wanted).abs() < 1e-12,
                "{:?}: {} and not {wanted}",
                rows[j],
                found[j].torque
            );
            assert_eq!(found[j].torque, drives(&rows, false)[j].torque);
            assert_eq!(drives(&rows, false)[j].damping, 0.0);
            let slope = -(up[j].torque - down[j].torque) / (2.0 * by);
            assert!(
                (found[j].damping - slope).abs() < 1e-6,
                "{:?}: {} and not {slope}",
                rows[j],
                found[j].damping
            );
            match wanted {
                _ if wanted == effort => free += 1,
                _ if wanted.abs() == limit => held += 1,
                0.0 => spent += 1,
                _ => on_the_line += 1,
            }
        }
    }
    let all = [on_the_line, free, held, spent];
    assert!(all.iter().all(|count| *count > 20), "{all:?}");
}

#[test]
fn a_motor_without_a_no_load_speed_has_its_limit_at_any_speed() {
    for velocity in [-1e3, 0.0, 1e3] {
        let found = drives(&[(100.0, velocity, f64::INFINITY, 30.0, 20.0)], true)[0];
        assert_eq!((found.torque, found.damping), (20.0, 0.0));
    }
}

#[test]
fn a_no_load_speed_needs_a_stall_torque() {
    let model = clamped("go2");
    let mut robot = Robot::nominal(&model);
    robot.stall_torque[3] = f64::INFINITY;
    assert!(robot.params(&model).is_ok());
    robot.no_load_speed[3] = 30.0;
    let error = robot.params(&model).unwrap_err().to_string();
    assert!(error.contains(&model.joints[3].name) && error.contains("stall_torque"), "{error}");
    robot.stribeck_velocity[2] = 0.0;
    let error = robot.params(&model).unwrap_err().to_string();
    assert!(error.contains("stribeck_velocity") && error.contains("0.001"), "{error}");
}

/// A step is that of a robot whose friction is constant at what the drives' torques make it.
#[test]
fn friction_grows_with_the_motors_torque() {
    let model = clamped("go2");
    let mut random = Random(9);
    let tree = compile::<f64>(&model, &converged(&model)).unwrap();
    let joints = tree.joints();
    let mut state = State::new(&tree);
    state.qvel = random.signed(joints, 0.5);
    let drives: Vec<Drive<f64>> =
        (0..joints).map(|j| Drive { torque: 1.3 * j as f64 - 7.0, ..Drive::zero() }).collect();
    let after = |robot: &Robot| {
        let mut state = state.clone();
        step(&tree, &robot.params(&model).unwrap(), &drives, &mut state, &mut Work::new(&tree));
        state.qvel
    };
    let mut loaded = Robot::nominal(&model);
    loaded.frictionloss.fill(0.2);
    let without = after(&loaded);
    loaded.load_friction = (0..joints).map(|j| 0.02 * j as f64).collect();
    let mut constant = Robot::nominal(&model);
    constant.frictionloss =
        (0..joints).map(|j| 0.2 + loaded.load_friction[j] * drives[j].torque.abs()).collect();
    let (found, wanted) = (after(&loaded), after(&constant));
    assert!(difference(&found, &wanted) < 1e-12, "{found:?} and not {wanted:?}");
    assert!(difference(&found, &without) > 1e-3, "friction under load does nothing");
}

/// The bound is that of the step's start: the step is that of a robot whose friction is constant at F(q̇).
#[test]
fn friction_falls_from_rest_to_motion() {
    let model = clamped("go2");
    let mut random = Random(8);
    let mut apart = 0.0f64;
    for scale in [0.0, 0.01, 0.1, 0.4, 3.0] {
        for damping in [gaitfit_physics::Damping::Implicit, gaitfit_physics::Damping::Folded] {
            let tree = compile::<f64>(&model, &Settings { damping, ..converged(&model) }).unwrap();
            let joints = tree.joints();
            let mut state = State::new(&tree);
            state.qvel = random.signed(joints, scale);
            let mut robot = Robot::nominal(&model);
            (robot.frictionloss, robot.stiction) = (vec![0.3; joints], random.signed(joints, 0.4));
            robot.stiction.iter_mut().for_each(|x| *x = x.abs());
            robot.stribeck_velocity = vec![0.15; joints];
            let mut constant = Robot::nominal(&model);
            for j in 0..joints {
                let part = (state.qvel[j] / robot.stribeck_velocity[j]).powi(2);
                constant.frictionloss[j] = 0.3 + robot.stiction[j] * (-part).exp();
            }
            let after = |robot: &Robot| {
                let mut state = state.clone();
                let drives: Vec<Drive<f64>> =
                    (0..joints).map(|j| Drive { torque: 0.3 * j as f64 - 1.5, ..Drive::zero() }).collect();
                let params = robot.params(&model).unwrap();
                step(&tree, &params, &drives, &mut state, &mut Work::new(&tree));
                state.qvel
            };
            let (found, wanted) = (after(&robot), after(&constant));
            assert!(difference(&found, &wanted) < 1e-12, "{found:?} and not {wanted:?}");
            robot.stiction.fill(0.0);
            apart = apart.max(difference(&found, &after(&robot)));
        }
    }
    assert!(apart > 1e-3, "friction at rest does nothing: {apart:e}");
}
