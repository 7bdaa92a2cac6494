//! Whether a replay can be drawn, said before a page comes out that shows nothing.

use super::{Frame, Replay, ReplayError, ReplayRobot, Shape};

/// Robots a page holds at most.
const ROBOTS: usize = 8;
/// Bodies, simple geoms, geoms that are meshes, joints or feet of a robot at most.
const PARTS: usize = 1000;
/// Frames of a robot at most: twenty minutes at 50 Hz.
const FRAMES: usize = 60_000;
/// Max number of meshes of a robot.
const MESHES: usize = 256;
/// Max number of triangles of a robot.
const TRIANGLES: usize = 20_000;
/// Heights of the ground at most.
const HEIGHTS: usize = 250_000;

pub(super) fn check(replay: &Replay) -> Result<(), ReplayError> {
    // Written with `!`, so that NaN is refused too.
    if !(replay.dt.is_finite() && replay.dt > 0.0) {
        return Err(ReplayError::TimeStep { dt: replay.dt });
    }
    if replay.robots.is_empty() || replay.robots.len() > ROBOTS {
        return Err(ReplayError::Robots { count: replay.robots.len(), max: ROBOTS });
    }
    for robot in &replay.robots {
        let fail = |what| ReplayError::Robot { robot: crate::format::clean(&robot.name), what };
        let all =
            tree(robot).and_then(|()| meshes(robot)).and_then(|()| geoms(robot)).and_then(|()| frames(robot));
        all.and_then(|()| ground(robot)).map_err(fail)?;
    }
    Ok(())
}

fn tree(robot: &ReplayRobot) -> Result<(), String> {
    if robot.bodies.is_empty() {
        return Err("has no bodies; the first body is the base".to_string());
    }
    // Meshes have a limit of their own, because many triangles belong to one geom.
    let simple = robot.geoms.iter().filter(|geom| !matches!(geom.shape, Shape::Mesh { .. })).count();
    for (what, count) in [
        ("bodies", robot.bodies.len()),
        ("simple geoms", simple),
        ("geoms that are meshes", robot.geoms.len() - simple),
        ("feet", robot.feet.len()),
    ] {
        if count > PARTS {
            return Err(format!("has {count} {what}; a page holds at most {PARTS}"));
        }
    }
    for (i, body) in robot.bodies.iter().enumerate() {
        let joined = match body.parent {
            None => i == 0,
            // The page places bodies in one pass: a parent must have its place already.
            Some(parent) => i > 0 && parent < i,
        };
        if !joined {
            return Err(format!("body {i} needs a parent listed before it; only the first body has none"));
        }
        let joint = body.joint.iter().flat_map(|j| j.axis.iter().chain(&j.anchor));
        if !body.position.iter().chain(&body.quaternion).chain(joint).all(|x| x.is_finite()) {
            return Err(format!("body {i} has a number that is not finite"));
        }
        if length(&body.quaternion) == 0.0 || body.joint.as_ref().is_some_and(|j| length(&j.axis) == 0.0) {
            return Err(format!("body {i} has a quaternion or joint axis of length zero"));
        }
    }
    Ok(())
}

fn meshes(robot: &ReplayRobot) -> Result<(), String> {
    let triangles: usize = robot.meshes.iter().map(|mesh| mesh.triangles.len()).sum();
    if robot.meshes.len() > MESHES || triangles > TRIANGLES {
        return Err(format!(
            "has {} meshes of {triangles} triangles; a page holds at most {MESHES} of {TRIANGLES}",
            robot.meshes.len()
        ));
    }
    for (i, mesh) in robot.meshes.iter().enumerate() {
        let corners = mesh.vertices.len();
        let finite = mesh.vertices.iter().flatten().all(|x| x.is_finite());
        let theirs = mesh.triangles.iter().flatten().all(|&corner| usize::from(corner) < corners);
        // Triangles name their corners by 16 bits.
        if !finite || !theirs || corners > 1 + usize::from(u16::MAX) {
            return Err(format!("mesh {i} has a corner that cannot be drawn, or that is not there"));
        }
    }
    Ok(())
}

fn geoms(robot: &ReplayRobot) -> Result<(), String> {
    for (i, geom) in robot.geoms.iter().enumerate() {
        if geom.body >= robot.bodies.len() {
            return Err(format!("geom {i} is on body {}, of {}", geom.body, robot.bodies.len()));
        }
        if geom.foot.is_some_and(|foot| foot >= robot.feet.len()) {
            return Err(format!("geom {i} is a foot that the list of feet does not have"));
        }
        let sizes = match geom.shape {
            Shape::Box { half } => half.to_vec(),
            Shape::Sphere { radius } => vec![radius],
            Shape::Cylinder { radius, half_length } => vec![radius, half_length],
            Shape::Capsule { radius, half_length } => vec![radius, half_length],
            Shape::Mesh { mesh } if mesh >= robot.meshes.len() => {
                return Err(format!("geom {i} is mesh {mesh}, of {}", robot.meshes.len()));
            }
            Shape::Mesh { .. } => Vec::new(),
        };
        let finite = geom.position.iter().chain(&geom.quaternion).all(|x| x.is_finite());
        if !finite || length(&geom.quaternion) == 0.0 || !sizes.iter().all(|s| s.is_finite() && *s >= 0.0) {
            return Err(format!("geom {i} has a size, position or quaternion that cannot be drawn"));
        }
    }
    Ok(())
}

fn frames(robot: &ReplayRobot) -> Result<(), String> {
    let count = robot.frames.len();
    if count == 0 || count > FRAMES {
        return Err(format!("has {count} frames; a page holds 1 to {FRAMES}"));
    }
    // There is a first frame: a count of 0 is refused above.
    let joints = robot.frames[0].joints.len();
    // Saturating: the largest index fails the check below instead of overflowing.
    let wanted =
        robot.bodies.iter().filter_map(|b| b.joint.as_ref()).map(|j| j.index.saturating_add(1)).max();
    if joints < wanted.unwrap_or(0) || joints > PARTS {
        return Err(format!(
            "has {joints} joint angles a frame; its joints need {}, and a page holds at most {PARTS}",
            wanted.unwrap_or(0)
        ));
    }
    let fits = |f: &Frame| f.joints.len() == joints && f.contacts.len() == robot.feet.len();
    match robot.frames.iter().position(|f| !fits(f)) {
        Some(i) => Err(format!(
            "frame {i} has {} joint angles and {} contacts; expected {joints} and {}",
            robot.frames[i].joints.len(),
            robot.frames[i].contacts.len(),
            robot.feet.len()
        )),
        None => Ok(()),
    }
}

fn ground(robot: &ReplayRobot) -> Result<(), String> {
    let Some(ground) = &robot.ground else { return Ok(()) };
    let count = ground.heights.len();
    if ground.columns < 2
        || !count.is_multiple_of(ground.columns)
        // A surface needs two rows of two heights. `columns` is at least 2 here, so nothing divides by zero.
        || count / ground.columns < 2
        || count > HEIGHTS
    {
        let columns = ground.columns;
        return Err(format!(
            "has ground of {count} heights in rows of {columns}; give whole rows, two of two at least, and at most \
             {HEIGHTS} heights"
        ));
    }
    let numbers = ground.heights.iter().chain(&ground.corner).chain([&ground.step]);
    if !numbers.into_iter().all(|x| x.is_finite()) || ground.step <= 0.0 {
        return Err("has ground with a number that cannot be drawn".to_string());
    }
    Ok(())
}

fn length(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}
