//! The robots of a tile, in blocks of lanes.

use std::ops::{Add, Mul, Sub};

use gaitfit_physics::{
    Drive, IMU_READING, JointModification, Lanes, Params, Period, SensorPlaces, State, Tree, WIDEST, Work,
    memory_of, settle,
};

use crate::motion::{Motion, Start};
use crate::tile::{RobotState, Robots};

struct Block<T> {
    params: Params<T>,
    state: State<T>,
    /// Sent targets, newest first; `taps × joints`.
    history: Vec<T>,
    /// Contact forces and places of the last step, as the scratch is shared by the blocks.
    normal_force: Vec<T>,
    tracked: Vec<[T; 3]>,
    torque: Vec<T>,
    /// Memory of the modifications.
    memory: Vec<T>,
    /// Lanes whose target history and memory start with their next target.
    fresh: [bool; WIDEST],
}

/// Data that all robots of a tile share.
pub(crate) struct Shared<'a> {
    pub tree: &'a Tree<f32>,
    /// Control periods of sent targets that are kept.
    pub taps: usize,
    pub substeps: usize,
    /// Compiled pairs whose places are reported.
    pub tracked: &'a [usize],
    pub modifications: Vec<JointModification<f32>>,
}

pub(crate) struct LaneRobots<'a, T: Lanes> {
    shared: Shared<'a>,
    environments: usize,
    blocks: Vec<Block<T>>,
    work: Work<T>,
    drives: Vec<Drive<T>>,
    disturbance: Vec<T>,
    settled: Vec<T>,
    sensors: SensorPlaces,
}

impl<'a, T: Lanes> LaneRobots<'a, T> {
    pub fn new(robots: &[Params<f64>], shared: Shared<'a>) -> Self {
        let tree = shared.tree;
        let memory = memory_of(&shared.modifications);
        let joints = tree.joints();
        let block = |robots: &[Params<f64>]| {
            // Lanes beyond the last robot repeat it.
            let sets: Vec<&Params<f64>> =
                (0..T::LANES).map(|lane| &robots[lane.min(robots.len() - 1)]).collect();
            Block {
                params: Params::in_lanes(&sets),
                state: State::new(tree),
                history: vec![T::zero(); shared.taps * joints],
                normal_force: vec![T::zero(); tree.model_pairs().len()],
                tracked: vec![[T::zero(); 3]; shared.tracked.len()],
                torque: vec![T::zero(); joints],
                memory: vec![T::zero(); memory],
                // No robot has got a target yet.
                fresh: [true; WIDEST],
            }
        };
        let blocks = robots.chunks(T::LANES).map(block).collect();
        Self {
            sensors: SensorPlaces::new(&shared.modifications),
            shared,
            environments: robots.len(),
            blocks,
            work: Work::new(tree),
            drives: vec![Drive::zero(); joints],
            disturbance: Vec::new(),
            settled: vec![T::zero(); memory],
        }
    }

    /// One value a lane from rows of `width` numbers, starting at environment `first`.
    fn gather(&self, rows: &[f32], first: usize, width: usize, column: usize) -> T {
        let mut values = [0.0; WIDEST];
        for (lane, slot) in values.iter_mut().enumerate().take(T::LANES) {
            // Lanes beyond the last robot repeat it, as its parameters do.
            let environment = (first + lane).min(self.environments - 1);
            *slot = rows[environment * width + column];
        }
        T::load(&values)
    }

    fn scatter(&self, value: T, rows: &mut [f32], first: usize, width: usize, column: usize) {
        let mut values = [0.0; WIDEST];
        value.store(&mut values);
        // Lanes beyond the last robot repeat it and are not reported.
        let count = T::LANES.min(self.environments - first);
        for (lane, value) in values.iter().enumerate().take(count) {
            rows[(first + lane) * width + column] = *value;
        }
    }

