//! The tests of `gaitfit-log`: one program, one module for each subject.

mod check;
mod clock;
mod csv;
mod falls;
mod folder;
mod ops;
mod recorded;
