//! The replay page: whole, closed to the network, safe against hostile names, small, and refused with the reason
//! when its data contradict one another.
#![allow(clippy::unwrap_used)] // A test that panics has failed.

use crate::go2;
use crate::page;

use gaitfit_view::replay::{Frame, Geom, Ground, Joint, Mesh, Replay, ReplayError, Shape};
use gaitfit_view::replay_html;
use page::{HOSTILE, assert_harmless, assert_offline, parse};
use serde_json::Value;

fn replay(frames: usize) -> Replay {
    Replay {
        title: "walk".into(),
        note: "nominal simulator".into(),
        dt: go2::DT,
        robots: vec![go2::trot("before", frames, 0.7), go2::trot("after", frames, 1.0)],
    }
}

fn data(html: &str) -> Value {
    let document = parse(html);
    let script = document.descendants().find(|n| n.attribute("id") == Some("replay")).unwrap();
    assert_eq!(script.attribute("type"), Some("application/json"));
    serde_json::from_str(script.text().unwrap()).unwrap()
}

#[test]
fn ten_seconds_of_a_go2_are_small_and_complete() {
    let mut one = replay(500);
    one.robots.truncate(1);
    let html = replay_html(&one).unwrap();
    assert!(html.len() < 105_000, "{} bytes", html.len());
    let data = data(&html);
    let robot = &data["robots"][0];
    assert_eq!(robot["bodies"].as_array().unwrap().len(), 13);
    // Three shapes of the trunk, and five of each leg.
    assert_eq!(robot["geoms"].as_array().unwrap().len(), 3 + 4 * 5);
    assert_eq!((&robot["frames"], &robot["joints"]), (&Value::from(500), &Value::from(12)));
    assert_eq!(robot["feet"], serde_json::json!(["FL", "FR", "RL", "RR"]));
    assert_eq!(robot["offset"].as_array().unwrap().len(), 12 + 13);
    // Two bytes a number and a byte a foot, four characters for three bytes.
    let length = |key: &str| robot[key].as_str().unwrap().len();
    assert_eq!(length("motion"), (500 * 25 * 2_usize).div_ceil(3) * 4);
    assert_eq!(length("contacts"), (500 * 4_usize).div_ceil(3) * 4);
}

/// As many triangles as a robot has at most, on two robots.
#[test]
fn meshes_of_a_robot_are_in_the_page_once() {
    let plain = replay_html(&replay(50)).unwrap().len();
    let mut replay = replay(50);
    let vertex = |k: u16| [0.01 * f64::from(k % 100), 0.01 * f64::from(k / 100), f64::from(k).sin()];
    let triangle = |k: u16| [k % 7998, k % 7998 + 1, k % 7998 + 2];
    let mesh =
        Mesh { vertices: (0..8000).map(vertex).collect(), triangles: (0..15_000).map(triangle).collect() };
    for robot in &mut replay.robots {
        robot.meshes = vec![mesh.clone()];
        robot.geoms[0].shape = Shape::Mesh { mesh: 0 };
    }
    let html = replay_html(&replay).unwrap();
    assert_offline(&html);
    let data = data(&html);
    assert_eq!(data["meshes"].as_array().unwrap().len(), 1);
    assert!(data["robots"].as_array().unwrap().iter().all(|robot| robot["geoms"][0]["mesh"] == 0));
    assert!(html.len() < plain + 400_000, "{} bytes", html.len() - plain);
}

#[test]
fn every_robot_has_its_pane() {
    let html = replay_html(&replay(50)).unwrap();
    assert_offline(&html);
    let document = parse(&html);
    let panes = document.descendants().filter(|n| n.attribute("class") == Some("pane"));
    let names: Vec<&str> =
        panes.filter_map(|p| p.descendants().find(|n| n.has_tag_name("th")).and_then(|n| n.text())).collect();
    assert_eq!(names, ["before", "after"]);
    for id in ["scene", "strip", "play", "speed", "loop", "time", "clock", "flat", "stage"] {
        assert!(document.descendants().any(|n| n.attribute("id") == Some(id)), "{id}");
    }
}

