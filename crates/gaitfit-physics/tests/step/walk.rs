//! The quick presets on a walk with elliptic friction cones: MuJoCo's own steps, one after the other, each begun from
//! MuJoCo's state with the warm start of the step before (fixtures by tools/make_walk_fixtures.py).

use crate::common::random::Random;
use crate::common::{Arrays, here, largest};
use gaitfit_model::{Cone, Model, ReadOptions, read};
use gaitfit_physics::{Forward, Preset, Settings, state_from, state_to};

/// Root-mean-square error of a step's new velocity (norm over all degrees of freedom), and the share of steps off by
/// more than 0.01.
fn errors(model: &Model, preset: Preset, data: &Arrays) -> (f64, f64) {
    let (nq, nv, nu) = (model.nq(), model.nv(), model.nu());
    let mut forward = Forward::new(model, &Settings::new(&model.options, preset)).unwrap();
    let mut squares = Vec::new();
    for robot in 0..data.len("qpos") {
        let row = |name, width: usize, step: usize| &data.row(name, robot)[step * width..(step + 1) * width];
        let state_at = |forward: &Forward, step| {
            state_from(forward.tree(), row("qpos", nq, step), row("qvel", nv, step)).unwrap()
        };
        let mut last = state_at(&forward, 0);
        for step in 0..data.row("torque", robot).len() / nu {
            let mut state = state_at(&forward, step);
            state.base_acceleration = last.base_acceleration;
            state.qacc.clone_from(&last.qacc);
            forward.step(&mut state, row("torque", nu, step)).unwrap();
            let (_, got) = state_to(forward.tree(), &state);
            let square: f64 = got.iter().zip(row("qvel", nv, step + 1)).map(|(a, b)| (a - b).powi(2)).sum();
            // The first step has no warm start.
            if step > 0 {
                squares.push(square);
            }
            last = state;
        }
    }
    let count = squares.len() as f64;
    let off = squares.iter().filter(|&&square| square > 1e-4).count();
    ((squares.iter().sum::<f64>() / count).sqrt(), off as f64 / count)
}

#[test]
fn presets_walk_on_elliptic_cones_as_mujoco_does() {
    for impratio in [1, 100] {
        let data = Arrays::open(&here(&format!("tests/fixtures/walk_go2_ell_imp{impratio}.npz")));
        let mut model = read(&here("../../assets/go2.xml"), &ReadOptions::default()).unwrap();
        model.options.cone = Cone::Elliptic;
        model.options.impratio = f64::from(impratio);
        // Speeds of joints on this walk are 4 rad/s in the mean, and a full Newton step without a search errs by 5.
        let limits =
            [(Preset::Fast, 0.8, 0.03), (Preset::Accurate, 0.2, 0.01), (Preset::Converged, 1e-6, 0.0)];
        for (preset, mean, share) in limits {
            let (error, off) = errors(&model, preset, &data);
            println!("impratio {impratio}, {preset:?}: {error:.1e}, {:.1} % off", 100.0 * off);
            assert!(error <= mean, "impratio {impratio}, {preset:?}: off by {error}");
            assert!(off <= share, "impratio {impratio}, {preset:?}: {off} of the steps are off");
        }
    }
}

/// From random states, feet in the ground among them, the few iterations of the quick presets end near the minimum. A
/// line search that goes far beyond what it has looked at gets eight times as far from it in each iteration, in one of
/// forty of these states.
#[test]
fn quick_presets_do_not_run_away_on_elliptic_cones() {
    let mut model = read(&here("../../assets/go2.xml"), &ReadOptions::default()).unwrap();
    model.options.cone = Cone::Elliptic;
    model.options.impratio = 100.0;
    model.options.timestep = 0.005;
    for preset in [Preset::Fast, Preset::Accurate] {
        let mut forward = Forward::new(&model, &Settings::new(&model.options, preset)).unwrap();
        let mut random = Random(1);
        let (mut fastest, mut away) = (0.0f64, 0);
        for _ in 0..20_000 {
            let mut qpos = vec![0.0, 0.0, random.uniform(0.2, 0.4), 1.0];
            qpos.extend(random.signed(3, 0.3));
            qpos.extend((0..12).map(|joint| [0.0, 0.9, -1.8][joint % 3] + random.uniform(-0.3, 0.3)));
            let mut state = state_from(forward.tree(), &qpos, &random.signed(18, 1.5)).unwrap();
            for _ in 0..3 {
                forward.step(&mut state, &[0.0; 12]).unwrap();
            }
            let (_, velocities) = state_to(forward.tree(), &state);
            fastest = fastest.max(largest(&velocities));
            away += usize::from(!velocities.iter().all(|speed| speed.abs() < 100.0));
        }
        println!("{preset:?}: at most {fastest:.1} m/s or rad/s, {away} of 20,000 above 100");
        assert_eq!(away, 0, "{preset:?}");
    }
}
