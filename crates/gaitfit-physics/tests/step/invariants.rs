//! What holds whatever the numbers: energy, momentum, mirror symmetry, the equation of motion written out.

mod friction;
mod gears;
mod links;
mod motor;
mod parameters;

use std::collections::BTreeSet;

use crate::common::kinematics::{center, kinetic, mass, momentum, potential, sub};
use crate::common::random::{Random, qpos};
use crate::common::{Arrays, Ledger, clamped, converged, difference, here, largest, relative, robot};
use gaitfit_model::{Cone, Model};
use gaitfit_physics::in_f64::{accelerate, step};
use gaitfit_physics::{
    Drive, Forward, Params, Preset, Robot, RowKind, Settings, Slot, State, Tree, Work, acceleration, bias,
    compile, constraint_rows, mass_matrix, state_from, state_to,
};

/// The robot without anything that takes or gives energy: no contacts, limits, friction, damping, and no springs
/// unless asked for.
fn frictionless(mut model: Model, springs: bool) -> Model {
    model.pairs.clear();
    for joint in &mut model.joints {
        (joint.range, joint.damping, joint.frictionloss) = (None, 0.0, 0.0);
        if !springs {
            joint.stiffness = 0.0;
        }
    }
    model
}

struct Sim {
    tree: Tree<f64>,
    params: Params<f64>,
    state: State<f64>,
    work: Work<f64>,
    drives: Vec<Drive<f64>>,
}

impl Sim {
    fn new(model: &Model, timestep: f64, qpos: &[f64], qvel: &[f64]) -> Self {
        let tree = compile::<f64>(model, &Settings { timestep, ..converged(model) }).unwrap();
        let params = Robot::nominal(model).params(model).unwrap();
        let state = state_from(&tree, qpos, qvel).unwrap();
        let (work, drives) = (Work::new(&tree), vec![Drive::zero(); tree.joints()]);
        Self { tree, params, state, work, drives }
    }

    fn step(&mut self) {
        step(&self.tree, &self.params, &self.drives, &mut self.state, &mut self.work);
    }

    fn read(&self) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let (qpos, qvel) = state_to(&self.tree, &self.state);
        (mass_matrix(&self.tree, &self.params, &self.state), qpos, qvel)
    }

    fn energy(&self, model: &Model) -> f64 {
        let (m, qpos, qvel) = self.read();
        kinetic(&m, &qvel) + potential(model, &qpos)
    }
}

/// Error of a quantity after `seconds` at steps h, h/2 and h/4 must halve with h: the integrator is of first order.
fn halves(label: &str, model: &Model, seconds: f64, error: &dyn Fn(&mut Sim, usize) -> f64) {
    let mut random = Random(3);
    let qpos = qpos(model, &mut random, 1.0, true, 0.0);
    let qvel = random.signed(model.nv(), 2.0);
    let errors = [1e-3, 5e-4, 2.5e-4].map(|h| {
        let mut sim = Sim::new(model, h, &qpos, &qvel);
        error(&mut sim, (seconds / h).round() as usize)
    });
    let ratios = [errors[0] / errors[1], errors[1] / errors[2]];
    let shown = errors.map(|e| format!("{e:.1e}")).join(", ");
    println!("{label}: errors {shown} at 1, 0.5, 0.25 ms, ratios {ratios:.2?}");
    for ratio in ratios {
        assert!((1.7..2.3).contains(&ratio), "{label}: {errors:?} does not halve with the step");
    }
}

#[test]
fn energy_is_conserved_in_flight_and_swing() {
    let robots = [
        ("go2", frictionless(robot("go2"), true)),
        ("humanoid", frictionless(robot("humanoid"), true)),
        ("biped with springs", frictionless(robot("biped"), true)),
        ("arm with a spring", frictionless(robot("arm"), true)),
        ("clamped go2", frictionless(clamped("go2"), true)),
    ];
    for (label, model) in robots {
        halves(&format!("energy, {label}"), &model, 0.1, &|sim, steps| {
            let before = sim.energy(&model);
            let (m, _, qvel) = sim.read();
            let scale = kinetic(&m, &qvel);
            for _ in 0..steps {
                sim.step();
            }
            let error = (sim.energy(&model) - before).abs() / scale;
            assert!(error < 0.05, "{label}: energy changes by {error} of the kinetic energy");
            error
        });
    }
}

