//! The tests of `gaitfit-policy`: one program, one module for each subject.

mod common;
mod interface;
mod motion;
mod network;
mod observation;
mod recurrent;
mod sequences;
