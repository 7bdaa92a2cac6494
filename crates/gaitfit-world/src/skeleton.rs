//! Bones for robots, or parts of them, without geoms that could be drawn: from a body's origin to those of its children.

use gaitfit_model::Model;
use gaitfit_view::replay::{Geom, Shape};

/// Radius of a bone as a share of its length, and its maximum, m.
const THIN: f64 = 0.1;
const THICKEST: f64 = 0.05;
/// Bones shorter than this are not drawn, m.
const SHORTEST: f64 = 1e-3;

/// Bones of all bodies without a geom, or with balls alone, as feet are in files whose links are meshes. A body at the end of
/// a limb gets one to its ball, or else to its centre of mass. `carrier`: the drawn body of each body of the model.
pub(crate) fn bones(model: &Model, carrier: &[usize]) -> Vec<Geom> {
    let geoms = |body: usize| model.geoms.iter().filter(move |geom| geom.body == body);
    let ball = |geom: &gaitfit_model::Geom| matches!(geom.shape, gaitfit_model::Shape::Sphere { .. });
    let bare = |body: usize| geoms(body).all(ball);
    let mut bones = Vec::new();
    for (index, body) in model.bodies.iter().enumerate() {
        // A link without a shape is drawn as the line to the joint of its child.
        if let Some(parent) = body.parent.filter(|&parent| bare(parent)) {
            bones.extend(bone(carrier[parent], body.pos));
        }
        // A body without mass and geoms marks a place, such as a foot's; it gets no bone.
        let end = !model.bodies.iter().any(|other| other.parent == Some(index));
        if end && bare(index) && (body.mass > 0.0 || geoms(index).next().is_some()) {
            // A bare body has balls alone, so the first geom is one.
            let to = geoms(index).next().map_or(body.ipos, |ball| ball.pos);
            bones.extend(bone(carrier[index], to));
        }
    }
    bones
}

/// A capsule from the origin of a drawn body to a point of it.
fn bone(body: usize, end: [f64; 3]) -> Option<Geom> {
    let length = end.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !(length >= SHORTEST && length.is_finite()) {
        return None;
    }
    let [x, y, z] = end.map(|x| x / length);
    // The turn of z into the bone's direction; half a turn about x where that is opposite.
    // (1 + cos, sin × axis), normalised, is the shortest rotation; it has no direction where the cosine is −1.
    let quaternion = if z > -0.999_999 {
        let norm = (2.0 * (1.0 + z)).sqrt();
        [(1.0 + z) / norm, -y / norm, x / norm, 0.0]
    } else {
        [0.0, 1.0, 0.0, 0.0]
    };
    Some(Geom {
        body,
        shape: Shape::Capsule { radius: (THIN * length).min(THICKEST), half_length: 0.5 * length },
        position: end.map(|x| 0.5 * x),
        quaternion,
        foot: None,
    })
}
