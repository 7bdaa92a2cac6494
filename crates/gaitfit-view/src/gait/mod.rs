//! A picture of a gait: which foot touches the ground when, how high feet are lifted, how well the base follows its
//! command, and at which frequencies the joints work.

mod data;
mod drawing;

pub use data::{FootTrack, GaitPicture, TorqueSpectrum, VelocityTrack};

/// The picture as an element of a page: contacts, foot heights, commanded and measured velocity over time, and the
/// torque spectrum. Parts without data are left out; without any data it is empty.
pub(crate) fn inline(gait: &GaitPicture) -> String {
    let figure = drawing::draw(gait);
    if figure.is_empty() { String::new() } else { figure.inline() }
}
