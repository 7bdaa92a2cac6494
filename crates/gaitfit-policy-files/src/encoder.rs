//! The encoder of a described two-part policy: tensors beside the actor's, or an ONNX file of its own.

use super::file::bytes;
use super::onnx;
use super::tensors::Tensors;
use gaitfit_policy::invalid;
use gaitfit_policy::network::{Activation, Network};
use gaitfit_policy::observation::Layout;
use gaitfit_policy::{Encoder, Front, Interface, Latent, PolicyError};
use serde::Deserialize;
use std::path::Path;

/// Where an encoder is, which sees the whole observation, and what the actor sees beside its latent.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EncoderTensors {
    /// Prefix of the tensors in safetensors: `encoder` finds `encoder.0.weight`.
    pub tensors: Option<String>,
    /// Its own ONNX file, relative to the description, beside an actor in ONNX.
    pub file: Option<String>,
    /// Activation of its hidden layers in safetensors; none is the actor's.
    pub activation: Option<Activation>,
    /// Function of its output; in safetensors.
    pub output_activation: Option<Activation>,
    /// What of the observation the actor sees.
    #[serde(default)]
    pub passes: Passes,
    /// Where the latent stands in the actor's input.
    #[serde(default)]
    pub latent: Latent,
}

/// What of the observation an actor behind an encoder sees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Passes {
    /// All of it.
    #[default]
    All,
    /// The present frame of each term.
    Present,
}

impl EncoderTensors {
    /// The encoder among the tensors of the actor's file.
    pub(super) fn among(
        &self,
        tensors: &mut Tensors<'_>,
        interface: &Interface,
        (activation, epsilon): (Activation, f32),
    ) -> Result<Front, PolicyError> {
        let (Some(prefix), None) = (&self.tensors, &self.file) else {
            return Err(invalid(
                "`encoder` beside an actor in safetensors needs `tensors`, the prefix of its tensors in that file, and no \
                 `file`",
            ));
        };
        let mut network = tensors.network(prefix, self.activation.unwrap_or(activation), epsilon)?;
        network.output = self.output_activation;
        Ok(self.front(interface, network))
    }

    /// The encoder in an ONNX file of its own in `folder`.
    pub(super) fn beside(&self, folder: &Path, interface: &Interface) -> Result<Front, PolicyError> {
        let Some(file) = &self.file else {
            return Err(invalid(
                "`encoder` beside an actor in ONNX needs `file`, the encoder's ONNX file, such as \"encoder.onnx\"",
            ));
        };
        let given = [
            ("tensors", self.tensors.is_some()),
            ("activation", self.activation.is_some()),
            ("output_activation", self.output_activation.is_some()),
        ];
        if let Some((key, _)) = given.iter().find(|(_, given)| *given) {
            return Err(invalid(format!(
                "`encoder.{key}` is for safetensors; the encoder's ONNX graph itself says it: leave it out"
            )));
        }
        let path = folder.join(file);
        let inside = |source| PolicyError::In { path: path.clone(), source: Box::new(source) };
        // External data of the encoder's graph lie beside that graph.
        let home = path.parent().unwrap_or(folder);
        let onnx::Read { memory, network, clip } =
            onnx::read_chain(&bytes(&path)?, home).and_then(|chain| chain.read(None)).map_err(inside)?;
        // An interface can clip actions, but nothing clips what lies between encoder and actor.
        if clip.is_some() {
            return Err(inside(invalid(
                "an encoder whose output is clipped is not read; export it without its Clip",
            )));
        }
        if memory.is_some() {
            return Err(inside(invalid(
                "an encoder with recurrent layers is not read; only multilayer perceptrons are",
            )));
        }
        // The encoder sees all frames. Only what is passed beside it can be cut to the present one.
        let observed = Layout::new(interface, &interface.observation).width();
        if network.shape.inputs != observed {
            let takes = network.shape.inputs;
            return Err(inside(invalid(format!(
                "the encoder takes {takes} numbers, the observation has {observed}: it must see the whole observation, \
                 histories included"
            ))));
        }
        Ok(self.front(interface, network))
    }

    fn front(&self, interface: &Interface, network: Network) -> Front {
        let layout = Layout::new(interface, &interface.observation);
        let passed = match self.passes {
            Passes::All => (0..layout.width()).collect(),
            Passes::Present => layout.slots().iter().flat_map(|slot| slot.present.clone()).collect(),
        };
        Front::Encoder(Encoder { network, passed, latent: self.latent })
    }
}
