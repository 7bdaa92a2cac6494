//! Uneven ground of a task: a height field of cells, kinds side by side and harder ones further on, and a curriculum
//! that moves robots among its levels.
//!
//! Kinds, sizes and curriculum follow Rudin, Hoeller, Reist, Hutter: "Learning to Walk in Minutes Using Massively
//! Parallel Deep Reinforcement Learning", CoRL 2022 (legged_gym), and Isaac Lab's terrain generator.

mod course;
mod heights;
mod kind;
mod places;
mod settings;

pub(super) use course::Way;
pub use course::{Cell, Course};
pub use kind::{Kinds, TerrainKind};
pub use settings::TerrainSettings;
