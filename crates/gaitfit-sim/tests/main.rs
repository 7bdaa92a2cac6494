//! The tests of `gaitfit-sim`: one program, one module for each subject.

mod batch;
mod late_imu;
mod replay;
mod velocity_filter;
