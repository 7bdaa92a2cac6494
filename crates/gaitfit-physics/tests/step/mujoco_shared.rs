//! The engine against MuJoCo 4.0.0 on a Go2 with feet only, 200 states a file and falls and trots at 1 kHz.
//! The numbers lie beside the repository, not in it; so the tests are run on demand.

use std::path::PathBuf;

use crate::common::compare::{self, Limits};
use crate::common::{Arrays, Ledger, converged, difference, here};
use gaitfit_model::{Cone, Model, ReadOptions, read};
use gaitfit_physics::{Forward, state_from, state_to};

fn folder() -> PathBuf {
    here("../../../shared/data/mujoco_ref")
}

/// The robot with the numbers of a `fl` or `nofl` file.
fn go2(folder: &std::path::Path, cone: Cone, impratio: f64, altered: bool) -> Model {
    let mut model = read(&folder.join("go2_feet.xml"), &ReadOptions::default()).unwrap();
    model.options.cone = cone;
    model.options.impratio = impratio;
    if altered {
        for (j, joint) in model.joints.iter_mut().enumerate() {
            joint.frictionloss = [0.10, 0.15, 0.20][j % 3];
            joint.armature = [0.05, 0.08, 0.10][j % 3];
        }
    }
    model
}

const VARIANTS: [(&str, Cone, f64, bool); 8] = [
    ("pyr_imp1_nofl", Cone::Pyramidal, 1.0, false),
    ("pyr_imp1_fl", Cone::Pyramidal, 1.0, true),
    ("pyr_imp100_nofl", Cone::Pyramidal, 100.0, false),
    ("pyr_imp100_fl", Cone::Pyramidal, 100.0, true),
    ("ell_imp1_nofl", Cone::Elliptic, 1.0, false),
    ("ell_imp1_fl", Cone::Elliptic, 1.0, true),
    ("ell_imp100_nofl", Cone::Elliptic, 100.0, false),
    ("ell_imp100_fl", Cone::Elliptic, 100.0, true),
];

#[test]
#[ignore = "needs recordings of real robots and reference numbers in ../shared"]
fn shared_states() {
    let folder = folder();
    for (name, cone, impratio, altered) in VARIANTS {
        let data = Arrays::open(&folder.join(format!("states_{name}.npz")));
        let model = go2(&folder, cone, impratio, altered);
        let mut ledger = Ledger::default();
        let next = [(1, "next1"), (20, "next20")];
        let limits = Limits::promised(&model);
        compare::states(name, &model, &converged(&model), &data, &next, &limits, &mut ledger);
        ledger.check(name);
    }
}

/// Follows MuJoCo from every `stride`-th state of a rollout for `window` steps with the recorded torques.
fn follow(label: &str, model: &Model, data: &Arrays, stride: usize, window: usize, limit: f64) {
    let mut forward = Forward::new(model, &converged(model)).unwrap();
    let mut ledger = Ledger::default();
    let steps = data.len("torque");
    for start in (0..steps + 1 - window).step_by(stride) {
        let mut state = state_from(forward.tree(), data.row("qpos", start), data.row("qvel", start)).unwrap();
        for step in start..start + window {
            forward.step(&mut state, data.row("torque", step)).unwrap();
        }
        let (q, v) = state_to(forward.tree(), &state);
        let end = start + window;
        let place = || format!("steps {start} to {end}");
        ledger.note("qpos", difference(&q, data.row("qpos", end)), limit, place);
        ledger.note("qvel", difference(&v, data.row("qvel", end)), 100.0 * limit, place);
    }
    ledger.check(&format!("{label}, windows of {window} steps"));
}

/// Half a second of free flight.
#[test]
#[ignore = "needs recordings of real robots and reference numbers in ../shared"]
fn shared_flight() {
    let folder = folder();
    for (name, altered) in [("nofl", false), ("fl", true)] {
        let data = Arrays::open(&folder.join(format!("rollout_flight_{name}.npz")));
        let model = go2(&folder, Cone::Pyramidal, 1.0, altered);
        follow(&format!("flight {name}"), &model, &data, 500, 500, 1e-9);
    }
}

/// Windows of 20 ms of a trot: longer ones are chaotic where feet land.
#[test]
#[ignore = "needs recordings of real robots and reference numbers in ../shared"]
fn shared_trot() {
    let folder = folder();
    for (name, cone, impratio, altered) in VARIANTS {
        let data = Arrays::open(&folder.join(format!("rollout_trot_{name}.npz")));
        let model = go2(&folder, cone, impratio, altered);
        let limit = if cone == Cone::Elliptic { 1e-6 } else { 1e-10 };
        follow(&format!("trot {name}"), &model, &data, 40, 20, limit);
    }
}