/// A spring of the model and the same one as a robot's parameters, torque = spring_torque − stiffness · angle.
#[test]
fn a_spring_of_the_parameters_is_one_of_the_model() {
    let plain = frictionless(robot("go2"), false);
    let (stiffness, rest) = ([75.0, 12.0], [-1.9, 0.6]);
    let mut sprung = plain.clone();
    let mut robot = Robot::nominal(&plain);
    for (j, (stiffness, rest)) in stiffness.into_iter().zip(rest).enumerate() {
        (sprung.joints[j].stiffness, sprung.joints[j].springref) = (stiffness, rest);
        (robot.stiffness[j], robot.spring_torque[j]) = (stiffness, stiffness * rest);
    }
    let mut random = Random(4);
    let (q, v) = (qpos(&plain, &mut random, 1.0, true, 0.0), random.signed(plain.nv(), 2.0));
    let move_on = |mut sim: Sim| {
        (0..50).for_each(|_| sim.step());
        let (_, qpos, qvel) = sim.read();
        [qpos, qvel].concat()
    };
    let modelled = move_on(Sim::new(&sprung, 1e-3, &q, &v));
    let mut sim = Sim::new(&plain, 1e-3, &q, &v);
    let without = move_on(Sim::new(&plain, 1e-3, &q, &v));
    sim.params = robot.params(&plain).unwrap();
    let found = move_on(sim);
    assert!(relative(&found, &modelled) < 1e-9, "{found:?} {modelled:?}");
    assert!(relative(&found, &without) > 1e-2, "it acts");
}

/// Torques between the links move no robot as a whole; gravity is off.
#[test]
fn momentum_is_conserved_under_internal_torques() {
    for name in ["go2", "humanoid", "biped"] {
        let mut model = frictionless(robot(name), true);
        model.options.gravity = [0.0; 3];
        let drift = |angular: bool| {
            let model = &model;
            move |sim: &mut Sim, steps: usize| {
                let torques = Random(5).signed(sim.drives.len(), 5.0);
                for (drive, torque) in sim.drives.iter_mut().zip(torques) {
                    drive.torque = torque;
                }
                let read = |sim: &Sim| {
                    let (m, qpos, qvel) = sim.read();
                    momentum(model, &m, &qpos, &qvel)
                };
                let before = read(sim);
                for _ in 0..steps {
                    sim.step();
                }
                let after = read(sim);
                let (a, b) = if angular { (after.1, before.1) } else { (after.0, before.0) };
                relative(&a, &b)
            }
        };
        halves(&format!("linear momentum, {name}"), &model, 0.05, &drift(false));
        halves(&format!("angular momentum, {name}"), &model, 0.05, &drift(true));
    }
}

/// Derivatives of momentum along the motion, from accelerations alone: no integrator, so to rounding of the
/// difference quotient. Without gravity both vanish; with it the force is the weight.
#[test]
fn momentum_changes_by_the_weight_alone() {
    let mut ledger = Ledger::default();
    for name in ["go2", "humanoid", "biped"] {
        let model = frictionless(robot(name), true);
        let mut forward = Forward::new(&model, &converged(&model)).unwrap();
        let mut random = Random(17);
        for _ in 0..10 {
            let q = qpos(&model, &mut random, 1.0, true, 0.0);
            let v = random.signed(model.nv(), 2.0);
            let ctrl = random.signed(model.nu(), 1.0);
            let qacc = forward.evaluate(&q, &v, &ctrl).unwrap().qacc;
            let h = 2e-6;
            let mut at = |t: f64| {
                let (q, v) = moved(&q, &v, &qacc, t);
                let m = forward.evaluate(&q, &v, &ctrl).unwrap().mass;
                momentum(&model, &m, &q, &v)
            };
            let (after, before) = (at(h), at(-h));
            let force = sub(after.0, before.0).map(|x| x / (2.0 * h));
            let moment = sub(after.1, before.1).map(|x| x / (2.0 * h));
            let weight = model.options.gravity.map(|g| g * mass(&model));
            let scale = largest(&weight);
            ledger.note("force", difference(&force, &weight) / scale, 1e-6, || name.to_owned());
            ledger.note("moment", largest(&moment) / scale, 1e-6, || name.to_owned());
        }
    }
    ledger.check("change of momentum in flight");
}

