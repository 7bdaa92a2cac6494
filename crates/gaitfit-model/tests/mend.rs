//! A mending reading: what it weighs and keeps, what it still refuses, and that a strict one is as before.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_model::{Form, Model, ReadOptions, Root, mesh, read, read_mjcf_str, read_urdf_str};
use std::path::Path;

fn mending() -> ReadOptions {
    ReadOptions { mend: true, add_floor: true, ..ReadOptions::default() }
}

fn inertial(mass: f64) -> String {
    format!(
        "<inertial><mass value=\"{mass}\"/><inertia ixx=\"{0}\" ixy=\"0\" ixz=\"0\" iyy=\"{0}\" iyz=\"0\" izz=\"{0}\"/></inertial>",
        0.01 * mass
    )
}

fn joint(name: &str, kind: &str, parent: &str, child: &str, more: &str) -> String {
    format!(
        "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin xyz=\"0 0 -0.2\"/>\
         <axis xyz=\"0 1 0\"/>{more}</joint>"
    )
}

const LIMIT: &str = "<limit lower=\"-1\" upper=\"2\" effort=\"9\" velocity=\"8\"/>";

fn urdf(body: &str) -> String {
    format!("<robot name=\"r\">{body}</robot>")
}

/// A cube of edges 2 in binary STL, as exporters write it.
pub fn cube() -> Vec<u8> {
    let corner = |index: usize| [0, 1, 2].map(|k| if index >> k & 1 == 0 { -1.0_f32 } else { 1.0 });
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces: Vec<[usize; 3]> = sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let mut bytes = vec![0; 80];
    bytes.extend((faces.len() as u32).to_le_bytes());
    for face in faces {
        bytes.extend([0; 12]);
        face.iter().for_each(|&index| bytes.extend(corner(index).iter().flat_map(|x| x.to_le_bytes())));
        bytes.extend([0; 2]);
    }
    bytes
}

fn says(model: &Model, words: &[&str]) {
    let all: Vec<String> =
        model.changed.iter().map(|change| format!("{} {}", change.what, change.how)).collect();
    for word in words {
        assert!(all.iter().any(|text| text.contains(word)), "`{word}` is not in {all:?}");
    }
}

#[test]
fn closed_loops_are_not_mended() {
    let looped = "<mujoco><worldbody><body name=\"a\"><freejoint/><geom size=\".1\"/><body name=\"b\"><joint/>\
                <geom size=\".1\"/></body><body name=\"c\"><joint/><geom size=\".1\"/></body></body>\
                </worldbody><equality><connect body1=\"b\" body2=\"c\" anchor=\"0 0 0\"/></equality></mujoco>";
    let refusal = read_mjcf_str(looped, &mending()).unwrap_err().to_string();
    assert!(refusal.contains("<connect>") && refusal.contains("closes a loop"), "{refusal}");
    let off = looped.replace("<connect ", "<connect active=\"false\" ");
    assert_eq!(read_mjcf_str(&off, &mending()).unwrap().joints.len(), 2);
    assert_eq!(read_mjcf_str(&off, &ReadOptions::default()).unwrap().joints.len(), 2);
}

