//! Networks of joints: ActionDelta and ResidAct (Dao and Fern; He et al. 2025).

use super::features;
use super::joint_parameters::every_joint;
use super::network_kind::{NETWORK_LAYERS, OUTPUT_WEIGHTS};
use super::read_context::ReadContext;
use super::saved::MAX_VALUE;
use super::{
    Entry, Found, LinearSpring, Modification, NetworkName, SavedNetwork, Sharing, ThetaError, ThetaFile,
    ThetaFileError,
};
use gaitfit_model::JointKind;
use gaitfit_model::patterns::plain;
use gaitfit_physics::{NETWORK_WEIGHTS, NetworkScales};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::{Candidate, JointNetworks};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// The range of scales. Beyond it a scale is no unit, and single precision may overflow.
const SCALES: RangeInclusive<f64> = 1e-6..=1e6;
/// Standard deviation of random hidden biases. Without any, hidden units would be odd functions.
const BIAS_DEVIATION: f64 = 0.25;

/// Where the search for weights begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NetworkStart {
    /// All weights 0, as in the paper. All hidden units are then alike, and near the start the output depends on the
    /// inputs only through products of three small weights.
    #[default]
    Zero,
    /// Hidden weights drawn anew for each seed, the last layer 0: the output is 0 too, but the last layer's five
    /// weights act on it at once. Weights are normal with variance 1 / inputs, biases with deviation 0.25.
    Random,
    /// Hidden weights fixed so that the last layer's five weights stand for friction, damping, inertia, stiffness and
    /// an offset; only these five are searched, from 0.
    Features,
}

impl NetworkStart {
    /// Weights of a network that are searched, and what each is called after the network's name.
    fn searched(self) -> Vec<String> {
        match self {
            Self::Zero | Self::Random => (0..NETWORK_WEIGHTS).map(|weight| weight.to_string()).collect(),
            Self::Features => features::NAMES.map(str::to_owned).to_vec(),
        }
    }

    /// Their units, where a single weight means something.
    fn units(self, output: f64, torque: bool) -> Vec<String> {
        match self {
            Self::Zero | Self::Random => vec!["-".to_owned(); NETWORK_WEIGHTS],
            Self::Features => features::units(output, torque).to_vec(),
        }
    }
}

/// A rule: networks (6 inputs, hidden 8 and 4, tanh, one output) of the joints it covers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkRule {
    /// The quantity that the networks correct.
    pub kind: NetworkName,
    /// How many joints share weights. A network sees its own joint alone either way.
    #[serde(default = "per_joint")]
    pub per: Sharing,
    /// Patterns over joint names, with or without a final `_joint`; a joint is covered when any matches.
    #[serde(default = "every_joint")]
    pub joints: Vec<String>,
    /// Lower bound of every weight that is searched.
    #[serde(default = "minus_one")]
    pub lower: f64,
    /// Upper bound of every weight that is searched.
    #[serde(default = "one")]
    pub upper: f64,
    /// Start of the search.
    #[serde(default)]
    pub start: NetworkStart,
    /// First standard deviation of every weight that is searched.
    #[serde(default = "quarter")]
    pub deviation: f64,
    /// Factor on the joint's angle less its rest angle, 1/rad.
    #[serde(default = "one")]
    pub position_scale: f64,
    /// Factor on the joint's velocity, s/rad.
    #[serde(default = "tenth")]
    pub velocity_scale: f64,
    /// Output for a last layer of weight 1, rad or N·m.
    #[serde(default = "one")]
    pub output_scale: f64,
    /// Added to every cost times the mean over the networks of b² + Σ w² over the last layer (weights w, bias b). Hidden
    /// units lie in [−1, 1], so five times that bounds the square of the output in units of `output_scale`: joints
    /// that the cost says nothing about stay uncorrected.
    #[serde(default)]
    pub regularisation: f64,
}

fn per_joint() -> Sharing {
    Sharing::Joint
}

fn minus_one() -> f64 {
    -1.0
}

fn one() -> f64 {
    1.0
}

fn quarter() -> f64 {
    0.25
}

fn tenth() -> f64 {
    0.1
}

impl NetworkRule {
    /// A rule over all joints with the defaults: the paper's bounds, start and deviation, outputs in rad or N·m.
    pub fn new(kind: NetworkName) -> Self {
        Self {
            kind,
            per: Sharing::Joint,
            joints: every_joint(),
            lower: -1.0,
            upper: 1.0,
            start: NetworkStart::Zero,
            deviation: 0.25,
            position_scale: 1.0,
            velocity_scale: 0.1,
            output_scale: 1.0,
            regularisation: 0.0,
        }
    }

