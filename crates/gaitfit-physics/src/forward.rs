//! One evaluation in MuJoCo's layout, for holding the engine against another.

use gaitfit_model::Model;

use crate::compile::compile;
use crate::dense::{bias, mass_matrix};
use crate::drive::{Drive, actuate};
use crate::in_f64::{accelerate, step};
use crate::state::{State, Work};
use crate::tree::Tree;
use crate::vec3::*;
use crate::{Params, PhysicsError, Robot, Settings};

/// What [`Forward::evaluate`] returns, in MuJoCo's coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Mass matrix with armature, `nv × nv`, row-major.
    pub mass: Vec<f64>,
    /// Coriolis, centrifugal and gravity forces, `nv`.
    pub qfrc_bias: Vec<f64>,
    /// Acceleration under constraints, `nv`.
    pub qacc: Vec<f64>,
    /// Position after one step, `nq`.
    pub next_qpos: Vec<f64>,
    /// Velocity after one step, `nv`.
    pub next_qvel: Vec<f64>,
}

/// A robot in `f64` that takes MuJoCo's `qpos`, `qvel` and `ctrl`.
pub struct Forward {
    model: Model,
    tree: Tree<f64>,
    params: Params<f64>,
    work: Work<f64>,
}

impl Forward {
    /// Compiles `model` with its own parameters.
    pub fn new(model: &Model, settings: &Settings) -> Result<Self, PhysicsError> {
        let tree = compile::<f64>(model, settings)?;
        let params = Robot::nominal(model).params(model)?;
        let work = Work::new(&tree);
        Ok(Self { model: model.clone(), tree, params, work })
    }

    /// The compiled tree.
    pub fn tree(&self) -> &Tree<f64> {
        &self.tree
    }

    /// The robot's parameters.
    pub fn params(&self) -> &Params<f64> {
        &self.params
    }

    /// Evaluates one state from a cold start. Lengths must be the model's `nq`, `nv` and `nu`.
    pub fn evaluate(&mut self, qpos: &[f64], qvel: &[f64], ctrl: &[f64]) -> Result<Evaluation, PhysicsError> {
        let mut state = state_from(&self.tree, qpos, qvel)?;
        let drives = self.drives(&state, ctrl)?;
        let mass = mass_matrix(&self.tree, &self.params, &state);
        let qfrc_bias = bias(&self.tree, &self.params, &state);
        // A copy: the step below must start from the same cold state.
        let mut solved = state.clone();
        accelerate(&self.tree, &self.params, &drives, &mut solved, &mut self.work);
        let qacc = acceleration(&self.tree, &solved);
        step(&self.tree, &self.params, &drives, &mut state, &mut self.work);
        let (next_qpos, next_qvel) = state_to(&self.tree, &state);
        Ok(Evaluation { mass, qfrc_bias, qacc, next_qpos, next_qvel })
    }

    /// Advances a state by one step; the warm start is carried in `state`.
    pub fn step(&mut self, state: &mut State<f64>, ctrl: &[f64]) -> Result<(), PhysicsError> {
        let drives = self.drives(state, ctrl)?;
        step(&self.tree, &self.params, &drives, state, &mut self.work);
        Ok(())
    }

    fn drives(&self, state: &State<f64>, ctrl: &[f64]) -> Result<Vec<Drive<f64>>, PhysicsError> {
        let expected = self.model.nu();
        if ctrl.len() != expected {
            return Err(PhysicsError::Length { what: "ctrl", found: ctrl.len(), expected });
        }
        Ok(actuate(&self.model, ctrl, &state.qpos, &state.qvel))
    }
}

/// State from MuJoCo's `qpos` and `qvel`; the quaternion is normalised.
pub fn state_from(tree: &Tree<f64>, qpos: &[f64], qvel: &[f64]) -> Result<State<f64>, PhysicsError> {
    for (what, found, expected) in [("qpos", qpos.len(), tree.nq()), ("qvel", qvel.len(), tree.nv())] {
        if found != expected {
            return Err(PhysicsError::Length { what, found, expected });
        }
    }
    // The accelerations stay 0, so the solver begins without a warm start.
    let mut state = State::<f64>::new(tree);
    let (mut p, mut v) = (0, 0);
    if tree.floating {
        state.base_position = [qpos[0], qpos[1], qpos[2]];
        let norm = qpos[3..7].iter().map(|x| x * x).sum::<f64>().sqrt();
        // The condition is negated so that it refuses NaN too.
        if !(norm > 0.0 && norm.is_finite()) {
            return Err(PhysicsError::Value {
                object: "qpos".to_owned(),
                quantity: "the quaternion's length",
                value: norm,
                must: "positive",
            });
        }
        state.base_quaternion = std::array::from_fn(|k| qpos[3 + k] / norm);
        state.base_linear = [qvel[0], qvel[1], qvel[2]];
        state.base_angular = [qvel[3], qvel[4], qvel[5]];
        // A pose has four numbers of rotation, a velocity three.
        (p, v) = (7, 6);
    }
    state.qpos.copy_from_slice(&qpos[p..]);
    state.qvel.copy_from_slice(&qvel[v..]);
    Ok(state)
}

/// MuJoCo's `qpos` and `qvel` of a state.
pub fn state_to(tree: &Tree<f64>, state: &State<f64>) -> (Vec<f64>, Vec<f64>) {
    let (mut qpos, mut qvel) = (Vec::with_capacity(tree.nq()), Vec::with_capacity(tree.nv()));
    if tree.floating {
        qpos.extend(state.base_position);
        qpos.extend(state.base_quaternion);
        qvel.extend(state.base_linear);
        qvel.extend(state.base_angular);
    }
    qpos.extend(&state.qpos);
    qvel.extend(&state.qvel);
    (qpos, qvel)
}

/// MuJoCo's `qacc` of a state.
pub fn acceleration(tree: &Tree<f64>, state: &State<f64>) -> Vec<f64> {
    let mut qacc = Vec::with_capacity(tree.nv());
    if tree.floating {
        // MuJoCo has translation first and the rotation in body axes; the state has rotation first, all in
        // world axes.
        qacc.extend(state.base_acceleration[1]);
        qacc.extend(rotate_back(&quat_matrix(&state.base_quaternion), state.base_acceleration[0]));
    }
    qacc.extend(&state.qacc);
    qacc
}
