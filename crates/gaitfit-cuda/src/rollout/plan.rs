//! A rollout as data: arrays, and the kernels of each step. A GPU runs it, and so does the test without one.

use super::scene::{Mode, Scene};
use super::text::program;
use crate::emit::Class;
use crate::ppo::{Array, Id, Kind, Launch, Value};
use crate::runtime::{Program, Shape};
use crate::walker::{kept, physics_arrays};
use gaitfit_learn::task::{Foot, Interval};
use gaitfit_sim::IMU_NUMBERS;

/// Who has an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Home {
    /// The rollout itself.
    Own,
    /// The physics: all tiles of a class.
    Physics(Class),
    /// Who calls: the learner, under the same name, or who gives actions.
    Caller,
}

/// Numbers in `control`: the first step, the seed (2 words), six ends of ranges in double precision (2 words each),
/// and the first environment; see [`control`].
const CONTROL: usize = 16;
/// Threads of a block: few, so that few environments are spread over the GPU.
pub(super) const THREADS: u32 = 32;
/// Threads of each environment at the end of a step: each computes some of the reward's terms.
pub(super) const FINISH_PARTS: u32 = 4;
/// Threads of a block where each thread records a number.
const RECORDERS: u32 = 128;

/// Numbers of a base in the array `motion`: position, orientation, velocity, rates.
pub(super) const BASE_NUMBERS: usize = 13;
/// Arrays that observations are made from, and those that they go to.
const OBSERVED: [&str; 14] = [
    "control",
    "robot_state",
    "robot_params",
    "robot_memory",
    "steps",
    "fresh",
    "imu",
    "command",
    "last_action",
    "past",
    "critic_past",
    "observation",
    "critic_observation",
    // Launches leave out arrays that a plan does not have.
    "turned",
];

/// Numbers that kernels read before a rollout: number of the first step, the seed, the ranges of commands (forward,
/// left, yaw rate), and the number of the first environment.
pub fn control(first_step: u32, seed: u64, ranges: [Interval; 3], first_environment: u32) -> Vec<u32> {
    let words = |number: u64| [number as u32, (number >> 32) as u32];
    let ends = ranges.iter().flatten().flat_map(|end| words(end.to_bits()));
    [first_step].into_iter().chain(words(seed)).chain(ends).chain([first_environment]).collect()
}

/// Arrays and kernels of a rollout.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The kernels.
    pub program: Program,
    /// All arrays. Those of the physics have the numbers of whole tiles of the environments asked for.
    pub arrays: Vec<Array>,
    /// Who has each.
    pub homes: Vec<Home>,
    environments: usize,
    actions: usize,
    tallies: usize,
    mode: Mode,
    /// Physics steps of a control period, if torques disturb it.
    disturbed: Option<usize>,
    /// Terms of the actor's and of the critic's observations.
    terms: [usize; 2],
    /// Numbers that are recorded of a robot before a step.
    recorded: usize,
}

