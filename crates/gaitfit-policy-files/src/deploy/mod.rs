//! What other programs need to run a policy: its interface as YAML, unitree_rl_lab's `deploy.yaml`, and C++ with the
//! network inside.

mod controller;
mod cxx;
mod layers;
mod unitree;

use crate::onnx;
use gaitfit_model::Model;
use gaitfit_policy::invalid;
use gaitfit_policy::{Front, Policy, PolicyError};
use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment, UndefinedBehavior};
use serde::Serialize;
use std::fmt::Display;

/// The network's file in a bundle, where unitree_rl_lab looks for it.
const NETWORK: &str = "exported/policy.onnx";

/// Files for another program, and what they do not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deployment {
    /// Paths inside a folder, with `/`, and contents.
    pub files: Vec<(String, Vec<u8>)>,
    /// Facts that a file does not state, or reasons why there is no file, in words.
    pub unsaid: Vec<String>,
}

/// Refuses policies that follow a motion, which the programs do not read.
fn without_motion(policy: &Policy) -> Result<(), PolicyError> {
    match policy.interface.reference {
        None => Ok(()),
        Some(_) => Err(invalid(
            "the policy follows a reference motion, which is not written for other programs; `--onnx` and `--safetensors` keep \
             it for gaitfit",
        )),
    }
}

/// A folder for those who run the policy without gaitfit: `exported/policy.onnx` (one row at a time),
/// `controller.yaml` (the whole interface as parameters of a ROS 2 node) and, for Unitree's robots, `params/deploy.yaml`
/// of unitree_rl_lab. `model`: the robot, whose effort limits are written.
///
/// # Errors
/// A policy whose parts do not fit ([`Policy::check`]), one that ONNX does not hold (recurrent, two-part), a robot
/// that lacks a joint of the policy.
pub fn bundle(policy: &Policy, model: Option<&Model>) -> Result<Deployment, PolicyError> {
    without_motion(policy)?;
    let network = match policy.front {
        None | Some(Front::Function(_) | Front::Graph(_)) => onnx::write_single(policy)?,
        Some(Front::Recurrent(_)) => {
            return Err(invalid(
                "programs that take a bundle keep no memory between steps, so there is none of recurrent policies; `--onnx` \
                 writes them with h_in and h_out, and `--cpp` writes them as C++",
            ));
        }
        Some(Front::Encoder(_)) => {
            return Err(invalid(
                "two-part policies are not written as ONNX, so there is no bundle of them; `--cpp` writes them as C++",
            ));
        }
    };
    let mut made = Deployment { files: vec![(NETWORK.to_owned(), network)], unsaid: Vec::new() };
    let text = controller::write(policy, model, &mut made.unsaid)?;
    made.files.push(("controller.yaml".to_owned(), text.into_bytes()));
    match unitree::obstacle(&policy.interface) {
        Some(why) => made.unsaid.push(format!("no params/deploy.yaml: {why}")),
        None => {
            let text = unitree::write(policy, &mut made.unsaid)?;
            made.files.push(("params/deploy.yaml".to_owned(), text.into_bytes()));
        }
    }
    Ok(made)
}

/// A C++17 header with the policy inside, `policy.hpp`, and `example.cpp` that runs it on numbers from standard input.
/// The header needs nothing but the standard library, and allocates nothing. Histories, recurrent and two-part policies
/// are in it. `model`: the robot, whose effort limits are written.
///
/// # Errors
/// A policy whose parts do not fit ([`Policy::check`]), one of more than two million numbers, and a robot that lacks a
/// joint of the policy.
pub fn cxx(policy: &Policy, model: Option<&Model>) -> Result<Deployment, PolicyError> {
    policy.check()?;
    without_motion(policy)?;
    let mut unsaid = Vec::new();
    let efforts = efforts("policy.hpp", policy, model, &mut unsaid)?;
    if efforts.held.is_some() {
        unsaid.push("policy.hpp: effort limits of the held joints".to_owned());
    }
    unsaid.push("policy.hpp: limits of joint angles; clamp what you send to motors".to_owned());
    let files = vec![
        ("policy.hpp".to_owned(), cxx::header(policy, efforts.moved.as_deref())?.into_bytes()),
        ("example.cpp".to_owned(), include_bytes!("example.cpp").to_vec()),
    ];
    Ok(Deployment { files, unsaid })
}

