//! The tests of `gaitfit-import`: one program, one module for each subject.

mod common;
mod formats;
mod hostile;
mod loggers;
mod times;
