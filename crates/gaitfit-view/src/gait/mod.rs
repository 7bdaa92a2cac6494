//! A picture of a gait: which foot touches the ground when, how high feet are lifted, how well the base follows its
//! command, and at which frequencies the joints work.

mod data;
pub(crate) mod svg;

pub use data::{FootTrack, GaitPicture, TorqueSpectrum, VelocityTrack};

/// A self-contained SVG document of the gait: contacts, foot heights, commanded and measured velocity over time, and
/// the torque spectrum. Parts without data are left out; light or dark as the viewer prefers.
pub fn gait_picture_svg(gait: &GaitPicture) -> String {
    let drawn = svg::draw(gait);
    let inner = drawn.strip_prefix("<svg ").unwrap_or(r#"viewBox="0 0 1 1"></svg>"#);
    let style = include_str!("../page/style.css");
    // The document's root has the page's classes and colours, and the page's paper behind it.
    let (attributes, body) = inner.split_once('>').unwrap_or((inner, ""));
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" {attributes}><style>/*<![CDATA[*/\n{style}\
         svg {{ background: var(--paper); font-family: system-ui, sans-serif; }}/*]]>*/</style>{body}"
    )
}
