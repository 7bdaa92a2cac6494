//! The commands, one file each.

pub mod adapt;
pub mod bench;
pub mod config;
pub mod doctor;
pub mod forward;
pub mod inspect;
