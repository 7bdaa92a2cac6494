//! The kernels' text: numbers and tables of the task, then the files.

use std::fmt::Write;

use gaitfit_learn::task::reward::Value;
use gaitfit_learn::task::{BaseMoment, FASTEST_BASE, FASTEST_JOINT, Foot, Task, advanced_foot};
use gaitfit_model::kinematics::Reach;
use gaitfit_model::rotation::vec_of;
use gaitfit_model::{JointKind, Model, Shape};
use gaitfit_policy::walker::GAP;

use super::expression::Terms;
use super::ground::GROUND_HEIGHTS;
use super::plan::{FINISH_PARTS, THREADS};
use super::scene::{Mode, Scene};
use super::sums::Sum;
use crate::runtime::Program;
use crate::traced::function;
use crate::words::{Words, braces, double, single};

/// The program of a scene's rollouts. Products and sums are rounded one by one, as the CPU does it.
pub(super) fn program(scene: &Scene<'_>) -> Program {
    let mut text = String::from(include_str!("../common.cuh"));
    text.push_str(include_str!("kernels/structs.cu"));
    let mut writer = Words { text };
    let heights = writer.ground(&scene.task.walker);
    writer.course(scene.task);
    writer.sizes(scene);
    writer.task(scene);
    writer.robot(scene);
    writer.rows(scene);
    let walker = &scene.task.walker;
    let motion = writer.reference(walker, &walker.observation, Some(&walker.critic_observation));
    let mut text = writer.text;
    for part in [
        include_str!("kernels/draws.cu"),
        include_str!("kernels/ground.cu"),
        include_str!("kernels/course.cu"),
        include_str!("kernels/robot.cu"),
        include_str!("kernels/sensors.cu"),
        include_str!("kernels/turns.cu"),
        include_str!("kernels/reference.cu"),
        include_str!("kernels/observe.cu"),
        include_str!("kernels/targets.cu"),
        include_str!("kernels/falls.cu"),
        include_str!("kernels/rows.cu"),
        include_str!("kernels/act.cu"),
        include_str!("kernels/episode.cu"),
        include_str!("kernels/moment.cu"),
        &functions(),
        &reward_terms(scene.task),
        include_str!("kernels/finish.cu"),
        if scene.is(Mode::Steps) { include_str!("kernels/stepwise.cu") } else { "" },
    ] {
        text.push_str(part);
    }
    if scene.recorded() > 0 {
        text.push_str(include_str!("kernels/record.cu"));
    }
    let program = motion.fill(Program::new("rollout", text).option("-fmad=false"));
    if heights.is_empty() { program } else { program.table(GROUND_HEIGHTS, heights) }
}

/// Functions of a moment: `advanced_foot`, `base_moment`, `base_errors`.
fn functions() -> String {
    let foot = [("before", Foot::NUMBERS), ("force", 1), ("place", 3), ("dt", 1), ("begins", 1)];
    let foot = function("advanced_foot", &foot, |all: [_; Foot::NUMBERS + 6]| {
        let (before, rest) = all.split_at(Foot::NUMBERS);
        let before = std::array::from_fn(|k| before[k]);
        let (numbers, landed) = advanced_foot(before, rest[0], vec_of(&rest[1..]), rest[4], rest[5]);
        numbers.into_iter().chain([landed]).collect()
    });
    let base = [("quaternion", 4), ("linear", 3), ("angular", 3), ("command", 3), ("posture", 3)];
    let base = function("base_moment", &base, |[w, x, y, z, rest @ ..]: [_; 16]| {
        let vector = |from: usize| vec_of(&rest[from..]);
        let base = BaseMoment::new([w, x, y, z], vector(0), vector(3), vector(6), vector(9));
        let three = base.velocity.into_iter().chain(base.gravity);
        three.chain([base.yaw_rate, base.uprightness, base.walking]).collect()
    });
    let errors = [("velocity", 3), ("yaw_rate", 1), ("command", 3)];
    let errors = function("base_errors", &errors, |[x, y, z, yaw_rate, a, b, c]| {
        BaseMoment::errors([x, y, z], yaw_rate, [a, b, c]).to_vec()
    });
    foot + &base + &errors
}