#[test]
fn floating_joints_of_urdf_and_slides_with_a_ball_are_the_free_base() {
    let trunk =
        format!("<link name=\"trunk\">{}</link><link name=\"leg\">{}</link>", inertial(5.0), inertial(1.0));
    let hip = joint("hip", "revolute", "trunk", "leg", LIMIT);
    for world in [
        "<link name=\"world\"/>",
        "<link name=\"base\"><inertial><mass value=\"1e-6\"/><inertia ixx=\"1e-6\" ixy=\"1e-6\" ixz=\"1e-6\" iyy=\"1e-6\" iyz=\"1e-6\" izz=\"1e-6\"/></inertial></link>",
    ] {
        let name = world.split('"').nth(1).unwrap();
        let text = urdf(&format!("{world}{trunk}{hip}{}", joint("free", "floating", name, "trunk", "")));
        match read_urdf_str(&text, &ReadOptions::default()) {
            Ok(model) => {
                assert_eq!(
                    (model.root, model.bodies[0].name.as_str(), model.joints.len()),
                    (Root::Floating, "trunk", 1)
                );
                says(&model, &["a floating joint hangs \"trunk\" on it"]);
            }
            // Its inertia cannot be, and nothing of the robot is fixed to it.
            Err(error) => assert!(name == "base" && error.to_string().contains("A + B >= C"), "{error}"),
        }
        assert_eq!(read_urdf_str(&text, &mending()).unwrap().bodies[0].name, "trunk", "{name}");
    }
    let inside = urdf(&format!("{trunk}{}", joint("free", "floating", "trunk", "leg", "")));
    for options in [ReadOptions::default(), mending()] {
        let refusal = read_urdf_str(&inside, &options).unwrap_err().to_string();
        assert!(refusal.contains("floating below a part of the robot"), "{refusal}");
    }

    let slides: String = ["1 0 0", "0 1 0", "0 0 1"]
        .iter()
        .map(|axis| format!("<joint type=\"slide\" axis=\"{axis}\"/>"))
        .collect();
    let text = |turn: &str| {
        format!(
            "<mujoco><worldbody><body name=\"a\">{slides}{turn}<geom size=\".1\"/><body><joint name=\"hip\"/><geom size=\".1\"/></body></body>\
             </worldbody></mujoco>"
        )
    };
    let model = read_mjcf_str(&text("<joint type=\"ball\"/>"), &mending()).unwrap();
    assert_eq!((model.root, model.joints.len(), model.planes.len()), (Root::Floating, 1, 1));
    let refusal = read_mjcf_str(&text("<joint type=\"ball\"/><joint/>"), &mending()).unwrap_err().to_string();
    assert!(refusal.contains("ball joints are not simulated"), "{refusal}");
}

#[test]
fn links_without_mass_get_that_of_their_mesh() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("pack/meshes")).unwrap();
    std::fs::create_dir_all(folder.path().join("pack/urdf")).unwrap();
    std::fs::write(folder.path().join("pack/meshes/cube.stl"), cube()).unwrap();
    let mesh = "<collision><origin xyz=\"0 0 0.3\"/><geometry><mesh filename=\"package://pack/meshes/cube.stl\" scale=\"0.05 0.05 0.1\"/></geometry></collision>";
    let text = urdf(&format!(
        "<link name=\"trunk\">{}</link><link name=\"leg\">{mesh}</link>{}",
        inertial(5.0),
        joint("hip", "revolute", "trunk", "leg", LIMIT)
    ));
    let file = folder.path().join("pack/urdf/r.urdf");
    std::fs::write(&file, &text).unwrap();
    let refusal = read(&file, &ReadOptions::default()).unwrap_err().to_string();
    assert!(refusal.contains("moves, but has no mass"), "{refusal}");
    let model = read(&file, &mending()).unwrap();
    let leg = &model.bodies[1];
    // A block of 0.1 × 0.1 × 0.2 m of water, and its moment about x: m (0.1² + 0.2²) / 12.
    assert!((leg.mass - 2.0).abs() < 1e-6 && (leg.ipos[2] - 0.3).abs() < 1e-6, "{leg:?}");
    assert!(leg.inertia.iter().any(|moment| (moment - 2.0 * 0.05 / 12.0).abs() < 1e-6), "{leg:?}");
    says(&model, &["inertia of body \"leg\"", "2 kg at 1000 kg/m³"]);
    let outline = &model.outlines[0];
    assert!(
        outline.colliding
            && outline.body == 1
            && matches!(&outline.form, Form::Mesh(mesh) if mesh.file.is_file())
    );
    assert!(outline.points().unwrap().iter().all(|point| point[2] > 0.199 && point[2] < 0.401));
    // Without the file it counts as a small ball, and the outline names the place.
    std::fs::remove_file(folder.path().join("pack/meshes/cube.stl")).unwrap();
    let model = read(&file, &mending()).unwrap();
    assert!((model.bodies[1].mass - 0.005).abs() < 1e-9, "{:?}", model.bodies[1]);
    let missing = model.outlines[0].points().unwrap_err().to_string();
    assert!(missing.contains("cube.stl"), "{missing}");

    // MJCF weighs a mesh geom as MuJoCo does: with its density, or its mass.
    std::fs::write(folder.path().join("pack/meshes/cube.stl"), cube()).unwrap();
    let mjcf = |geom: &str| {
        let text = format!(
            "<mujoco><compiler meshdir=\"../meshes\"/><default><mesh scale=\".05 .05 .05\"/></default><asset><mesh file=\"cube.stl\"/></asset>\
             <worldbody><body><freejoint/><geom size=\".1\"/><body name=\"leg\"><joint/><geom type=\"mesh\" mesh=\"cube\" {geom}/></body></body>\
             </worldbody></mujoco>"
        );
        let file = folder.path().join("pack/urdf/r.xml");
        std::fs::write(&file, text).unwrap();
        read(&file, &mending()).unwrap().bodies[1].mass
    };
    assert!((mjcf("density=\"500\"") - 0.5).abs() < 1e-6 && (mjcf("mass=\"3\"") - 3.0).abs() < 1e-12);
}

