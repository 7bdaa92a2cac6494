//! From a simulated robot and its record to what a 3-D replay draws.

use crate::dress::dressed;
use crate::skeleton::bones;
use gaitfit_learn::evaluate::GaitRecord;
use gaitfit_model::{JointKind, Model, Shape, Surface};
use gaitfit_policy::walker::Walker;
use gaitfit_view::replay::{Body, Frame, Geom, Ground, Joint, ReplayRobot, Shape as Drawn};

/// The robot called `name`, moving as recorded.
pub fn robot(name: &str, model: &Model, record: &GaitRecord) -> ReplayRobot {
    let frames = (0..record.steps()).map(|step| frame(model, record, step)).collect();
    ReplayRobot { frames, ..shape(name, model, &record.feet) }
}

/// The robot called `name` without a motion. `feet`: names of the geoms, or of bodies, whose contacts are shown.
pub fn shape(name: &str, model: &Model, feet: &[String]) -> ReplayRobot {
    dressed(bare(name, model, feet), model)
}

/// The robot in simple shapes: first the model's geoms, then bones.
pub(crate) fn bare(name: &str, model: &Model, feet: &[String]) -> ReplayRobot {
    let mut bodies: Vec<Body> = Vec::with_capacity(model.bodies.len());
    // The drawn body that carries a model body's geoms and children.
    let mut carrier = Vec::with_capacity(model.bodies.len());
    for (index, body) in model.bodies.iter().enumerate() {
        let joints = model.joints.iter().enumerate().filter(|(_, joint)| joint.body == index);
        let mut joints = joints.map(|(number, joint)| Joint {
            name: joint.name.clone(),
            axis: joint.axis,
            anchor: joint.pos,
            index: number,
            slides: joint.kind == JointKind::Slide,
        });
        let parent = body.parent.map(|parent| carrier[parent]);
        bodies.push(Body {
            name: body.name.clone(),
            parent,
            position: body.pos,
            quaternion: body.quat,
            // The base has no parent to move against; a joint on it gets a body of its own below.
            joint: if parent.is_some() { joints.next() } else { None },
        });
        // A drawn body has one joint: further ones of the model's body act one after the other.
        for joint in joints {
            let parent = Some(bodies.len() - 1);
            bodies.push(Body { name: body.name.clone(), parent, joint: Some(joint), ..Body::default() });
        }
        carrier.push(bodies.len() - 1);
    }
    let geoms = model.geoms.iter().map(|geom| Geom {
        body: carrier[geom.body],
        shape: match geom.shape {
            Shape::Sphere { radius } => Drawn::Sphere { radius },
            Shape::Capsule { radius, half_length } => Drawn::Capsule { radius, half_length },
            Shape::Cylinder { radius, half_length } => Drawn::Cylinder { radius, half_length },
            Shape::Box { half_size } => Drawn::Box { half: half_size },
        },
        position: geom.pos,
        quaternion: geom.quat,
        foot: feet.iter().position(|foot| *foot == geom.name || *foot == model.bodies[geom.body].name),
    });
    ReplayRobot {
        name: name.to_owned(),
        geoms: geoms.chain(bones(model, &carrier)).collect(),
        bodies,
        meshes: Vec::new(),
        feet: feet.iter().map(|foot| foot_name(foot).to_owned()).collect(),
        ground: None,
        frames: Vec::new(),
    }
}

/// The same on the ground of its simulator: where that is uneven, the part under the robot's way is drawn.
pub fn robot_on(name: &str, walker: &Walker, record: &GaitRecord) -> ReplayRobot {
    let ground = walker.ground().and_then(|ground| patch(ground, record));
    ReplayRobot { ground, ..robot(name, walker.model(), record) }
}

/// How far the ground is drawn beside a robot's way, m.
const BESIDE: f64 = 2.5;
/// Distance of drawn heights, m, and their max number along an edge: long ways get a coarser grid.
const FINE: f64 = 0.05;
const MAX_HEIGHTS: f64 = 400.0;

/// The ground about a robot's way.
fn patch(ground: &Surface, record: &GaitRecord) -> Option<Ground> {
    let along = |k: usize| {
        // A pose of the base is 7 numbers: position and quaternion.
        let places = record.base.iter().skip(k).step_by(7).filter(|x| x.is_finite());
        places.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &x| [low.min(x), high.max(x)])
    };
    // Some ground beside the way, so that the robot does not walk along an edge.
    let spans = [along(0), along(1)].map(|[low, high]| [low - BESIDE, high + BESIDE]);
    let longest = spans.iter().map(|[low, high]| high - low).fold(0.0, f64::max);
    if !longest.is_finite() || longest <= 0.0 {
        return None;
    }
    // Coarser for long ways: a page holds a limited number of heights.
    let step = FINE.max(longest / MAX_HEIGHTS);
    // Heights lie on whole steps of the world, where generated ground has its vertices.
    let corner = spans.map(|[low, _]| (low / step).floor() * step);
    // One height more than steps, because both ends have one.
    let [columns, rows] = [0, 1].map(|k| ((spans[k][1] - corner[k]) / step).ceil() as usize + 1);
    let heights = (0..rows * columns).map(|k| {
        ground.height(corner[0] + (k % columns) as f64 * step, corner[1] + (k / columns) as f64 * step)
    });
    Some(Ground { corner, step, columns, heights: heights.collect() })
}

/// A foot's name as it is shown: `FL` of `FL_foot`.
pub fn foot_name(geom: &str) -> &str {
    geom.strip_suffix("_foot").unwrap_or(geom)
}

fn frame(model: &Model, record: &GaitRecord, step: usize) -> Frame {
    let three = |values: &[f64]| std::array::from_fn(|k| values[3 * step + k]);
    let (joints, feet) = (model.joints.len(), record.feet.len());
    let angles = &record.joint_position[step * joints..(step + 1) * joints];
    Frame {
        base_position: std::array::from_fn(|k| record.base[7 * step + k]),
        base_quaternion: std::array::from_fn(|k| record.base[7 * step + 3 + k]),
        // A page's joints count from the pose of the file; the model's count from their own zero.
        joints: angles.iter().zip(&model.joints).map(|(q, joint)| q - joint.reference).collect(),
        contacts: record.contact[step * feet..(step + 1) * feet].to_vec(),
        command: three(&record.command),
        velocity: three(&record.velocity),
    }
}
