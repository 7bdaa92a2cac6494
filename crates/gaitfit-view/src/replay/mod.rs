//! A 3-D replay of robots in one HTML file that plays offline.

mod data;

pub use data::{Body, Frame, Geom, Joint, Replay, ReplayRobot, Shape};
