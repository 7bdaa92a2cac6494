//! The last action of each environment.

/// The last actions of some environments, policy order, before scaling and clipping: what a policy observes as
/// [`crate::Quantity::LastAction`] and what the change of an action is measured against. Zero before an episode's
/// first action.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LastAction {
    joints: usize,
    /// `environments × joints`.
    rows: Vec<f32>,
}

impl LastAction {
    /// Zero for `environments` robots of `joints` joints.
    pub fn new(environments: usize, joints: usize) -> Self {
        Self { joints, rows: vec![0.0; environments * joints] }
    }

    /// The last action of environment `index`; `joints` numbers.
    ///
    /// # Panics
    /// If there is no such environment.
    pub fn row(&self, index: usize) -> &[f32] {
        &self.rows[index * self.joints..(index + 1) * self.joints]
    }

    /// Zero for environment `index`: its episode begins.
    ///
    /// # Panics
    /// If there is no such environment.
    pub fn begin(&mut self, index: usize) {
        self.rows[index * self.joints..(index + 1) * self.joints].fill(0.0);
    }

    /// Sets that of environment `index`, for a robot put into the middle of a log.
    ///
    /// # Panics
    /// If there is no such environment, or `action` is not `joints` numbers.
    pub fn set(&mut self, index: usize, action: &[f32]) {
        self.rows[index * self.joints..(index + 1) * self.joints].copy_from_slice(action);
    }

    /// Takes up the actions of all environments, `environments × joints`, once the robots have moved under them.
    ///
    /// # Panics
    /// If `actions` has another size.
    pub fn take(&mut self, actions: &[f32]) {
        self.rows.copy_from_slice(actions);
    }

    /// All rows, `environments × joints`, for a checkpoint.
    pub fn rows(&self) -> &[f32] {
        &self.rows
    }
}
