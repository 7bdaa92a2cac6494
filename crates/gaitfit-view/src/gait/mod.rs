//! A picture of a gait: which foot touches the ground when, how high feet are lifted, how well the base follows its
//! command, and at which frequencies the joints work.

mod data;
mod spectrum;

pub use data::{FootTrack, GaitPicture, TorqueSpectrum, VelocityTrack};