    /// The modification for a robot with these `joints`; `groups` are names with joint patterns; `rest` are the angles
    /// at which the position inputs are 0 (the policy's default pose), rad, one a joint.
    ///
    /// # Errors
    /// [`ThetaError`] if patterns or numbers do not fit.
    pub fn modification(
        &self,
        groups: &[(String, Vec<String>)],
        joints: &[String],
        rest: &[f64],
    ) -> Result<Box<dyn Modification>, ThetaError> {
        let kind = self.kind.name();
        for (what, value, allowed) in [
            ("position_scale", self.position_scale, SCALES),
            ("velocity_scale", self.velocity_scale, SCALES),
            ("output_scale", self.output_scale, SCALES),
            ("regularisation", self.regularisation, 0.0..=f64::MAX),
        ] {
            if !allowed.contains(&value) {
                return Err(ThetaError::Network { kind, what, value });
            }
        }
        if rest.len() != joints.len() || rest.iter().any(|angle| !angle.is_finite()) {
            return Err(ThetaError::Rest { kind, count: rest.len(), joints: joints.len() });
        }
        // Each share is one network: its joints have the same weights.
        let shares = self.per.shares(kind, &self.joints, groups, joints)?;
        // Only the weights that the start leaves open are searched; the others are fixed.
        let searched = self.start.searched();
        let units = self.start.units(self.output_scale, self.kind == NetworkName::ResidAct);
        let mut entries = Vec::with_capacity(shares.len() * searched.len());
        let mut networks = Vec::with_capacity(shares.len());
        for share in shares {
            let name = share.named(kind);
            for (weight, unit) in searched.iter().zip(&units) {
                entries.push(Entry {
                    name: format!("{name}_{weight}"),
                    kind,
                    unit: unit.clone(),
                    joints: share.joints.iter().map(|&joint| joint.clone()).collect(),
                    lower: self.lower,
                    upper: self.upper,
                    // Random starts differ from seed to seed; this is their mean.
                    start: 0.0,
                    deviation: self.deviation,
                });
            }
            let angle =
                // Rest angles go with the joint's name, because shares list joints in their own order.
                |name: &String| joints.iter().position(|joint| joint == name).map_or(0.0, |at| rest[at]);
            networks.push(share.joints.into_iter().map(|joint| (joint.clone(), angle(joint))).collect());
        }
        // All entries have the same bounds, so checking one is enough.
        if let Some(entry) = entries.first() {
            entry.check(f64::NEG_INFINITY, MAX_VALUE)?;
        }
        Ok(Box::new(Networks { rule: self.clone(), networks, entries }))
    }

    fn scales(&self) -> NetworkScales {
        NetworkScales {
            position: self.position_scale,
            velocity: self.velocity_scale,
            output: self.output_scale,
        }
    }
}

/// Some networks, each of one joint or shared by several.
#[derive(Debug)]
struct Networks {
    rule: NetworkRule,
    /// Joints of each network, with their rest angles, rad.
    networks: Vec<Vec<(String, f64)>>,
    entries: Vec<Entry>,
}

impl Networks {
    /// Values of θ a network.
    fn searched(&self) -> usize {
        self.entries.len() / self.networks.len().max(1)
    }

    /// All weights of the network with these values of θ.
    fn weights(&self, values: &[f64]) -> Vec<f64> {
        match (self.rule.start, <&[f64; OUTPUT_WEIGHTS]>::try_from(values)) {
            (NetworkStart::Features, Ok(last)) => {
                features::weights(last, self.rule.position_scale, self.rule.velocity_scale).to_vec()
            }
            // Other starts search all weights as they are.
            _ => values.to_vec(),
        }
    }
}

impl Modification for Networks {
    fn entries(&self) -> &[Entry] {
        &self.entries
    }

    fn apply(&self, values: &[f64], joints: &[String], candidate: &mut Candidate) {
        let mut networks = JointNetworks {
            kind: self.rule.kind.kind(),
            joints: Vec::new(),
            rest: Vec::new(),
            weights: Vec::new(),
            scales: self.rule.scales(),
        };
        for (shared, values) in self.networks.iter().zip(values.chunks_exact(self.searched())) {
            let weights = self.weights(values);
            for (name, rest) in shared {
                if let Some(joint) = joints.iter().position(|joint| joint == name) {
                    networks.joints.push(joint);
                    networks.rest.push(*rest);
                    networks.weights.extend_from_slice(&weights);
                }
            }
        }
        candidate.networks.push(networks);
    }

    fn springs(&self, values: &[f64]) -> Vec<LinearSpring> {
        // Only here does a weight of the last layer stand for a stiffness.
        if self.rule.kind != NetworkName::ResidAct || self.rule.start != NetworkStart::Features {
            return Vec::new();
        }
        let each = self.networks.iter().zip(values.chunks_exact(self.searched()));
        let network = |(shared, last): (&Vec<(String, f64)>, &[f64])| {
            let (stiffness, offset) = features::spring(last, self.rule.output_scale);
            let spring = |(joint, rest): &(String, f64)| LinearSpring {
                joint: joint.clone(),
                kind: JointKind::Hinge,
                stiffness,
                // The network's input is the angle less `rest`, and a spring's angle counts from 0.
                torque: offset + stiffness * rest,
            };
            shared.iter().map(spring).collect::<Vec<_>>()
        };
        each.flat_map(network).collect()
    }