/// Effort limits, N·m; absent where one of the joints has no known limit.
struct Efforts {
    /// Of the joints that the policy moves.
    moved: Option<Vec<f64>>,
    /// Of the joints that are held.
    held: Option<Vec<f64>>,
}

/// The effort limits of `model` that `file` takes.
///
/// # Errors
/// A robot that lacks a joint of the policy.
fn efforts(
    file: &str,
    policy: &Policy,
    model: Option<&Model>,
    unsaid: &mut Vec<String>,
) -> Result<Efforts, PolicyError> {
    let Some(model) = model else {
        unsaid.push(format!("{file}: effort limits; give the robot with --robot"));
        return Ok(Efforts { moved: None, held: None });
    };
    let interface = &policy.interface;
    let joints = interface.resolve(model)?;
    let held = interface.resolve_held(model, &joints)?;
    let mut limits = |joints: &[usize]| {
        // One joint without a limit leaves all of them out, because a list has a number for each joint.
        let efforts: Option<Vec<f64>> =
            joints.iter().map(|&joint| model.effort(joint).filter(|limit| limit.is_finite())).collect();
        if efforts.is_none() {
            unsaid.push(format!(
                "{file}: effort limits, as robot `{}` does not limit each of these joints",
                gaitfit_model::shown(&model.name)
            ));
        }
        efforts
    };
    // Without held joints there is nothing to report as missing.
    Ok(Efforts { moved: limits(&joints), held: if held.is_empty() { None } else { limits(&held) } })
}

/// A number as YAML and C++ read it in double precision: with a point, without an exponent.
fn number(value: impl Display) -> String {
    let text = value.to_string();
    // Rust prints no exponent, but whole numbers without a point, which YAML reads as integers.
    if text.contains('.') { text } else { text + ".0" }
}

/// `[0.1, 0.2]`.
fn numbers<T: Display>(values: impl IntoIterator<Item = T>) -> String {
    list(values.into_iter().map(number))
}

/// `[3, 12]`, of whole numbers and of texts that are YAML already.
fn list<T: Display>(values: impl IntoIterator<Item = T>) -> String {
    let texts: Vec<String> = values.into_iter().map(|value| value.to_string()).collect();
    format!("[{}]", texts.join(", "))
}

/// A text between double quotes, as YAML reads it: a JSON string is one.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

/// The factors of one frame of a term, one a number.
fn scale_of(policy: &Policy, term: &gaitfit_policy::Term) -> Vec<f32> {
    let width = term.quantity.width(policy.interface.joints.len());
    match term.scale[..] {
        [] => vec![1.0; width],
        [one] => vec![one; width],
        _ => term.scale.clone(),
    }
}

/// Describes the first observed quantity that a robot does not measure.
fn unmeasured(interface: &gaitfit_policy::Interface) -> Option<String> {
    let quantity = interface.unmeasured()?.name();
    Some(format!("the policy observes {quantity}, which a robot does not measure; train one without it"))
}

/// A template with the numbers of `page`.
fn render(template: &str, page: impl Serialize) -> Result<String, PolicyError> {
    let mut environment = Environment::new();
    // No text here is HTML, and a missing number must not leave an empty place in a robot's file.
    environment.set_auto_escape_callback(|_| AutoEscape::None);
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    let failed = |error: minijinja::Error| invalid(format!("the text cannot be made: {error}"));
    // A line with nothing but a statement of the template leaves no empty line.
    let syntax =
        SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).keep_trailing_newline(true).build();
    environment.set_syntax(syntax.map_err(failed)?);
    environment.render_str(template, Serde(page)).map_err(failed)
}
