//! The tests of `gaitfit-learn`: one program, one module for each subject.

mod checkpoint;
mod collect;
mod evaluate;
mod follow;
mod foreign;
mod history;
mod joints_and_feet;
mod memory;
mod motion;
mod own_simulator;
mod ppo_gae;
mod ppo_learner;
mod ppo_warmup;
mod rewards;
mod sensors;
mod task;
mod task_common;