/// Position and velocity `t` later to second order (floating robots).
fn moved(qpos: &[f64], qvel: &[f64], qacc: &[f64], t: f64) -> (Vec<f64>, Vec<f64>) {
    let rate = |i: usize| t * qvel[i] + 0.5 * t * t * qacc[i];
    let mut q = qpos.to_vec();
    for k in 0..3 {
        q[k] += rate(k);
    }
    let half = [0.5 * rate(3), 0.5 * rate(4), 0.5 * rate(5)];
    let angle = half.iter().map(|x| x * x).sum::<f64>().sqrt();
    let s = if angle > 0.0 { angle.sin() / angle } else { 1.0 };
    let turn = [angle.cos(), s * half[0], s * half[1], s * half[2]];
    let turned = crate::common::kinematics::product([qpos[3], qpos[4], qpos[5], qpos[6]], turn);
    q[3..7].copy_from_slice(&turned);
    for j in 7..q.len() {
        q[j] += rate(j - 1);
    }
    (q, qvel.iter().zip(qacc).map(|(v, a)| v + t * a).collect())
}

/// The mass matrix's momentum against mass times the velocity of the centre of mass, by a second kinematics; its
/// energy's derivative against the power of gravity and torques.
#[test]
fn kinetic_energy_agrees_with_a_second_kinematics() {
    let mut ledger = Ledger::default();
    for name in ["go2", "humanoid", "biped"] {
        let model = frictionless(robot(name), false);
        let mut forward = Forward::new(&model, &converged(&model)).unwrap();
        let mut random = Random(23);
        for _ in 0..10 {
            let q = qpos(&model, &mut random, 1.0, true, 0.0);
            let v = random.signed(model.nv(), 2.0);
            let zeros = vec![0.0; model.nv()];
            let h = 1e-5;
            let place = || name.to_owned();
            let shifted = |t: f64| center(&model, &moved(&q, &v, &zeros, t).0);
            let speed = sub(shifted(h), shifted(-h)).map(|x| x / (2.0 * h));
            let m = forward.evaluate(&q, &v, &vec![0.0; model.nu()]).unwrap().mass;
            let linear = momentum(&model, &m, &q, &v).0.map(|x| x / mass(&model));
            ledger.note("velocity of the centre of mass", difference(&linear, &speed), 1e-8, place);

            let tree = forward.tree().clone();
            let params = forward.params().clone();
            let state = state_from(&tree, &q, &v).unwrap();
            let torques = random.signed(tree.joints(), 5.0);
            let drives: Vec<Drive<f64>> =
                torques.iter().map(|&torque| Drive { torque, ..Drive::zero() }).collect();
            let mut solved = state.clone();
            accelerate(&tree, &params, &drives, &mut solved, &mut Work::new(&tree));
            let qacc = acceleration(&tree, &solved);
            let energy = |t: f64| {
                let (q, v) = moved(&q, &v, &qacc, t);
                let m = mass_matrix(&tree, &params, &state_from(&tree, &q, &v).unwrap());
                kinetic(&m, &v) + potential(&model, &q)
            };
            let rate = (energy(h) - energy(-h)) / (2.0 * h);
            let power: f64 = torques.iter().zip(&v[6..]).map(|(t, v)| t * v).sum();
            let scale = kinetic(&m, &v);
            ledger.note("power", (rate - power).abs() / scale, 1e-6, place);
        }
    }
    ledger.check("finite differences");
}

