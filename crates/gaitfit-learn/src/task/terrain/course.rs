//! The cells of a task's ground, and how robots move among their levels.

use gaitfit_model::HeightField;
use gaitfit_random::{Purpose, Stream};

use super::heights::{at_level, field};
use super::{TerrainKind, TerrainSettings};
use crate::task::TaskError;

/// A cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cell {
    /// Level of difficulty, from 0.
    pub level: usize,
    /// Column, from 0.
    pub column: usize,
}

/// The cells of a task's ground.
#[derive(Clone, Debug)]
pub struct Course {
    settings: TerrainSettings,
    /// Kind of each column, and its number among those of its kind.
    columns: Vec<(TerrainKind, usize)>,
    /// Half the ground's edges, without the strip that ends an episode, m.
    inside: [f64; 2],
}

/// Width of the strip at the edge of the ground that ends an episode, m.
const STRIP: f64 = 0.5;
/// Min distance of a start from the edge of the platform, m: the robot's feet stand on it.
const ROOM: f64 = 0.4;

impl Course {
    /// The cells that the settings describe, and the ground with them.
    ///
    /// # Errors
    /// Settings out of range.
    pub fn new(settings: &TerrainSettings) -> Result<(Self, HeightField), TaskError> {
        settings.check()?;
        // Half of all cells, and the rim, which is on each side.
        let half = |cells: usize| {
            0.5 * settings.cell * (cells * settings.across()) as f64 + settings.cell * settings.rim() as f64
        };
        let course = Self {
            settings: settings.clone(),
            columns: settings.kind.columns(settings.columns),
            inside: [half(settings.levels) - STRIP, half(settings.columns) - STRIP],
        };
        let ground = field(settings, &course);
        Ok((course, ground))
    }

    /// Settings of the ground.
    pub fn settings(&self) -> &TerrainSettings {
        &self.settings
    }

    /// Edge of a cell, in whole vertices, m.
    pub fn size(&self) -> f64 {
        self.settings.across() as f64 * self.settings.cell
    }

    /// Kind of ground on a cell.
    pub fn kind(&self, cell: Cell) -> TerrainKind {
        self.columns.get(cell.column).map_or(TerrainKind::Flat, |(kind, _)| *kind)
    }

    /// Whether slopes or stairs lead up from the middle of the cell: every other column of a kind, from the first.
    pub fn is_pit(&self, cell: Cell) -> bool {
        let number = self.columns.get(cell.column).map_or(0, |(_, number)| *number);
        matches!(self.kind(cell), TerrainKind::Slopes | TerrainKind::Stairs) && number.is_multiple_of(2)
    }

    /// Share of the way from the first level to the last, 0 to 1.
    pub fn fraction(&self, cell: Cell) -> f64 {
        // With a single level this is 0 / 1: it is the first.
        cell.level as f64 / (self.settings.levels - 1).max(1) as f64
    }

    /// Difficulty of a cell: height of its steps (m), slope, or roughness (m); 0 on level ground.
    pub fn difficulty(&self, cell: Cell) -> f64 {
        let range = match self.kind(cell) {
            TerrainKind::Flat => return 0.0,
            TerrainKind::Slopes => self.settings.slope,
            TerrainKind::Stairs => self.settings.step_height,
            TerrainKind::Rough => self.settings.roughness,
        };
        at_level(range, self.fraction(cell))
    }

    /// x and y of the middle of a cell, m.
    pub fn middle(&self, cell: Cell) -> [f64; 2] {
        // The cells lie evenly about the world's origin, as the height field does.
        let along = |number: usize, count: usize| self.size() * (number as f64 + 0.5 - 0.5 * count as f64);
        [along(cell.level, self.settings.levels), along(cell.column, self.settings.columns)]
    }

    /// The cell's column of a robot.
    pub(in crate::task) fn column(&self, environment: u32) -> usize {
        environment as usize % self.settings.columns
    }

    /// Half the edges of the ground, along levels and columns, without the strip that ends an episode, m.
    pub fn inside(&self) -> [f64; 2] {
        self.inside
    }

