//! A control period allocates nothing, in `f64` and in lanes.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]
#![allow(unsafe_code, reason = "an allocator can be counted only by being one")]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::batch::{networks, pack, pack_params, state_of, values};
use common::{Arrays, here, robot};
use gaitfit_model::{Cone, Model};
use gaitfit_physics::in_f64::control_period;
use gaitfit_physics::{
    Drive, Isa, Lanes, Period, Preset, Robot, Settings, Work, compile, memory_of, state_from, with_lanes,
};

struct Counting;

thread_local! {
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.set(CALLS.get() + 1);
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        CALLS.set(CALLS.get() + 1);
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        CALLS.set(CALLS.get() + 1);
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocator calls of this thread during `work`.
fn calls(work: impl FnOnce()) -> u64 {
    let before = CALLS.get();
    work();
    CALLS.get() - before
}

#[test]
fn the_counter_counts() {
    assert!(calls(|| drop(std::hint::black_box(vec![1, 2, 3]))) >= 2);
}

/// A pose with contacts, as a flat list.
fn pressed(model: &Model) -> Vec<f64> {
    let data = Arrays::open(&here("tests/fixtures/states_go2_pyr_imp1_fl.npz"));
    let tree = compile::<f64>(model, &Settings::new(&model.options, Preset::Fast)).unwrap();
    values(&state_from(&tree, data.row("qpos", 5), data.row("qvel", 5)).unwrap())
}

fn presets(model: &Model) -> impl Iterator<Item = (Model, Settings)> {
    let with = |cone| {
        let mut model = model.clone();
        model.options.cone = cone;
        model
    };
    [Preset::Fast, Preset::Accurate, Preset::Converged]
        .into_iter()
        .flat_map(|preset| [Cone::Pyramidal, Cone::Elliptic].map(|cone| (preset, cone)))
        .map(move |(preset, cone)| {
            let model = with(cone);
            let settings = Settings::new(&model.options, preset);
            (model, settings)
        })
        .collect::<Vec<_>>()
        .into_iter()
}

#[test]
fn f64_period_allocates_nothing() {
    for (model, settings) in presets(&robot("go2")) {
        let tree = compile::<f64>(&model, &settings).unwrap();
        let params = Robot::nominal(&model).params(&model).unwrap();
        let mut state = state_of::<f64>(&tree, &pressed(&model));
        let mut targets = [state.qpos.clone(), state.qpos.clone()].concat();
        let modifications = networks::<f64>(tree.joints());
        let mut memory = vec![0.0; memory_of(&modifications)];
        let (mut work, mut drives) = (Work::new(&tree), vec![Drive::zero(); tree.joints()]);
        let count = calls(|| {
            control_period(&mut Period {
                tree: &tree,
                params: &params,
                targets: &mut targets,
                disturbance: &[],
                modifications: &modifications,
                memory: &mut memory,
                substeps: 3,
                state: &mut state,
                work: &mut work,
                drives: &mut drives,
            });
        });
        assert_eq!(count, 0, "{settings:?}");
    }
}

fn lanes<T: Lanes>() {
    for (model, settings) in presets(&robot("go2")) {
        let tree = compile::<T>(&model, &settings).unwrap();
        let params = pack_params::<T>(&vec![Robot::nominal(&model).params(&model).unwrap(); T::LANES]);
        let mut state = state_of::<T>(&tree, &pack(&vec![pressed(&model); T::LANES]));
        let mut targets = [state.qpos.clone(), state.qpos.clone()].concat();
        let modifications = networks::<T>(tree.joints());
        let mut memory = vec![T::zero(); memory_of(&modifications)];
        let (mut work, mut drives) = (Work::new(&tree), vec![Drive::zero(); tree.joints()]);
        let count = calls(|| {
            T::control_period(&mut Period {
                tree: &tree,
                params: &params,
                targets: &mut targets,
                disturbance: &[],
                modifications: &modifications,
                memory: &mut memory,
                substeps: 3,
                state: &mut state,
                work: &mut work,
                drives: &mut drives,
            });
        });
        assert_eq!(count, 0, "{settings:?}");
    }
}

#[test]
fn lanes_allocate_nothing() {
    for isa in Isa::found() {
        with_lanes!(isa, T => lanes::<T>());
    }
}
