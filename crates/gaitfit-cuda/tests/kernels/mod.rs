//! Programs that a control period is lowered to: what they compute, their text, and batches of robots on a GPU. One
//! program, because each that has the step compiles it anew.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

mod batches;
mod lowering;
mod text;