    /// Half the edge of the square about the middle of a cell in which episodes start, m.
    pub fn room(&self) -> f64 {
        // On a platform smaller than the room for feet, all start in its middle.
        (0.5 * self.settings.platform - ROOM).max(0.0)
    }

    /// Levels that the first episode, or any without a curriculum, starts on, from the lowest.
    pub fn drawn_levels(&self) -> usize {
        if self.settings.curriculum {
            // A start level beyond the last one means all levels.
            self.settings.start_level.saturating_add(1).min(self.settings.levels)
        } else {
            self.settings.levels
        }
    }

    /// Whether x, y is so near the edge of the ground that the episode ends, or beyond it.
    pub(in crate::task) fn is_outside(&self, [x, y]: [f32; 2]) -> bool {
        f64::from(x).abs() > self.inside[0] || f64::from(y).abs() > self.inside[1]
    }

    /// Place on `cell` at which an episode of `environment` starts that begins at `step`: x and y, m.
    pub(in crate::task) fn place(&self, cell: Cell, seed: u64, environment: u32, step: u32) -> [f64; 2] {
        let stream = Stream::new(seed, Purpose::PLACE).environment(environment).step(step);
        let room = self.room();
        let [x, y] = self.middle(cell);
        // Draw 0 of this stream is the one of the level.
        let off = |draw: u32| room * (2.0 * stream.uniform(draw) - 1.0);
        [x + off(1), y + off(2)]
    }

    /// The random level of the first episode of `environment`; without a curriculum, of any episode, which begins at
    /// `step`.
    pub(in crate::task) fn drawn_level(&self, seed: u64, environment: u32, step: u32) -> usize {
        any(self.drawn_levels(), seed, environment, step)
    }

    /// The level of the episode of `environment` that begins at `step`, after one that went like `way` and ended at x,
    /// y (m), by a fall or otherwise.
    pub(in crate::task) fn next_level(
        &self,
        way: &Way,
        end: [f32; 2],
        fell: bool,
        seed: u64,
        environment: u32,
        step: u32,
    ) -> usize {
        if !self.settings.curriculum {
            return self.drawn_level(seed, environment, step);
        }
        let cell = Cell { level: way.level, column: self.column(environment) };
        let [x, y] = self.middle(cell);
        // Measured from the middle of the cell, near which all episodes start.
        let far = (f64::from(end[0]) - x).hypot(f64::from(end[1]) - y);
        // Thresholds of legged_gym's `_update_terrain_curriculum`: half a cell up, half of the commanded way
        // down.
        if far > 0.5 * self.size() {
            let next = way.level + 1;
            // Passing the last level leads to any level, so that robots do not all gather on the hardest one.
            return if next < self.settings.levels {
                next
            } else {
                any(self.settings.levels, seed, environment, step)
            };
        }
        // A robot on the lowest level stays there.
        if fell || way.walked < 0.5 * way.commanded { way.level.saturating_sub(1) } else { way.level }
    }
}

/// A level of `levels`, all alike.
fn any(levels: usize, seed: u64, environment: u32, step: u32) -> usize {
    let stream = Stream::new(seed, Purpose::PLACE).environment(environment).step(step);
    // A product that is rounded up may be `levels` itself.
    ((stream.uniform(0) * levels as f64) as usize).min(levels - 1)
}

/// Progress of a robot's episode on its cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::task) struct Way {
    /// Level of its cell.
    pub level: usize,
    /// Distance walked in the commanded direction since the episode began, m.
    pub walked: f32,
    /// Distance commanded since then, m.
    pub commanded: f32,
}

impl Way {
    /// Takes up `dt` seconds under `command` (forward, left, m/s) at `velocity`, heading frame.
    pub fn advance(&mut self, command: [f32; 3], velocity: [f32; 3], dt: f32) {
        let speed = (command[0] * command[0] + command[1] * command[1]).sqrt();
        // Standing and turning on the spot cover no distance, and are not to count as lagging.
        if speed > 0.0 {
            self.walked += dt * (velocity[0] * command[0] + velocity[1] * command[1]) / speed;
            self.commanded += dt * speed;
        }
    }

    /// Its numbers, for a checkpoint.
    pub fn numbers(&self) -> [f32; 3] {
        [self.level as f32, self.walked, self.commanded]
    }

