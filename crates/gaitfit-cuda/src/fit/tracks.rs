//! Signals that come back from a GPU.

use gaitfit_policy::follow::Track;

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
    /// The signals of a log of a robot whose policy moves so many joints, as the CPU keeps them.
    pub fn log(&self, joints: usize) -> Track {
        let mut track = Track { fell_at: self.fell_at, ..Track::default() };
        for row in self.rows.chunks_exact(self.dimensions.max(1)) {
            let mut rest = row;
            // The order of `Tables::dimensions`.
            for (signal, width) in [
                (&mut track.position, joints),
                (&mut track.velocity, joints),
                (&mut track.action, joints),
                (&mut track.base_position, 3),
                (&mut track.base_velocity, 3),
                (&mut track.base_quaternion, 4),
                (&mut track.base_rates, 3),
            ] {
                let (values, others) = rest.split_at(width);
                signal.extend_from_slice(values);
                rest = others;
            }
        }
        track
    }

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
