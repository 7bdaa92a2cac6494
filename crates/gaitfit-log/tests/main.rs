//! The tests of `gaitfit-log`: one program, one module for each subject.

mod check;
mod clock;
mod csv;
mod falls;
mod folder;
mod imu;
mod motors;
mod ops;
mod recorded;
mod remarks;
