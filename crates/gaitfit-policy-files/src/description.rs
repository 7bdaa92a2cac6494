//! A policy trained elsewhere, described in TOML: everything that its weights do not say.

use super::file::{bytes, ending};
use super::normalised::normalised;
use super::tensors::Tensors;
use super::{
    DescribedTerm, EncoderTensors, MemoryTensors, NormaliserTensors, PerJoint, ReferenceSource, onnx, torch,
    weights,
};
use gaitfit_model::with_meant;
use gaitfit_policy::invalid;
use gaitfit_policy::network::{Activation, LayerNorm, Network};
use gaitfit_policy::{
    ActionClip, FrameOrder, Front, Held, History, Inputs, Interface, InterfaceError, Quantity,
};
use gaitfit_policy::{Policy, PolicyError, Provenance};
use serde::Deserialize;
use std::path::Path;

/// The description of a policy trained elsewhere. Vectors over joints are in the order of `joints`, and may be one
/// number for all.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// The weights: an `.onnx` or `.safetensors` file, relative to the description.
    pub file: String,
    /// Activation of the hidden layers; for safetensors, which do not say.
    pub activation: Option<Activation>,
    /// Function of the actor's output, where it has one; for safetensors.
    pub output_activation: Option<Activation>,
    /// ε of layer norms in safetensors.
    pub layer_norm_epsilon: Option<f32>,
    /// Prefix of the actor's tensors in safetensors: `actor`, the default, finds `actor.0.weight`.
    pub actor: Option<String>,
    /// Prefix of the critic's tensors in safetensors; none leaves the critic out. Needs `critic_observation`.
    pub critic: Option<String>,
    /// Recurrent layers before the actor, in safetensors.
    pub memory: Option<MemoryTensors>,
    /// Encoder of a two-part policy: in the same safetensors, or in an ONNX file of its own.
    pub encoder: Option<EncoderTensors>,
    /// Normaliser of the actor's observation in safetensors; it becomes part of the actor's first layer.
    pub normaliser: Option<NormaliserTensors>,
    /// Normaliser of the critic's observation.
    pub critic_normaliser: Option<NormaliserTensors>,
    /// Standard deviation of the actions, for training on, 0.5 by default; safetensors with `log_std` or `std` have their own.
    pub std: Option<f64>,
    /// Name of the robot model; empty where it is not known.
    #[serde(default)]
    pub robot: String,
    /// Joint names in the policy's order.
    pub joints: Vec<String>,
    /// Pose at action zero, rad.
    pub default_pose: PerJoint,
    /// Target change per unit action, rad.
    pub action_scale: PerJoint,
    /// Largest action magnitude, before scaling.
    pub action_clip: Option<ActionClip>,
    /// Position gain, N·m/rad.
    pub kp: PerJoint,
    /// Velocity gain, N·m·s/rad.
    pub kd: PerJoint,
    /// Those of `joints` whose targets are velocities, rad/s, such as wheels; their pose and kp are 0.
    #[serde(default)]
    pub velocity_joints: Vec<String>,
    /// Joints that the policy does not move and a PD controller holds: `[[held]]` with `joint`, `position`, `kp`, `kd`.
    #[serde(default)]
    pub held: Vec<Held>,
    /// Time between actions, s.
    pub control_dt: f64,
    /// Frequency of the gait clock, Hz; where `gait_phase` is observed.
    pub gait_frequency: Option<f64>,
    /// The motion that the policy follows: a log, relative to the description.
    pub reference: Option<ReferenceSource>,
    /// Name of the body whose orientation the motion holds, as the policy's own file has it.
    pub anchor_body: Option<String>,
    /// What each input of an ONNX graph takes of the observation, where their widths do not say it.
    #[serde(default)]
    pub inputs: Inputs,
    /// The output of an ONNX graph that is the action, where it has several.
    pub output: Option<String>,
    /// How past frames lie in a row, where terms have a history.
    #[serde(default)]
    pub history: History,
    /// The actor's observation, part by part.
    pub observation: Vec<DescribedTerm>,
    /// The critic's observation, part by part.
    #[serde(default)]
    pub critic_observation: Vec<DescribedTerm>,
}

/// Standard deviation of the actions.
const STD: f64 = 0.5;