/// M qacc + bias − τ − Jᵀf with the rows' forces written out, relative to the largest term, and the number of rows,
/// which must not be elliptic. The solver starts from joint accelerations `warm`.
fn imbalance(model: &Model, q: &[f64], v: &[f64], torques: &[f64], warm: &[f64]) -> (f64, usize) {
    let tree = compile::<f64>(model, &converged(model)).unwrap();
    let params = Robot::nominal(model).params(model).unwrap();
    let mut state = state_from(&tree, q, v).unwrap();
    state.qacc.copy_from_slice(warm);
    let drives: Vec<Drive<f64>> = torques.iter().map(|&torque| Drive { torque, ..Drive::zero() }).collect();
    let mut work = Work::new(&tree);
    let mut solved = state.clone();
    accelerate(&tree, &params, &drives, &mut solved, &mut work);
    let qacc = acceleration(&tree, &solved);
    let m = mass_matrix(&tree, &params, &state);
    let (n, first) = (tree.nv(), tree.nv() - tree.joints());
    let mut sum = bias(&tree, &params, &state);
    let mut scale = largest(&sum);
    for i in 0..n {
        let inertial: f64 = (0..n).map(|k| m[i * n + k] * qacc[k]).sum();
        sum[i] += inertial;
        scale = scale.max(inertial.abs());
    }
    for (j, joint) in model.joints.iter().enumerate() {
        let spring = joint.stiffness * (state.qpos[j] - joint.springref);
        sum[first + j] -= torques[j] - spring - joint.damping * state.qvel[j];
    }
    let rows = constraint_rows(&tree, &params, &state, &mut work);
    for row in &rows {
        let along: f64 = row.jacobian.iter().zip(&qacc).map(|(j, a)| j * a).sum();
        let pull = row.d * (along - row.aref);
        let force = match row.kind {
            RowKind::Friction(j) => -pull.clamp(-model.joints[j].frictionloss, model.joints[j].frictionloss),
            RowKind::Free(_) => {
                let loss = model.free_joint.map_or(0.0, |free| free.frictionloss);
                -pull.clamp(-loss, loss)
            }
            RowKind::Coupling(_) => -pull,
            RowKind::Limit(_) | RowKind::Contact(..) | RowKind::SelfContact(..) => -pull.min(0.0),
        };
        for (sum, j) in sum.iter_mut().zip(&row.jacobian) {
            *sum -= j * force;
            scale = scale.max((j * force).abs());
        }
    }
    (largest(&sum) / scale, rows.len())
}

#[test]
fn articulated_bodies_solve_the_dense_equation() {
    let mut ledger = Ledger::default();
    let robots = [
        ("go2", robot("go2")),
        ("humanoid", robot("humanoid")),
        ("biped", robot("biped")),
        ("arm", robot("arm")),
        ("clamped go2", clamped("go2")),
        ("clamped humanoid", clamped("humanoid")),
    ];
    for (name, model) in robots {
        let free = frictionless(model, true);
        let mut random = Random(29);
        for _ in 0..20 {
            let q = qpos(&free, &mut random, 1.0, true, 0.3);
            let (v, torques) = (random.signed(free.nv(), 5.0), random.signed(free.joints.len(), 20.0));
            let (error, rows) = imbalance(&free, &q, &v, &torques, &random.signed(free.joints.len(), 100.0));
            assert_eq!(rows, 0);
            ledger.note("M qacc + bias - tau", error, 1e-11, || name.to_owned());
        }
    }
    ledger.check("free robots");
}

/// The minimum of MuJoCo's problem is where the forces of all rows balance the motion.
#[test]
fn constraint_forces_balance() {
    let mut ledger = Ledger::default();
    for (name, file) in [
        ("go2", "states_go2_pyr_imp1_fl"),
        ("humanoid", "states_humanoid_pyr_imp1_fl"),
        ("biped", "states_biped_pyr_imp1_fl"),
        ("arm", "states_arm_pyr_imp1_fl"),
    ] {
        let model = robot(name);
        assert_eq!(model.options.cone, Cone::Pyramidal);
        let data = Arrays::open(&here(&format!("tests/fixtures/{file}.npz")));
        let mut random = Random(31);
        let mut rows = 0;
        for index in 0..data.len("qpos") {
            let torques = random.signed(model.joints.len(), 10.0);
            let warm = random.signed(model.joints.len(), 50.0);
            let (error, count) =
                imbalance(&model, data.row("qpos", index), data.row("qvel", index), &torques, &warm);
            ledger.note(name, error, 1e-9, || format!("state {index}, {count} rows"));
            rows += count;
        }
        assert!(rows > 100);
    }
    ledger.check("M qacc + bias - tau - J'f");
}

