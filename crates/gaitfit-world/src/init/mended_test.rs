//! Robots whose files do not read as they are, or have feet of meshes: what `init` makes of them.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::{Preparation, look, other_guesses, prepare};
use gaitfit_model::{ReadOptions, Shape, read_mjcf_str};
use gaitfit_view::replay::Shape as Drawn;
use std::fs;
use std::path::{Path, PathBuf};

/// A block of half sizes 0.5 in binary STL: 12 triangles.
fn block() -> Vec<u8> {
    let corner = |index: usize| [0, 1, 2].map(|k| if index >> k & 1 == 0 { -0.5_f32 } else { 0.5 });
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

fn inertial(mass: f64, [a, b, c]: [f64; 3], z: f64) -> String {
    let moments = [b * b + c * c, a * a + c * c, a * a + b * b].map(|sum| mass * sum / 12.0);
    format!(
        "<inertial><origin xyz=\"0 0 {z}\"/><mass value=\"{mass}\"/><inertia ixx=\"{}\" ixy=\"0\" ixz=\"0\" iyy=\"{}\" iyz=\"0\" \
         izz=\"{}\"/></inertial>",
        moments[0], moments[1], moments[2]
    )
}

fn mesh(at: &str, scale: &str) -> String {
    format!(
        "<collision><origin xyz=\"{at}\"/><geometry><mesh filename=\"package://walker/meshes/block.stl\" scale=\"{scale}\"/></geometry>\
         </collision>"
    )
}

fn joint(name: &str, parent: &str, child: &str, at: &str, axis: &str, effort: f64) -> String {
    format!(
        "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin xyz=\"{at}\"/><axis \
         xyz=\"{axis}\"/><limit lower=\"-2.5\" upper=\"2.5\" effort=\"{effort}\" velocity=\"20\"/></joint>"
    )
}

/// A robot on legs of 0.4 m whose trunk and last links are meshes; a `sole` under two legs, else shanks alone.
fn walker(legs: &[(&str, f64, f64)], sole: bool, effort: f64) -> String {
    let mut text = String::from("<robot name=\"walker\">");
    text += &format!(
        "<link name=\"trunk\">{}{}</link>",
        inertial(6.0, [0.4, 0.2, 0.1], 0.0),
        mesh("0 0 0", "0.4 0.2 0.1")
    );
    for (leg, x, y) in legs {
        let (thigh, shank, foot) = (format!("{leg}_thigh"), format!("{leg}_shank"), format!("{leg}_ankle"));
        text += &format!("<link name=\"{thigh}\">{}</link>", inertial(0.8, [0.04, 0.04, 0.2], -0.1));
        let shape = mesh("0 0 -0.1", "0.03 0.03 0.2");
        text += &format!("<link name=\"{shank}\">{}{shape}</link>", inertial(0.3, [0.03, 0.03, 0.2], -0.1));
        text += &joint(&format!("{leg}_hip"), "trunk", &thigh, &format!("{x} {y} 0"), "0 1 0", effort);
        text += &joint(&format!("{leg}_knee"), &thigh, &shank, "0 0 -0.2", "0 1 0", effort);
        if sole {
            let shape = mesh("0.02 0 -0.03", "0.16 0.08 0.04");
            text +=
                &format!("<link name=\"{foot}\">{}{shape}</link>", inertial(0.2, [0.16, 0.08, 0.04], -0.03));
            text += &joint(&format!("{leg}_ankle_pitch"), &shank, &foot, "0 0 -0.2", "0 1 0", effort);
        }
    }
    text + "</robot>"
}

const FOUR: [(&str, f64, f64); 4] =
    [("FL", 0.2, 0.1), ("FR", 0.2, -0.1), ("RL", -0.2, 0.1), ("RR", -0.2, -0.1)];
const TWO: [(&str, f64, f64); 2] = [("left", 0.0, 0.1), ("right", 0.0, -0.1)];

/// A package with a robot file and perhaps its mesh.
fn package(text: &str, with_mesh: bool) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let home = folder.path().join("walker");
    fs::create_dir_all(home.join("urdf")).unwrap();
    fs::create_dir_all(home.join("meshes")).unwrap();
    if with_mesh {
        fs::write(home.join("meshes/block.stl"), block()).unwrap();
    }
    let file = home.join("urdf/walker.urdf");
    fs::write(&file, text).unwrap();
    (folder, file)
}