    fn start(&self, seed: u64) -> Vec<f64> {
        match self.rule.start {
            NetworkStart::Zero | NetworkStart::Features => vec![0.0; self.entries.len()],
            NetworkStart::Random => {
                (0..self.networks.len()).flat_map(|network| random_start(&self.rule, seed, network)).collect()
            }
        }
    }

    fn regularisation(&self, values: &[f64]) -> f64 {
        if self.rule.regularisation == 0.0 {
            return 0.0;
        }
        // Only the last layer is charged: its weights alone set how large corrections can be.
        let last = |values: &[f64]| -> f64 {
            values[values.len() - OUTPUT_WEIGHTS..].iter().map(|weight| weight * weight).sum()
        };
        let sum: f64 = values.chunks_exact(self.searched()).map(last).sum();
        // The mean over networks does not grow with the number of joints.
        self.rule.regularisation * sum / self.networks.len() as f64
    }

    fn save(&self, estimates: &[Found], file: &mut ThetaFile) {
        for (shared, estimates) in self.networks.iter().zip(estimates.chunks_exact(self.searched())) {
            let values: Vec<f64> = estimates.iter().map(|estimate| estimate.value).collect();
            let weights = self.weights(&values);
            // A file has one network a joint, so shared weights are written for each of their joints.
            file.network.extend(shared.iter().map(|(joint, rest)| SavedNetwork {
                name: format!("{}_{}", self.rule.kind.name(), plain(joint)),
                kind: self.rule.kind,
                joint: joint.clone(),
                rest: *rest,
                position_scale: self.rule.position_scale,
                velocity_scale: self.rule.velocity_scale,
                output_scale: self.rule.output_scale,
                weights: weights.clone(),
            }));
        }
    }
}

/// Random hidden layers and a last layer of 0, within the bounds.
fn random_start(rule: &NetworkRule, seed: u64, network: usize) -> Vec<f64> {
    // The purpose is also the policies' initial weights', which no fit draws; the kind takes the step.
    let stream = Stream::new(seed, Purpose::WEIGHTS).environment(network as u32).step(rule.kind as u32);
    let mut draws = vec![0.0; NETWORK_WEIGHTS - OUTPUT_WEIGHTS];
    stream.fill_normals(0, &mut draws);
    let mut at = 0;
    for (inputs, outputs) in &NETWORK_LAYERS[..2] {
        // A layer has its weights first, then its biases.
        let (matrix, end) = (at + inputs * outputs, at + (inputs + 1) * outputs);
        // So divided, the sum of inputs of variance 1 has variance 1, however many inputs there are.
        draws[at..matrix].iter_mut().for_each(|weight| *weight /= (*inputs as f64).sqrt());
        draws[matrix..end].iter_mut().for_each(|bias| *bias *= BIAS_DEVIATION);
        at = end;
    }
    // The last layer begins at 0, so that the first networks correct nothing.
    draws.resize(NETWORK_WEIGHTS, 0.0);
    // Normals may lie outside narrow bounds.
    draws.iter().map(|weight| weight.clamp(rule.lower, rule.upper)).collect()
}

/// Adds a network of a file to a candidate; networks of one kind and scale go together.
pub(super) fn read(
    saved: &SavedNetwork,
    context: &ReadContext<'_>,
    candidate: &mut Candidate,
) -> Result<(), ThetaFileError> {
    let joint = context.joint(&saved.joint)?;
    let scales = [saved.position_scale, saved.velocity_scale, saved.output_scale];
    let finite = saved.weights.iter().chain(&scales).chain([&saved.rest]).all(|value| value.is_finite());
    if saved.weights.len() != NETWORK_WEIGHTS || !finite {
        return Err(ThetaFileError::Network { name: saved.name.clone(), count: saved.weights.len() });
    }
    let kind = saved.kind.kind();
    // Two networks of one kind would correct the joint twice.
    if candidate.networks.iter().any(|one| one.kind == kind && one.joints.contains(&joint)) {
        return Err(ThetaFileError::Twice { name: saved.name.clone(), joint: saved.joint.clone() });
    }
    let scales = NetworkScales { position: scales[0], velocity: scales[1], output: scales[2] };
    // Networks of one kind and scale are one block, because a candidate states its scales once a block.
    if candidate.networks.last().is_none_or(|last| last.kind != kind || last.scales != scales) {
        candidate.networks.push(JointNetworks {
            kind,
            joints: Vec::new(),
            rest: Vec::new(),
            weights: Vec::new(),
            scales,
        });
    }
    if let Some(networks) = candidate.networks.last_mut() {
        networks.joints.push(joint);
        networks.rest.push(saved.rest);
        networks.weights.extend_from_slice(&saved.weights);
    }
    Ok(())
}
