//! Fitting a simulator to a robot: θ, costs, CMA-ES and the loop that joins them.

mod checksum;
pub mod cmaes;
pub mod cost;
pub mod fit;
mod replay;
mod simulator;
mod theta;

pub use replay::ReplaySimulator;
pub use simulator::{
    Cancel, Consume, Identity, Resets, Rollout, SharedSimulator, Signals, Simulator, SimulatorError, never,
};
pub use theta::{
    Defaults, Entry, Found, JointParameter, LinearSpring, MAX_REASON, Modification, NETWORK_LAYERS,
    NetworkName, NetworkRule, NetworkStart, ParameterRule, Prior, RobotNumber, RobotRule, Rules,
    SavedNetwork, SavedParameter, Sharing, Theta, ThetaError, ThetaFile, ThetaFileError,
};
