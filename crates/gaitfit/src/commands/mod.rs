//! The commands, one file each.

pub mod adapt;
pub mod bench;
pub mod collect;
pub mod config;
pub mod doctor;
pub mod evaluate;
pub mod export;
pub mod finetune;
pub mod forward;
pub mod inspect;
pub mod loop_;
pub mod reproduce;
pub mod train;