#[test]
fn links_without_mass_get_that_of_shapes_fixed_to_them() {
    let cube = "<collision><geometry><box size=\"0.1 0.1 0.1\"/></geometry></collision>";
    let text = urdf(&format!(
        "<link name=\"trunk\">{}</link><link name=\"leg\"/><link name=\"foot\">{cube}</link>{}{}",
        inertial(5.0),
        joint("hip", "revolute", "trunk", "leg", LIMIT),
        joint("sole", "fixed", "leg", "foot", "")
    ));
    let model = read_urdf_str(&text, &mending()).unwrap();
    let masses: Vec<f64> = model.bodies.iter().map(|body| body.mass).collect();
    assert!(masses[..2] == [5.0, 0.0] && (masses[2] - 1.0).abs() < 1e-9, "{masses:?}");
    says(
        &model,
        &["inertia of body \"foot\" it moves without mass or inertia in the file; its shapes weigh 1 kg"],
    );
    // The masses that a mending adds count for the robot's whole mass.
    let total = "<mujoco><compiler settotalmass=\"12\"/></mujoco></robot>";
    let model = read_urdf_str(&text.replace("</robot>", total), &mending()).unwrap();
    assert!((model.total_mass() - 12.0).abs() < 1e-9 && (model.bodies[2].mass - 2.0).abs() < 1e-9);
    says(&model, &["its shapes weigh 1 kg at 1000 kg/m³, before `settotalmass` scales all masses (a guess)"]);
}

#[test]
fn parts_that_are_only_seen_refuse_no_robot() {
    let folder = tempfile::tempdir().unwrap();
    let seen = |at: &str| {
        format!("<visual><origin xyz=\"{at}\"/><geometry><box size=\"0.1 0.2 0.3\"/></geometry></visual>")
    };
    let text = urdf(&format!(
        "<link name=\"a\">{}{}{}</link><link name=\"b\">{}</link>{}",
        inertial(1.0),
        seen("0 0 far"),
        seen("0 0 1"),
        inertial(1.0),
        joint("hip", "revolute", "a", "b", LIMIT)
    ));
    let file = folder.path().join("r.urdf");
    std::fs::write(&file, text).unwrap();
    assert!(read(&file, &ReadOptions::default()).unwrap().outlines.is_empty());
    let outlines = read(&file, &mending()).unwrap().outlines;
    assert_eq!(outlines.iter().map(|one| one.pos).collect::<Vec<_>>(), [[0.0, 0.0, 1.0]]);

    let text = "<mujoco><asset><mesh class=\"gone\" file=\"cube.stl\"/></asset><worldbody><body name=\"a\"><freejoint/><geom size=\".1\"/>\
        <geom type=\"mesh\" mesh=\"cube\" mass=\"0\" contype=\"0\" conaffinity=\"0\"/></body></worldbody></mujoco>";
    let file = folder.path().join("r.xml");
    std::fs::write(&file, text).unwrap();
    says(&read(&file, &mending()).unwrap(), &["<mesh> its default class \"gone\" does not exist"]);
}

