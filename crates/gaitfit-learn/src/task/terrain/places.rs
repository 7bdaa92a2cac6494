//! Robots of a tile on the cells of generated ground.

use super::{Cell, Way};
use crate::task::{Ended, Environment, Task};

impl Task {
    /// Whether a point of the world (m) is at the edge of generated ground or beyond it.
    pub(in crate::task) fn is_outside(&self, [x, y, _]: [f32; 3]) -> bool {
        self.course.as_ref().is_some_and(|course| course.is_outside([x, y]))
    }
}

impl Environment<'_> {
    /// The cell that environment `index` started on; none without generated ground.
    pub fn cell(&self, index: usize) -> Option<Cell> {
        let course = self.task.course.as_ref()?;
        let way = self.ways.get(index)?;
        Some(Cell { level: way.level, column: course.column(self.first + index as u32) })
    }

    /// Starts environment `index` anew, as at step 0, on level `level` of its column. The motion shows it after
    /// [`Environment::refresh`].
    pub fn put_on_level(&mut self, index: usize, level: usize) {
        if let Some(way) = self.ways.get_mut(index) {
            *way = Way { level, ..Way::default() };
            self.restart(index, 0);
        }
    }

    /// The level of the first episode.
    pub(in crate::task) fn draw_level(&mut self, index: usize, step: u32) {
        let number = self.first + index as u32;
        if let (Some(course), Some(way)) = (&self.task.course, self.ways.get_mut(index)) {
            *way = Way { level: course.drawn_level(self.seed, number, step), ..Way::default() };
        }
    }

    /// The level of the episode that begins at `step`, after one that ended so.
    pub(in crate::task) fn move_on(&mut self, index: usize, step: u32, ended: Ended) {
        let number = self.first + index as u32;
        if let (Some(course), Some(way)) = (&self.task.course, self.ways.get_mut(index)) {
            let place = &self.motion.base_position[3 * index..];
            // A simulation that came apart counts as a fall. Its place may be NaN, which no comparison takes
            // for far.
            let fell = ended != Ended::TimeOut;
            let level = course.next_level(way, [place[0], place[1]], fell, self.seed, number, step);
            *way = Way { level, ..Way::default() };
        }
    }

    /// Place at which an episode of environment `index` starts that begins at `step`: x and y, m.
    pub(in crate::task) fn start_place(&self, index: usize, step: u32) -> [f64; 2] {
        match (&self.task.course, self.cell(index)) {
            (Some(course), Some(cell)) => course.place(cell, self.seed, self.first + index as u32, step),
            _ => [0.0; 2],
        }
    }

    /// The saved ways of some environments; `None` if one cannot be.
    pub(in crate::task) fn saved_ways(&self, numbers: &[f32]) -> Option<Vec<Way>> {
        let levels = self.task.course.as_ref().map_or(0, |course| course.settings().levels);
        numbers.as_chunks::<3>().0.iter().map(|numbers| Way::from_numbers(numbers, levels)).collect()
    }
}
