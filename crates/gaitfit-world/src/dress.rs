//! Robots of replays in the meshes of their files.

use gaitfit_model::mesh::ThinMesh;
use gaitfit_model::rotation::{Vec3, add, normalize, rotate};
use gaitfit_model::{Look, Model};
use gaitfit_view::replay::{Geom, Mesh, ReplayRobot, Shape};

/// The robot with the meshes of its file in the place of all geoms of their links but feet.
pub(crate) fn dressed(mut robot: ReplayRobot, model: &Model) -> ReplayRobot {
    let looks = model.looks();
    // If several drawn bodies have the same name, the last carries the geoms.
    let carrier = |name: &str| robot.bodies.iter().rposition(|body| body.name == name);
    let meshes = looks.places.iter().filter_map(|place| {
        let body = carrier(&place.body)?;
        let shape = Shape::Mesh { mesh: place.mesh };
        // A mesh that hides a foot lights up in its place.
        let foot = foot_within(&robot, body, &corners(place, &looks.meshes[place.mesh]));
        Some(Geom { body, shape, position: place.pos, quaternion: place.quat, foot })
    });
    let meshes: Vec<Geom> = meshes.collect();
    // A foot that only other links' meshes cover is drawn a little larger, so that its contact shows.
    let hidden = |foot: usize| !meshes.is_empty() && meshes.iter().all(|mesh| mesh.foot != Some(foot));
    for geom in robot.geoms.iter_mut().filter(|geom| geom.foot.is_some_and(hidden)) {
        geom.shape = grown(geom.shape);
    }
    robot.geoms.retain(|geom| geom.foot.is_some() || !meshes.iter().any(|mesh| mesh.body == geom.body));
    robot.geoms.extend(meshes);
    let mesh = |mesh: &ThinMesh| Mesh { vertices: mesh.vertices.clone(), triangles: mesh.triangles.clone() };
    robot.meshes = looks.meshes.iter().map(mesh).collect();
    robot
}

/// A foot's geom, a tenth thicker, so that it shows through the leg's mesh.
fn grown(shape: Shape) -> Shape {
    // A tenth of the smallest size, so that a long, flat shape does not become much longer.
    let by = |sizes: &[f64]| 0.1 * sizes.iter().copied().fold(f64::INFINITY, f64::min);
    match shape {
        Shape::Box { half } => Shape::Box { half: half.map(|side| side + by(&half)) },
        Shape::Sphere { radius } => Shape::Sphere { radius: radius + by(&[radius]) },
        Shape::Cylinder { radius, half_length } => {
            let more = by(&[radius, half_length]);
            Shape::Cylinder { radius: radius + more, half_length: half_length + more }
        }
        Shape::Capsule { radius, half_length } => {
            Shape::Capsule { radius: radius + by(&[radius]), half_length }
        }
        Shape::Mesh { .. } => shape,
    }
}

/// A mesh's vertices in its body's frame, m.
fn corners(place: &Look, mesh: &ThinMesh) -> Vec<Vec3> {
    mesh.vertices.iter().map(|&vertex| add(place.pos, rotate(place.quat, vertex))).collect()
}

/// The foot whose geoms a mesh hides: all of the mesh lies within or near their box. The mesh then shows the contact.
fn foot_within(robot: &ReplayRobot, body: usize, corners: &[Vec3]) -> Option<usize> {
    let geoms = |foot: usize| {
        let of_foot = move |geom: &&Geom| geom.body == body && geom.foot == Some(foot);
        robot.geoms.iter().filter(of_foot)
    };
    // A mesh without vertices shows nothing.
    if corners.is_empty() {
        return None;
    }
    (0..robot.feet.len()).find(|&foot| {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for geom in geoms(foot) {
            let half = half_box(geom);
            for k in 0..3 {
                low[k] = low[k].min(geom.position[k] - half[k]);
                high[k] = high[k].max(geom.position[k] + half[k]);
            }
        }
        // A mesh may be larger than the foot's geoms by half of their box. A shank is longer than that.
        let beside = (0..3).map(|k| 0.5 * (high[k] - low[k])).fold(0.0, f64::max);
        corners.iter().all(|point| (0..3).all(|k| (low[k] - beside..=high[k] + beside).contains(&point[k])))
    })
}

