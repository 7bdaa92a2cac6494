//! The table `[terrain]` of a task.

use gaitfit_model::shown_number;
use serde::{Deserialize, Serialize};

use super::{Kinds, TerrainKind};
use crate::task::error::refuse;
use crate::task::{Interval, TaskError};

/// Uneven ground: a grid of square cells, levels of difficulty along x and kinds along y. Each robot starts in the middle
/// of a cell. Pairs of sizes are those of the first and of the last level.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TerrainSettings {
    /// What is on the cells: a kind, or kinds with their shares of the columns. Of slopes and stairs every other column is
    /// a pit, out of which a robot climbs.
    pub kind: Kinds,
    /// Levels of difficulty: cells along x.
    pub levels: usize,
    /// Cells along y.
    pub columns: usize,
    /// Edge of a cell, m.
    pub size: f64,
    /// Edge of the level place in the middle of slopes and stairs, m.
    pub platform: f64,
    /// Height of a step of stairs, m.
    pub step_height: Interval,
    /// Depth of a step of stairs, m.
    pub step_depth: Interval,
    /// Slope: rise over run.
    pub slope: Interval,
    /// Largest height of rough ground above and below its middle, m.
    pub roughness: Interval,
    /// Distance of the heights of rough ground that are drawn, m.
    pub rough_distance: f64,
    /// Distance of neighbouring vertices, m; feet must have a radius of at most half of it.
    pub cell: f64,
    /// Width of the level ground around all cells, m. An episode ends, as if time were up, half a metre from its edge.
    pub border: f64,
    /// Seed of the rough ground.
    pub seed: u64,
    /// Whether robots move among the levels: one that leaves its cell goes one up, one that falls or comes less than half
    /// as far as was commanded goes one down, one that passes the last level starts at any. Otherwise each episode
    /// starts at any level.
    pub curriculum: bool,
    /// The highest level, from 0, that a robot of a curriculum begins at; the last one, if there are fewer.
    pub start_level: usize,
}

impl Default for TerrainSettings {
    fn default() -> Self {
        let shares = [(TerrainKind::Slopes, 0.25), (TerrainKind::Rough, 0.25), (TerrainKind::Stairs, 0.5)];
        Self {
            kind: Kinds::Shares(shares.into_iter().collect()),
            levels: 10,
            columns: 8,
            size: 6.0,
            platform: 1.5,
            step_height: [0.03, 0.18],
            step_depth: [0.3, 0.3],
            slope: [0.0, 0.4],
            roughness: [0.01, 0.06],
            rough_distance: 0.2,
            cell: 0.05,
            border: 2.0,
            seed: 1,
            curriculum: true,
            start_level: 3,
        }
    }
}

/// Min width of the border, m.
const MIN_BORDER: f64 = 1.0;
/// Max number of vertices of the height field.
const MAX_VERTICES: f64 = (1 << 22) as f64;
/// Max number of levels and of columns.
const MAX_CELLS: usize = 200;

impl TerrainSettings {
    /// The table with another kind of ground.
    pub fn with_kind(kind: Kinds) -> Self {
        Self { kind, ..Self::default() }
    }

    /// Vertices from edge to edge of a cell.
    pub(super) fn across(&self) -> usize {
        (self.size / self.cell).round() as usize
    }

    /// Vertices across the border.
    pub(super) fn rim(&self) -> usize {
        (self.border / self.cell).round() as usize
    }

    /// Refuses numbers out of range, by setting.
    pub(in crate::task) fn check(&self) -> Result<(), TaskError> {
        // What only one kind uses may be anything where that kind is not: its default need not fit other settings.
        let has = |kind| self.kind.shares().iter().any(|(other, share)| *other == kind && *share > 0.0);
        let (rough, stairs) = (has(TerrainKind::Rough), has(TerrainKind::Stairs));
        for (setting, value, [low, high], counts) in [
            ("terrain.size", self.size, [0.5, 100.0], true),
            ("terrain.cell", self.cell, [0.01, 1.0], true),
            // At least a twentieth of the area on each side is left for slopes and steps. Its edge is a whole number of cells.
            (
                "terrain.platform",
                self.platform,
                [0.0, 0.9 * self.size.min(self.across() as f64 * self.cell)],
                true,
            ),
            ("terrain.rough_distance", self.rough_distance, [self.cell, self.size], rough),
            ("terrain.border", self.border, [MIN_BORDER, 100.0], true),
        ] {
            if counts && !(low..=high).contains(&value) {
                let what = format!("is {}; it must be from {low} to {high} m", shown_number(value));
                return refuse(setting, what);
            }
        }
        for (setting, range, [low, high], counts) in [
            ("terrain.step_height", self.step_height, [0.0, 1.0], true),
            ("terrain.step_depth", self.step_depth, [self.cell, self.size], stairs),
            ("terrain.slope", self.slope, [0.0, 2.0], true),
            ("terrain.roughness", self.roughness, [0.0, 1.0], true),
        ] {
            let outside = |value: &f64| !(low..=high).contains(value);
            if let Some(value) = range.into_iter().find(outside).filter(|_| counts) {
                let what = format!(
                    "has {}; it must be [at the first level, at the last], from {low} to {high}",
                    shown_number(value)
                );
                return refuse(setting, what);
            }
        }
        for (setting, count) in [("terrain.levels", self.levels), ("terrain.columns", self.columns)] {
            if !(1..=MAX_CELLS).contains(&count) {
                return refuse(setting, format!("is {count}; it must be from 1 to {MAX_CELLS}"));
            }
        }
        let shares = self.kind.shares();
        let wrong = |share: f64| !(0.0..=1e6).contains(&share);
        if let Some((kind, share)) = shares.iter().find(|(_, share)| wrong(*share)) {
            let what =
                format!("gives {} the share {}; give from 0 to 1e6", kind.name(), shown_number(*share));
            return refuse("terrain.kind", what);
        }
        if !shares.iter().any(|(_, share)| *share > 0.0) {
            return refuse("terrain.kind", "has no share above 0; name a kind".to_owned());
        }
        // In `f64`, so that a huge product is refused and does not wrap.
        let along = |cells: usize| (cells * self.across() + 2 * self.rim() + 1) as f64;
        let vertices = along(self.levels) * along(self.columns);
        if vertices > MAX_VERTICES {
            let what = format!(
                "makes {vertices} vertices with these levels, columns, size and border; at most {MAX_VERTICES} may be: \
                 take fewer or smaller cells, or a longer distance"
            );
            return refuse("terrain.cell", what);
        }
        Ok(())
    }
}
