//! The kernels' text: constants of the settings and networks, then the files.

use std::fmt::Write;

use gaitfit_learn::ppo::{Precision, Schedule, Settings, Widths};
use gaitfit_policy::network::{Activation, Network};

use super::layout::{MAX_LAYERS, NetLayout, TooWide};
use crate::runtime::Program;
use crate::words::{FUNCTIONS, function, single};

/// Threads of a block of the large kernel.
pub(super) const THREADS: usize = 512;
/// Numbers of samples that a block works on together, best first; the first that fits into shared memory is taken. In
/// bf16, of those that fit, the cheapest is taken.
const ROWS: [usize; 2] = [64, 32];
const ROWS_BF16: [usize; 5] = [192, 128, 96, 64, 32];
/// Samples of a block that only looks ahead: in a rollout there are few, for all multiprocessors.
const FORESEEN_BF16: [usize; 2] = [64, 32];
/// Cost of a tile besides its samples, in samples.
const TILE_COST: usize = 32;
/// Sums that a block keeps besides gradients and the derivative by ln σ; `LOSSES` of the text.
pub(super) const LOSSES: usize = 6;
/// Max number of actions. Some kernels use one thread for each action and each loss, and a block has 256 threads.
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
    /// Samples of a tile, and bytes of shared memory, of the kernel that looks ahead.
    pub foreseen: usize,
    pub foreseen_shared: usize,
}

/// The sizes that a text is made for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Room {
    /// Bytes of shared memory of a block.
    pub shared: usize,
    /// Multiprocessors.
    pub processors: usize,
    /// Samples of a minibatch.
    pub minibatch: usize,
}

impl Text {
    /// For a GPU with so much room.
    pub(super) fn new(
        settings: &Settings,
        widths: Widths,
        networks: [&Network; 2],
        memory: bool,
        precision: Precision,
        room: Room,
    ) -> Result<Self, TooWide> {
        let [actor, critic] = networks.map(|network| &network.shape);
        let nets = [actor, critic].map(|shape| NetLayout::new(shape, precision));
        // Blocks of actor and critic run in one launch, which has one size of shared memory.
        let widest = nets[0].bytes.max(nets[1].bytes);
        let losses = (LOSSES + widths.action) * size_of::<f32>();
        let (rows, foreseen): (&[usize], &[usize]) = match precision {
            Precision::Bf16 => (&ROWS_BF16, &FORESEEN_BF16),
            Precision::Tf32 | Precision::F32 => (&ROWS, &ROWS),
        };
        let fits = |rows: &&usize| **rows * (widest + losses) <= room.shared;
        // Rounds of all multiprocessors, half of which have a network.
        let cost = |rows: &&usize| {
            let tiles = room.minibatch.div_ceil(**rows).max(1);
            tiles.div_ceil((room.processors / 2).max(1)) * (**rows + TILE_COST)
        };
        let mut candidates = rows.iter().filter(fits);
        let chosen =
            if precision == Precision::Bf16 { candidates.min_by_key(cost) } else { candidates.next() };
        let (Some(&rows), Some(&foreseen)) = (chosen, foreseen.iter().find(fits)) else {
            let rows = rows.last().copied().unwrap_or(1);
            let network = if nets[0].bytes > nets[1].bytes { actor } else { critic }.to_string();
            let needed = rows * (widest + losses);
            return Err(TooWide { network, needed, rows, available: room.shared });
        };
        let shared = rows * (widest + losses);
        let [actor_net, critic_net] = nets;
        let mut text = defines(
            settings,
            widths,
            [&actor_net, &critic_net],
            (precision, memory),
            [rows, foreseen],
            networks,
        );
        let layers = match precision {
            Precision::Bf16 => include_str!("kernels/layers_bf16.cu"),
            Precision::Tf32 | Precision::F32 => include_str!("kernels/layers.cu"),
        };
        for part in [
            include_str!("../common.cuh"),
            include_str!("../activations.cuh"),
            include_str!("kernels/common.cu"),
            include_str!("kernels/shuffle.cu"),
            include_str!("kernels/advantages.cu"),
            include_str!("kernels/statistics.cu"),
            include_str!("kernels/activation.cu"),
            layers,
            include_str!("kernels/network.cu"),
            include_str!("kernels/step.cu"),
            include_str!("kernels/memory.cu"),
        ] {
            text.push_str(part);
        }
        let program = Program::new("ppo", text);
        let foreseen_shared = foreseen * widest;
        Ok(Self { program, actor: actor_net, critic: critic_net, rows, shared, foreseen, foreseen_shared })
    }
}