/// Functions of the reward terms. [`Scene::new`] refuses those that are not expressions.
fn reward_terms(task: &Task) -> String {
    let mut terms = Terms::new(task);
    for (name, value) in task.reward_values() {
        if let Value::Expression(expression) = value {
            terms.add(name, expression);
        }
    }
    terms.text()
}

impl Words {
    fn sizes(&mut self, scene: &Scene<'_>) {
        let task = scene.task;
        self.physics(scene.period, &scene.spots);
        for (name, value) in [
            ("ENVIRONMENTS", scene.sizes.environments),
            ("FEET", task.foot_geoms().len()),
            ("BODY_GEOMS", task.body_geoms().len()),
            ("REWARDS", task.reward_weights().count()),
            ("CUTS", scene.cuts()),
            ("THREADS", THREADS as usize),
            ("FINISH_PARTS", FINISH_PARTS as usize),
            ("LOG_STD_AT", scene.sizes.networks),
            ("TRIALS", usize::from(scene.is(Mode::Trials))),
            ("ENDS_APART", scene.ends_apart()),
            ("STEPWISE", usize::from(scene.is(Mode::Steps))),
        ] {
            self.define(name, value);
        }
        self.text.push_str(&Sum::text(task.reward_weights().count()));
        let foot = Foot::NAMES.map(str::to_uppercase).join(", ");
        self.text.push_str(&format!("enum {{ {foot}, FOOT_SIZE }};\n"));
    }

    fn task(&mut self, scene: &Scene<'_>) {
        let (task, settings) = (scene.task, &scene.task.settings);
        let interface = &task.walker.interface;
        self.walker(&task.walker);
        for (name, value) in [
            ("LOG_TAU", std::f32::consts::TAU.ln()),
            ("GAMMA", scene.sizes.gamma as f32),
            ("FASTEST_BASE", FASTEST_BASE),
            ("FASTEST_JOINT", FASTEST_JOINT),
        ] {
            self.define(name, single(value));
        }
        let start = &settings.start;
        for (name, value) in [
            ("GAP", GAP),
            ("COMMAND_STANDING", settings.command.standing),
            ("PUSH_VELOCITY", settings.push.velocity),
            ("START_YAW", start.yaw.to_radians()),
            ("START_PITCH", start.pitch.to_radians()),
            ("START_TILT", start.tilt.to_radians()),
            ("START_JOINT_POSITION", start.joint_position),
            ("START_JOINT_VELOCITY", start.joint_velocity),
            ("START_LINEAR_VELOCITY", start.linear_velocity),
            ("START_ANGULAR_VELOCITY", start.angular_velocity),
        ] {
            self.define(name, double(value));
        }
        // A period of 0 turns pushes off in the kernels.
        let push = if settings.push.velocity == 0.0 { 0.0 } else { settings.push.seconds };
        for (name, value) in [
            ("EPISODE_STEPS_MAX", scene.episode_steps()),
            ("COMMAND_STEPS", scene.command_steps()),
            ("PUSH_PERIOD", (push / interface.control_dt).round() as u32),
        ] {
            self.define(name, format!("{value}u"));
        }
        let feet: Vec<usize> = task.foot_geoms().iter().flat_map(|foot| foot.geoms.clone()).collect();
        self.integers("FOOT_GEOM", &feet);
        let mut ends = vec![0];
        for foot in task.foot_geoms() {
            ends.push(ends[ends.len() - 1] + foot.geoms.len());
        }
        self.integers("FOOT_FIRST", &ends);
        self.integers("BODY_GEOM", task.body_geoms());
        // Statements that compute the reward's terms: each is run by some of an environment's threads.
        let _ = writeln!(self.text, "#define REWARD_TERMS \\");
        for (number, (name, weight)) in task.reward_weights().enumerate() {
            let _ = writeln!(
                self.text,
                "    if (part == {}) terms[{number}][lane] = {} * reward_{name}(m); \\",
                number % FINISH_PARTS as usize,
                single(weight)
            );
        }
        self.text.push('\n');
    }

