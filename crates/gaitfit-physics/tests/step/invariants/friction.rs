//! Mirror symmetry, dry friction, and what presets and names share.

use super::*;

/// The Go2 with its left–right asymmetries (wiring in the trunk) taken out.
fn symmetric_go2() -> Model {
    let mut model = robot("go2");
    let base = &mut model.bodies[0];
    base.ipos[1] = 0.0;
    base.iquat = [1.0, 0.0, 0.0, 0.0];
    base.inertia = [0.02448, 0.098077, 0.107];
    model
}

/// The state as seen in a mirror at the plane y = 0.
fn mirror(model: &Model, state: &State<f64>) -> State<f64> {
    let mut seen = state.clone();
    let [w, x, y, z] = state.base_quaternion;
    seen.base_quaternion = [w, -x, y, -z];
    seen.base_position[1] = -state.base_position[1];
    seen.base_linear[1] = -state.base_linear[1];
    seen.base_angular = [-state.base_angular[0], state.base_angular[1], -state.base_angular[2]];
    for j in 0..state.qpos.len() {
        let (from, sign) = mirrored_joint(model, j);
        (seen.qpos[j], seen.qvel[j]) = (sign * state.qpos[from], sign * state.qvel[from]);
    }
    seen
}

/// The joint on the other side, and whether its angle changes sign.
fn mirrored_joint(model: &Model, j: usize) -> (usize, f64) {
    let name = &model.joints[j].name;
    let side = if &name[1..2] == "L" { "R" } else { "L" };
    let other = model.joint(&format!("{}{side}{}", &name[..1], &name[2..])).unwrap();
    (other, if name.contains("hip") { -1.0 } else { 1.0 })
}

#[test]
fn go2_is_left_right_symmetric() {
    let mut ledger = Ledger::default();
    for cone in [Cone::Pyramidal, Cone::Elliptic] {
        let mut model = symmetric_go2();
        model.options.cone = cone;
        let file = "states_go2_pyr_imp1_fl";
        let data = Arrays::open(&here(&format!("tests/fixtures/{file}.npz")));
        let mut random = Random(37);
        let mut rows = 0;
        for index in 0..data.len("qpos") {
            let mut sim = Sim::new(&model, 0.002, data.row("qpos", index), data.row("qvel", index));
            rows += constraint_rows(&sim.tree, &sim.params, &sim.state, &mut sim.work).len();
            let torques = random.signed(sim.drives.len(), 10.0);
            let mut image = Sim::new(&model, 0.002, data.row("qpos", index), data.row("qvel", index));
            image.state = mirror(&model, &sim.state);
            for j in 0..torques.len() {
                let (from, sign) = mirrored_joint(&model, j);
                sim.drives[j].torque = torques[j];
                image.drives[j].torque = sign * torques[from];
            }
            for _ in 0..10 {
                sim.step();
                image.step();
            }
            let (want_q, want_v) = state_to(&sim.tree, &mirror(&model, &sim.state));
            let (got_q, got_v) = state_to(&image.tree, &image.state);
            let place = || format!("{cone:?} state {index}");
            ledger.note("qpos", difference(&got_q, &want_q), 1e-9, place);
            ledger.note("qvel", difference(&got_v, &want_v), 1e-7, place);
        }
        assert!(rows > 100, "nothing touches");
    }
    ledger.check("mirror symmetry after 10 steps");
}

/// Without gravity and torques, dry friction only ever takes kinetic energy, and stops the joints.
#[test]
fn friction_loss_only_dissipates() {
    let mut model = clamped("go2");
    model.pairs.clear();
    model.options.gravity = [0.0; 3];
    for joint in &mut model.joints {
        (joint.range, joint.damping, joint.stiffness, joint.frictionloss) = (None, 0.0, 0.0, 0.4);
    }
    let mut random = Random(41);
    for _ in 0..5 {
        let q = qpos(&model, &mut random, 0.0, false, 0.0);
        let mut sim = Sim::new(&model, 1e-4, &q, &random.signed(model.nv(), 3.0));
        let energy = |sim: &Sim| {
            let (m, _, v) = sim.read();
            kinetic(&m, &v)
        };
        let first = energy(&sim);
        let mut last = first;
        for _ in 0..6000 {
            sim.step();
            let now = energy(&sim);
            // The integrator's own error is of the order of the step.
            assert!(now <= last + 1e-5 * first, "kinetic energy rises from {last} to {now} J");
            last = now;
        }
        println!("dry friction: {first:.3} J to {last:.1e} J in 0.6 s");
        assert!(last < 1e-3 * first, "{last} of {first} J are left");
    }
}

/// A torque below the dry friction holds a joint but for MuJoCo's slow creep; one above it moves it.
#[test]
fn dry_friction_holds_small_torques() {
    let mut model = clamped("go2");
    model.pairs.clear();
    model.options.gravity = [0.0; 3];
    for joint in &mut model.joints {
        (joint.range, joint.damping, joint.frictionloss) = (None, 0.0, 0.5);
    }
    for (torque, moves) in [(0.25, false), (1.0, true)] {
        let mut sim = Sim::new(&model, 1e-3, &vec![0.0; model.nq()], &vec![0.0; model.nv()]);
        sim.drives[2].torque = torque;
        for _ in 0..200 {
            sim.step();
        }
        println!("{torque} N·m against 0.5 N·m for 0.2 s: {:.2e} rad/s", sim.state.qvel[2]);
        assert_eq!(sim.state.qvel[2].abs() > 0.5, moves, "{torque} N·m: {} rad/s", sim.state.qvel[2]);
    }
}

