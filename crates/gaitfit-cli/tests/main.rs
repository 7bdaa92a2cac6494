//! The tests of `gaitfit-cli`: one program, one module for each subject.

mod adapt;
mod advice;
mod bad_input;
#[path = "common/chromium.rs"]
mod chromium;
mod collect;
mod common;
mod conventions;
mod docs;
mod evaluate;
mod export;
mod finetune;
mod forward;
mod init;
mod inspect;
mod link;
mod loop_robot;
mod memory;
mod motion;
mod odd_joints;
mod pages;
mod preflight;
mod program;
mod readme;
mod remembered;
mod reproduce;
mod resume;
mod robots;
mod run;
mod sensors;
mod train;
mod validate;
mod wheels;
mod whole_loop;