    fn robot(&mut self, scene: &Scene<'_>) {
        let (task, walker) = (scene.task, &scene.task.walker);
        let model = walker.model();
        self.singles("START_POSE", &task.start_pose);
        let action_of = |joint: usize| walker.joints.iter().position(|&own| own == joint);
        let actions = (0..walker.default_pose.len())
            .map(|joint| action_of(joint).map_or("-1".to_owned(), |k| k.to_string()));
        self.table("int", "ACTION_OF", actions.collect());
        let joint = |joint: &gaitfit_model::Joint| {
            let (limited, slides) =
                (u32::from(joint.range.is_some()), u32::from(joint.kind == JointKind::Slide));
            let range = doubles(&joint.range.unwrap_or_default());
            format!("{{{}, {limited}, {range}, {slides}}}", double(joint.reference))
        };
        self.lookup("Joint", "JOINT", model.joints.iter().map(joint).collect());
        let coupling = |coupling: &gaitfit_model::Coupling| {
            let leader = coupling.leader.map_or("-1".to_owned(), |leader| leader.to_string());
            format!("{{{}, {leader}, {}}}", coupling.follower, doubles(&coupling.polynomial))
        };
        self.define("COUPLINGS", model.couplings.len());
        self.lookup("Coupling", "COUPLING", model.couplings.iter().map(coupling).collect());
        let mut way = Vec::new();
        let shapes = model.pairs.iter().map(|pair| {
            let geom = &model.geoms[pair.geom];
            let reach = Reach::new(geom);
            let first = way.len();
            way.extend(links(model, geom.body));
            let (position, axis) = (doubles(&geom.pos), doubles(&reach.axis));
            let edges: Vec<f64> = reach.edges.iter().flatten().copied().collect();
            let (radius, rim) = (double(reach.radius), double(reach.rim));
            let count = way.len() - first;
            let round = matches!(geom.shape, Shape::Sphere { .. } | Shape::Capsule { .. });
            let round = u32::from(round);
            format!("{{{first}, {count}, {position}, {radius}, {}, {rim}, {axis}, {round}}}", doubles(&edges))
        });
        let shapes: Vec<String> = shapes.collect();
        self.lookup("Link", "WAY_TO", way);
        self.define("SHAPES", shapes.len());
        self.lookup("Shape", "SHAPE", shapes);
        let ground = model.planes.first().map_or(0.0, |plane| plane.pos[2]);
        self.define("GROUND", format!("({})", double(ground)));
    }

    fn rows(&mut self, scene: &Scene<'_>) {
        let (walker, noise) = (&scene.task.walker, &scene.task.settings.noise);
        let rows = self.observed(
            walker,
            &[
                (&walker.observation, &|quantity| noise.half_range(quantity)),
                (&walker.critic_observation, &|_| 0.0),
            ],
        );
        for (name, row) in ["ACTOR_ROW", "CRITIC_ROW"].into_iter().zip(rows) {
            let _ = writeln!(self.text, "TABLE Row {name} = {row};");
        }
    }
}

fn doubles(numbers: &[f64]) -> String {
    braces(numbers, |&x| double(x))
}

/// The frame of a `Link` that has none, as C text.
const NO_FRAME: &str = "0, {}, {}";

/// The way from the base to body `to`, as `Link`s.
fn links(model: &Model, to: usize) -> Vec<String> {
    let mut bodies: Vec<usize> = std::iter::successors(Some(to), |&body| model.bodies[body].parent).collect();
    bodies.reverse();
    let mut links = Vec::new();
    for index in bodies {
        let body = &model.bodies[index];
        let mut frame =
            format!("{}, {}, {}", u32::from(body.parent.is_some()), doubles(&body.pos), doubles(&body.quat));
        let joints = model.joints.iter().enumerate().filter(|(_, joint)| joint.body == index);
        let count = links.len();
        for (number, joint) in joints {
            let slides = u32::from(joint.kind == JointKind::Slide);
            let (anchor, axis) = (doubles(&joint.pos), doubles(&joint.axis));
            links.push(format!("{{{frame}, {number}, {slides}, {anchor}, {axis}}}"));
            // Further joints of the body act in the frame that the first one turned.
            frame = NO_FRAME.to_owned();
        }
        if links.len() == count {
            links.push(format!("{{{frame}, -1, 0, {{}}, {{}}}}"));
        }
    }
    links
}