/// Without constraints one Newton step solves the problem: all presets agree.
#[test]
fn presets_agree_in_flight() {
    let model = frictionless(robot("humanoid"), true);
    let mut random = Random(43);
    let q = qpos(&model, &mut random, 1.0, true, 0.0);
    let v = random.signed(model.nv(), 2.0);
    let ctrl = vec![0.0; model.nu()];
    let with = |preset| {
        let settings = Settings::new(&model.options, preset);
        Forward::new(&model, &settings).unwrap().evaluate(&q, &v, &ctrl).unwrap().next_qvel
    };
    let want = with(Preset::Converged);
    for preset in [Preset::Fast, Preset::Accurate] {
        assert!(relative(&with(preset), &want) < 1e-10, "{preset:?}");
    }
}

/// No two numbers have one name, and what is visited is what is changed.
#[test]
fn every_number_has_its_own_name() {
    for name in ["go2", "humanoid", "biped", "arm"] {
        let model = robot(name);
        let tree = compile::<f64>(&model, &converged(&model)).unwrap();
        let mut state = State::<f64>::new(&tree);
        let mut params = Robot::nominal(&model).params(&model).unwrap();
        let mut work = Work::<f64>::new(&tree);
        let mut next = 0.0;
        let mut of_state = Vec::new();
        state.visit_mut(|slot, number| name_and_count(slot, number, &mut of_state, &mut next));
        let mut of_params = Vec::new();
        params.visit_mut(|slot, number| name_and_count(slot, number, &mut of_params, &mut next));
        let mut of_work = Vec::new();
        work.visit_mut(&tree, |slot, number| name_and_count(slot, number, &mut of_work, &mut next));
        assert_eq!(of_state.len(), 3 * tree.joints() + 19);
        for names in [of_state, of_params, of_work] {
            let different: BTreeSet<&String> = names.iter().collect();
            assert_eq!(different.len(), names.len(), "{name}");
        }
        let mut seen = Vec::new();
        state.visit(|_, &number| seen.push(number));
        params.visit(|_, &number| seen.push(number));
        work.visit(&tree, |_, &number| seen.push(number));
        let want: Vec<f64> = (1..=seen.len()).map(|number| number as f64).collect();
        assert_eq!(seen, want, "{name}");
    }
}

/// Keeps a number's name and makes the number its place.
fn name_and_count(slot: Slot, number: &mut f64, names: &mut Vec<String>, next: &mut f64) {
    names.push(slot.to_string());
    *next += 1.0;
    *number = *next;
}

/// Contacts that are slower by some part are those of a model whose `solref` is longer by it.
#[test]
fn softer_ground_is_a_longer_time_constant() {
    let model = robot("go2");
    let softness = 0.7;
    let mut soft = model.clone();
    for pair in &mut soft.pairs {
        pair.solref[0] *= 1.0 + softness;
    }
    let mut changed = Robot::nominal(&model);
    changed.ground_softness = softness;
    fall_alike(&soft, &model, &changed);
}

/// Contacts with a larger first impedance are those of a model whose `solimp` says so. No curve rises above its end.
#[test]
fn firmer_ground_is_a_larger_first_impedance() {
    let model = robot("go2");
    for least in [0.6_f64, 0.97] {
        let mut firm = model.clone();
        for pair in &mut firm.pairs {
            pair.solimp[0] = pair.solimp[0].max(least.min(pair.solimp[1]));
        }
        assert!(firm.pairs.iter().any(|pair| pair.solimp[0] == least), "the feet get firmer");
        let mut changed = Robot::nominal(&model);
        changed.ground_impedance = least;
        fall_alike(&firm, &model, &changed);
    }
}

/// Drops the robot of the file `changed` and the robot `by_number` of the file `model` onto the ground; they move alike.
fn fall_alike(changed: &gaitfit_model::Model, model: &gaitfit_model::Model, by_number: &Robot) {
    for emulated_step in [None, Some(1e-3)] {
        let [by_file, by_number] =
            [(changed, &Robot::nominal(changed)), (model, by_number)].map(|(model, robot)| {
                let settings = Settings { emulated_step, ..converged(model) };
                let tree = compile::<f64>(model, &settings).unwrap();
                let params = robot.params(model).unwrap();
                let mut state = State::new(&tree);
                (state.base_position[2], state.base_linear[2]) = (0.31, -0.5);
                (0..12).for_each(|j| state.qpos[j] = [0.0, 0.9, -1.8][j % 3]);
                let (mut work, drives) = (Work::new(&tree), vec![Drive::zero(); 12]);
                for _ in 0..200 {
                    gaitfit_physics::in_f64::step(&tree, &params, &drives, &mut state, &mut work);
                }
                [state.base_position.to_vec(), state.qpos.clone(), state.qvel.clone()].concat()
            });
        assert!(by_file[2] < 0.3, "it fell onto the ground: {}", by_file[2]);
        for (a, b) in by_file.iter().zip(&by_number) {
            assert!((a - b).abs() < 1e-9, "{a} and {b}");
        }
    }
}
