//! From a record of a walk to the picture of its gait, and the commands to show a policy with.

use crate::replay::foot_name;
use gaitfit_learn::evaluate::GaitRecord;
use gaitfit_learn::task::CommandSettings;
use gaitfit_view::GaitPicture;
use gaitfit_view::gait::{FootTrack, TorqueSpectrum, VelocityTrack};
use indexmap::IndexMap;

/// Ten seconds (each part's length, s, and its command) that show what a policy can: standing, ahead, left, turning,
/// back, standing; as fast as it is asked for in training.
pub fn tour(command: &CommandSettings) -> [(f64, [f64; 3]); 6] {
    [
        (1.0, [0.0; 3]),
        (2.0, [command.x[1], 0.0, 0.0]),
        (2.0, [0.0, command.y[1], 0.0]),
        (2.0, [0.0, 0.0, command.yaw[1]]),
        (2.0, [command.x[0], 0.0, 0.0]),
        (1.0, [0.0; 3]),
    ]
}

/// Longest part of a record in the picture, s: steps must stay apart.
const MOST_SECONDS: f64 = 5.0;

/// The record as a picture: its first seconds; the spectra are of all of it.
pub fn picture(record: &GaitRecord) -> GaitPicture {
    let steps = record.steps().min((MOST_SECONDS / record.dt).round() as usize);
    let feet = record.feet.len();
    let track = |foot: usize| FootTrack {
        name: foot_name(&record.feet[foot]).to_owned(),
        contact: record.contact.iter().skip(foot).step_by(feet).take(steps).copied().collect(),
        height_m: record.foot_clearance.iter().skip(foot).step_by(feet).take(steps).copied().collect(),
    };
    let part = |values: &[f64], k: usize| values.iter().skip(k).step_by(3).take(steps).copied().collect();
    let velocity =
        |k| VelocityTrack { command: part(&record.command, k), measured: part(&record.velocity, k) };
    GaitPicture {
        time_s: (1..=steps).map(|step| step as f64 * record.dt).collect(),
        feet: (0..feet).map(track).collect(),
        velocity: [velocity(0), velocity(1), velocity(2)],
        spectra: spectra(record),
    }
}

/// Torque spectra by joints of one name on different legs.
fn spectra(record: &GaitRecord) -> Vec<TorqueSpectrum> {
    let joints = record.joints.len();
    let torques =
        |joint: usize| -> Vec<f64> { record.torque.iter().skip(joint).step_by(joints).copied().collect() };
    let mut groups: IndexMap<&str, Vec<Vec<f64>>> = IndexMap::new();
    for (joint, name) in record.joints.iter().enumerate() {
        groups.entry(group(name)).or_default().push(torques(joint));
    }
    if groups.len() == joints {
        groups = IndexMap::from([("all joints", (0..joints).map(torques).collect())]);
    }
    groups
        .iter()
        .map(|(name, torques)| TorqueSpectrum::from_samples(name, record.dt.recip(), torques))
        .collect()
}

/// `hip` of `FL_hip_joint`.
fn group(joint: &str) -> &str {
    let joint = joint.strip_suffix("_joint").unwrap_or(joint);
    joint.split_once('_').map_or(joint, |(_, part)| part)
}
