//! The commands, one file each.

pub mod adapt;
pub mod config;
pub mod doctor;
pub mod inspect;