#[test]
fn foreign_words_of_other_programs_are_listed() {
    let text = urdf(&format!(
        "<link name=\"a\"><origin xyz=\"0 0 0\"/><self_filter/><collision_checking/>{}</link><link name=\"b\">{}</link>{}",
        inertial(1.0),
        inertial(1.0),
        joint("hip", "revolute", "a", "b", &format!("{LIMIT}<joint_properties damping=\"1\"/>"))
    ));
    let model = read_urdf_str(&text, &ReadOptions::default()).unwrap();
    assert!(model.outlines.is_empty() && model.dropped.len() == 4, "{:?}", model.dropped);
    assert!(model.dropped.iter().all(|one| one.harmless));
}

/// What is written reads as the same robot, but for the last bits of orientations.
fn written(model: &Model) -> Model {
    let text = model.to_mjcf(&["a comment -- with --- many ---- hyphens -".to_owned()], None).unwrap();
    read_mjcf_str(&text, &ReadOptions::default()).unwrap()
}

#[test]
fn what_is_written_is_the_same_robot() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let feet = "<mujoco model=\"a &amp; b\"><option timestep=\"0.004\" cone=\"elliptic\" integrator=\"implicitfast\"/><worldbody>\
        <geom name=\"floor\" type=\"plane\" size=\"0 0 1\" friction=\"0.7 0.01 0.001\"/><geom name=\"step\" type=\"box\" size=\".2 .2 .1\" pos=\"1 0 0\"/>\
        <body name=\"trunk\" pos=\"0 0 1\"><joint type=\"free\" damping=\"0.1\" frictionloss=\"0.2\"/><geom size=\".1\" contype=\"0\" conaffinity=\"0\"/>\
        <site name=\"imu\" pos=\"0 0 .1\"/><body name=\"leg\"><joint name=\"k &quot;1&quot;\" range=\"-1 1\" ref=\"0.2\" armature=\"0.01\" damping=\"0.5\" \
        actuatorfrcrange=\"-3 4\" solimplimit=\"0.9 0.99 0.01\"/><geom name=\"foot\" type=\"capsule\" size=\".02 .1\" euler=\"10 20 30\" condim=\"4\" \
        solref=\"0.01 1\" margin=\"0.001\"/></body></body></worldbody><actuator><position joint=\"k &quot;1&quot;\" kp=\"20\" kv=\"0.5\" \
        forcerange=\"-9 9\" gear=\"2\"/><general joint=\"k &quot;1&quot;\" gainprm=\"3\" biastype=\"affine\" biasprm=\"1 2 -3\"/></actuator>\
        <keyframe><key name=\"home\" qpos=\"0 0 1 1 0 0 0 0.5\"/></keyframe></mujoco>";
    let feet = feet.replace("-1 1", "-60 60");
    let models = [
        read(&root.join("assets/go2.xml"), &ReadOptions::default()).unwrap(),
        read_mjcf_str(&feet, &ReadOptions::default()).unwrap(),
    ];
    for model in &models {
        let again = written(model);
        let value = |model: &Model| serde_json::to_value(model).unwrap();
        let (before, after) = (value(model), value(&again));
        for (key, wanted) in before.as_object().unwrap() {
            if key != "dropped" && key != "changed" {
                close(&after[key], wanted, key);
            }
        }
    }
}

/// Values of two documents, numbers to 1e-15.
fn close(found: &serde_json::Value, wanted: &serde_json::Value, place: &str) {
    use serde_json::Value::{Array, Number, Object};
    match (found, wanted) {
        (Number(a), Number(b)) => {
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            assert!((a - b).abs() <= 1e-15 * b.abs().max(1.0), "{place}: {a} {b}");
        }
        (Array(a), Array(b)) if a.len() == b.len() => {
            a.iter().zip(b).enumerate().for_each(|(k, (a, b))| close(a, b, &format!("{place}.{k}")));
        }
        (Object(a), Object(b)) if a.len() == b.len() => {
            b.iter().for_each(|(key, b)| close(&a[key], b, &format!("{place}.{key}")))
        }
        (a, b) => assert_eq!(a, b, "{place}"),
    }
}

