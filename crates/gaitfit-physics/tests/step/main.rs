//! The step against MuJoCo's numbers, against itself in other scalars, and against what holds whatever the numbers. One
//! program, because each that has the step compiles it anew.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

#[path = "../common/mod.rs"]
mod common;
mod invariants;
mod lanes;
mod mujoco_fixtures;
mod mujoco_shared;
mod resid_act;
mod terrain;
mod tracing;
mod walk;