impl Description {
    /// Reads the description itself.
    ///
    /// # Errors
    /// Wrong TOML, or unknown and missing keys, with line and column.
    pub fn parse(text: &str) -> Result<Self, PolicyError> {
        toml::from_str(text).map_err(|error| {
            let message = with_meant(error.message());
            match error.span() {
                Some(span) => {
                    let before = text.get(..span.start).unwrap_or_default();
                    let line = before.matches('\n').count() + 1;
                    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
                    invalid(format!("line {line}, column {column}: {message}"))
                }
                None => invalid(message),
            }
        })
    }

    /// The description in a table.
    ///
    /// # Errors
    /// Unknown and missing keys.
    pub fn from_table(table: toml::Table) -> Result<Self, PolicyError> {
        // What it shows names the key, beneath the message.
        table.try_into().map_err(|error: toml::de::Error| {
            let shown = error.to_string().replace(error.message(), &with_meant(error.message()));
            invalid(shown.trim_end().replace('\n', " "))
        })
    }

    /// Returns the policy's interface, with files relative to the present folder.
    ///
    /// # Errors
    /// As [`Interface::check`]; a motion that cannot be read.
    pub fn interface(&self) -> Result<Interface, InterfaceError> {
        self.interface_in(Path::new("")).map_err(|error| match error {
            PolicyError::Interface(error) => error,
            other => InterfaceError(other.to_string()),
        })
    }

    /// Returns the policy's interface, with files relative to `folder`, where the description lies.
    ///
    /// # Errors
    /// As [`Description::interface`].
    pub fn interface_in(&self, folder: &Path) -> Result<Interface, PolicyError> {
        let joints = self.joints.len();
        // With this order a term is one block of all its frames. Others put whole observations one after the other.
        let by_term = self.history.order == FrameOrder::Terms;
        let terms = |terms: &[DescribedTerm]| terms.iter().flat_map(|term| term.terms(by_term)).collect();
        let sines = |term: &DescribedTerm| {
            term.quantity == Quantity::GaitSine
                && term.history > 1
                && matches!(&term.scale, Some(PerJoint::Each(scale)) if scale.len() > 1)
        };
        if by_term && self.observation.iter().chain(&self.critic_observation).any(sines) {
            return Err(InterfaceError(
                "gait_sine with several factors has a history: set history.order to \"frames\" or \"newest_first\""
                    .to_owned(),
            )
            .into());
        }
        let interface = Interface {
            robot: self.robot.clone(),
            joints: self.joints.clone(),
            default_pose: self.default_pose.spread(joints),
            action_scale: self.action_scale.spread(joints),
            action_clip: self.action_clip.clone(),
            kp: self.kp.spread(joints),
            kd: self.kd.spread(joints),
            velocity_joints: self.velocity_joints.clone(),
            held: self.held.clone(),
            control_dt: self.control_dt,
            gait_frequency: self.gait_frequency,
            reference: self
                .reference
                .as_ref()
                .map(|source| source.read(folder, &self.joints, self.anchor_body.as_deref()))
                .transpose()?,
            history: self.history,
            observation: terms(&self.observation),
            critic_observation: terms(&self.critic_observation),
        };
        interface.check()?;
        Ok(interface)
    }

    /// Reads the weights, relative to `folder`, and puts the policy together. Of a safetensors file that this program
    /// wrote everything but the interface is kept, unless `activation` says to read its tensors as another program's.
    ///
    /// # Errors
    /// Weights that are no multilayer perceptron, or do not fit the description.
    pub fn load(&self, folder: &Path) -> Result<Policy, PolicyError> {
        let mut interface = self.interface_in(folder)?;
        let std = self.std.unwrap_or(STD);
        // The policy holds the logarithm, which neither 0 nor a negative number has.
        if !(std > 0.0 && std.is_finite()) {
            return Err(invalid(format!("std is {std}; give a positive number")));
        }
        if self.file.is_empty() {
            return Err(invalid("`file` is empty; it must name an .onnx or .safetensors file"));
        }
        let path = folder.join(&self.file);
        let inside = |source| PolicyError::In { path: path.clone(), source: Box::new(source) };
        let ending = ending(&path);
        if ending.as_deref() == Some("safetensors") && self.activation.is_none() {
            let bytes = bytes(&path)?;
            if weights::interface(&bytes).is_some() {
                return self.other_interface(interface, weights::read(&bytes).map_err(inside)?);
            }
        }
        let Loaded { front, actor, critic, log_std, clip, notes } = match ending.as_deref() {
            Some("onnx") => {
                // The graph may name further files, which lie beside it and not beside the description.
                let home = path.parent().unwrap_or(folder);
                let mut loaded = self.onnx(&bytes(&path)?, home, &interface).map_err(inside)?;
                if let Some(encoder) = &self.encoder {
                    if loaded.front.is_some() {
                        return Err(inside(invalid(
                            "it has recurrent layers or is a graph of its own, and `encoder` is given: a policy has one of \
                             them",
                        )));
                    }
                    loaded.front = Some(encoder.beside(folder, &interface)?);
                }
                loaded
            }
            Some("safetensors") => self.safetensors(&interface, &bytes(&path)?).map_err(inside)?,
            Some(ending) if torch::ENDINGS.contains(&ending) => {
                return Err(inside(torch::refuse(
                    &path,
                    &bytes(&path)?,
                    Some(interface.observation_width()),
                )));
            }
            _ => return Err(inside(invalid("`file` must name an .onnx or .safetensors file"))),
        };
        // Networks have no clip, so the clip of the graph becomes one of the interface.
        let clip = clip.map(|clip| clipped(&mut interface, clip));
        let notes = notes.into_iter().chain(clip).collect();
        let policy = Policy {
            log_std: log_std.unwrap_or_else(|| vec![std.ln() as f32; interface.joints.len()]),
            interface,
            front,
            actor,
            critic,
            normaliser: None,
            critic_memory: None,
            critic_normaliser: None,
            provenance: Provenance::default(),
            notes,
        };
        policy.check()?;
        Ok(policy)
    }

