//! The tests of `gaitfit-policy-files`: one program, one module for each subject.

mod common;
mod deploy;
mod exported;
mod files;
mod foreign;
mod graphs;
mod hostile;
mod import;
mod motion;
mod programs;
mod recurrent;
mod trainers;
