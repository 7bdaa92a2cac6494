//! The program, in Python's process.

use crate::errors::{failed, to_py_err};
use crate::watch::waited;
use gaitfit::watch::Watch;
use gaitfit_cli::ExplainInput;
use gaitfit_physics::JointParameter;
use gaitfit_sim::Candidate;
use pyo3::prelude::*;
use serde_json::json;
use std::ffi::OsString;
use std::path::PathBuf;

/// Runs the program with what starts it and its arguments; its exit code.
#[pyfunction]
pub fn program(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| gaitfit_cli::program(arguments))
}

/// What logs show that the robot has and its model lacks, as JSON.
#[pyfunction]
pub fn explain(
    py: Python<'_>,
    robot: PathBuf,
    logs: PathBuf,
    policy: Option<PathBuf>,
    lenient: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let explained = move |watch: &Watch<'_>| {
        let input = ExplainInput { logs: &logs, robot: &robot, policy: policy.as_deref(), lenient };
        gaitfit_cli::explain(input, watch)
    };
    waited(py, progress.as_ref(), explained)?.map_err(|error| to_py_err(&error))
}

/// What a robot's file states of the whole robot and of its joints, as JSON.
#[pyfunction]
pub fn robot_numbers(robot: PathBuf, lenient: bool) -> PyResult<String> {
    let model = gaitfit::robot::named(&robot, lenient).map_err(|error| to_py_err(&error))?;
    let nominal = Candidate::nominal(&model);
    let limits = nominal.robot.joints(JointParameter::TorqueLimit);
    let joints = model.joints.iter().zip(limits).map(|(joint, limit)| {
        json!({
            "name": joint.name,
            "slides": !joint.kind.is_hinge(),
            "range": joint.range,
            "frictionloss": joint.frictionloss,
            "armature": joint.armature,
            "damping": joint.damping,
            "stiffness": joint.stiffness,
            "rest": joint.springref,
            "torque_limit": Some(limit).filter(|limit| limit.is_finite()),
            "velocity_limit": joint.velocity_limit,
        })
    });
    let mass: f64 = model.bodies.iter().map(|body| body.mass).sum();
    let document = json!({ "name": model.name, "mass": mass, "joints": joints.collect::<Vec<_>>() });
    serde_json::to_string(&document).map_err(failed)
}
