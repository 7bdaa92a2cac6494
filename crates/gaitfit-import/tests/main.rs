//! The tests of `gaitfit-import`: one program, one module for each subject.

#[cfg(feature = "all-formats")]
mod all_formats;
mod common;
mod formats;
mod hostile;
mod loggers;
mod times;