    /// Reads a way from its saved numbers, on ground with `levels` levels; `None` if its level does not exist.
    pub fn from_numbers(&[level, walked, commanded]: &[f32; 3], levels: usize) -> Option<Self> {
        // The level was saved as a float among others: a damaged one need not be a whole number.
        let known = level >= 0.0 && level.fract() == 0.0 && (level as usize) < levels;
        (known && walked.is_finite() && commanded.is_finite()).then_some(Self {
            level: level as usize,
            walked,
            commanded,
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::super::Kinds;
    use super::*;

    fn course(curriculum: bool) -> Course {
        let settings = TerrainSettings {
            levels: 4,
            columns: 2,
            size: 4.0,
            curriculum,
            start_level: 1,
            ..TerrainSettings::with_kind(Kinds::One(TerrainKind::Stairs))
        };
        Course::new(&settings).unwrap().0
    }

    /// A robot of column 1 whose episode on `level` ended `far` from the middle of its cell.
    fn next(
        course: &Course,
        level: usize,
        far: f32,
        walked: f32,
        commanded: f32,
        fell: bool,
        step: u32,
    ) -> usize {
        let [x, y] = course.middle(Cell { level, column: 1 });
        let end = [x as f32 + 0.6 * far, y as f32 - 0.8 * far];
        course.next_level(&Way { level, walked, commanded }, end, fell, 7, 1, step)
    }

    #[test]
    fn who_leaves_the_cell_climbs_and_who_lags_or_falls_descends() {
        let course = course(true);
        assert_eq!(next(&course, 1, 2.1, 3.0, 4.0, false, 9), 2);
        assert_eq!(next(&course, 1, 2.1, 3.0, 4.0, true, 9), 2, "it came far enough before it fell");
        assert_eq!(next(&course, 1, 1.9, 3.0, 4.0, false, 9), 1);
        assert_eq!(next(&course, 1, 1.9, 1.9, 4.0, false, 9), 0);
        assert_eq!(next(&course, 1, 1.9, 3.0, 4.0, true, 9), 0);
        assert_eq!(next(&course, 0, 0.0, 0.0, 4.0, true, 9), 0);
        assert_eq!(next(&course, 2, 0.1, 0.0, 0.0, false, 9), 2, "it was to stand");
        // Whoever passes the last one starts at any.
        let levels: Vec<usize> = (0..40).map(|step| next(&course, 3, 2.1, 3.0, 4.0, false, step)).collect();
        assert!((0..4).all(|level| levels.contains(&level)), "{levels:?}");
    }

    #[test]
    fn levels_are_drawn_where_there_is_no_curriculum_and_at_first() {
        let (moving, drawn) = (course(true), course(false));
        let first: Vec<usize> = (0..40).map(|robot| moving.drawn_level(7, robot, 0)).collect();
        assert!(
            first.contains(&0) && first.contains(&1) && first.iter().all(|level| *level < 2),
            "{first:?}"
        );
        let levels: Vec<usize> = (0..40).map(|step| next(&drawn, 0, 0.0, 0.0, 4.0, true, step)).collect();
        assert!((0..4).all(|level| levels.contains(&level)), "{levels:?}");
    }

    #[test]
    fn a_way_counts_what_was_walked_along_the_command() {
        let mut way = Way { level: 2, ..Way::default() };
        way.advance([0.6, 0.8, 0.3], [0.6, 0.8, 5.0], 0.5);
        way.advance([0.0, 0.0, 1.0], [1.0, 1.0, 0.0], 0.5);
        way.advance([1.0, 0.0, 0.0], [-0.2, 1.0, 0.0], 0.5);
        assert!((way.walked - 0.4).abs() < 1e-6 && (way.commanded - 1.0).abs() < 1e-6, "{way:?}");
        assert_eq!(Way::from_numbers(&way.numbers(), 3), Some(way));
        assert_eq!(Way::from_numbers(&way.numbers(), 2), None);
        for wrong in [[-1.0, 0.0, 0.0], [0.5, 0.0, 0.0], [f32::NAN, 0.0, 0.0], [0.0, f32::NAN, 0.0]] {
            assert_eq!(Way::from_numbers(&wrong, 2), None);
        }
    }
}
