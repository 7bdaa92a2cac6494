//! The commands, one file each.

pub mod adapt;
pub mod bench;
pub mod config;
pub mod doctor;
pub mod export;
pub mod forward;
pub mod inspect;
