//! A walk as MCAP for viewers, written while the robot walks: complete to its last row whatever ends the program.

use std::io::Write;
use std::path::{Path, PathBuf};

use gaitfit_import::{LiveMcap, McapHead, McapRow, McapState};
use gaitfit_policy::Interface;

use super::record::{Acted, Log};
use crate::RobotError;
use crate::state::RobotState;

/// An MCAP log that is open.
pub(super) struct View {
    path: PathBuf,
    log: LiveMcap<Rows>,
}

/// A file that is given whole rows.
struct Rows {
    file: Log,
    row: Vec<u8>,
}

impl Write for Rows {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        // Kept until the row is whole.
        self.row.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        let written = self.file.put(&self.row);
        // A row that could not be written is not tried again.
        self.row.clear();
        written
    }
}

impl Drop for Rows {
    fn drop(&mut self) {
        // The file's end: without it the file is read as well.
        let _ = self.flush();
    }
}

impl View {
    /// A new file.
    pub(super) fn new(path: PathBuf, interface: &Interface, robot: &str) -> Result<Self, RobotError> {
        let rows = Rows { file: Log::new(path.clone(), &[])?, row: Vec::new() };
        let head = McapHead {
            joints: &interface.joints,
            rate_hz: 1.0 / interface.control_dt,
            robot: Some(robot),
            gains: Some((&interface.kp, &interface.kd)),
            fell: false,
        };
        match LiveMcap::live(rows, &head) {
            Ok(log) => Ok(Self { path, log }),
            Err(error) => Err(RobotError::Write { path, problem: error.to_string() }),
        }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// A row; `motors`: for each of the policy's joints, its motor.
    pub(super) fn row(
        &mut self,
        motors: &[usize],
        state: &RobotState,
        age: f64,
        acted: &Acted<'_>,
    ) -> Result<(), RobotError> {
        let of_motors =
            |values: &[f32]| motors.iter().map(|&motor| f64::from(values[motor])).collect::<Vec<_>>();
        let wide = |values: &[f32]| values.iter().copied().map(f64::from).collect::<Vec<_>>();
        // NaN means that the robot does not report it.
        let battery = state
            .battery
            .map_or([f64::NAN; 2], |battery| [f64::from(battery.charge), f64::from(battery.volts)]);
        let temperature: Vec<f64> = motors.iter().map(|&motor| f64::from(state.temperature[motor])).collect();
        let row = McapRow {
            time: acted.time,
            lead: 0.0,
            position: &of_motors(&state.q),
            velocity: &of_motors(&state.dq),
            torque: &of_motors(&state.torque),
            target: Some(&wide(acted.targets)),
            action: Some(&wide(acted.action)),
            command: Some(acted.command.map(f64::from)),
            quaternion: Some(state.quaternion.map(f64::from)),
            angular_velocity: Some(state.gyroscope.map(f64::from)),
            acceleration: Some(state.accelerometer.map(f64::from)),
            state: Some(McapState { temperature: &temperature, battery, age }),
        };
        self.log
            .flushed(&row)
            .map_err(|error| RobotError::Write { path: self.path.clone(), problem: error.to_string() })
    }
}