/// A scene that names itself, or one geometry many times, ends within a bound of work.
#[test]
fn scenes_that_name_themselves_are_refused() {
    let scene = |nodes: &str| {
        format!(
            "<COLLADA><library_geometries><geometry id=\"g\"><mesh><source id=\"p\"><float_array>{}</float_array></source><vertices \
             id=\"v\"><input semantic=\"POSITION\" source=\"#p\"/></vertices><triangles><input semantic=\"VERTEX\" source=\"#v\"/><p>0 1 \
             2</p></triangles></mesh></geometry></library_geometries><visual_scene>{nodes}</visual_scene></COLLADA>",
            "0 1 2 ".repeat(3000)
        )
    };
    let itself = scene("<node id=\"a\"><instance_node url=\"#a\"/><instance_node url=\"#a\"/></node>");
    assert!(mesh::parse("dae", itself.as_bytes()).unwrap_err().to_string().contains("nodes deeper than"));
    let many = scene(&format!("<node>{}</node>", "<instance_geometry url=\"#g\"/>".repeat(20_000)));
    assert!(mesh::parse("dae", many.as_bytes()).unwrap_err().to_string().contains("numbers and nodes"));
    let attributes: String = (0..200).map(|k| format!(" a{k}=\"\"")).collect();
    let wide = scene(&format!("<node{attributes}/>"));
    assert!(mesh::parse("dae", wide.as_bytes()).unwrap_err().to_string().contains("attributes"));
    let one = scene("<node><instance_geometry url=\"#g\"/></node>");
    assert_eq!(mesh::parse("dae", one.as_bytes()).unwrap().triangles.len(), 1);
}

#[test]
fn strips_and_fans_of_collada_are_read_and_holes_are_refused() {
    let mesh = |group: &str, faces: &str, turn: &str| {
        let text = format!(
            "<COLLADA><geometry id=\"g\"><mesh><source id=\"p\"><float_array>0 0 0 1 0 0 1 1 0 0 1 0</float_array>\
             </source><{group}><input semantic=\"VERTEX\" source=\"#p\"/>{faces}</{group}></mesh></geometry>\
             <visual_scene><node><rotate>{turn}</rotate><instance_geometry url=\"#g\"/></node></visual_scene></COLLADA>"
        );
        mesh::parse("dae", text.as_bytes())
    };
    let [a, b, c, d] = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    // A rotation about no axis is none.
    let fan = mesh("trifans", "<p>0 1 2 3</p><p>1 2 3</p>", "0 0 0 90").unwrap();
    assert_eq!(fan.triangles, [[a, b, c], [a, c, d], [b, c, d]]);
    // Both triangles of a strip show the same side.
    let strip = mesh("tristrips", "<p>0 1 3 2</p>", "0 0 0 0").unwrap();
    assert_eq!(strip.triangles, [[a, b, d], [d, b, c]]);
    let holes = mesh("polygons", "<p>0 1 2</p><ph><p>0 1 2</p><h>1 2 3</h></ph>", "0 0 1 0");
    assert!(holes.unwrap_err().to_string().contains("polygons with holes (<ph>)"));
    assert!(mesh("triangles", "<p>0 1 2</p>", "nan 0 0 90").is_err());
}

#[test]
fn damaged_meshes_end_in_a_mesh_or_an_error() {
    let whole = cube();
    let mut state = 1_u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for round in 0..2000 {
        let mut bytes = whole.clone();
        for _ in 0..1 + round % 5 {
            let at = random(bytes.len());
            bytes[at] = random(256) as u8;
        }
        bytes.truncate(if round % 3 == 0 { random(bytes.len()) } else { bytes.len() });
        for ending in ["stl", "obj", "dae", "msh"] {
            if let Ok(mesh) = mesh::parse(ending, &bytes) {
                assert!(mesh.triangles.iter().flatten().flatten().all(|x| x.is_finite()));
                let _ = mesh::Measure::new(&mesh);
            }
        }
    }
}