    fn report(&self, index: usize, motion: &mut Motion) {
        let block = &self.blocks[index];
        let (state, first, joints) = (&block.state, index * T::LANES, self.shared.tree.joints());
        if self.sensors.velocities.is_some() {
            motion.filtered_velocity.resize(self.environments * joints, 0.0);
        }
        // A diverged robot's acceleration times 0 is no 0.
        let lead = Some(self.shared.tree.settings().lead()).filter(|&lead| lead != 0.0).map(T::lit);
        let base = lead.map_or([[T::zero(); 3]; 2], |lead| {
            velocity_change(state.base_acceleration, state.base_quaternion, [lead, T::lit(2.0)])
        });
        for k in 0..3 {
            self.scatter(state.base_position[k], &mut motion.base_position, first, 3, k);
            self.scatter(state.base_angular[k] + base[0][k], &mut motion.base_angular, first, 3, k);
            self.scatter(state.base_linear[k] + base[1][k], &mut motion.base_linear, first, 3, k);
        }
        for k in 0..4 {
            self.scatter(state.base_quaternion[k], &mut motion.base_quaternion, first, 4, k);
        }
        // A late unit's memory holds what it reads beyond the present.
        if let Some(place) = self.sensors.imu {
            let readings = motion.late_imu.get_or_insert_default();
            readings.resize(self.environments * IMU_READING, 0.0);
            let angular: [T; 3] = std::array::from_fn(|k| state.base_angular[k] + base[0][k]);
            for (k, truth) in state.base_quaternion.into_iter().chain(angular).enumerate() {
                self.scatter(truth + block.memory[place + k], readings, first, IMU_READING, k);
            }
        }
        for j in 0..joints {
            let reading = state.qpos[j] + block.params.joints[j].encoder_bias;
            self.scatter(reading, &mut motion.joint_position, first, joints, j);
            // The velocity `lead` seconds on, by the last acceleration.
            let velocity = lead.map_or(state.qvel[j], |lead| lead.fma(state.qacc[j], state.qvel[j]));
            self.scatter(velocity, &mut motion.joint_velocity, first, joints, j);
            if let Some(place) = self.sensors.velocities {
                let reading = velocity + block.memory[place + j];
                self.scatter(reading, &mut motion.filtered_velocity, first, joints, j);
            }
            self.scatter(state.qacc[j], &mut motion.joint_acceleration, first, joints, j);
            self.scatter(block.torque[j], &mut motion.torque, first, joints, j);
        }
        let geoms = block.normal_force.len();
        for (k, &force) in block.normal_force.iter().enumerate() {
            self.scatter(force, &mut motion.normal_force, first, geoms, k);
        }
        let width = 3 * block.tracked.len();
        for (k, place) in block.tracked.iter().enumerate() {
            for (axis, &coordinate) in place.iter().enumerate() {
                self.scatter(coordinate, &mut motion.tracked, first, width, 3 * k + axis);
            }
        }
    }
}

/// Returns the change of the angular (body frame) and linear velocity by `seconds` of the last acceleration
/// (angular and linear, world frame), of a base with orientation `quaternion`. `two`: 2.
fn velocity_change<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T>>(
    [angular, linear]: [[T; 3]; 2],
    quaternion: [T; 4],
    [seconds, two]: [T; 2],
) -> [[T; 3]; 2] {
    let [w, x, y, z] = quaternion;
    // The inverse turn: v − 2 w (u × v) + 2 u × (u × v).
    let cross = |b: [T; 3]| [y * b[2] - z * b[1], z * b[0] - x * b[2], x * b[1] - y * b[0]];
    let once = cross(angular);
    let twice = cross(once);
    let body: [T; 3] = std::array::from_fn(|k| angular[k] + two * (twice[k] - w * once[k]));
    [body.map(|a| seconds * a), linear.map(|a| seconds * a)]
}

/// The numbers of all lanes.
fn lanes<T: Lanes>(value: T) -> [f32; WIDEST] {
    let mut values = [0.0; WIDEST];
    value.store(&mut values);
    values
}

fn set_lane<T: Lanes>(value: &mut T, lane: usize, x: f32) {
    let mut values = [0.0; WIDEST];
    value.store(&mut values);
    values[lane] = x;
    *value = T::load(&values);
}

impl<T: Lanes> Block<T> {
    /// Every number that changes from step to step.
    fn numbers(&mut self) -> impl Iterator<Item = &mut T> {
        // `robot`, `set_robot` and saved tiles rely on this order.
        let mut state = Vec::new();
        self.state.visit_mut(|_, number| state.push(number));
        let last =
            self.normal_force.iter_mut().chain(self.tracked.iter_mut().flatten()).chain(&mut self.torque);
        state.into_iter().chain(&mut self.history).chain(&mut self.memory).chain(last)
    }
}

