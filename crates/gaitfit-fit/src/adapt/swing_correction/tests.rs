//! Simulated robots as their caller sees them.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;
use crate::adapt::Opening;
use crate::settings;
use crate::watch::Event;
use gaitfit_run::ErrorKind;
use std::ops::ControlFlow;
use std::path::Path;

#[test]
fn a_caller_sees_the_simulated_robots_and_can_stop_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let changes = [
        format!("policy={:?}", root.join("assets/go2-walk.safetensors")),
        // A few of the logs: it is stopped long before their correction ends.
        format!("logs=[{:?}]", root.join("examples/go2-ground/logs/trajectory_0[0-4].csv")),
        "base=\"free\"".to_owned(),
    ];
    let config: AdaptConfig = settings::load(None, &changes).unwrap();
    let (robots, total) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let stop_after_two = |event: Event<'_>| {
        match event {
            Event::Begin(work) => total.store(work.total, Ordering::Relaxed),
            Event::Step(step) => robots.store(step.done, Ordering::Relaxed),
            _ => (),
        }
        if robots.load(Ordering::Relaxed) < 2 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let watch = Watch::new(&stop_after_two);
    let Err(error) = Opening::new(&config, &root.join("fit.toml")).threads(2).watch(&watch).open() else {
        panic!("it was not stopped")
    };
    assert!(
        error.kind() == ErrorKind::Interrupted && error.to_string().contains("before the fit"),
        "{error}"
    );
    let (robots, total) = (robots.into_inner(), total.into_inner());
    assert!((2..=4).contains(&robots) && total >= FIRST_ROBOTS + ROUNDS * ROBOTS, "{robots} of {total}");
}
