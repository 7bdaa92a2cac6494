//! A program shared among threads, computed in `f64`, equals the step.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

mod common;

use common::{difference, feet, recorded, robot, samples, shared};
use gaitfit_model::{Cone, Model};
use gaitfit_physics::{Preset, Settings};

/// Holds the program of `lanes` threads against the step.
fn compare(label: &str, model: &Model, preset: Preset, lanes: usize, least_guarded: usize, limit: f64) {
    let settings = Settings { timestep: 0.005, ..Settings::new(&model.options, preset) };
    let (taps, substeps) = (2, 3);
    let (period, tree) = recorded(model, &settings, taps, substeps, true);
    let program = shared(&period, &tree, lanes, least_guarded);
    let mut worst = 0.0f64;
    for sample in samples(model, &settings, taps, substeps, true, false, 12) {
        worst = worst.max(difference(&program.evaluate(&sample.inputs), &sample.outputs));
    }
    let table = program.program.table.len();
    let (nodes, regions) = (program.program.nodes.len(), program.program.regions.len());
    println!(
        "{label}, {preset:?}, {lanes} lanes: {nodes} nodes, {regions} regions, {table} rows, off by {worst:.1e}"
    );
    assert!(worst <= limit, "{worst}");
}

#[test]
fn one_thread_computes_the_step() {
    let go2 = robot("go2");
    compare("go2", &go2, Preset::Fast, 1, 100, 0.0);
    compare("go2 feet", &feet(go2), Preset::Accurate, 1, 0, 0.0);
}

#[test]
fn a_quadruped_is_shared() {
    let go2 = robot("go2");
    for lanes in [2, 4] {
        for least_guarded in [0, usize::MAX] {
            compare("go2 feet", &feet(go2.clone()), Preset::Fast, lanes, least_guarded, 1e-11);
        }
        compare("go2", &go2, Preset::Accurate, lanes, 100, 1e-11);
    }
}

#[test]
fn an_elliptic_quadruped_is_shared() {
    let mut go2 = robot("go2");
    go2.options.cone = Cone::Elliptic;
    compare("elliptic go2 feet", &feet(go2), Preset::Accurate, 4, 100, 1e-9);
}

#[test]
fn two_legged_robots_are_shared() {
    compare("biped", &robot("biped"), Preset::Fast, 2, 100, 1e-11);
    compare("humanoid", &robot("humanoid"), Preset::Fast, 2, 100, 1e-11);
}