/// Half sides of a geom's box along the axes of its body.
fn half_box(geom: &Geom) -> Vec3 {
    let (half, round) = match geom.shape {
        Shape::Box { half } => (half, 0.0),
        Shape::Sphere { radius } => ([0.0; 3], radius),
        Shape::Cylinder { radius, half_length } => ([radius, radius, half_length], 0.0),
        Shape::Capsule { radius, half_length } => ([0.0, 0.0, half_length], radius),
        Shape::Mesh { .. } => ([0.0; 3], 0.0),
    };
    let quaternion = normalize(geom.quaternion);
    let axes = [0, 1, 2].map(|k| {
        let mut axis = [0.0; 3];
        axis[k] = half[k];
        rotate(quaternion, axis)
    });
    // The extent of a turned box along an axis is the sum of its half sides' shares. A round part adds its radius.
    std::array::from_fn(|k| round + axes.iter().map(|axis| axis[k].abs()).sum::<f64>())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::replay::shape;

    #[test]
    fn meshes_stand_for_all_geoms_but_feet() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        write("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4");
        let visual = |mesh: &str| {
            format!(
                "<geom type=\"mesh\" mesh=\"{mesh}\" mass=\"0\" contype=\"0\" conaffinity=\"0\" pos=\"0 0 -.2\"/>"
            )
        };
        let text = |visuals: &str| {
            format!(
                "<mujoco><asset><mesh name=\"sole\" file=\"m.obj\" scale=\".02 .02 .02\"/><mesh name=\"shank\" file=\"m.obj\" \
                 scale=\".03 .03 .2\"/></asset><worldbody><geom type=\"plane\" size=\"1 1 1\"/><body name=\"trunk\"><freejoint/>\
                 <geom size=\".1\"/><body name=\"leg\"><joint/><geom type=\"capsule\" fromto=\"0 0 0 0 0 -.2\" size=\".01\"/>\
                 <geom name=\"foot\" size=\".02\" pos=\"0 0 -.2\"/>{visuals}</body></body></worldbody></mujoco>"
            )
        };
        write("r.xml", &text(&(visual("sole") + &visual("shank"))));
        let read = |name: &str| gaitfit_model::read(&folder.path().join(name), &Default::default()).unwrap();
        let drawn = shape("r", &read("r.xml"), &["foot".to_owned()]);
        let geoms: Vec<_> = drawn.geoms.iter().map(|geom| (geom.body, geom.shape, geom.foot)).collect();
        assert_eq!(foot_within(&drawn, 1, &[[0.0, 0.0, -0.2]]), Some(0));
        assert_eq!(foot_within(&drawn, 1, &[]), None, "a mesh without vertices");
        let ball = |radius| Shape::Sphere { radius };
        let mesh = |mesh| Shape::Mesh { mesh };
        // The sole hides the foot's ball: it shows the contact too.
        assert_eq!(
            geoms,
            [(0, ball(0.1), None), (1, ball(0.02), Some(0)), (1, mesh(0), Some(0)), (1, mesh(1), None)]
        );
        // A shank hides it too, and is no foot: the ball shows through.
        write("shank.xml", &text(&visual("shank")));
        let drawn = shape("r", &read("shank.xml"), &["foot".to_owned()]);
        let geoms: Vec<_> = drawn.geoms.iter().map(|geom| (geom.shape, geom.foot)).collect();
        assert_eq!(geoms, [(ball(0.1), None), (ball(0.022), Some(0)), (mesh(0), None)]);
        write("bare.xml", &text(""));
        std::fs::remove_file(folder.path().join("m.obj")).unwrap();
        assert_eq!(
            shape("r", &read("r.xml"), &[]),
            shape("r", &read("bare.xml"), &[]),
            "without the file as before"
        );
    }
}