fn defines(
    settings: &Settings,
    widths: Widths,
    nets: [&NetLayout; 2],
    (precision, memory): (Precision, bool),
    [rows, foreseen]: [usize; 2],
    networks: [&Network; 2],
) -> String {
    let hidden = networks.map(|network| network.shape.activation);
    let mut text = functions(hidden, networks.map(|network| network.output));
    let mut define = |name: &str, value: String| {
        // Writing to a string does not fail.
        let _ = writeln!(text, "#define {name} {value}");
    };
    let parameters = nets.map(|net| net.map.len());
    for (name, value) in [
        ("ACTOR_INPUTS", nets[0].widths[0]),
        ("MEMORY", usize::from(memory)),
        ("ACTIONS", widths.action),
        ("ROWS", rows),
        ("FORESEEN", foreseen),
        ("THREADS", THREADS),
        ("SPLIT", usize::from(precision == Precision::F32)),
        ("BF16", usize::from(precision == Precision::Bf16)),
        ("ACTOR_PARAMETERS", parameters[0]),
        ("CRITIC_PARAMETERS", parameters[1]),
        ("PARAMETERS", parameters[0] + parameters[1] + widths.action),
        ("ACTOR_PACKED", nets[0].packed),
        ("ACTOR_GRADIENT", nets[0].gradient),
        ("CRITIC_GRADIENT", nets[1].gradient),
        ("ACTOR_KEPT", nets[0].kept),
        ("CRITIC_KEPT", nets[1].kept),
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
    // Groups of a block of so many samples, and threads that share the addition of a loss over them.
    let bf16 = precision == Precision::Bf16;
    define("GROUPS_OF(rows)", if bf16 { "((rows) % 64 == 0 ? 4 : 2)" } else { "1" }.to_owned());
    define("SHARERS", if bf16 { "8" } else { "1" }.to_owned());
    let [min, max] = settings.learning_rate_limits;
    for (name, value) in [
        ("DESIRED_KL", settings.desired_kl),
        ("MIN_RATE", min),
        ("MAX_RATE", max),
        ("MAX_GRADIENT_NORM", settings.max_gradient_norm),
    ] {
        define(name, format!("{value:?}"));
    }
    put_networks(&mut text, nets, hidden);
    text
}

/// Names of the functions: of hidden layers (actor, critic), then of the output (actor, critic).
fn functions(hidden: [Activation; 2], outputs: [Option<Activation>; 2]) -> String {
    let mut text = format!("enum {{ {} }};\n", FUNCTIONS.join(", "));
    for (number, activation) in hidden.map(Some).into_iter().chain(outputs).enumerate() {
        let (name, alpha, lambda) = activation.map_or(("LINEAR", 0.0, 0.0), function);
        let (alpha, lambda) = (single(alpha), single(lambda));
        // Writing to a string does not fail.
        let _ = write!(
            text,
            "#define FUNCTION_{number} {name}\n#define ALPHA_{number} {alpha}\n#define LAMBDA_{number} {lambda}\n"
        );
    }
    text
}

/// Shapes of the layers, and where the networks' numbers are.
fn put_networks(text: &mut String, nets: [&NetLayout; 2], functions: [Activation; 2]) {
    let list = |numbers: &[usize]| {
        let mut words: Vec<String> = numbers.iter().map(ToString::to_string).collect();
        words.resize(MAX_LAYERS + 1, "0".into());
        format!("{{{}}}", words.join(", "))
    };
    // Layers of equal widths and functions share their code.
    let other = usize::from(functions[0] != functions[1]);
    let shapes_of = [(nets[0], 0), (nets[1], other)].map(|(net, function)| -> Vec<_> {
        net.shapes().into_iter().map(|widths| (widths, function)).collect()
    });
    let mut shapes = shapes_of.concat();
    shapes.sort_unstable();
    shapes.dedup();
    let size = MAX_LAYERS + 1;
    let rows = [0, 1].map(|number| {
        let (net, shapes_of) = (nets[number], &shapes_of[number]);
        let place = |shape| shapes.iter().position(|other| other == shape).unwrap_or(0);
        let numbers: Vec<usize> = shapes_of.iter().map(place).collect();
        let lists: Vec<String> = [
            &numbers,
            &net.widths,
            &net.padded,
            &net.apart,
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
        .map(|(number, ([used_in, inputs, outputs, used_out], function))| {
            format!("X({number}, {used_in}, {inputs}, {outputs}, {used_out}, {function})")
        })
        .collect();
    let _ = write!(
        text,
        "#define SHAPES(X) {}\n#ifndef GAITFIT_HOST\n#define GAITFIT_TABLE __constant__\n#else\n\
         #define GAITFIT_TABLE static const\n#endif\nstruct Net {{\n    int layers, end, gradient, shape[{size}], \
         width[{size}], padded[{size}], apart[{size}], place[{size}], weight[{size}], bias[{size}], back[{size}], of_weight[{size}], \
         of_bias[{size}];\n}};\nGAITFIT_TABLE Net NETS[2] = {{\n{}{}}};\n",
        cases.join(" "),
        rows[0],
        rows[1]
    );
}