    /// `policy` with another interface. The critic goes where nothing says what it sees.
    fn other_interface(&self, interface: Interface, policy: Policy) -> Result<Policy, PolicyError> {
        let given = [
            ("output_activation", self.output_activation.is_some()),
            ("layer_norm_epsilon", self.layer_norm_epsilon.is_some()),
            ("actor", self.actor.is_some()),
            ("std", self.std.is_some()),
            ("inputs", !self.inputs.is_empty()),
            ("output", self.output.is_some()),
            ("critic", self.critic.is_some()),
            ("memory", self.memory.is_some()),
            ("encoder", self.encoder.is_some()),
            ("normaliser", self.normaliser.is_some()),
            ("critic_normaliser", self.critic_normaliser.is_some()),
        ];
        if let Some((key, _)) = given.iter().find(|(_, given)| *given) {
            return Err(invalid(format!(
                "`{key}` is for files of other programs; {} is gaitfit's and has its own: leave it out",
                self.file
            )));
        }
        let sees = !interface.critic_observation.is_empty();
        // The inputs of a graph take other places in the observation of the new interface, so the graph is
        // read again.
        let front = match policy.front {
            Some(Front::Graph(graph)) => Some(Front::Graph(onnx::graph_behind(&graph, &interface)?)),
            front => front,
        };
        let policy = Policy {
            front,
            interface,
            critic: policy.critic.filter(|_| sees),
            critic_memory: policy.critic_memory.filter(|_| sees),
            critic_normaliser: policy.critic_normaliser.filter(|_| sees),
            ..policy
        };
        policy.check()?;
        Ok(policy)
    }

    fn onnx(&self, bytes: &[u8], folder: &Path, interface: &Interface) -> Result<Loaded, PolicyError> {
        let other = [
            ("activation", self.activation.is_some()),
            ("output_activation", self.output_activation.is_some()),
            ("layer_norm_epsilon", self.layer_norm_epsilon.is_some()),
            ("critic", self.critic.is_some()),
            ("memory", self.memory.is_some()),
            ("normaliser", self.normaliser.is_some()),
            ("critic_normaliser", self.critic_normaliser.is_some()),
        ];
        if let Some((key, _)) = other.iter().find(|(_, given)| *given) {
            return Err(invalid(format!(
                "`{key}` is for safetensors; the ONNX graph itself says it: leave it out"
            )));
        }
        match onnx::read_graph(bytes, folder, interface, &self.inputs, self.output.as_deref())? {
            onnx::Found::Layers(onnx::Read { memory, network, clip }) => {
                let front = memory.map(Front::Recurrent);
                Ok(Loaded { front, clip, ..Loaded::new(network) })
            }
            onnx::Found::Graph(graph, notes) => {
                // The graph gives the actions; the actor passes them on as they are.
                let actor = Network::identity(interface.joints.len())?;
                Ok(Loaded { front: Some(Front::Graph(graph)), notes, ..Loaded::new(actor) })
            }
        }
    }

