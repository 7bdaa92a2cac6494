//! Logs that are complete whenever the program ends: each row is written whole, when it is known.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use gaitfit_log::column_names::{BASE_QUATERNION, BASE_RATES, COMMAND};
use gaitfit_policy::Interface;

use super::view::View;
use crate::RobotError;
use crate::command::Command;
use crate::robot::Robot;
use crate::state::RobotState;
use crate::supervisor::Phase;

/// The name of the log of the walk, which fits read, and of that of everything.
pub const WALK: &str = "walk.csv";
/// See [`WALK`].
pub const WHOLE: &str = "whole.csv";
/// Folder of [`WHOLE`] beside the logs of several walks: a fit reads all logs of their folder.
pub const RUN: &str = "run";

/// Columns of [`WHOLE`] with the command that was sent to each joint: angle, rad; gains; velocity, rad/s.
const SENT: [&str; 4] = ["sent_q_", "sent_kp_", "sent_kd_", "sent_dq_"];

/// Action of the policy in a control period.
#[derive(Clone, Copy, Debug)]
pub struct Acted<'a> {
    /// Time since the walk's beginning, s.
    pub time: f64,
    /// Command: m/s, m/s, rad/s.
    pub command: [f32; 3],
    /// Action, policy order.
    pub action: &'a [f32],
    /// Targets, policy order: rad, or rad/s for wheels that roll.
    pub targets: &'a [f32],
}

/// A log that is open.
pub(super) struct Log {
    path: PathBuf,
    file: File,
    /// Bytes of the rows that were written whole.
    whole: u64,
    rows: u64,
}

/// Logs of a run: each walk as `gaitfit collect` writes it, and every control period of every phase with what was sent.
pub struct Recorder {
    folder: PathBuf,
    /// The robot's name.
    robot: String,
    /// Comments and header of a walk's log.
    head: String,
    /// Digits of the walks' numbers in their files' names; `None`: one walk.
    digits: Option<usize>,
    walk: Option<Log>,
    /// The MCAP file of the same walk.
    view: Option<View>,
    interface: Interface,
    whole: Option<Log>,
    whole_path: PathBuf,
    whole_head: String,
    /// For each of the policy's joints, its motor.
    motors: Vec<usize>,
    line: String,
}

impl Recorder {
    /// For one walk of `robot`: [`WALK`] and [`WHOLE`] in `folder`. No file is made before [`Recorder::open`] or the first row.
    ///
    /// # Errors
    /// A policy for other joints.
    pub fn new(folder: &Path, interface: &Interface, robot: &Robot) -> Result<Self, RobotError> {
        Self::within(folder, None, interface, robot)
    }

    /// For `count` walks: `trajectory_00.csv`, … in `folder`, as `gaitfit collect` names them, and [`WHOLE`] in [`RUN`].
    /// No file is made before [`Recorder::open`] or the first row.
    ///
    /// # Errors
    /// A policy for other joints.
    pub fn of_walks(
        folder: &Path,
        count: usize,
        interface: &Interface,
        robot: &Robot,
    ) -> Result<Self, RobotError> {
        // At least two digits, as `gaitfit collect` has them.
        let digits = count.saturating_sub(1).to_string().len().max(2);
        Self::within(folder, Some(digits), interface, robot)
    }

