//! The tests of `gaitfit-cuda`: one program, one module for each subject.

mod candidates;
mod common;
mod compiler;
mod costs;
mod device;
mod evaluation_device;
mod fit_device;
mod fit_host;
mod fit_policies;
mod fit_predict;
mod fit_replay;
mod host;
mod kernels;
mod motions;
mod ppo_device;
mod ppo_functions;
mod ppo_host;
mod ppo_memory;
mod ppo_shares;
mod reference;
mod rollout_device;
mod rollout_host;
mod shares_device;
mod stepper_device;
