//! The meshes that pictures show: found in both formats and through mended files, placed as in the file, left out where one is not there.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::mend::cube;
use gaitfit_model::rotation::{add, rotate};
use gaitfit_model::{Looks, ReadOptions, read};
use std::path::{Path, PathBuf};

/// A folder with a cube of edges 2 in `meshes`.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["meshes", "robots", "tasks"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
    }
    std::fs::write(folder.path().join("meshes/cube.stl"), cube()).unwrap();
    folder
}

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join("robots").join(name);
    std::fs::write(&path, text).unwrap();
    path
}

fn looks(path: &Path) -> Looks {
    read(path, &ReadOptions { lenient: true, add_floor: true, ..ReadOptions::default() })
        .unwrap()
        .looks()
        .clone()
}

/// The box of each mesh in its body's frame, with the body's name.
fn boxes(looks: &Looks) -> Vec<(String, [[f64; 2]; 3])> {
    let extent = |look: &gaitfit_model::Look| {
        let mut found = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
        for &vertex in &looks.meshes[look.mesh].vertices {
            let point = add(look.pos, rotate(look.quat, vertex));
            for k in 0..3 {
                found[k] = [found[k][0].min(point[k]), found[k][1].max(point[k])];
            }
        }
        (look.body.clone(), found)
    };
    looks.places.iter().map(extent).collect()
}

fn assert_box(found: &(String, [[f64; 2]; 3]), body: &str, wanted: [[f64; 2]; 3]) {
    assert_eq!(found.0, body);
    for (found, wanted) in found.1.iter().flatten().zip(wanted.iter().flatten()) {
        assert!((found - wanted).abs() < 1e-6, "{body}: {found}, not {wanted}");
    }
}

/// A robot of two bodies; `geoms` are in its leg.
fn mjcf(geoms: &str, more: &str) -> String {
    format!(
        "<mujoco><compiler meshdir=\"../meshes\"/><default><default class=\"small\"><mesh scale=\"0.01 0.02 -0.03\"/></default>\
         <default class=\"shown\"><geom type=\"mesh\" mass=\"0\" contype=\"0\" conaffinity=\"0\"/></default></default>\
         <asset><mesh class=\"small\" file=\"cube.stl\"/><mesh name=\"moved\" file=\"cube.stl\" scale=\"0.1 0.1 0.1\" refpos=\"1 0 0\" \
         refquat=\"1 0 0 1\"/><mesh name=\"gone\" file=\"gone.stl\"/></asset><worldbody><body name=\"trunk\"><freejoint/><geom size=\".1\"/>\
         <body name=\"leg\" pos=\"0 0 -.2\"><joint/><geom size=\".02\"/>{geoms}</body></body></worldbody>{more}</mujoco>"
    )
}

#[test]
fn meshes_lie_where_the_file_puts_them() {
    let folder = folder();
    let shown = "<geom class=\"shown\" mesh=\"cube\" pos=\"0 0 .5\" euler=\"0 90 0\"/><geom class=\"shown\" mesh=\"moved\"/>";
    let text = mjcf(&format!("{shown}<geom type=\"mesh\" mesh=\"gone\"/>"), "");
    let file = write(folder.path(), "r.xml", &text);
    let found = looks(&file);
    let found_boxes = boxes(&found);
    assert_eq!(found_boxes.len(), 2, "what collides is not shown beside what is seen: {found_boxes:?}");
    // Half sides 0.01, 0.02 and 0.03 m, z turned to x.
    assert_box(&found_boxes[0], "leg", [[-0.03, 0.03], [-0.02, 0.02], [0.49, 0.51]]);
    // The corner region x - 1 in -2 ... 0 of the file, then a quarter turn back about z, then the scale.
    assert_box(&found_boxes[1], "leg", [[-0.1, 0.1], [0.0, 0.2], [-0.1, 0.1]]);
    assert!(
        found.meshes.iter().all(|mesh| (mesh.vertices.len(), mesh.triangles.len()) == (8, 12)),
        "{found:?}"
    );
    // Twice the same mesh is one.
    let twice = write(folder.path(), "twice.xml", &mjcf(&shown.replace("moved", "cube"), ""));
    assert_eq!((looks(&twice).meshes.len(), looks(&twice).places.len()), (1, 2));
}

#[test]
fn links_show_their_visual_meshes_or_else_those_that_collide() {
    let folder = folder();
    let inertial = "<inertial><mass value=\"1\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial>";
    let mesh = |kind: &str, name: &str, scale: &str| {
        format!(
            "<{kind}><geometry><mesh filename=\"package://p/meshes/{name}.stl\" scale=\"{scale}\"/></geometry></{kind}>"
        )
    };
    let link = |name: &str, shapes: &str| format!("<link name=\"{name}\">{inertial}{shapes}</link>");
    let joint = |child: &str| {
        format!(
            "<joint name=\"{child}\" type=\"continuous\"><parent link=\"a\"/><child link=\"{child}\"/><limit effort=\"1\" \
             velocity=\"1\"/></joint>"
        )
    };
    let visual = mesh("visual", "cube", "0.1 0.1 0.1");
    let colliding = mesh("collision", "cube", "0.2 0.2 0.2");
    let text = [
        link("a", &(visual.clone() + &colliding)),
        link("b", &colliding),
        link("c", &(visual + &mesh("visual", "gone", "1 1 1"))),
        ["b", "c"].map(joint).concat(),
    ];
    let file = write(folder.path(), "r.urdf", &format!("<robot name=\"r\">{}</robot>", text.concat()));
    let found = boxes(&looks(&file));
    assert_eq!(found.len(), 2, "a link that lacks a mesh shows none: {found:?}");
    assert_box(&found[0], "a", [[-0.1, 0.1]; 3]);
    assert_box(&found[1], "b", [[-0.2, 0.2]; 3]);
    std::fs::write(folder.path().join("meshes/cube.stl"), &cube()[..100]).unwrap();
    assert_eq!(looks(&file), Looks::default(), "a damaged mesh");
}

#[test]
fn a_file_without_meshes_names_the_one_that_has_them() {
    let folder = folder();
    let file = write(folder.path(), "r.xml", &mjcf("<geom class=\"shown\" mesh=\"cube\"/>", ""));
    let model = read(&file, &ReadOptions { add_floor: true, ..ReadOptions::default() }).unwrap();
    let again = folder.path().join("tasks/mended.xml");
    let written = |source: Option<&str>| {
        std::fs::write(&again, model.to_mjcf(&[], source).unwrap()).unwrap();
        let again = read(&again, &ReadOptions::default()).unwrap();
        (again.looks().clone(), again)
    };
    let (found, read_again) = written(Some("../robots/r.xml"));
    assert_eq!(&found, model.looks());
    assert_eq!(found.places.len(), 1);
    assert!(std::ptr::eq(read_again.looks(), read_again.clone().looks()), "copies read the meshes once");
    for source in [None, Some("../robots/gone.xml"), Some("mended.xml"), Some("../meshes/cube.stl")] {
        assert_eq!(written(source).0, Looks::default(), "{source:?}");
    }
}
