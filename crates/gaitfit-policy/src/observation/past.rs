//! The rows that come before the next ones.

use super::Layout;

/// The last rows of some environments, whose frames move up when [`Layout::write`] writes the next. It keeps nothing for
/// layouts without past frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Past {
    /// Numbers of a row; 0 where nothing is kept.
    width: usize,
    /// `environments × width`.
    rows: Vec<f32>,
    /// Whether an environment has a row: its episode did not just begin.
    begun: Vec<bool>,
}

impl Past {
    /// Past rows of `environments` robots whose episodes begin.
    pub fn new(layout: &Layout, environments: usize) -> Self {
        // A single frame is the present one, for which no row is kept.
        let width = if layout.frames() > 1 { layout.width() } else { 0 };
        let kept = if width > 0 { environments } else { 0 };
        Self { width, rows: vec![0.0; kept * width], begun: vec![false; kept] }
    }

    /// Whether rows are kept at all.
    pub fn is_kept(&self) -> bool {
        self.width > 0
    }

    /// The last row of environment `index`; `None` at its episode's start.
    pub fn row(&self, index: usize) -> Option<&[f32]> {
        let begun = self.begun.get(index).is_some_and(|&begun| begun);
        begun.then(|| &self.rows[index * self.width..(index + 1) * self.width])
    }

    /// The episode of environment `index` begins.
    pub fn begin(&mut self, index: usize) {
        if let Some(begun) = self.begun.get_mut(index) {
            *begun = false;
        }
    }

    /// Takes up a row of environment `index`, [`Layout::width`] numbers.
    ///
    /// # Panics
    /// If the row has another size: an error of the caller.
    pub fn set(&mut self, index: usize, row: &[f32]) {
        if let Some(begun) = self.begun.get_mut(index) {
            *begun = true;
            self.rows[index * self.width..(index + 1) * self.width].copy_from_slice(row);
        }
    }

    /// Takes up the rows of all environments, once the policy has acted on them.
    ///
    /// # Panics
    /// If `rows` has another size: an error of the caller.
    pub fn take(&mut self, rows: &[f32]) {
        if self.is_kept() {
            self.rows.copy_from_slice(rows);
            self.begun.fill(true);
        }
    }

    /// Everything, for a checkpoint: all rows, then 1 for every environment that has one and 0 for others.
    pub fn numbers(&self) -> impl Iterator<Item = f32> {
        self.rows.iter().copied().chain(self.begun.iter().map(|&begun| f32::from(u8::from(begun))))
    }

    /// Count of [`Past::numbers`].
    pub fn size(&self) -> usize {
        self.rows.len() + self.begun.len()
    }

    /// Takes up [`Past::numbers`] of as many environments.
    ///
    /// # Panics
    /// If they are not [`Past::size`] many: an error of the caller.
    pub fn restore(&mut self, numbers: &[f32]) {
        let (rows, begun) = numbers.split_at(self.rows.len());
        self.rows.copy_from_slice(rows);
        assert_eq!(begun.len(), self.begun.len(), "rows of another number of environments");
        for (begun, &saved) in self.begun.iter_mut().zip(begun) {
            *begun = saved != 0.0;
        }
    }
}
