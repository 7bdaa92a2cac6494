//! Robot models: MJCF and URDF files compiled to a [`Model`], joints by name.
//!
//! [`read`] takes a path; the readers refuse what the engine does not honour, with file, line and
//! column, or drop and list it when asked to be lenient. Numbers mean what they mean in MuJoCo 4.0.

mod actuator;
mod attributes;
mod bodies;
mod compile;
mod contact;
mod defaults;
mod error;
mod geom;
mod inertia;
mod inertial;
mod joint;
mod keyframes;
mod mjcf;
mod model;
mod options;
mod orientation;
mod pairs;
mod read;
mod site;
mod spec;
mod summary;
mod urdf;
mod xml;

pub use error::{ModelError, Place};
pub use model::*;
pub use read::{ReadOptions, read, read_mjcf_str, read_urdf_str};
pub use summary::*;
