//! theta.json: every number with its interval, and what they make of each joint.

use super::joint::JointNumbers;
use gaitfit_adapt::{JointParameter, RobotNumber, ThetaFile};
use gaitfit_model::Model;
use gaitfit_settings::Error;
use gaitfit_sim::Candidate;
use serde_json::{Map, Value, json};

/// The document's text.
pub(super) fn document(
    file: &ThetaFile,
    joints: &[JointNumbers],
    model: &Model,
    candidate: &Candidate,
) -> Result<String, Error> {
    let parameters: Vec<Value> = file
        .parameter
        .iter()
        .map(|parameter| {
            json!({
                "name": parameter.name, "kind": parameter.kind, "joints": parameter.joints, "value": parameter.value,
                "unit": parameter.unit, "interval": parameter.interval, "identified": parameter.identified,
                "at_bound": parameter.at_bound,
            })
        })
        .collect();
    let robot = &candidate.robot;
    // JSON has no infinity: a limit that a joint lacks is null.
    let finite = |number: f64| number.is_finite().then_some(number);
    let mut by_joint = Map::new();
    for (index, joint) in joints.iter().enumerate().filter(|(_, joint)| joint.named) {
        // Every parameter of the step but gains, which are the controller's; then what the robot's file has a part in.
        let gains =
            [JointParameter::Kp, JointParameter::Kd, JointParameter::KpScale, JointParameter::KdScale];
        let exported = JointParameter::ALL.iter().filter(|&one| {
            !(gains.contains(one)
                || JointParameter::LINKS.contains(one)
                || *one == JointParameter::TorqueScale)
        });
        let mut numbers: Map<String, Value> =
            exported.map(|&one| (one.name().to_owned(), json!(finite(robot.joints(one)[index])))).collect();
        for (name, number) in [
            ("stiffness", joint.stiffness),
            ("spring_torque", joint.spring_torque),
            ("kp_factor", joint.kp_factor),
            ("kd_factor", joint.kd_factor),
        ] {
            numbers.insert(name.to_owned(), json!(number));
        }
        by_joint.insert(joint.name.clone(), Value::Object(numbers));
    }
    let mut links = Map::new();
    // Only links that the fit changed, so the document stays short.
    for (body, change) in
        model.bodies.iter().zip(robot.body_changes(model)).filter(|(_, change)| change.changed())
    {
        links.insert(body.name.clone(), json!({"mass_factor": change.factor, "com_shift": change.shift}));
    }
    let networks: Vec<Value> = file
        .network
        .iter()
        .map(|network| {
            json!({
                "name": network.name, "kind": network.kind, "joint": network.joint, "rest": network.rest,
                "position_scale": network.position_scale, "velocity_scale": network.velocity_scale,
                "output_scale": network.output_scale, "weights": network.weights,
            })
        })
        .collect();
    let numbers: Map<String, Value> =
        RobotNumber::ALL.iter().map(|one| (one.name().to_owned(), json!(one.value(candidate)))).collect();
    let whole = json!({
        "robot": file.robot, "cost_name": file.cost_name, "cost": file.cost, "physics_step": file.physics_step,
        "parameters": parameters, "joints": by_joint,
        "base": {
            "mass": robot.base_mass, "com": robot.base_com, "payload_mass": robot.payload_mass,
            "payload_position": robot.payload_position,
        },
        "links": links,
        "friction_factor": robot.friction_scale, "ground_softness": robot.ground_softness,
        "ground_impedance": robot.ground_impedance, "torque_noise": candidate.torque_noise, "numbers": numbers,
        "networks": networks,
        "sensors": {"imu_tilt": candidate.sensors.imu_tilt, "gyro_bias": candidate.sensors.gyro_bias, "velocity_lag": robot.velocity_lag},
    });
    serde_json::to_string_pretty(&whole)
        .map(|text| text + "\n")
        .map_err(|error| Error::failed(format!("cannot write theta.json: {error}")))
}