impl<T: Lanes> Robots for LaneRobots<'_, T> {
    fn environments(&self) -> usize {
        self.environments
    }

    fn place(&mut self, environment: usize, start: &Start) {
        let lane = environment % T::LANES;
        let block = &mut self.blocks[environment / T::LANES];
        // In the order of `visit`, accelerations of 0 among them.
        let mut numbers = Vec::new();
        start.state().visit(|_, &number| numbers.push(number));
        let mut numbers = numbers.into_iter();
        block.state.visit_mut(|_, number| set_lane(number, lane, numbers.next().unwrap_or_default()));
        for number in block.torque.iter_mut().chain(&mut block.normal_force) {
            set_lane(number, lane, 0.0);
        }
        block.tracked.iter_mut().flatten().for_each(|number| set_lane(number, lane, 0.0));
        // What sensors read before the first step is the start's too.
        block.memory.iter_mut().skip(self.sensors.begin).for_each(|number| set_lane(number, lane, 0.0));
        // What it held before is known only with its next target.
        block.fresh[lane] = true;
    }

    fn correct(&mut self, readings: &[(usize, Start)]) {
        // Velocities are reported `lead` seconds ahead of the integrator's, so a reading is taken back by as much.
        let lead = self.shared.tree.settings().lead() as f32;
        // Robots of one block are set together: each number of a block is stored and loaded once for all of
        // them.
        for of_block in readings.chunk_by(|(one, _), (other, _)| one / T::LANES == other / T::LANES) {
            let state = &mut self.blocks[of_block[0].0 / T::LANES].state;
            let vectors = state.base_acceleration.map(|vector| vector.map(lanes));
            let quaternions = state.base_quaternion.map(lanes);
            // How far each robot's reported velocity is ahead of the integrator's.
            let changes: Vec<[[f32; 3]; 2]> = of_block
                .iter()
                .map(|(environment, _)| {
                    let lane = environment % T::LANES;
                    let acceleration = vectors.each_ref().map(|vector| vector.map(|values| values[lane]));
                    velocity_change(acceleration, quaternions.map(|values| values[lane]), [lead, 2.0])
                })
                .collect();
            let set = |number: &mut T, value: &dyn Fn(&Start, usize) -> f32| {
                let mut values = lanes(*number);
                for (place, (environment, reading)) in of_block.iter().enumerate() {
                    values[environment % T::LANES] = value(reading, place);
                }
                *number = T::load(&values);
            };
            for k in 0..3 {
                set(&mut state.base_position[k], &|reading, _| reading.base_position[k]);
                set(&mut state.base_angular[k], &|reading, at| reading.base_angular[k] - changes[at][0][k]);
                set(&mut state.base_linear[k], &|reading, at| reading.base_linear[k] - changes[at][1][k]);
            }
            for k in 0..4 {
                set(&mut state.base_quaternion[k], &|reading, _| reading.base_quaternion[k]);
            }
            for j in 0..state.qpos.len() {
                let accelerations = lanes(state.qacc[j]);
                set(&mut state.qpos[j], &|reading, _| reading.joint_position[j]);
                set(&mut state.qvel[j], &|reading, at| {
                    let lane = of_block[at].0 % T::LANES;
                    reading.joint_velocity[j] - lead * accelerations[lane]
                });
            }
        }
    }

    fn push(&mut self, environment: usize, velocity: [f32; 3]) {
        let lane = environment % T::LANES;
        let linear = &mut self.blocks[environment / T::LANES].state.base_linear;
        for (component, change) in linear.iter_mut().zip(velocity) {
            let mut values = [0.0; WIDEST];
            component.store(&mut values);
            values[lane] += change;
            *component = T::load(&values);
        }
    }

    fn step(&mut self, targets: &[f32], disturbance: &[f32], motion: &mut Motion) {
        let (tree, joints) = (self.shared.tree, self.shared.tree.joints());
        for index in 0..self.blocks.len() {
            let first = index * T::LANES;
            let kept = self.blocks[index].history.len() - joints;
            // The history is newest first, so older targets move back by one row.
            self.blocks[index].history.copy_within(..kept, joints);
            for j in 0..joints {
                let target = self.gather(targets, first, joints, j);
                self.blocks[index].history[j] = target;
            }
            // It stays empty if there are no disturbances.
            self.disturbance.clear();
            // Rows are `environments × joints` for each substep; the lanes of one block are taken out of each.
            for substep in disturbance.chunks_exact(joints * self.environments) {
                for j in 0..joints {
                    let torque = self.gather(substep, first, joints, j);
                    self.disturbance.push(torque);
                }
            }
            let block = &mut self.blocks[index];
            // Memory settles with the first target, because only now the target is known that the robot is
            // taken to have held.
            if !block.memory.is_empty() && block.fresh.contains(&true) {
                settle(&self.shared.modifications, &block.params, &block.state, &mut self.settled);
            }
            // `settle` computes all lanes at once. Only fresh ones take its numbers.
            for lane in 0..T::LANES {
                if std::mem::take(&mut block.fresh[lane]) {
                    let mut values = [0.0; WIDEST];
                    for (number, settled) in block.memory.iter_mut().zip(&self.settled) {
                        settled.store(&mut values);
                        set_lane(number, lane, values[lane]);
                    }
                    // All older targets become the new one.
                    for j in 0..joints {
                        block.history[j].store(&mut values);
                        for tap in block.history[j..].iter_mut().step_by(joints) {
                            set_lane(tap, lane, values[lane]);
                        }
                    }
                }
            }
            T::control_period(&mut Period {
                tree,
                params: &block.params,
                targets: &mut block.history,
                disturbance: &self.disturbance,
                modifications: &self.shared.modifications,
                memory: &mut block.memory,
                substeps: self.shared.substeps,
                state: &mut block.state,
                work: &mut self.work,
                drives: &mut self.drives,
            });
            // Copied, because the next block uses the same scratch.
            for (torque, drive) in block.torque.iter_mut().zip(&self.drives) {
                *torque = drive.torque;
            }
            for (pair, force) in block.normal_force.iter_mut().enumerate() {
                *force = self.work.normal_force(tree, pair);
            }
            // Places are about the base's origin at the start of the last step, a physics step ago.
            let h = T::lit(tree.settings().timestep);
            for (place, &pair) in block.tracked.iter_mut().zip(self.shared.tracked) {
                let center = self.work.pair_center(tree, pair);
                for k in 0..3 {
                    // The step moved the base by h times its new velocity; taking that back gives the place before
                    // the step.
                    let origin = h.fnma(block.state.base_linear[k], block.state.base_position[k]);
                    place[k] = origin + center[k];
                }
            }
            self.report(index, motion);
        }
    }

    fn observe(&self, motion: &mut Motion) {
        for index in 0..self.blocks.len() {
            self.report(index, motion);
        }
    }

    fn save(&mut self) -> Vec<f32> {
        let mut saved = Vec::new();
        let mut values = [0.0; WIDEST];
        for block in &mut self.blocks {
            for number in block.numbers() {
                number.store(&mut values);
                saved.extend(&values[..T::LANES]);
            }
            saved.extend(block.fresh[..T::LANES].iter().map(|&fresh| if fresh { 1.0 } else { 0.0 }));
        }
        saved
    }

    fn robot(&mut self, environment: usize) -> RobotState {
        let lane = environment % T::LANES;
        let block = &mut self.blocks[environment / T::LANES];
        let (targets, memory) = (block.history.len(), block.memory.len());
        let (forces, tracked, torques) =
            (block.normal_force.len(), 3 * block.tracked.len(), block.torque.len());
        let mut values = [0.0; WIDEST];
        let mut numbers: Vec<f32> = Vec::new();
        for number in block.numbers() {
            number.store(&mut values);
            numbers.push(values[lane]);
        }
        // The parts follow each other as in [`Block::numbers`]; what is left in front of them is the motion.
        let mut state = numbers;
        let mut rest = state.split_off(state.len() - targets - memory - forces - tracked - torques);
        let mut part = |length: usize| {
            let after = rest.split_off(length);
            std::mem::replace(&mut rest, after)
        };
        RobotState {
            targets: part(targets),
            memory: part(memory),
            normal_force: part(forces),
            tracked: part(tracked),
            torque: part(torques),
            fresh: block.fresh[lane],
            state,
        }
    }

    fn set_robot(&mut self, environment: usize, robot: &RobotState) -> bool {
        let lane = environment % T::LANES;
        let block = &mut self.blocks[environment / T::LANES];
        let RobotState { state, targets, memory, normal_force, tracked, torque, fresh } = robot;
        let given = [state, targets, memory, normal_force, tracked, torque];
        // Counted first, so that nothing is written of a state that does not fit.
        let numbers: Vec<&mut T> = block.numbers().collect();
        if numbers.len() != given.iter().map(|part| part.len()).sum::<usize>() {
            return false;
        }
        for (number, &value) in numbers.into_iter().zip(given.into_iter().flatten()) {
            set_lane(number, lane, value);
        }
        block.fresh[lane] = *fresh;
        true
    }

    fn restore(&mut self, saved: &[f32]) -> bool {
        // One number more in each lane says whether the robot is fresh.
        let width: usize = self.blocks.iter_mut().map(|block| (block.numbers().count() + 1) * T::LANES).sum();
        if saved.len() != width {
            return false;
        }
        let mut lanes = saved.chunks_exact(T::LANES);
        let mut values = [0.0; WIDEST];
        for block in &mut self.blocks {
            // `numbers` must stand first: `zip` asks it first, so that its end takes no row of `lanes`, which the
            // flags need.
            for (number, saved) in block.numbers().zip(&mut lanes) {
                values[..T::LANES].copy_from_slice(saved);
                *number = T::load(&values);
            }
            for (fresh, saved) in block.fresh.iter_mut().zip(lanes.next().unwrap_or_default()) {
                *fresh = *saved != 0.0;
            }
        }
        true
    }
}