impl Plan {
    /// The rollouts of a scene.
    pub fn new(scene: &Scene<'_>) -> Self {
        let environments = scene.sizes.environments;
        let rows = scene.sizes.steps * environments;
        let interface = &scene.task.walker.interface;
        let (observation, critic) = (interface.observation_width(), interface.critic_width());
        let (actions, feet) = (scene.actions(), scene.task.foot_geoms().len());
        let tiles = environments.div_ceil(scene.period.layout().environments());
        let stepwise = scene.is(Mode::Steps);
        let tails = if stepwise { 0 } else { (1 + scene.cuts()) * environments };
        let only = |mode: Mode, length: usize| if scene.is(mode) { length } else { 0 };
        // Steps one by one have no learner: what would be its arrays is their own.
        let (own, learner) = (Home::Own, if stepwise { Home::Own } else { Home::Caller });
        let (mut homes, mut arrays): (Vec<_>, Vec<_>) = physics_arrays(scene.period, tiles)
            .into_iter()
            .map(|(class, array)| (Home::Physics(class), array))
            .unzip();
        for (name, home, kind, length) in [
            ("observation", learner, Kind::F32, rows * observation),
            ("critic_observation", learner, Kind::F32, rows * critic),
            ("action", learner, Kind::F32, rows * actions),
            ("mean", Home::Caller, Kind::F32, rows * actions),
            ("log_probability", learner, Kind::F32, rows),
            ("reward", learner, Kind::F32, rows),
            ("done", learner, Kind::F32, rows),
            ("last_value", learner, Kind::F32, environments),
            ("parameters", learner, Kind::F32, scene.sizes.networks + actions),
            ("control", own, Kind::U32, CONTROL),
            ("deviation", own, Kind::F64, environments),
            ("imu", own, Kind::F32, IMU_NUMBERS * environments),
            ("steps", own, Kind::U32, environments),
            ("fresh", own, Kind::U32, environments),
            ("command", own, Kind::F32, 3 * environments),
            ("last_action", own, Kind::F32, actions * environments),
            ("feet", own, Kind::F32, Foot::NUMBERS * feet * environments),
            ("returns", own, Kind::F32, 2 * environments),
            ("past", own, Kind::F32, kept(&scene.task.walker.observation) * environments),
            ("critic_past", own, Kind::F32, kept(&scene.task.walker.critic_observation) * environments),
            ("ways", own, Kind::F32, if scene.task.course.is_some() { 3 * environments } else { 0 }),
            ("cut", own, Kind::U32, scene.cuts() * environments),
            ("tail", own, Kind::F32, tails * critic),
            ("tail_value", own, Kind::F32, tails),
            ("tail_memory", own, Kind::F32, scene.cuts() * environments * scene.sizes.remembered),
            ("tally", own, Kind::F64, scene.tallies() * environments),
            ("totals", own, Kind::F64, scene.tallies()),
            ("errors", own, Kind::F32, only(Mode::Trials, 2 * rows)),
            ("bases", own, Kind::F32, only(Mode::Trials, 7 * rows)),
            ("records", own, Kind::F32, scene.recorded() * rows),
            ("ends", own, Kind::U8, only(Mode::Steps, 3 * scene.ends_apart())),
            ("last_observation", own, Kind::F32, only(Mode::Steps, environments * observation)),
            ("refused", own, Kind::U32, only(Mode::Steps, 1)),
            ("held", own, Kind::U32, only(Mode::Steps, 1)),
            ("chosen", own, Kind::U32, only(Mode::Steps, environments)),
            ("motion", own, Kind::F32, only(Mode::Steps, environments * (BASE_NUMBERS + 3 * actions))),
        ] {
            arrays.push(Array { name, kind, length });
            homes.push(home);
        }
        if scene.follows() {
            // Angles by which motions are turned, rad, and distances of the joints from them, rad.
            for (name, length) in [("turned", environments), ("motion_errors", only(Mode::Trials, rows))] {
                arrays.push(Array { name, kind: Kind::F32, length });
                homes.push(own);
            }
        }
        let program = program(scene);
        let terms = [interface.observation.len(), interface.critic_observation.len()];
        let disturbed = (!scene.spots.disturbance.is_empty()).then(|| scene.period.substeps());
        let (tallies, recorded, mode) = (scene.tallies(), scene.recorded(), scene.sizes.mode);
        Self { program, arrays, homes, environments, actions, tallies, mode, disturbed, terms, recorded }
    }

    /// The array of this name.
    pub fn array(&self, name: &str) -> Option<Id> {
        self.arrays.iter().position(|array| array.name == name).map(Id)
    }

    fn launch(&self, kernel: &'static str, step: Option<usize>, arrays: &[&str]) -> Launch {
        let step = step.map(|step| Value::U32(u32::try_from(step).unwrap_or(u32::MAX)));
        let arrays = arrays.iter().filter_map(|name| self.array(name)).map(Value::Array);
        let shape = Shape::cover(self.environments, THREADS);
        Launch { kernel, shape, arguments: step.into_iter().chain(arrays).collect() }
    }

    /// A launch with `count` block columns.
    fn columns(&self, mut launch: Launch, count: usize) -> Launch {
        launch.shape.grid[1] = u32::try_from(count).unwrap_or(1);
        launch
    }

    /// Episodes of an environment that a rollout cuts off at most.
    pub fn cuts(&self) -> usize {
        self.array("cut").map_or(0, |Id(number)| self.arrays[number].length / self.environments.max(1))
    }

    /// Before the first step.
    pub fn begin(&self) -> Launch {
        self.launch("begin_rollout", None, &["tally", "cut"])
    }

    /// The launch that records before step `step`, where walks are recorded.
    pub fn record(&self, step: usize) -> Option<Launch> {
        let arrays = ["robot_state", "robot_params", "robot_memory", "imu", "command", "records"];
        let launch = self.launch("record", Some(step), &arrays);
        let shape = Shape::cover(self.recorded * self.environments, RECORDERS);
        (self.recorded > 0).then_some(Launch { shape, ..launch })
    }