#[test]
fn feet_that_are_meshes_get_balls_on_four_legs_and_soles_on_two() {
    let (_folder, file) = package(&walker(&FOUR, false, 20.0), true);
    let prepared = prepare(&file, Preparation::default()).unwrap();
    assert_eq!(
        prepared.look.settings.feet,
        ["FL_shank_foot", "FR_shank_foot", "RL_shank_foot", "RR_shank_foot"]
    );
    assert_eq!(prepared.look.settings.gait.len(), 2);
    assert_eq!(prepared.look.settings.fall.contacts, ["trunk_base"]);
    let foot = prepared.model.geoms.iter().find(|geom| geom.name == "FL_shank_foot").unwrap();
    let Shape::Sphere { radius } = foot.shape else { panic!("{foot:?}") };
    // As low as the mesh, and about as wide.
    assert!((foot.pos[2] - radius + 0.2).abs() < 1e-6 && (0.01..0.04).contains(&radius), "{foot:?}");
    let text = prepared.file.as_ref().unwrap();
    for words in ["fitted to block.stl", "FL_shank_foot", "gaitfit init"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    // What was written stands as the robot does.
    let again = read_mjcf_str(text, &ReadOptions::default()).unwrap();
    let mut settings = look(&again).unwrap().settings;
    // It has the smallest rotor of the training, which adds to it.
    let added = std::mem::replace(
        &mut settings.randomisation.armature,
        prepared.look.settings.randomisation.armature,
    );
    assert_eq!(settings, prepared.look.settings);
    let range = settings.randomisation.armature;
    let smallest = again.joints[0].armature;
    assert!(
        added == [0.0; 2] && range[0] == 0.0 && (range[1] - 2.0 * smallest).abs() < 0.2 * smallest,
        "{range:?}"
    );
    assert!(text.contains("rotor inertia of"), "{text}");

    let (_folder, file) = package(&walker(&TWO, true, 20.0), true);
    let prepared = prepare(&file, Preparation::default()).unwrap();
    let soles: Vec<&Shape> = prepared
        .model
        .geoms
        .iter()
        .filter(|geom| geom.name.ends_with("foot"))
        .map(|geom| &geom.shape)
        .collect();
    assert!(
        soles.len() == 2
            && soles
                .iter()
                .all(|shape| matches!(shape, Shape::Box { half_size } if (half_size[0] - 0.08).abs() < 1e-6)),
        "{soles:?}"
    );
    assert_eq!(prepared.model.joints.len(), 6);
}

#[test]
fn without_the_mesh_the_foot_is_a_guess_that_names_the_file() {
    let (_folder, file) = package(&walker(&FOUR, false, 20.0), false);
    let prepared = prepare(&file, Preparation::default()).unwrap();
    let feet: Vec<&str> = prepared
        .mended
        .iter()
        .filter(|guess| guess.what == "foot")
        .map(|guess| guess.found.as_str())
        .collect();
    assert_eq!(feet.len(), 4, "{:?}", prepared.mended);
    assert!(
        feet.iter()
            .all(|foot| foot.contains("a guess from the link's inertia") && foot.contains("block.stl")),
        "{feet:?}"
    );
    let foot = prepared.model.geoms.iter().find(|geom| geom.name == "FL_shank_foot").unwrap();
    let Shape::Sphere { radius } = foot.shape else { panic!("{foot:?}") };
    assert!(
        (foot.pos[2] - radius + 0.2).abs() < 1e-3,
        "at the end of the rod that has the shank's inertia: {foot:?}"
    );
}

/// The mended file names the one with the meshes, wherever both lie.
#[test]
fn a_mended_robot_is_drawn_in_its_own_meshes() {
    let (folder, file) = package(&walker(&FOUR, false, 20.0), true);
    let tasks = folder.path().join("tasks");
    fs::create_dir(&tasks).unwrap();
    let prepared = prepare(&file, Preparation { folder: Some(&tasks), ..Preparation::default() }).unwrap();
    let text = prepared.file.as_ref().unwrap();
    assert!(text.contains("data=\"../walker/urdf/walker.urdf\""), "{text}");
    let file = tasks.join("walker.xml");
    fs::write(&file, text).unwrap();
    let again = gaitfit_model::read(&file, &ReadOptions::default()).unwrap();
    for model in [&prepared.model, &again] {
        let robot = &prepared.look.stance(model).robots[0];
        // The trunk and the shanks are meshes, of two sizes; the thighs have nothing but bones.
        let count = |is: fn(&Drawn) -> bool| robot.geoms.iter().filter(|geom| is(&geom.shape)).count();
        assert_eq!(count(|shape| matches!(shape, Drawn::Mesh { .. })), 5);
        assert_eq!(count(|shape| matches!(shape, Drawn::Sphere { .. })), 4, "feet");
        assert_eq!((count(|shape| matches!(shape, Drawn::Capsule { .. })), robot.geoms.len()), (4, 13));
        assert_eq!(robot.meshes.len(), 2);
    }
}

/// Files that read as they are keep their own shapes, unless the meshes are asked for.
#[test]
fn a_robot_with_other_feet_is_left_as_it_is() {
    let ball = "<collision><origin xyz=\"0 0 -0.2\"/><geometry><sphere radius=\"0.02\"/></geometry></collision></link><joint";
    let text = walker(&FOUR, false, 20.0);
    let text = text.split("</link><joint").collect::<Vec<_>>().join(ball);
    let (_folder, file) = package(&text, true);
    let plain = prepare(&file, Preparation::default()).unwrap();
    assert!(plain.file.is_none() && plain.mended.is_empty());
    assert!(plain.model.outlines.is_empty());
    let anew = prepare(&file, Preparation { feet_from_mesh: true, ..Preparation::default() }).unwrap();
    assert!(
        anew.file.is_some() && anew.look.settings.feet[0] == "FL_shank_foot",
        "{:?}",
        anew.look.settings.feet
    );
}

#[test]
fn a_foot_whose_name_was_made_up_has_its_links() {
    let ball =
        "<collision><origin xyz=\"0 0 -0.2\"/><geometry><sphere radius=\"0.02\"/></geometry></collision>";
    let text = walker(&FOUR, false, 20.0);
    let mut parts: Vec<&str> = text.split("<collision>").collect();
    let first = parts.remove(0).to_owned();
    let rest: String =
        parts.iter().map(|part| format!("{ball}{}", part.split_once("</collision>").unwrap().1)).collect();
    let (_folder, file) = package(&(first + &rest), false);
    let prepared = prepare(&file, Preparation::default()).unwrap();
    assert!(prepared.file.is_none());
    assert_eq!(prepared.look.settings.feet, ["FL_shank", "FR_shank", "RL_shank", "RR_shank"]);
}

#[test]
fn limits_that_nobody_meant_are_flagged_with_a_guess() {
    let said = |effort: f64| {
        let (_folder, file) = package(&walker(&FOUR, false, effort), true);
        let prepared = prepare(&file, Preparation::default()).unwrap();
        prepared
            .look
            .guesses
            .iter()
            .filter(|guess| guess.what == "limits")
            .map(|guess| guess.found.clone())
            .collect::<String>()
    };
    assert_eq!(said(20.0), "");
    let flagged = said(1000.0);
    for words in ["FL_hip", "1000", "A guess is", "effort"] {
        assert!(flagged.contains(words), "{words}: {flagged}");
    }
}

/// A robot with a closed loop names the file of its serial twin.
#[test]
fn closed_loops_name_a_serial_twin() {
    let leg = |name: &str, x: f64, y: f64| {
        format!(
            "<body name=\"{name}_thigh\" pos=\"{x} {y} 0\"><joint name=\"{name}_hip\" axis=\"0 1 0\"/><geom type=\"capsule\" fromto=\"0 0 0 0 0 -.2\" \
             size=\".02\"/><body name=\"{name}_shank\" pos=\"0 0 -.2\"><joint name=\"{name}_knee\" axis=\"0 1 0\"/><geom name=\"{name}\" \
             size=\".02\" pos=\"0 0 -.2\"/></body></body>"
        )
    };
    let legs: String = FOUR.iter().map(|(name, x, y)| leg(name, *x, *y)).collect();
    let robot = |more: &str| {
        format!(
            "<mujoco model=\"looped\"><worldbody><body name=\"trunk\" pos=\"0 0 .4\"><freejoint/><geom type=\"box\" size=\".2 .1 .05\"/>{legs}</body>\
             </worldbody>{more}</mujoco>"
        )
    };
    let folder = tempfile::tempdir().unwrap();
    let looped = folder.path().join("looped.xml");
    fs::write(
        &looped,
        robot("<equality><connect body1=\"FL_shank\" body2=\"FR_shank\" anchor=\"0 0 0\"/></equality>"),
    )
    .unwrap();
    let alone = prepare(&looped, Preparation::default()).unwrap_err().to_string();
    assert!(
        alone.contains("<equality>") && alone.contains("closes a loop") && !alone.contains("try it"),
        "{alone}"
    );
    fs::write(folder.path().join("serial.xml"), robot("")).unwrap();
    fs::write(folder.path().join("other.xml"), "<mujoco/>").unwrap();
    let named = prepare(&looped, Preparation::default()).unwrap_err().to_string();
    assert!(named.contains("serial.xml has 8 joints of the same names"), "{named}");
    assert!(prepare(Path::new("absent.xml"), Preparation::default()).is_err());
}

#[test]
fn iterations_are_written_over_those_of_two_legs_and_beside_the_task_of_four() {
    for (legs, soles) in [(&FOUR[..], false), (&TWO[..], true)] {
        let (_folder, file) = package(&walker(legs, soles, 20.0), true);
        let look = prepare(&file, Preparation::default()).unwrap().look;
        let read =
            |look: &super::Look| -> toml::Table { look.configuration("r.xml", false).parse().unwrap() };
        let (before, after) = (read(&look), read(&look.with_iterations(1234)));
        assert_eq!(before.contains_key("train"), legs.len() == 2);
        assert_eq!(after["train"].as_table().unwrap().len(), 1);
        assert_eq!(after["train"]["iterations"].as_integer(), Some(1234));
        assert!(before["task"] == after["task"] && before["robot"] == after["robot"]);
    }
}

#[test]
fn soles_are_paid_for_standing_and_point_feet_for_the_step_clock() {
    for (soles, steps) in [(true, 3.0), (false, 0.0)] {
        let (_folder, file) = package(&walker(&TWO, soles, 20.0), true);
        let settings = prepare(&file, Preparation::default()).unwrap().look.settings;
        let weight = |term: &str| settings.rewards.get(term).copied().unwrap_or(0.0);
        assert_eq!((weight("steps"), weight("step_clock")), (steps, 3.0 - steps));
        assert_eq!(weight("stand_still") < 0.0, soles);
        assert_eq!(settings.terms.contains_key("steps"), soles);
        // While it walks, the term is the built-in one.
        let clock =
            gaitfit_learn::task::reward::TERMS.iter().find(|term| term.name == "step_clock").unwrap().text;
        let plain = |text: &str| text.split_whitespace().collect::<String>();
        if let Some(steps) = settings.terms.get("steps") {
            assert!(plain(steps).contains(&plain(clock)), "{steps}");
        }
    }
}

#[test]
fn other_guesses_differ_from_the_first_in_their_gains() {
    let (_folder, file) = package(&walker(&FOUR, false, 20.0), true);
    let prepared = prepare(&file, Preparation::default()).unwrap();
    let others = other_guesses(&prepared.model, &prepared.look);
    // No servos: softer and stiffer than by size.
    assert_eq!(others.len(), 2);
    let kp = |look: &super::Look| look.settings.policy.clone();
    assert!(
        others.iter().all(
            |other| kp(other) != kp(&prepared.look) && other.settings.feet == prepared.look.settings.feet
        )
    );
    let page = gaitfit_view::replay_html(&prepared.look.stance(&prepared.model)).unwrap();
    assert!(page.contains("stance and gait"));
}
