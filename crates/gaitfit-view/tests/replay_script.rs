//! The page's script, run outside a browser: it places bodies where rotation matrices do.
#![allow(clippy::unwrap_used)] // A test that panics has failed.

use crate::go2;
use crate::page;

use gaitfit_view::replay::{Ground, Replay, ReplayRobot};
use gaitfit_view::replay_html;
use std::io::Write;
use std::process::{Command, Stdio};

type Matrix = [[f64; 3]; 3];

fn times(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn apply(a: &Matrix, v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| (0..3).map(|k| a[i][k] * v[k]).sum())
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

fn from_quaternion(q: [f64; 4]) -> Matrix {
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [w, x, y, z] = q.map(|c| c / norm);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Rodrigues' formula, R = cos θ I + sin θ [a] + (1 − cos θ) a aᵀ, for an axis of any length.
fn about(axis: [f64; 3], angle: f64) -> Matrix {
    let norm = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [x, y, z] = axis.map(|c| c / norm);
    let (s, c) = angle.sin_cos();
    let (hat, a) = ([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], [x, y, z]);
    std::array::from_fn(|i| {
        std::array::from_fn(|j| c * f64::from(u8::from(i == j)) + s * hat[i][j] + (1.0 - c) * a[i] * a[j])
    })
}

/// World positions of all geoms in one frame.
fn geoms(robot: &ReplayRobot, frame: usize) -> Vec<[f64; 3]> {
    let frame = &robot.frames[frame];
    let mut poses: Vec<([f64; 3], Matrix)> = Vec::new();
    for body in &robot.bodies {
        let pose = match body.parent {
            None => (frame.base_position, from_quaternion(frame.base_quaternion)),
            Some(parent) => {
                let (p, r) = &poses[parent];
                let (p, r) = (plus(*p, apply(r, body.position)), times(r, &from_quaternion(body.quaternion)));
                match &body.joint {
                    None => (p, r),
                    Some(joint) if joint.slides => {
                        let norm = joint.axis.iter().map(|x| x * x).sum::<f64>().sqrt();
                        let by = frame.joints[joint.index] / norm;
                        (plus(p, apply(&r, joint.axis.map(|x| x * by))), r)
                    }
                    Some(joint) => {
                        let turn = about(joint.axis, frame.joints[joint.index]);
                        // x ↦ anchor + R (x − anchor), in the body's frame.
                        let origin = plus(joint.anchor, apply(&turn, joint.anchor.map(|x| -x)));
                        (plus(p, apply(&r, origin)), times(&r, &turn))
                    }
                }
            }
        };
        poses.push(pose);
    }
    let place = |g: &gaitfit_view::replay::Geom| plus(poses[g.body].0, apply(&poses[g.body].1, g.position));
    robot.geoms.iter().map(place).collect()
}

fn run_node(script: &str) -> String {
    let node = Command::new("node").arg("-").stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let mut node = node.expect("this test needs node on the path");
    node.stdin.take().unwrap().write_all(script.as_bytes()).unwrap();
    let output = node.wait_with_output().unwrap();
    assert!(output.status.success(), "the script failed");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
#[ignore = "needs node, which runs the page's script"]
fn node_bodies_are_where_rotation_matrices_place_them() {
    let mut robot = go2::trot("go2", 100, 1.0);
    // The Go2's anchors are at its bodies' origins, its axes have unit length, its bodies are not turned: other
    // robots differ.
    for (i, body) in robot.bodies.iter_mut().enumerate().skip(1) {
        body.quaternion = [1.5, 0.1 * i as f64, -0.2, 0.05];
        let joint = body.joint.as_mut().unwrap();
        joint.anchor = [0.03, -0.01 * i as f64, 0.05];
        joint.axis = [0.5, 2.0, 0.1 * i as f64];
        // And some joints slide.
        joint.slides = i % 3 == 2;
    }
    // Uneven ground: 3 × 4 heights on a plane that rises along x.
    robot.ground = Some(Ground {
        corner: [-1.0, 2.0],
        step: 0.5,
        columns: 4,
        heights: (0..12).map(|k| 0.1 * f64::from(k % 4)).collect(),
    });
    let html =
        replay_html(&Replay { dt: go2::DT, robots: vec![robot.clone()], ..Replay::default() }).unwrap();
    let document = page::parse(&html);
    let scripts: Vec<&str> =
        document.descendants().filter(|n| n.has_tag_name("script")).filter_map(|n| n.text()).collect();
    // Everything up to the page itself, which needs a browser.
    let library = scripts[1].split_once("const element").unwrap().0.split_once("\"use strict\";").unwrap().1;
    let script = format!(
        "const data = {};\n{library}
        const gray = [0.5, 0.5, 0.5];
        const colors = {{ body: [gray, gray, gray, gray], foot: gray, contact: gray, command: gray, measured: gray }};
        const robot = new Robot(data.robots[0], data.dt);
        for (const frame of [0, 37, 99]) {{
            const list = shapes(robot, robot.at(frame * data.dt), colors).filter((s) => s.caster);
            console.log(list.map((s) => s.position.join(' ')).join(';'));
        }}
        const numbers = robot.ground.triangles();
        console.log([numbers.length, ...robot.ground.vertex(2, 1), ...numbers.slice(3, 6)].join(' '));
        console.log(robot.ground.lines(0, 2.5, 0.6).length);",
        scripts[0]
    );
    let printed = run_node(&script);
    let lines: Vec<&str> = printed.lines().collect();
    assert_eq!(lines.len(), 5);
    // Six cells of two triangles of three corners of six numbers; a vertex; the plane's normal.
    let numbers: Vec<f64> = lines[3].split(' ').map(|x| x.parse().unwrap()).collect();
    let slope = 0.2f64;
    let norm = slope.hypot(1.0);
    let wanted = [216.0, 0.0, 2.5, 0.2, -slope / norm, 0.0, 1.0 / norm];
    assert!(numbers.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-4), "{numbers:?}, not {wanted:?}");
    // All three rows, and the columns at -0.5, 0 and 0.5.
    assert_eq!(lines[4], "6");
    for (line, frame) in lines.iter().zip([0, 37, 99]) {
        let drawn: Vec<Vec<f64>> =
            line.split(';').map(|point| point.split(' ').map(|x| x.parse().unwrap()).collect()).collect();
        let expected = geoms(&robot, frame);
        assert_eq!(drawn.len(), expected.len());
        for (at, wanted) in drawn.iter().zip(&expected) {
            let apart = at.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(apart < 5e-4, "frame {frame}: {at:?}, not {wanted:?}");
        }
    }
}