    fn safetensors(&self, interface: &Interface, bytes: &[u8]) -> Result<Loaded, PolicyError> {
        if !self.inputs.is_empty() || self.output.is_some() {
            return Err(invalid("`inputs` and `output` are for ONNX graphs; leave them out"));
        }
        let activation = self.activation.ok_or_else(|| {
            invalid(
                "safetensors do not say the activation; add activation = \"elu\" (or relu, tanh, silu, …)",
            )
        })?;
        let mut tensors = Tensors::parse(bytes)?;
        let epsilon = self.layer_norm_epsilon.unwrap_or(LayerNorm::EPSILON);
        let kind = (activation, epsilon);
        // A normaliser before a memory or an encoder is not one of the actor's first layer.
        let normaliser = self.normaliser.as_ref().filter(|_| self.memory.is_none() && self.encoder.is_none());
        let mut actor = normalised(&mut tensors, self.actor.as_deref().unwrap_or("actor"), kind, normaliser)?;
        actor.output = self.output_activation;
        let front = self.front(&mut tensors, interface, kind)?;
        let critic = match &self.critic {
            Some(prefix) => Some(normalised(&mut tensors, prefix, kind, self.critic_normaliser.as_ref())?),
            None if self.critic_normaliser.is_some() => {
                return Err(invalid("critic_normaliser is given without critic; leave it out"));
            }
            None => None,
        };
        // A normaliser's standard deviation may have the name that trainers give the actions'.
        let of_normaliser = |name: &str| {
            let both = [&self.normaliser, &self.critic_normaliser];
            both.iter().any(|one| one.as_ref().is_some_and(|one| one.std == name || one.mean == name))
        };
        // Trainers store the standard deviation of the actions itself or its logarithm.
        let log_std = if tensors.has("log_std") {
            Some(tensors.vector("log_std")?)
        } else if tensors.has("std") && !of_normaliser("std") {
            Some(tensors.vector("std")?.into_iter().map(f64::ln).collect())
        } else {
            None
        };
        let log_std = log_std.map(|values| values.into_iter().map(|value| value as f32).collect());
        Ok(Loaded { front, critic, log_std, ..Loaded::new(actor) })
    }

    /// Reads what stands before the actor.
    fn front(
        &self,
        tensors: &mut Tensors<'_>,
        interface: &Interface,
        (activation, epsilon): (Activation, f32),
    ) -> Result<Option<Front>, PolicyError> {
        if (self.memory.is_some() || self.encoder.is_some()) && self.normaliser.is_some() {
            return Err(invalid(
                "`normaliser` is not read before a memory or an encoder; export the policy as ONNX, or scale the terms",
            ));
        }
        match (&self.memory, &self.encoder) {
            (None, None) => Ok(None),
            (Some(_), Some(_)) => Err(invalid("`memory` and `encoder` are not read together; give one")),
            (Some(MemoryTensors { cell, tensors: prefix }), None) => {
                Ok(Some(Front::Recurrent(tensors.recurrent(prefix, *cell)?)))
            }
            (None, Some(encoder)) => Ok(Some(encoder.among(tensors, interface, (activation, epsilon))?)),
        }
    }
}

/// Contents of weights files.
struct Loaded {
    front: Option<Front>,
    actor: Network,
    critic: Option<Network>,
    log_std: Option<Vec<f32>>,
    /// Largest magnitude of each output, where the graph clips them.
    clip: Option<Vec<f64>>,
    notes: Vec<String>,
}

impl Loaded {
    /// An actor alone.
    fn new(actor: Network) -> Self {
        Self { front: None, actor, critic: None, log_std: None, clip: None, notes: Vec::new() }
    }
}

/// Gives the interface the clip of a graph's outputs, as well as its own. What to know of it, in words.
fn clipped(interface: &mut Interface, clip: Vec<f64>) -> String {
    // Both clips act, so the smaller one is what is left.
    let clips: Vec<f64> =
        clip.iter().enumerate().map(|(joint, &clip)| clip.min(interface.clip(joint))).collect();
    let shown = match clips[..] {
        // Equal limits become one number, as a description would state them.
        [first, ref rest @ ..] if rest.iter().all(|&one| one == first) => {
            interface.action_clip = Some(ActionClip::All(first));
            format!("±{first}")
        }
        _ => {
            interface.action_clip = Some(ActionClip::Each(clips));
            "limits of each joint".to_owned()
        }
    };
    let seen = interface.observation.iter().any(|term| term.quantity == Quantity::LastAction);
    let seen = if seen { "; last_action is observed before the clip" } else { "" };
    format!("its graph clips the actions: read as action_clip ({shown}){seen}")
}