/// Where a joint nearly sticks, dry friction bends the cost within a narrow band of accelerations, and a line search
/// by Newton's method alone jumps from one side of the band to the other and back.
#[test]
fn line_search_does_not_flip_across_dry_friction() {
    let mut ledger = Ledger::default();
    let mut model = clamped("go2");
    model.pairs.clear();
    let n = model.joints.len();
    for joint in &mut model.joints {
        (joint.range, joint.damping) = (None, 0.0);
    }
    let mut random = Random(47);
    for trial in 0..1000 {
        let q = qpos(&model, &mut random, 0.0, false, 0.0);
        let (v, torques) = (random.signed(n, 0.1), random.signed(n, 1.5));
        let warm = random.signed(n, 40.0);
        let (error, _) = imbalance(&model, &q, &v, &torques, &warm);
        ledger.note("M qacc + bias - tau - J'f", error, 1e-9, || format!("trial {trial}"));
    }
    ledger.check("joints that nearly stick");
}

/// A URDF often begins with a massless link to which the trunk is welded.
#[test]
fn a_massless_base_and_a_load_move_as_what_is_welded_together() {
    let leg = r#"<body name="leg" pos="0.1 0 -0.1"><joint name="hip" axis="0 1 0"/>
        <inertial pos="0 0 -0.1" mass="0.5" diaginertia="0.002 0.002 0.001"/></body>"#;
    let trunk = r#"<inertial pos="0.02 0 0.01" mass="4" diaginertia="0.05 0.06 0.07"/>"#;
    let read = |base: &str| {
        let text = format!(
            r#"<mujoco><worldbody><body name="base"><freejoint/>{base}</body></worldbody>
               <actuator><motor joint="hip"/></actuator></mujoco>"#
        );
        gaitfit_model::read_mjcf_str(&text, &gaitfit_model::ReadOptions::default()).unwrap()
    };
    let plain = read(&format!("{trunk}{leg}"));
    let welded = read(&format!(r#"<body name="trunk">{trunk}{leg}</body>"#));
    let robot = |model: &Model, base_mass| Robot { base_mass, ..Robot::nominal(model) }.params(model);
    let (one, other) = (robot(&plain, 0.0).unwrap(), robot(&welded, 0.0).unwrap());
    for (a, b) in one.links.iter().zip(&other.links) {
        assert!((a.mass - b.mass).abs() < 1e-15, "{} {}", a.mass, b.mass);
        let pairs = a.com.iter().chain(&a.inertia).zip(b.com.iter().chain(&b.inertia));
        pairs.for_each(|(x, y)| assert!((x - y).abs() < 1e-15, "{x} {y}"));
    }
    let load = read(&format!(
        r#"{trunk}{leg}<body pos="0.03 0.05 0.08"><inertial pos="0 0 0" mass="2" diaginertia="1e-14 1e-14 1e-14"/></body>"#
    ));
    let loaded = Robot { payload_mass: 2.0, payload_position: [0.03, 0.05, 0.08], ..Robot::nominal(&welded) };
    let (one, other) = (loaded.params(&welded).unwrap(), robot(&load, 0.0).unwrap());
    let (one, other) = (&one.links[0], &other.links[0]);
    assert!((one.mass - 6.0).abs() < 1e-14 && (other.mass - 6.0).abs() < 1e-14);
    let pairs = one.com.iter().chain(&one.inertia).zip(other.com.iter().chain(&other.inertia));
    pairs.for_each(|(x, y)| assert!((x - y).abs() < 1e-13, "{x} {y}"));
    let wrong =
        Robot { payload_mass: -0.1, ..Robot::nominal(&plain) }.params(&plain).unwrap_err().to_string();
    assert!(wrong.contains("load") && wrong.contains("zero or positive"), "{wrong}");
    let refused = robot(&welded, -0.1).unwrap_err().to_string();
    assert!(refused.contains("body `base`") && refused.contains("zero or positive"), "{refused}");
    assert!(robot(&plain, -4.0).is_err(), "nothing is left of the base");
}
