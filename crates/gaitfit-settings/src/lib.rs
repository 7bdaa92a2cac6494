//! The settings of gaitfit's stages, and the error with which a stage stops.
//!
//! [`settings`] has a struct for each configuration with its defaults, the reading of TOML with places and remedies, and the
//! checks. [`robot`] reads robot files, [`paths`] finds the files that a configuration names. The crate knows no stage.

mod error;
pub mod paths;
pub mod robot;
pub mod settings;
mod spring;

pub use error::Error;
pub use spring::{Spring, SpringError};

use gaitfit_run::{files, short_numbers};
