//! From a record of a walk to the picture of its gait.

use crate::replay::foot_name;
use gaitfit_learn::evaluate::GaitRecord;
use gaitfit_view::GaitPicture;
use gaitfit_view::gait::{FootTrack, TorqueSpectrum, VelocityTrack};

/// Longest part of a record in the picture, s: steps must stay apart.
const MAX_SECONDS: f64 = 5.0;

/// The record as a picture: its first seconds; the spectra are of all of it.
pub fn picture(record: &GaitRecord) -> GaitPicture {
    let steps = record.steps().min((MAX_SECONDS / record.dt).round() as usize);
    let feet = record.feet.len();
    let track = |foot: usize| FootTrack {
        name: foot_name(&record.feet[foot]).to_owned(),
        // A record has the feet of a step side by side: every `feet`-th entry is one foot's.
        contact: record.contact.iter().skip(foot).step_by(feet).take(steps).copied().collect(),
        height_m: record.foot_clearance.iter().skip(foot).step_by(feet).take(steps).copied().collect(),
    };
    // Velocities and commands are triples: forward, left, yaw rate.
    let part = |values: &[f64], k: usize| values.iter().skip(k).step_by(3).take(steps).copied().collect();
    let velocity =
        |k| VelocityTrack { command: part(&record.command, k), measured: part(&record.velocity, k) };
    GaitPicture {
        // A record's first entry is after the first control period.
        time_s: (1..=steps).map(|step| step as f64 * record.dt).collect(),
        feet: (0..feet).map(track).collect(),
        velocity: [velocity(0), velocity(1), velocity(2)],
        spectra: spectra(record),
    }
}

/// Torque spectra by joints of one name on different legs.
fn spectra(record: &GaitRecord) -> Vec<TorqueSpectrum> {
    let mut groups: Vec<&str> = Vec::new();
    for name in record.joints.iter().map(|joint| group(joint)) {
        if !groups.contains(&name) {
            groups.push(name);
        }
    }
    let spectrum = |name: &str, wanted: &dyn Fn(&str) -> bool| {
        let (frequency_hz, density) = record.torque_spectrum(wanted);
        let slides = record.slides.iter().any(|joint| wanted(joint));
        TorqueSpectrum { group: name.to_owned(), slides, frequency_hz, density }
    };
    // No two joints share a name, so a spectrum for each would be as many curves as joints.
    if groups.len() == record.joints.len() {
        return vec![spectrum("all joints", &|_| true)];
    }
    groups.iter().map(|&name| spectrum(name, &|joint| group(joint) == name)).collect()
}

/// `hip` of `FL_hip_joint`.
fn group(joint: &str) -> &str {
    let joint = gaitfit_model::patterns::plain(joint);
    joint.split_once('_').map_or(joint, |(_, part)| part)
}
