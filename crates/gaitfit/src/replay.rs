//! From a simulated robot and its record to what a 3-D replay draws.

use gaitfit_learn::evaluate::GaitRecord;
use gaitfit_model::{Model, Shape};
use gaitfit_view::replay::{Body, Frame, Geom, Joint, ReplayRobot, Shape as Drawn};

/// The robot called `name`, moving as recorded.
pub fn robot(name: &str, model: &Model, record: &GaitRecord) -> ReplayRobot {
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
        });
        let parent = body.parent.map(|parent| carrier[parent]);
        bodies.push(Body {
            name: body.name.clone(),
            parent,
            position: body.pos,
            quaternion: body.quat,
            // The base has no parent to turn against; a hinge on it gets a body of its own below.
            joint: if parent.is_some() { joints.next() } else { None },
        });
        // A drawn body has one hinge: further ones of the model's body act one after the other.
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
        foot: record.feet.iter().position(|foot| *foot == geom.name),
    });
    ReplayRobot {
        name: name.to_owned(),
        geoms: geoms.collect(),
        bodies,
        feet: record.feet.iter().map(|foot| foot_name(foot).to_owned()).collect(),
        frames: (0..record.steps()).map(|step| frame(model, record, step)).collect(),
    }
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
        joints: angles.iter().zip(&model.joints).map(|(q, joint)| q - joint.reference).collect(),
        contacts: record.contact[step * feet..(step + 1) * feet].to_vec(),
        command: three(&record.command),
        velocity: three(&record.velocity),
    }
}