#[test]
fn hostile_names_stay_text() {
    let honest = replay_html(&replay(5)).unwrap();
    let mut hostile = replay(5);
    (hostile.title, hostile.note) = (HOSTILE.into(), HOSTILE.into());
    for robot in &mut hostile.robots {
        robot.name = HOSTILE.into();
        robot.feet = vec![HOSTILE.into(); 4];
        robot.bodies.iter_mut().for_each(|b| b.name = HOSTILE.into());
    }
    let html = replay_html(&hostile).unwrap();
    assert_harmless(&html, &honest);
    let shown = data(&html)["robots"][0]["feet"][0].as_str().unwrap().to_string();
    assert!(shown.contains("<script>alert('x')</script>"), "{shown}");
}

#[test]
fn strange_motion_is_still_drawn() {
    let mut strange = replay(40);
    let frames = &mut strange.robots[0].frames;
    frames[3].base_position = [f64::NAN, f64::INFINITY, -1e300];
    frames[4].base_quaternion = [0.0; 4];
    frames[5].joints[2] = f64::NAN;
    for frame in &mut strange.robots[1].frames {
        frame.velocity = [f64::NAN; 3];
        frame.base_position = [1e308, -1e308, f64::NEG_INFINITY];
    }
    strange.robots[1].frames.truncate(1);
    let data = data(&replay_html(&strange).unwrap());
    for robot in data["robots"].as_array().unwrap() {
        for key in ["offset", "scale"] {
            assert!(robot[key].as_array().unwrap().iter().all(Value::is_number), "{key}");
        }
    }
}

/// Makes one thing wrong.
type Spoil = fn(&mut Replay);

#[test]
fn what_does_not_fit_is_named() {
    let broken: [(&str, Spoil); 17] = [
        ("time between frames", |r| r.dt = 0.0),
        ("time between frames", |r| r.dt = f64::NAN),
        ("1 to 8 robots, not 0", |r| r.robots.clear()),
        ("\"before\": has 0 frames", |r| r.robots[0].frames.clear()),
        ("\"after\": has no bodies", |r| r.robots[1].bodies.clear()),
        ("body 1 needs a parent listed before it", |r| r.robots[0].bodies[1].parent = Some(1)),
        ("body 0 needs a parent", |r| r.robots[0].bodies[0].parent = Some(0)),
        ("body 3 has a number that is not finite", |r| r.robots[0].bodies[3].position[1] = f64::NAN),
        ("its joints need 13", |r| {
            let joint =
                Joint { name: "j".into(), axis: [0.0, 1.0, 0.0], anchor: [0.0; 3], index: 12, slides: false };
            r.robots[0].bodies[12].joint = Some(joint);
        }),
        ("geom 23 is on body 99, of 13", |r| {
            let shape = Shape::Capsule { radius: 0.01, half_length: 0.1 };
            let quaternion = [1.0, 0.0, 0.0, 0.0];
            r.robots[0].geoms.push(Geom { body: 99, shape, position: [0.0; 3], quaternion, foot: None });
        }),
        ("geom 0 is mesh 0, of 0", |r| r.robots[0].geoms[0].shape = Shape::Mesh { mesh: 0 }),
        ("mesh 0 has a corner", |r| {
            r.robots[0].meshes = vec![Mesh { vertices: vec![[0.0; 3]; 2], triangles: vec![[0, 1, 2]] }];
        }),
        ("1 meshes of 30000 triangles", |r| {
            r.robots[0].meshes =
                vec![Mesh { vertices: vec![[0.0; 3]; 3], triangles: vec![[0, 1, 2]; 30_000] }];
        }),
        ("frame 7 has 2 joint angles", |r| r.robots[0].frames[7].joints.truncate(2)),
        ("frame 2 has 12 joint angles and 0 contacts; expected 12 and 4", |r| {
            r.robots[0].frames[2].contacts = Vec::new();
        }),
        ("ground of 7 heights in rows of 3", |r| {
            r.robots[0].ground =
                Some(Ground { step: 0.1, columns: 3, heights: vec![0.0; 7], ..Ground::default() });
        }),
        ("ground with a number that cannot be drawn", |r| {
            let heights = vec![0.0, f64::NAN, 0.0, 0.0];
            r.robots[0].ground = Some(Ground { step: 0.1, columns: 2, heights, ..Ground::default() });
        }),
    ];
    for (expected, spoil) in broken {
        let mut replay = replay(10);
        spoil(&mut replay);
        let message = replay_html(&replay).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}, not {expected}");
    }
    let mut long = replay(1);
    long.robots[0].frames = vec![Frame::default(); 60_001];
    assert!(matches!(replay_html(&long), Err(ReplayError::Robot { .. })));
}
