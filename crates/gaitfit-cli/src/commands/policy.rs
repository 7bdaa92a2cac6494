//! A policy at a glance, for `export` and `inspect`.

use crate::table::table;
use gaitfit_policy::Front;
use gaitfit_policy::observation::{Layout, Slot};
use gaitfit_policy::{ActionClip, Held, Policy, Provenance, Quantity, Term};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::PathBuf;

/// A policy, as `--json` prints it.
#[derive(Serialize)]
pub struct Document {
    robot: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    before_actor: Option<String>,
    actor: Network,
    critic: Option<Network>,
    normaliser: bool,
    observation: Vec<Part>,
    critic_observation: Vec<Part>,
    joints: Vec<Joint>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    held: Vec<Held>,
    action_clip: Option<ActionClip>,
    control_dt: f64,
    gait_frequency: Option<f64>,
    provenance: Provenance,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    notes: Vec<String>,
    written: Vec<String>,
    /// Files of the policy that carry no checksum.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    without_checksum: Vec<String>,
    /// What the written files do not state.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    not_said: Vec<String>,
}

impl Document {
    /// With the files that carry no checksum.
    pub fn unsealed(self, files: &[PathBuf]) -> Self {
        Self { without_checksum: files.iter().map(|file| file.display().to_string()).collect(), ..self }
    }

    /// With what its files do not say.
    pub fn without(self, not_said: Vec<String>) -> Self {
        Self { not_said, ..self }
    }
}

#[derive(Serialize)]
struct Network {
    layers: Vec<usize>,
    activation: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    output_activation: Option<String>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    layer_norm: bool,
    parameters: usize,
}

/// One term of an observation: elements `start .. end` are its present frame.
#[derive(Serialize)]
struct Part {
    quantity: Quantity,
    start: usize,
    end: usize,
    /// The first numbers of its frames, the oldest first; for terms with a history.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    frames: Vec<usize>,
    scale: Vec<f32>,
}

#[derive(Serialize)]
struct Joint {
    name: String,
    default_pose: f64,
    action_scale: f64,
    kp: f64,
    kd: f64,
    std: f32,
}

/// Describes `policy`; `written`: files to which it was written.
pub fn document(policy: &Policy, written: Vec<String>) -> Document {
    let interface = &policy.interface;
    let network = |network: &gaitfit_policy::network::Network| Network {
        layers: std::iter::once(network.shape.inputs)
            .chain(network.shape.hidden.iter().copied())
            .chain([network.shape.outputs])
            .collect(),
        activation: network.shape.activation.to_string(),
        output_activation: network.output.map(|output| output.to_string()),
        layer_norm: network.norms.iter().any(Option::is_some),
        parameters: network.parameters.len(),
    };
    let parts = |terms: &[Term]| {
        // The place of a term in the observation is what a program needs that runs the policy elsewhere.
        let part = |(term, slot): (&Term, &Slot)| Part {
            quantity: slot.quantity,
            start: slot.present.start,
            end: slot.present.end,
            frames: if slot.frames.len() > 1 { slot.frames.clone() } else { Vec::new() },
            scale: term.scale.clone(),
        };
        terms.iter().zip(Layout::new(interface, terms).slots()).map(part).collect()
    };
    let joint = |(index, name): (usize, &String)| Joint {
        name: name.clone(),
        default_pose: interface.default_pose[index],
        action_scale: interface.action_scale[index],
        kp: interface.kp[index],
        kd: interface.kd[index],
        // The file holds the logarithm.
        std: policy.log_std[index].exp(),
    };
    Document {
        robot: interface.robot.clone(),
        before_actor: policy.front.as_ref().map(|front| match front {
            Front::Recurrent(memory) => {
                let sizes: Vec<String> = memory.layers.iter().map(|layer| layer.hidden.to_string()).collect();
                format!("{} of {} units", memory.cell.name(), sizes.join(", "))
            }
            Front::Encoder(encoder) => {
                let (passed, shape) = (encoder.passed.len(), &encoder.network.shape);
                format!("encoder {shape} {}, {passed} numbers of the observation beside it", shape.activation)
            }
            Front::Function(_) => "a function".to_owned(),
            Front::Graph(graph) => graph.describe(),
        }),
        actor: network(&policy.actor),
        critic: policy.critic.as_ref().map(network),
        normaliser: policy.normaliser.is_some(),
        observation: parts(&interface.observation),
        critic_observation: parts(&interface.critic_observation),
        joints: interface.joints.iter().enumerate().map(joint).collect(),
        held: interface.held.clone(),
        action_clip: interface.action_clip.clone(),
        control_dt: interface.control_dt,
        gait_frequency: interface.gait_frequency,
        provenance: policy.provenance.clone(),
        notes: policy.notes.clone(),
        written,
        without_checksum: Vec::new(),
        not_said: Vec::new(),
    }
}

