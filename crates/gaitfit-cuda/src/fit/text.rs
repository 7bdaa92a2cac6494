//! The kernels' text: numbers and tables of what is simulated, then the files.

use gaitfit_policy::Term;
use gaitfit_policy::predict::{Feet, Foot};
use gaitfit_policy::walker::Walker;

use super::scene::{Scene, Subject};
use crate::networks::{Blocks, Networks};
use crate::reference::ReferenceTables;
use crate::rollout::GROUND_HEIGHTS;
use crate::runtime::Program;
use crate::walker::kept;
use crate::words::{Words, double, single};

/// The program of a scene, `rows` robots of a block together, `group` of a thread. `logs`: whether robots that walk make
/// logs. Products and sums are rounded one by one, as the CPU does it.
pub(super) fn program(scene: &Scene<'_>, logs: bool, rows: usize, group: usize) -> Program {
    let mut text = String::from(include_str!("../common.cuh"));
    text.push_str(include_str!("../rollout/kernels/structs.cu"));
    let mut words = Words { text };
    let heights = scene.subject.walker().map_or_else(Vec::new, |walker| words.ground(walker));
    sizes(&mut words, scene);
    let mut motion = ReferenceTables::default();
    let parts: &[&str] = match scene.subject {
        Subject::Walk(walker, policy) => {
            walk(&mut words, walker);
            motion = words.reference(walker, &walker.observation, None);
            Networks::new(policy).write(&mut words, policy, Blocks { rows, group });
            words.define("MAKES_LOGS", u32::from(logs));
            &[
                include_str!("../rollout/kernels/draws.cu"),
                include_str!("../rollout/kernels/ground.cu"),
                include_str!("../rollout/kernels/robot.cu"),
                include_str!("../rollout/kernels/sensors.cu"),
                include_str!("../rollout/kernels/turns.cu"),
                include_str!("../rollout/kernels/reference.cu"),
                include_str!("../rollout/kernels/observe.cu"),
                include_str!("../rollout/kernels/targets.cu"),
                include_str!("../rollout/kernels/falls.cu"),
                include_str!("kernels/places.cu"),
                include_str!("../activations.cuh"),
                include_str!("../networks/kernels/network.cu"),
                include_str!("kernels/walk.cu"),
                include_str!("kernels/disturb.cu"),
            ]
        }
        Subject::Predict(walker) => {
            words.walker(walker);
            legs(&mut words, walker);
            words.define("ROWS", rows);
            &[
                include_str!("../rollout/kernels/draws.cu"),
                include_str!("../rollout/kernels/robot.cu"),
                include_str!("../rollout/kernels/sensors.cu"),
                include_str!("../rollout/kernels/targets.cu"),
                include_str!("kernels/places.cu"),
                include_str!("kernels/predict.cu"),
                include_str!("kernels/disturb.cu"),
            ]
        }
        Subject::Replay(replay) => {
            words.lead(0.0);
            words.define("HAS_CLOCK", 0);
            words.define("HALF_STEP", single(0.5 * replay.settings().timestep as f32));
            &[
                include_str!("../rollout/kernels/robot.cu"),
                include_str!("kernels/places.cu"),
                include_str!("kernels/replay.cu"),
            ]
        }
    };
    // The order matters: a part uses what earlier ones declare.
    for part in parts {
        words.text.push_str(part);
    }
    let program = motion.fill(Program::new("fit", words.text).option("-fmad=false"));
    if heights.is_empty() { program } else { program.table(GROUND_HEIGHTS, heights) }
}

fn sizes(words: &mut Words, scene: &Scene<'_>) {
    words.physics(scene.period, &scene.spots);
    words.define("PARAMS", scene.params.len());
    words.define("REPLAYS", usize::from(matches!(scene.subject, Subject::Replay(_))));
    words.spots("PARAM_SPOTS", &scene.params);
    let gains = scene.gains().into_iter().map(|gain| gain.map_or("-1".to_owned(), |gain| gain.to_string()));
    words.table("int", "GAIN_OF", gains.collect());
}

/// The feet that say how the base moves, and the joints of their legs.
fn legs(words: &mut Words, walker: &Walker) {
    let feet = Feet::new(walker);
    let (mut forces, mut joints) = (Vec::new(), Vec::new());
    // Feet have different numbers of forces and joints, so two flat lists hold them and a foot says where its
    // own begin.
    let row = |foot: &Foot| {
        let first = [forces.len(), joints.len()];
        forces.extend_from_slice(&foot.forces);
        joints.extend_from_slice(&foot.joints);
        format!("{{{}, {}, {}, {}}}", first[0], foot.forces.len(), first[1], foot.joints.len())
    };
    let rows: Vec<String> = feet.feet.iter().map(row).collect();
    words.define("LEGS", rows.len());
    words.define("LEG_JOINTS", leg_joints(&feet));
    words.define("LEAST_LOAD", double(feet.least_load));
    words.text.push_str("// A foot: the first of its forces in LEG_FORCE and their number, and the same of its leg's joints in LEG_JOINT.\n");
    words.text.push_str("struct Leg {\n    int force, forces, joint, joints;\n};\n");
    let numbers = |numbers: &[usize]| numbers.iter().map(ToString::to_string).collect();
    words.lookup("Leg", "LEG", rows);
    words.lookup("int", "LEG_FORCE", numbers(&forces));
    words.lookup("int", "LEG_JOINT", numbers(&joints));
}

/// The largest number of joints of a leg.
pub(super) fn leg_joints(feet: &Feet) -> usize {
    feet.feet.iter().map(|foot| foot.joints.len()).max().unwrap_or(0)
}

fn walk(words: &mut Words, walker: &Walker) {
    let interface = &walker.interface;
    words.walker(walker);
    words.define("OBSERVATION", interface.observation_width());
    // The critic's past frames are not looked at in walks.
    words.define("HAS_PAST", u32::from(kept(&walker.observation) > 0));
    let mut parts = Vec::new();
    for (number, Term { quantity, .. }) in interface.observation.iter().enumerate() {
        let width = quantity.width(interface.joints.len());
        parts.extend((0..width).step_by(4).map(|from| format!("{{{number}, {from}}}")));
    }
    words.define("PARTS", parts.len());
    words.text.push_str("// Four numbers of a term.\nstruct Part {\n    int term, from;\n};\n");
    words.table("Part", "PART", parts);
    words.observed(walker, &[(&walker.observation, &|_| 0.0)]);
}
