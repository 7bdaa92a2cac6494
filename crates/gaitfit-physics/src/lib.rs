//! One physics step of a legged robot in MuJoCo's formulation, written once over [`Real`].
//!
//! A [`gaitfit_model::Model`] is compiled to a [`Tree`] of constants; a [`Robot`] (the model's numbers, changed
//! joint by joint) becomes [`Params`]; a [`State`] is advanced by [`step`] with scratch in [`Work`]. Nothing is
//! allocated in a step, nothing is read or written outside its arguments, and there are no threads here.
//!
//! Conventions: SI units, radians, quaternions wxyz. The base's linear velocity is in world axes, its angular
//! velocity in body axes, as in MuJoCo.
//!
//! Geoms touch planes; spheres and capsules also touch static boxes and height fields. Chosen pairs of the robot's own
//! spheres, capsules and boxes touch each other. Nothing else touches.

mod compile;
mod cone;
mod contact;
mod coupling;
mod dense;
mod drive;
mod dual;
mod error;
mod forward;
mod free;
pub mod in_f64;
mod invweight;
mod joint_parameter;
mod kept;
mod lanes;
mod modify;
mod obstacles;
mod outline;
mod params;
pub mod phase;
mod real;
mod robot;
mod seat;
mod segment;
mod self_contact;
mod separate;
mod settings;
mod smooth;
mod softness;
mod solver;
mod spatial;
mod state;
mod step;
mod terrain;
pub mod trace;
mod tree;
mod vec3;
mod visit;

pub use compile::compile;
pub use dense::{Row, RowKind, bias, constraint_rows, mass_matrix};
pub use drive::{Drive, actuate, delay_taps};
pub use dual::Dual;
pub use error::PhysicsError;
pub use forward::{Evaluation, Forward, acceleration, state_from, state_to};
pub use gaitfit_isa::{Isa, IsaError};
pub use joint_parameter::{JointParameter, SearchDefaults};
pub use kept::Kept;
pub use lanes::*;
pub use modify::{
    ActionDelta, Engaged, Gears, IMU_PERIODS, IMU_READING, JointModification, JointNetwork, LateImu, Modify,
    NETWORK_WEIGHTS, NetworkScales, Parts, ResidAct, SensorPlaces, VelocityFilter, memory_of, settle,
};
pub use outline::LinkOutline;
pub use params::{JointParams, LinkInertia, PairInvweight, Params, RobotParams};
pub use real::Real;
pub use robot::{BodyChange, Robot};
pub use separate::Part;
pub use settings::{Damping, Preset, Settings};
pub use state::{State, Work};
pub use step::{Period, accelerate, control_period, step};
pub use tree::Tree;
pub use visit::{Owner, Slot};
