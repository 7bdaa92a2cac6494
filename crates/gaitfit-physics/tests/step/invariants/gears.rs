//! Gears with play and compliance against the rigid joint, against finer steps, and against MuJoCo, which has a further
//! joint between each motor and its link.

use super::*;
use gaitfit_physics::in_f64::control_period;
use gaitfit_physics::{Gears, JointModification, Period, memory_of};

/// Time between samples, s.
const SAMPLE: f64 = 0.02;
const JOINTS: usize = 12;

/// A Go2's gears.
#[derive(Clone, Copy)]
struct Case {
    play: f64,
    compliance: f64,
    friction: f64,
    /// Whether the step has gears at all.
    gears: bool,
}

const RIGID: Case = Case { play: 0.0, compliance: 0.0, friction: 0.2, gears: false };

/// Motion of a clamped Go2 whose targets swing for a second: the motors' angles, and the links' angles minus
/// the motors', `samples × joints`, rad.
fn swing(case: Case, timestep: f64) -> [Vec<f64>; 2] {
    let model = clamped("go2");
    let tree = compile::<f64>(&model, &Settings { timestep, ..converged(&model) }).unwrap();
    let mut robot = Robot::nominal(&model);
    (robot.kp, robot.kd) = (vec![40.0; JOINTS], vec![1.0; JOINTS]);
    (robot.armature, robot.damping) = (vec![0.02; JOINTS], vec![0.1; JOINTS]);
    robot.frictionloss = vec![case.friction; JOINTS];
    (robot.play, robot.compliance) = (vec![case.play; JOINTS], vec![case.compliance; JOINTS]);
    let params = robot.params(&model).unwrap();
    let gears = [JointModification::Gears(Gears { joints: JOINTS })];
    let gears: &[JointModification<f64>] = if case.gears { &gears } else { &[] };
    let mut memory = vec![0.0; memory_of(gears)];
    let mut state = State::new(&tree);
    let rest = |j: usize| [0.0, 0.9, -1.8][j % 3];
    (0..JOINTS).for_each(|j| state.qpos[j] = rest(j));
    let (mut work, mut drives) = (Work::new(&tree), vec![Drive::zero(); JOINTS]);
    let mut found: [Vec<f64>; 2] = Default::default();
    for sample in 0..(1.0 / SAMPLE).round() as usize {
        found[0].extend(&state.qpos);
        found[1].extend((0..JOINTS).map(|j| memory.get(3 * j).copied().unwrap_or(0.0)));
        let time = sample as f64 * SAMPLE;
        let target = |j: usize| rest(j) + 0.25 * (7.0 * time + j as f64).sin() + 0.1 * (23.0 * time).sin();
        let mut targets: Vec<f64> = (0..JOINTS).map(target).collect();
        control_period(&mut Period {
            tree: &tree,
            params: &params,
            targets: &mut targets,
            disturbance: &[],
            modifications: gears,
            memory: &mut memory,
            substeps: (SAMPLE / timestep).round() as usize,
            state: &mut state,
            work: &mut work,
            drives: &mut drives,
        });
    }
    found
}

fn rms(a: &[f64], b: &[f64]) -> f64 {
    (a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

#[test]
fn a_gear_without_play_and_compliance_is_a_joint() {
    let [joint, _] = swing(RIGID, 1e-3);
    let [motor, offset] = swing(Case { gears: true, ..RIGID }, 1e-3);
    // Some residue stays: such a gear twists by 0.0002 rad under 1 N·m.
    assert!(rms(&joint, &motor) < 1.2e-3, "{}", rms(&joint, &motor));
    assert!(offset.iter().all(|twist| twist.abs() < 2e-3));
}

#[test]
fn links_stay_within_their_play() {
    let [_, offset] = swing(Case { play: 0.03, gears: true, ..RIGID }, 1e-3);
    assert!(offset.iter().all(|offset| offset.abs() < 0.017));
    for j in 0..JOINTS {
        let of_joint = || offset.iter().skip(j).step_by(JOINTS);
        assert!(
            of_joint().any(|&x| x > 0.014) && of_joint().any(|&x| x < -0.014),
            "joint {j} crosses its play"
        );
    }
}

#[test]
fn errors_fall_with_the_step() {
    for (play, compliance) in [(0.03, 0.0), (0.0, 0.004), (0.02, 0.004)] {
        let case = Case { play, compliance, gears: true, ..RIGID };
        let [fine, _] = swing(case, 1e-4);
        let [coarse, middle] = [4e-3, 1e-3].map(|timestep| rms(&swing(case, timestep)[0], &fine));
        assert!(middle < 1e-3 && middle < 0.4 * coarse, "{play}, {compliance}: {coarse} and {middle}");
    }
}

#[test]
fn motion_is_that_of_mujoco_with_a_joint_between_motor_and_link() {
    let data = Arrays::open(&here("tests/fixtures/gears.npz"));
    let [rigid, _] = swing(RIGID, 2e-4);
    // MuJoCo's dry friction lets a joint at rest creep, and its stops give way.
    for (name, play, compliance, friction, near) in [
        ("play", 0.03, 0.0, 0.2, 1.5e-3),
        ("twist", 0.0, 0.004, 0.2, 1.2e-3),
        ("smooth", 0.0, 0.004, 0.0, 3e-4),
    ] {
        let (motor, offset) = (data.all(&format!("{name}_motor")), data.all(&format!("{name}_offset")));
        let [angle, twist] = swing(Case { play, compliance, friction, gears: true }, 2e-4);
        let (angle, twist, joint) = (rms(&angle, motor), rms(&twist, offset), rms(&rigid, motor));
        println!("{name}: motors {angle:e} (rigid {joint:e}), links {twist:e}");
        assert!(angle < near && angle < 0.6 * joint, "{name}: {angle} from MuJoCo, a rigid joint {joint}");
        assert!(twist < 0.25 * rms(offset, &vec![0.0; offset.len()]), "{name}: {twist}");
    }
}
