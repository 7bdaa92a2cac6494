//! Signals that come back from a GPU.

/// Signals of a candidate on a recording.
#[derive(Clone, Copy, Debug)]
pub struct Tracks<'a> {
    /// `samples × dimensions`, in the order of [`Tables::dimensions`](super::Tables::dimensions).
    pub rows: &'a [f32],
    /// Numbers of a row.
    pub dimensions: usize,
    /// The sample of the fall.
    pub fell_at: Option<usize>,
}

impl Tracks<'_> {
    /// Splits the signals of a prediction into joint positions, rad, and joint velocities, rad/s: `samples × joints` each.
    pub fn joints(&self) -> (Vec<f32>, Vec<f32>) {
        let [mut position, mut velocity] = [(); 2].map(|()| Vec::with_capacity(self.rows.len() / 2));
        for row in self.rows.chunks_exact(self.dimensions.max(1)) {
            let (positions, velocities) = row.split_at(self.dimensions / 2);
            position.extend_from_slice(positions);
            velocity.extend_from_slice(velocities);
        }
        (position, velocity)
    }
}
