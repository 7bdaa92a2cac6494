//! Environments of the CPU as the kernels' arrays, and back.

use std::ops::Range;

use gaitfit_learn::task::{Foot, Snapshot};
use gaitfit_policy::observation::Layout;
use gaitfit_sim::{Candidate, IMU_NUMBERS, Imu, RobotState};

use super::scene::Scene;
use crate::emit::Class;
use crate::spots::Spot;
use crate::walker::kept;

/// Environments as the kernels' arrays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Packed {
    /// Motion, sent targets, what networks remember, and the last physics step's report: tiles of the physics.
    pub state: Vec<f32>,
    /// As `state`.
    pub targets: Vec<f32>,
    /// As `state`.
    pub memory: Vec<f32>,
    /// As `state`.
    pub report: Vec<f32>,
    /// Steps since each episode began.
    pub steps: Vec<u32>,
    /// Whether each robot's targets begin with the next.
    pub fresh: Vec<u32>,
    /// Commands, a row a component.
    pub command: Vec<f32>,
    /// Last actions, a row a component.
    pub last_action: Vec<f32>,
    /// Feet, a row a number of a foot.
    pub feet: Vec<f32>,
    /// Reward and steps since each episode began, a row each.
    pub returns: Vec<f32>,
    /// Last rows of the actor, environment by environment; empty without past frames.
    pub past: Vec<f32>,
    /// Last rows of the critic, likewise.
    pub critic_past: Vec<f32>,
    /// Ways on generated ground, a row a number; empty without.
    pub ways: Vec<f32>,
    /// Angles by which the motion is turned, rad; empty if the policy follows none.
    pub turned: Vec<f32>,
}

impl Packed {
    /// Packs environments into `tiles` tiles; places beyond the last environment hold copies.
    pub fn new(scene: &Scene<'_>, snapshots: &[Snapshot], tiles: usize) -> Self {
        let class = |class: Class, spots: &[Spot], number: &dyn Fn(&Snapshot, usize) -> f32| {
            let (size, per_tile) = (scene.size(class), scene.period.layout().environments());
            let mut numbers = vec![0.0; tiles * size];
            for place in 0..tiles * per_tile {
                let Some(from) = snapshots.get(place % snapshots.len().max(1)) else { break };
                for (index, spot) in spots.iter().enumerate() {
                    let at = place / per_tile * size + spot.base + place % per_tile * spot.stride;
                    numbers[at] = number(from, index);
                }
            }
            numbers
        };
        let rows = |width: usize, number: &dyn Fn(&Snapshot, usize) -> f32| -> Vec<f32> {
            (0..width).flat_map(|k| snapshots.iter().map(move |one| number(one, k))).collect()
        };
        // An environment without a row does not read it.
        let past = |who: usize, layout: &Layout| -> Vec<f32> {
            let row = |one: &Snapshot| match one.past[who].len() {
                0 => vec![0.0; kept(layout)],
                _ => one.past[who].clone(),
            };
            snapshots.iter().flat_map(row).collect()
        };
        let shown = |one: &Snapshot, index: usize| {
            let RobotState { torque, normal_force, tracked, .. } = &one.robot;
            let number = torque.iter().chain(normal_force).chain(tracked).nth(index);
            number.copied().unwrap_or_default()
        };
        Self {
            state: class(Class::State, &scene.spots.state, &|one, index| one.robot.state[index]),
            targets: class(Class::Targets, &scene.spots.targets, &|one, index| one.robot.targets[index]),
            memory: class(Class::Memory, &scene.remembered, &|one, index| one.robot.memory[index]),
            report: class(Class::Report, &scene.spots.report, &shown),
            steps: snapshots.iter().map(|one| one.steps).collect(),
            fresh: snapshots.iter().map(|one| u32::from(one.robot.fresh)).collect(),
            command: rows(3, &|one, k| one.command[k]),
            last_action: rows(scene.actions(), &|one, k| one.last_action[k]),
            feet: rows(Foot::NUMBERS * scene.task.foot_geoms().len(), &|one, k| {
                one.feet[k / Foot::NUMBERS][k % Foot::NUMBERS]
            }),
            returns: rows(2, &|one, k| one.returns[k]),
            past: past(0, &scene.task.walker.observation),
            critic_past: past(1, &scene.task.walker.critic_observation),
            ways: rows(if scene.task.course.is_some() { 3 } else { 0 }, &|one, k| one.way[k]),
            turned: rows(usize::from(scene.follows()), &|one, _| one.turned),
        }
    }

    /// The environments.
    pub fn snapshots(&self, scene: &Scene<'_>) -> Vec<Snapshot> {
        let count = scene.sizes.environments;
        let per_tile = scene.period.layout().environments();
        let class = |numbers: &[f32], class: Class, spots: &[Spot], e: usize| -> Vec<f32> {
            let tile = e / per_tile * scene.size(class);
            spots.iter().map(|spot| numbers[tile + spot.base + e % per_tile * spot.stride]).collect()
        };
        let joints = scene.task.walker.default_pose.len();
        let geoms = scene.task.walker.batch.contact_geoms().len();
        let row = |numbers: &[f32], k: usize, e: usize| numbers[k * count + e];
        let one = |e: usize| {
            let shown = class(&self.report, Class::Report, &scene.spots.report, e);
            let (torque, rest) = shown.split_at(joints);
            let (normal_force, tracked) = rest.split_at(geoms);
            let feet = 0..scene.task.foot_geoms().len();
            Snapshot {
                robot: RobotState {
                    state: class(&self.state, Class::State, &scene.spots.state, e),
                    targets: class(&self.targets, Class::Targets, &scene.spots.targets, e),
                    memory: class(&self.memory, Class::Memory, &scene.remembered, e),
                    normal_force: normal_force.to_vec(),
                    tracked: tracked.to_vec(),
                    torque: torque.to_vec(),
                    fresh: self.fresh[e] != 0,
                },
                steps: self.steps[e],
                turned: self.turned.get(e).copied().unwrap_or_default(),
                command: std::array::from_fn(|k| row(&self.command, k, e)),
                last_action: (0..scene.actions()).map(|k| row(&self.last_action, k, e)).collect(),
                feet: feet
                    .map(|foot| std::array::from_fn(|k| row(&self.feet, Foot::NUMBERS * foot + k, e)))
                    .collect(),
                returns: std::array::from_fn(|k| row(&self.returns, k, e)),
                past: [&self.past, &self.critic_past].map(|rows| match (rows.len() / count, self.fresh[e]) {
                    (width, 0) => rows[e * width..(e + 1) * width].to_vec(),
                    _ => Vec::new(),
                }),
                way: std::array::from_fn(|k| self.ways.get(k * count + e).copied().unwrap_or_default()),
            }
        };
        (0..count).map(one).collect()
    }
}

/// Errors of the environments' inertial units, with `candidates` in turn, as kernels read them: one row for each number.
pub fn imu_rows(candidates: &[Candidate], environments: Range<usize>) -> Vec<f32> {
    let numbers = |candidate: &Candidate| Imu::numbers(candidate.sensors.imu().as_ref());
    let units: Vec<[f32; IMU_NUMBERS]> = candidates.iter().map(numbers).collect();
    // Candidates take turns over the environments of the whole training, of which these are a part.
    let first = environments.start % units.len().max(1);
    let row = |k: usize| units.iter().map(move |unit| unit[k]).cycle().skip(first).take(environments.len());
    (0..IMU_NUMBERS).flat_map(row).collect()
}
