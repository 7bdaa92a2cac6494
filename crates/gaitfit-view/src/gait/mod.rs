//! A picture of a gait: which foot touches the ground when, how high feet are lifted, how well the base follows its
//! command, and at which frequencies the joints work.

mod data;
mod drawing;

pub use data::{FootTrack, GaitPicture, TorqueSpectrum, VelocityTrack};

/// A self-contained SVG document of the gait: contacts, foot heights, commanded and measured velocity over time, and
/// the torque spectrum. Parts without data are left out.
pub fn gait_picture_svg(gait: &GaitPicture) -> String {
    drawing::draw(gait).standalone()
}

/// The same as an element of a page; empty without any data.
pub(crate) fn inline(gait: &GaitPicture) -> String {
    let figure = drawing::draw(gait);
    if figure.is_empty() { String::new() } else { figure.inline() }
}
