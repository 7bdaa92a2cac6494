//! All integration tests of this crate.

mod clamped;
mod effects;
mod recorded;
mod walks;
