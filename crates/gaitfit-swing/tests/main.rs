//! All integration tests of this crate.

mod clamped;
mod recorded;
mod walks;