    /// The kernels that it starts, in the order of a step.
    pub fn kernels(&self) -> Vec<&'static str> {
        let record = (self.recorded > 0).then_some("record");
        let others = ["observe", "act", "disturb", "finish", "observe_end", "add_values", "total"];
        let stepwise =
            ["take_actions", "next_step", "restart", "observe_chosen", "clear_step", "write_motion"]
                .into_iter()
                .filter(|_| self.mode == Mode::Steps);
        ["begin_rollout"].into_iter().chain(record).chain(others).chain(stepwise).collect()
    }

    /// The launch that writes the observations of actor and critic before step `step`.
    pub fn observe(&self, step: usize) -> Launch {
        self.columns(self.launch("observe", Some(step), &OBSERVED), self.terms[0] + self.terms[1])
    }

    /// Actions and targets, after the networks.
    pub fn act(&self, step: usize) -> Launch {
        let arrays = [
            "control",
            "parameters",
            // Actions from outside are there before.
            if self.mode == Mode::Steps { "action" } else { "mean" },
            "steps",
            "fresh",
            "robot_state",
            "robot_params",
            "robot_targets",
            "robot_memory",
            "action",
            "log_probability",
        ];
        self.launch("act", Some(step), &arrays)
    }

    /// Random torques of a step, where there are some. `tiles`: those of the physics.
    pub fn disturb(&self, step: usize, tiles: usize) -> Option<Launch> {
        let substeps = self.disturbed?;
        let launch = self.launch("disturb", Some(step), &["control", "deviation", "robot_disturbance"]);
        let mut launch = self.columns(launch, substeps);
        // The step comes first, then this, then the arrays.
        launch.arguments.insert(1, Value::U32(u32::try_from(tiles).unwrap_or(u32::MAX)));
        Some(launch)
    }

    /// The rest of a step, after the physics.
    pub fn finish(&self, step: usize) -> Launch {
        let arrays = [
            "control",
            "robot_state",
            "robot_params",
            "robot_report",
            "action",
            "reward",
            "done",
            "steps",
            "fresh",
            "command",
            "last_action",
            "feet",
            "returns",
            "cut",
            "tail",
            "tally",
            "errors",
            "bases",
            "ends",
            "last_observation",
            "robot_memory",
            "imu",
            "ways",
            "past",
            "critic_past",
            "held",
            "turned",
            "motion_errors",
        ];
        let mut launch = self.launch("finish", Some(step), &arrays);
        // The grid stays: a block still has the same number of environments.
        launch.shape.block[0] *= FINISH_PARTS;
        launch
    }

    /// The launch that writes the critic's observations after the last step.
    pub fn observe_end(&self) -> Launch {
        let arrays = [
            "robot_state",
            "robot_params",
            "steps",
            "fresh",
            "command",
            "last_action",
            "critic_past",
            "tail",
            "turned",
        ];
        self.columns(self.launch("observe_end", None, &arrays), self.terms[1])
    }

    /// Values of the last states, and of those where time was up, after the critic.
    pub fn add_values(&self) -> Launch {
        self.launch("add_values", None, &["cut", "tail_value", "reward", "last_value"])
    }

    /// Sums over all environments.
    pub fn total(&self) -> Launch {
        let launch = self.launch("total", None, &["tally", "totals"]);
        Launch { shape: Shape::new(u32::try_from(self.tallies).unwrap_or(1), 256), ..launch }
    }

    /// In [`Mode::Steps`]: reads the caller's actions, the array `mean`.
    pub fn take(&self) -> Launch {
        let launch = self.launch("take_actions", None, &["mean", "action", "refused"]);
        Launch { shape: Shape::cover(self.environments * self.actions, 256), ..launch }
    }

    /// In [`Mode::Steps`]: the launches before the physics.
    pub fn before(&self, tiles: usize) -> Vec<Launch> {
        [Some(self.begin()), Some(self.act(0)), self.disturb(0, tiles)].into_iter().flatten().collect()
    }

    /// In [`Mode::Steps`]: the launches after the physics.
    pub fn after(&self) -> Vec<Launch> {
        vec![self.finish(0), self.total(), self.next(), self.observe(0)]
    }

    /// In [`Mode::Steps`]: new episodes for the environments that the array `chosen` marks.
    pub fn restart(&self) -> Vec<Launch> {
        let arrays = [
            "chosen",
            "control",
            "robot_state",
            "robot_report",
            "robot_memory",
            "steps",
            "fresh",
            "command",
            "last_action",
            "feet",
            "returns",
            "ways",
            "turned",
        ];
        let observe = self.launch("observe_chosen", None, &[&["chosen"], &OBSERVED[..]].concat());
        let observe = self.columns(observe, self.terms[0] + self.terms[1]);
        vec![self.launch("restart", None, &arrays), self.next(), observe]
    }

    /// In [`Mode::Steps`]: the step of the environments that the array `chosen` marks belongs to no episode.
    pub fn clear(&self) -> Launch {
        self.launch("clear_step", None, &["chosen", "reward", "ends"])
    }

    /// In [`Mode::Steps`]: writes the motion of all robots into the array `motion`.
    pub fn motion(&self) -> Launch {
        let arrays = ["robot_state", "robot_params", "robot_report", "motion"];
        let launch = self.launch("write_motion", None, &arrays);
        let numbers = self.environments * (BASE_NUMBERS + 3 * self.actions);
        Launch { shape: Shape::cover(numbers, RECORDERS), ..launch }
    }

    fn next(&self) -> Launch {
        Launch { shape: Shape::new(1, THREADS), ..self.launch("next_step", None, &["control"]) }
    }
}
