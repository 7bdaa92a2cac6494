//! The kernels' text: constants of the settings and networks, then the files.

use std::fmt::Write;

use gaitfit_learn::ppo::{Schedule, Settings, Widths};
use gaitfit_policy::network::{Activation, Shape};
use serde::{Deserialize, Serialize};

use super::layout::{MAX_LAYERS, NetLayout, TooWide};
use crate::runtime::Program;

/// How matrix products are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// Factors rounded to 11 significant bits (TF32), sums in `f32`.
    #[default]
    Tf32,
    /// Factors split into two such numbers and three products added: the error is about that of `f32`.
    F32,
}

/// Threads of a block of the large kernel.
pub(super) const THREADS: usize = 512;
/// Samples that a block works on together: the first number that fits is taken.
const ROWS: [usize; 2] = [64, 32];
/// Sums that a block keeps besides gradients and the derivative by ln σ; `LOSSES` of the text.
pub(super) const LOSSES: usize = 6;
/// Most actions: each is a thread's in places.
pub(super) const MAX_ACTIONS: usize = 256 - LOSSES;

/// The text for one learner and what the launches must know of it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Text {
    pub program: Program,
    pub actor: NetLayout,
    pub critic: NetLayout,
    /// Samples of a tile.
    pub rows: usize,
    /// Bytes of shared memory of the large kernel.
    pub shared: usize,
}

impl Text {
    /// For a GPU with `available` bytes of shared memory a block.
    pub(super) fn new(
        settings: &Settings,
        widths: Widths,
        [actor, critic]: [&Shape; 2],
        memory: bool,
        precision: Precision,
        available: usize,
    ) -> Result<Self, TooWide> {
        let layout = |rows: usize| {
            let nets = [actor, critic].map(|shape| NetLayout::new(shape, rows));
            let shared = (nets[0].end.max(nets[1].end) + rows * (LOSSES + widths.action)) * size_of::<f32>();
            (rows, nets, shared)
        };
        let candidates = ROWS.map(layout);
        let Some((rows, [actor_net, critic_net], shared)) =
            candidates.iter().find(|(.., shared)| *shared <= available).cloned()
        else {
            let (rows, nets, needed) = &candidates[ROWS.len() - 1];
            let network = if nets[0].end > nets[1].end { actor } else { critic }.to_string();
            return Err(TooWide { network, needed: *needed, rows: *rows, available });
        };
        let mut text =
            defines(settings, widths, [&actor_net, &critic_net], (precision, memory), rows, actor.activation);
        for part in [
            include_str!("../common.cuh"),
            include_str!("kernels/common.cu"),
            include_str!("kernels/shuffle.cu"),
            include_str!("kernels/advantages.cu"),
            include_str!("kernels/statistics.cu"),
            include_str!("kernels/layers.cu"),
            include_str!("kernels/network.cu"),
            include_str!("kernels/step.cu"),
            include_str!("kernels/memory.cu"),
        ] {
            text.push_str(part);
        }
        let program = Program::new("ppo", text);
        Ok(Self { program, actor: actor_net, critic: critic_net, rows, shared })
    }
}

fn defines(
    settings: &Settings,
    widths: Widths,
    nets: [&NetLayout; 2],
    (precision, memory): (Precision, bool),
    rows: usize,
    activation: Activation,
) -> String {
    let mut text = String::new();
    let mut define = |name: &str, value: String| {
        // Writing to a string does not fail.
        let _ = writeln!(text, "#define {name} {value}");
    };
    let parameters = nets.map(|net| net.map.len());
    let activation = match activation {
        Activation::Elu => 0,
        Activation::Relu => 1,
        // `check_networks` refuses other functions.
        _ => 2,
    };
    for (name, value) in [
        ("ACTOR_INPUTS", nets[0].widths[0]),
        ("MEMORY", usize::from(memory)),
        ("ACTIONS", widths.action),
        ("ROWS", rows),
        ("THREADS", THREADS),
        ("SPLIT", usize::from(precision == Precision::F32)),
        ("ACTIVATION", activation),
        ("ACTOR_PARAMETERS", parameters[0]),
        ("CRITIC_PARAMETERS", parameters[1]),
        ("PARAMETERS", parameters[0] + parameters[1] + widths.action),
        ("ACTOR_PACKED", nets[0].packed),
        ("ACTOR_GRADIENT", nets[0].gradient),
        ("CRITIC_GRADIENT", nets[1].gradient),
        ("CLIPPED_VALUE_LOSS", usize::from(settings.clipped_value_loss)),
        ("LEARN_STD", usize::from(settings.fixed_std.is_none())),
        ("ADAPTIVE", usize::from(settings.schedule == Schedule::Adaptive)),
    ] {
        define(name, value.to_string());
    }
    for (name, value) in [
        ("CLIP", settings.clip),
        ("VALUE_COEFFICIENT", settings.value_coefficient),
        ("ENTROPY_COEFFICIENT", settings.entropy_coefficient),
    ] {
        define(name, format!("{:?}f", value as f32));
    }
    let [min, max] = settings.learning_rate_limits;
    for (name, value) in [
        ("DESIRED_KL", settings.desired_kl),
        ("MIN_RATE", min),
        ("MAX_RATE", max),
        ("MAX_GRADIENT_NORM", settings.max_gradient_norm),
    ] {
        define(name, format!("{value:?}"));
    }
    let list = |numbers: &[usize]| {
        let mut words: Vec<String> = numbers.iter().map(ToString::to_string).collect();
        words.resize(MAX_LAYERS + 1, "0".into());
        format!("{{{}}}", words.join(", "))
    };
    let mut shapes: Vec<[usize; 4]> = nets.iter().flat_map(|net| net.shapes()).collect();
    shapes.sort_unstable();
    shapes.dedup();
    let size = MAX_LAYERS + 1;
    let rows = nets.map(|net| {
        let numbers: Vec<usize> = net
            .shapes()
            .iter()
            .map(|shape| shapes.iter().position(|other| other == shape).unwrap_or(0))
            .collect();
        let lists: Vec<String> = [
            &numbers,
            &net.widths,
            &net.padded,
            &net.places,
            &net.weights,
            &net.biases,
            &net.backs,
            &net.gradients[0],
            &net.gradients[1],
        ]
        .map(|numbers| list(numbers))
        .to_vec();
        format!("    {{{}, {}, {}, {}}},\n", net.weights.len(), net.end, net.gradient, lists.join(", "))
    });
    let cases: Vec<String> = shapes
        .iter()
        .enumerate()
        .map(|(number, [used_in, inputs, outputs, used_out])| {
            format!("X({number}, {used_in}, {inputs}, {outputs}, {used_out})")
        })
        .collect();
    let _ = write!(
        text,
        "#define SHAPES(X) {}\n#ifndef GAITFIT_HOST\n#define GAITFIT_TABLE __constant__\n#else\n\
         #define GAITFIT_TABLE static const\n#endif\nstruct Net {{\n    int layers, end, gradient, shape[{size}], \
         width[{size}], padded[{size}], place[{size}], weight[{size}], bias[{size}], back[{size}], of_weight[{size}], \
         of_bias[{size}];\n}};\nGAITFIT_TABLE Net NETS[2] = {{\n{}{}}};\n",
        cases.join(" "),
        rows[0],
        rows[1]
    );
    text
}
