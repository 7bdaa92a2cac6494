//! The tests of `gaitfit-policy`: one program, one module for each subject.

mod common;
mod deploy;
mod exported;
mod files;
mod foreign;
mod graphs;
mod hostile;
mod import;
mod interface;
mod motion;
mod network;
mod observation;
mod recurrent;
mod sequences;
mod trainers;