/// The document for people.
pub fn text(document: &Document) -> String {
    let shape = |network: &Network| {
        let widths: Vec<String> = network.layers.iter().map(usize::to_string).collect();
        let norm = if network.layer_norm { " with layer norm" } else { "" };
        let output = network.output_activation.as_ref().map(|output| format!(", {output} of its output"));
        let output = output.unwrap_or_default();
        let (widths, parameters) = (widths.join("-"), network.parameters);
        format!("{widths} {}{norm}{output}, {parameters} parameters", network.activation)
    };
    let robot = if document.robot.is_empty() { "an unnamed robot" } else { &document.robot };
    let mut text = format!("policy for {robot}\nactor   {}", shape(&document.actor));
    if let Some(before) = &document.before_actor {
        let _ = write!(text, ", behind {before}");
    }
    text.push_str(if document.normaliser { ", observation normalised\n" } else { "\n" });
    if let Some(critic) = &document.critic {
        let _ = writeln!(text, "critic  {}", shape(critic));
    }
    let _ = write!(text, "action every {} s", document.control_dt);
    match &document.action_clip {
        Some(ActionClip::All(clip)) => {
            let _ = write!(text, ", clipped to ±{clip}");
        }
        Some(ActionClip::Each(_)) => text.push_str(", clipped joint by joint"),
        None => {}
    }
    if let Some(frequency) = document.gait_frequency {
        let _ = write!(text, ", gait clock {frequency} Hz");
    }
    let provenance = &document.provenance;
    // A policy without a version comes from another trainer.
    if provenance.program_version.is_empty() {
        text.push_str("\ntrained elsewhere\n\n");
    } else {
        // Twelve digits tell configurations apart; `--json` prints all of them.
        let hash: String = provenance.configuration_hash.chars().take(12).collect();
        let _ = writeln!(
            text,
            "\n{} iterations, seed {}, configuration {hash}, gaitfit {}\n",
            provenance.iteration, provenance.seed, provenance.program_version
        );
    }
    let mut observation = table(&["observation", "elements", "scale"], &[1]);
    for part in &document.observation {
        let scale: Vec<String> = part.scale.iter().map(f32::to_string).collect();
        // No scale means that numbers are taken as they are.
        let scale = if scale.is_empty() { "1".to_owned() } else { scale.join(" ") };
        // Terms with a history: where its oldest frame begins.
        let past = match part.frames[..] {
            [] => String::new(),
            [first, ..] => format!(", {} frames, the oldest from {first}", part.frames.len()),
        };
        observation.add_row([
            part.quantity.name().to_owned(),
            format!("{}..{}{past}", part.start, part.end),
            scale,
        ]);
    }
    let mut joints = table(
        &["joint", "default rad", "action scale rad", "kp N·m/rad", "kd N·m·s/rad", "action std"],
        &[1, 2, 3, 4, 5],
    );
    for joint in &document.joints {
        joints.add_row([
            joint.name.clone(),
            joint.default_pose.to_string(),
            joint.action_scale.to_string(),
            joint.kp.to_string(),
            joint.kd.to_string(),
            format!("{:.3}", joint.std),
        ]);
    }
    let _ = writeln!(text, "{observation}\n\n{joints}");
    if !document.held.is_empty() {
        let mut held = table(&["held joint", "at rad", "kp N·m/rad", "kd N·m·s/rad"], &[1, 2, 3]);
        for Held { joint, position, kp, kd } in &document.held {
            held.add_row([joint.clone(), position.to_string(), kp.to_string(), kd.to_string()]);
        }
        let _ = writeln!(text, "\n{held}");
    }
    for note in &document.notes {
        let _ = writeln!(text, "note: {note}");
    }
    for path in &document.without_checksum {
        let _ = writeln!(
            text,
            "no checksum: {path} comes from another program or an earlier version, so damage to it cannot be \
             detected; `gaitfit export` writes a file with a checksum"
        );
    }
    for path in &document.written {
        let _ = writeln!(text, "wrote {path}");
    }
    for what in &document.not_said {
        let _ = writeln!(text, "not included: {what}");
    }
    text
}