    fn within(
        folder: &Path,
        digits: Option<usize>,
        interface: &Interface,
        robot: &Robot,
    ) -> Result<Self, RobotError> {
        let per_joint = |prefix: &str| -> String {
            interface.joints.iter().fold(String::new(), |mut text, joint| {
                let _ = write!(text, ",{prefix}{joint}");
                text
            })
        };
        let named = |prefixes: &[&str]| prefixes.iter().map(|prefix| per_joint(prefix)).collect::<String>();
        let mut head = format!("# robot = {:?}\n# rate_hz = {:?}\n", robot.name, 1.0 / interface.control_dt);
        let body = [&BASE_QUATERNION[..], &BASE_RATES].concat().join(",");
        let more = format!("acc_x,acc_y,acc_z{},charge,volts,age_ms", named(&["tau_", "temp_"]));
        // Made before the policy's gains are in the head: other phases have other gains, and the columns `SENT`
        // have them.
        let whole = format!("{head}time{},{body},{more},phase{}\n", named(&["q_", "dq_"]), named(&SENT));
        let _ = writeln!(head, "# kp = {:?}\n# kd = {:?}", interface.kp, interface.kd);
        if !interface.velocity_joints.is_empty() {
            let _ = writeln!(head, "# velocity_joints = {:?}", interface.velocity_joints);
        }
        let head = format!(
            "{head}time{},{},{body},{more}\n",
            named(&["q_", "dq_", "qdes_", "act_"]),
            COMMAND.join(",")
        );
        // The logs of several walks are in one folder. A fit reads all of it, so the record of everything has its own.
        let whole_path = if digits.is_some() { folder.join(RUN).join(WHOLE) } else { folder.join(WHOLE) };
        Ok(Self {
            folder: folder.to_owned(),
            robot: robot.name.clone(),
            head,
            digits,
            walk: None,
            view: None,
            interface: interface.clone(),
            whole: None,
            whole_path,
            whole_head: whole,
            motors: robot.motors_of(&interface.joints)?,
            line: String::new(),
        })
    }

    /// Says in the logs' first line that they are of a dry run, in which nothing was sent.
    #[must_use]
    pub fn dry(mut self) -> Self {
        for head in [&mut self.head, &mut self.whole_head] {
            head.insert_str(0, "# dry run: nothing was sent\n");
        }
        self
    }

    /// Makes the files, so that what cannot be written is known before the robot moves.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn open(&mut self) -> Result<(), RobotError> {
        if self.whole.is_none() {
            self.whole = Some(Log::new(self.whole_path.clone(), self.whole_head.as_bytes())?);
        }
        if self.walk.is_none() && self.digits.is_none() {
            self.create(WALK)?;
        }
        Ok(())
    }

    /// Removes the logs that have no row yet.
    pub fn remove_empty(&mut self) {
        if self.walk.as_ref().is_some_and(|log| log.rows == 0) {
            // Dropping the view writes the file's end. By then the file has no name any more.
            self.view.take().map(|view| std::fs::remove_file(view.path()));
        }
        for slot in [&mut self.walk, &mut self.whole] {
            if let Some(log) = slot.take_if(|log| log.rows == 0) {
                // What stays keeps a later run from its folder, and is seen there.
                let _ = std::fs::remove_file(&log.path);
            }
        }
    }

    /// A walk's log, as CSV and as MCAP.
    fn create(&mut self, name: &str) -> Result<(), RobotError> {
        let path = self.folder.join(name);
        // The end of the walk before.
        self.view = None;
        self.view = Some(View::new(path.with_extension("mcap"), &self.interface, &self.robot)?);
        self.walk = Some(Log::new(path, self.head.as_bytes())?);
        Ok(())
    }

    /// The walk of this number begins.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn begin(&mut self, number: usize) -> Result<(), RobotError> {
        if let Some(digits) = self.digits {
            self.create(&format!("trajectory_{number:0digits$}.csv"))?;
        }
        Ok(())
    }

    /// A row of the walk: the state as the policy saw it `age` after it came (s), and what followed.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn walk(&mut self, state: &RobotState, age: f64, acted: &Acted<'_>) -> Result<(), RobotError> {
        self.open()?;
        self.row(acted.time, state);
        self.numbers(acted.targets.iter());
        self.numbers(acted.action.iter());
        self.numbers(acted.command.iter());
        self.rest(state, age);
        if let Some(walk) = &mut self.walk {
            walk.end(&mut self.line)?;
        }
        match &mut self.view {
            Some(view) => view.row(&self.motors, state, age, acted),
            None => Ok(()),
        }
    }

    /// A row of everything: `now` since the run began, the phase, what was sent last.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn whole(
        &mut self,
        now: f64,
        state: &RobotState,
        age: f64,
        phase: Phase,
        sent: Option<&Command>,
    ) -> Result<(), RobotError> {
        self.open()?;
        self.row(now, state);
        self.rest(state, age);
        let _ = write!(self.line, ",{}", phase.name());
        for part in 0..SENT.len() {
            for &motor in &self.motors {
                // Nothing was sent: an empty cell.
                let _ = match sent.map(|command| &command[motor]) {
                    Some(one) => write!(self.line, ",{:?}", [one.q, one.kp, one.kd, one.dq][part]),
                    None => write!(self.line, ","),
                };
            }
        }
        match &mut self.whole {
            Some(whole) => whole.end(&mut self.line),
            None => Ok(()),
        }
    }

    fn row(&mut self, time: f64, state: &RobotState) {
        self.line.clear();
        // `{:?}` of a number is the shortest text that reads back as the same number.
        let _ = write!(self.line, "{time:?}");
        let motors = std::mem::take(&mut self.motors);
        self.numbers(motors.iter().map(|&motor| &state.q[motor]));
        self.numbers(motors.iter().map(|&motor| &state.dq[motor]));
        self.motors = motors;
    }

    fn rest(&mut self, state: &RobotState, age: f64) {
        // Taken out, because `numbers` borrows all of `self`, and put back below.
        let motors = std::mem::take(&mut self.motors);
        self.numbers(state.quaternion.iter().chain(&state.gyroscope).chain(&state.accelerometer));
        self.numbers(motors.iter().map(|&motor| &state.torque[motor]));
        for &motor in &motors {
            let _ = write!(self.line, ",{}", state.temperature[motor]);
        }
        self.motors = motors;
        let _ = match state.battery {
            Some(battery) => write!(self.line, ",{},{:?}", battery.charge, battery.volts),
            None => write!(self.line, ",,"),
        };
        let _ = write!(self.line, ",{:.3}", 1e3 * age);
    }

    fn numbers<'n>(&mut self, numbers: impl Iterator<Item = &'n f32>) {
        for number in numbers {
            // The log's numbers are the doubles of single precision, as those of simulated logs.
            let _ = write!(self.line, ",{:?}", f64::from(*number));
        }
    }
}

