//! Policies of legged robots: what they see and do, their networks, and what they do on a robot. `gaitfit-policy-files`
//! reads and writes their files.
//!
//! Everything is batched: arrays of rows, one row an environment, row-major, never an object an environment. Joints
//! are in the order of [`Interface::joints`] and matched to a model by name.

mod anchor;
mod base_sample;
mod check;
mod error;
pub mod follow;
pub mod frames;
mod front;
mod function;
pub mod graph;
mod held;
mod history;
mod interface;
pub mod network;
pub mod observation;
mod pilot;
mod policy;
pub mod predict;
mod quantity;
mod reference;
mod term;
mod velocity_joints;
pub mod walker;

pub use base_sample::BaseSample;
pub use error::{PolicyError, invalid};
pub use front::{Encoder, Front, Latent};
pub use function::{Act, Function};
pub use graph::{Frames, Graph, Inputs, Taken};
pub use held::{ActionClip, Held};
pub use history::{FrameOrder, History, HistoryStart};
pub use interface::{Interface, InterfaceError};
pub use pilot::{Pilot, clock, target};
pub use policy::{Policy, Provenance, RobotFile};
pub use quantity::{OfBase, Quantity, Source, Width};
pub use reference::{AnchorJoint, MotionPlace, Reference};
pub use term::Term;