impl Log {
    /// A new file with its first bytes.
    pub(super) fn new(path: PathBuf, head: &[u8]) -> Result<Self, RobotError> {
        let written = || -> std::io::Result<File> {
            if let Some(folder) = path.parent() {
                std::fs::create_dir_all(folder)?;
            }
            // A log that is there already is a walk that nobody can repeat.
            let mut file = File::create_new(&path)?;
            file.write_all(head).inspect_err(|_| drop(std::fs::remove_file(&path)))?;
            Ok(file)
        };
        match written() {
            Ok(file) => Ok(Self { path, file, whole: head.len() as u64, rows: 0 }),
            Err(error) => Err(RobotError::Write { path, problem: error.to_string() }),
        }
    }

    fn end(&mut self, line: &mut String) -> Result<(), RobotError> {
        line.push('\n');
        self.put(line.as_bytes())
            .map_err(|error| RobotError::Write { path: self.path.clone(), problem: error.to_string() })?;
        self.rows += 1;
        Ok(())
    }

    /// One write a row: a killed program leaves no half of one, and what a full disk took of a row is cut off.
    pub(super) fn put(&mut self, row: &[u8]) -> std::io::Result<()> {
        let written = self.file.write_all(row);
        match &written {
            Ok(()) => self.whole += row.len() as u64,
            // The error that is reported is the first one.
            Err(_) => self.cut(),
        }
        written
    }

    /// Cuts off what follows the last whole row. The next row begins there: behind the cut it would follow zero bytes.
    fn cut(&mut self) {
        let _ = self.file.set_len(self.whole);
        let _ = self.file.seek(SeekFrom::Start(self.whole));
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn rows_after_half_a_row_follow_the_last_whole_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("walk.csv");
        let mut log = Log::new(path.clone(), b"time\n").unwrap();
        log.put(b"0.0\n").unwrap();
        // What a full disk takes of a row.
        log.file.write_all(b"0.0").unwrap();
        log.cut();
        log.put(b"0.04\n").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"time\n0.0\n0.04\n");
    }
}
