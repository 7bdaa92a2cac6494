//! Meaning of each column of a header: the table in the crate's documentation, as code.

use crate::column_names::{
    BASE_POSITION, BASE_QUATERNION, BASE_RATES, BASE_VELOCITY, COMMAND, MOTION, ROLL_PITCH_YAW,
};
use crate::{IgnoredColumn, LogError, TimeUnit};
use gaitfit_model::shown;
use std::collections::{HashMap, HashSet};
use std::path::Path;

const COMMAND_ALIAS: [&str; 3] = ["cmd_vx", "cmd_vy", "cmd_wz"];
/// Names of a gravity vector in the base's frame, without `_x` or `_0`.
const GRAVITY: [&str; 9] = [
    "projected_gravity",
    "proj_gravity",
    "gravity",
    "gravity_ori",
    "gravity_vec",
    "gravity_vector",
    "gravity_body",
    "base_gravity",
    "gravity_b",
];

/// The axis (0 to 2) of a gravity vector in the base's frame that a column called `name` holds, as other programs name them.
pub fn gravity_axis(name: &str) -> Option<usize> {
    let endings = [["_x", "_0", "[0]"], ["_y", "_1", "[1]"], ["_z", "_2", "[2]"]];
    endings.iter().position(|axis| {
        axis.iter().any(|end| name.strip_suffix(end).is_some_and(|stem| GRAVITY.contains(&stem)))
    })
}

/// Column numbers (from 0) of everything the reader takes.
#[derive(Debug)]
pub(crate) struct Layout {
    pub names: Vec<String>,
    pub time: usize,
    /// The time column's unit, where its name says it.
    pub time_unit: Option<TimeUnit>,
    pub joints: Vec<String>,
    pub position: Vec<usize>,
    pub velocity: Vec<usize>,
    pub target: Option<Vec<usize>>,
    pub action: Option<Vec<usize>>,
    pub command: Option<Vec<usize>>,
    pub motion: Option<Vec<usize>>,
    pub base_position: Option<Vec<usize>>,
    pub base_quaternion: Option<Vec<usize>>,
    pub roll_pitch_yaw: Option<Vec<usize>>,
    pub base_velocity: Option<Vec<usize>>,
    pub base_rates: Option<Vec<usize>>,
    /// Gravity in the base's frame; taken where there is no other orientation.
    pub gravity: Option<Vec<usize>>,
    /// Gains of each joint and sample.
    pub kp: Option<Vec<usize>>,
    pub kd: Option<Vec<usize>>,
    /// Desired velocities and feed-forward torques.
    pub target_velocity: Option<Vec<usize>>,
    pub feed_forward: Option<Vec<usize>>,
    pub ignored: Vec<IgnoredColumn>,
}

/// The remedy for files of other programs.
const IMPORT: &str = "Or import the file: `gaitfit import FILE --mapping MAP.toml --out LOG.csv`, where the mapping names \
                      columns and units (`gaitfit new` takes --mapping too)";

/// The beginning of the reason for which a column of a joint without positions is ignored.
pub(crate) const NO_POSITION: &str = "there is no `q_";

/// A header while its columns are sorted.
struct Header<'a> {
    path: &'a Path,
    line: u64,
    names: &'a [String],
    /// Column of each quantity.
    index: HashMap<&'a str, usize>,
    joints: &'a [String],
    /// The same, to look them up.
    known: HashSet<&'a str>,
    /// Columns that have their place.
    used: Vec<bool>,
    /// Columns that belong to something that is not there, with the reason.
    orphans: Vec<(usize, String)>,
}

/// Column of each quantity.
fn index<'a>(path: &Path, line: u64, names: &'a [String]) -> Result<HashMap<&'a str, usize>, LogError> {
    let mut index: HashMap<&str, usize> = HashMap::with_capacity(names.len());
    for (column, name) in names.iter().enumerate() {
        // Both names are one quantity, so a header with both repeats it.
        let quantity = match COMMAND_ALIAS.iter().position(|alias| alias == name) {
            Some(i) => COMMAND[i],
            None => name.as_str(),
        };
        if let Some(first) = index.insert(quantity, column) {
            return Err(LogError::DuplicateColumn {
                path: path.to_owned(),
                line,
                column: column + 1,
                first: first + 1,
                name: name.clone(),
            });
        }
    }
    Ok(index)
}

/// A column that a log needs.
fn missing(path: &Path, line: u64, name: &str, remedy: String) -> LogError {
    LogError::MissingColumn { path: path.to_owned(), line, name: name.to_owned(), remedy }
}

impl Header<'_> {
    fn take(&mut self, columns: &[usize]) {
        columns.iter().for_each(|&column| self.used[column] = true);
    }

    /// A column `prefix` of every joint; `None` if there is none and they are not needed.
    fn per_joint(&mut self, prefix: &str, needed: bool) -> Result<Option<Vec<usize>>, LogError> {
        let column_of = |joint: &String| self.index.get(format!("{prefix}{joint}").as_str()).copied();
        let columns: Vec<Option<usize>> = self.joints.iter().map(column_of).collect();
        // A column of an unknown joint is likely a typing error, so it is named with the reason.
        for (column, name) in self.names.iter().enumerate() {
            if let Some(joint) = name.strip_prefix(prefix)
                && !joint.is_empty()
                && !self.known.contains(joint)
            {
                self.orphans.push((column, format!("{NO_POSITION}{joint}`")));
            }
        }
        // A signal may be missing for all joints, but not for some.
        if !needed && columns.iter().all(Option::is_none) {
            return Ok(None);
        }
        let present = columns.iter().flatten().count();
        if let Some(lacking) = columns.iter().position(Option::is_none) {
            let joint = &self.joints[lacking];
            let remedy = if needed {
                format!(
                    "`q_{}` needs its velocity; log the encoder's velocity, rad/s, under that name",
                    shown(joint)
                )
            } else {
                format!(
                    "{present} of {} joints have a `{prefix}` column; log all of them or none",
                    self.joints.len()
                )
            };
            return Err(missing(self.path, self.line, &format!("{prefix}{joint}"), remedy));
        }
        let columns: Vec<usize> = columns.into_iter().flatten().collect();
        self.take(&columns);
        Ok(Some(columns))
    }

    /// The columns `wanted`, which belong together.
    fn group(&mut self, wanted: &[&str]) -> Option<Vec<usize>> {
        let columns: Vec<usize> = wanted.iter().filter_map(|name| self.index.get(name).copied()).collect();
        if columns.len() == wanted.len() {
            self.take(&columns);
            return Some(columns);
        }
        for &column in &columns {
            self.orphans.push((column, format!("incomplete: {} belong together", wanted.join(", "))));
        }
        None
    }

    /// The direction of gravity, whose columns have several names.
    fn gravity(&mut self) -> Option<Vec<usize>> {
        let names = self.names;
        let name_of_axis =
            |axis: usize| names.iter().find(|name| gravity_axis(name) == Some(axis)).map(String::as_str);
        let names: Option<Vec<&str>> = (0..3).map(name_of_axis).collect();
        self.group(&names?)
    }

    /// Gives up columns that say what others say.
    fn drop_repeated(&mut self, columns: &mut Option<Vec<usize>>, why: &str) {
        let repeated = columns.take().into_iter().flatten();
        self.orphans.extend(repeated.map(|column| (column, why.to_owned())));
    }

    /// Every column without a place, in the order of columns.
    fn ignored(mut self) -> Vec<IgnoredColumn> {
        let mut ignored = self.orphans;
        ignored.iter().for_each(|(column, _)| self.used[*column] = true);
        let unknown = (0..self.used.len()).filter(|&column| !self.used[column]);
        ignored.extend(unknown.map(|column| (column, "unknown name".to_owned())));
        ignored.sort();
        let column = |(column, reason): (usize, String)| IgnoredColumn {
            column: column + 1,
            name: self.names[column].clone(),
            reason,
        };
        ignored.into_iter().map(column).collect()
    }
}

/// Sorts out a header. `path` and `line` are for messages.
pub(crate) fn layout(path: &Path, line: u64, names: Vec<String>) -> Result<Layout, LogError> {
    let index = index(path, line, &names)?;
    let named = || TimeUnit::ALL.into_iter().find_map(|unit| Some((*index.get(unit.column())?, Some(unit))));
    let (time, time_unit) = index
        .get("time")
        .map(|&column| (column, None))
        .or_else(named)
        .ok_or_else(|| missing(path, line, "time", time_remedy(&names)))?;
    // Positions name the joints, and their columns give the order.
    let (position, joints): (Vec<usize>, Vec<String>) = names
        .iter()
        .enumerate()
        .filter_map(|(column, name)| Some((column, name.strip_prefix("q_")?.to_owned())))
        .filter(|(_, joint)| !joint.is_empty())
        .unzip();
    if joints.is_empty() {
        return Err(missing(path, line, "q_<joint>", position_remedy(&names)));
    }
    let orphans = TimeUnit::ALL
        // Two columns of time: the one that is taken is stated, the others are told.
        .into_iter()
        .filter_map(|unit| index.get(unit.column()).copied())
        .filter(|&column| column != time)
        .map(|column| (column, format!("`{}` says it already", names[time])))
        .collect();
    let used = vec![false; names.len()];
    let known = joints.iter().map(String::as_str).collect();
    let mut header = Header { path, line, names: &names, index, joints: &joints, known, used, orphans };
    header.take(&[time]);
    // Taken columns are marked, so that what is left at the end can be reported as ignored.
    header.take(&position);

    // Velocities are needed; what follows may be missing.
    let velocity = header.per_joint("dq_", true)?.unwrap_or_default();
    let target = header.per_joint("qdes_", false)?;
    let action = header.per_joint("act_", false)?;
    let (kp, kd) = (header.per_joint("kp_", false)?, header.per_joint("kd_", false)?);
    let target_velocity = header.per_joint("dqdes_", false)?;
    let feed_forward = header.per_joint("tauff_", false)?;

    let command = header.group(&COMMAND);
    let motion = header.group(&MOTION);
    // Half of the place in a motion cannot be used and must not be ignored in silence.
    if motion.is_none()
        && let Some(lacking) = MOTION.iter().find(|name| !names.iter().any(|own| own == *name))
        && MOTION.iter().any(|name| header.index.contains_key(name))
    {
        let remedy = "a log that states its place in the motion has both `motion_time` and `motion_heading`; write 0 as the \
                      heading if the motion has no orientations"
            .to_owned();
        return Err(missing(path, line, lacking, remedy));
    }
    let base_position = header.group(&BASE_POSITION);
    let base_quaternion = header.group(&BASE_QUATERNION);
    let mut roll_pitch_yaw = header.group(&ROLL_PITCH_YAW);
    let base_velocity = header.group(&BASE_VELOCITY);
    let base_rates = header.group(&BASE_RATES);
    let mut gravity = header.gravity();
    if base_quaternion.is_some() || roll_pitch_yaw.is_some() {
        // An orientation has the heading too, which gravity does not show.
        header.drop_repeated(&mut gravity, "the orientation has it already");
    }
    if base_quaternion.is_some() {
        header.drop_repeated(&mut roll_pitch_yaw, "base_quat_ says it already");
    }
    let ignored = header.ignored();
    Ok(Layout {
        time,
        time_unit,
        joints,
        position,
        velocity,
        target,
        action,
        command,
        motion,
        base_position,
        base_quaternion,
        roll_pitch_yaw,
        base_velocity,
        base_rates,
        gravity,
        kp,
        kd,
        target_velocity,
        feed_forward,
        ignored,
        names,
    })
}

fn time_remedy(names: &[String]) -> String {
    if names.first().is_some_and(|name| name.starts_with('<')) {
        return "the file is XML, such as a robot's; name a log".into();
    }
    if let [only] = names
        && (only.contains(';') || only.contains('\t'))
    {
        return "the header has one column; cells are separated by commas here: `gaitfit import FILE --mapping MAP.toml \
                --out log.csv` makes a log of it"
            .into();
    }
    if names.iter().all(|name| name.parse::<f64>().is_ok()) {
        return "the first line holds numbers; put the header line before it, without a leading `#`".into();
    }
    let similar = names.iter().find(|name| {
        let name = name.to_lowercase();
        ["t", "stamp", "secs"].contains(&name.as_str()) || name.contains("time") || name.contains("sec")
    });
    match similar {
        Some(name) => format!(
            "if `{}` is the sample time, rename it to `time` (seconds), `time_ms`, `time_us` or `time_ns`. {IMPORT}",
            shown(name)
        ),
        None => format!("add the sample time in seconds. {IMPORT}"),
    }
}

fn position_remedy(names: &[String]) -> String {
    if names.iter().any(|name| name.starts_with("qdes_")) {
        return "the file has targets only, such as chirp.csv of `gaitfit excite`; name the log that the robot \
                recorded while it followed them (play.py writes log.csv)"
            .into();
    }
    format!(
        "joint positions are columns such as `q_FL_hip` and velocities `dq_FL_hip`; rename the file's columns. {IMPORT}"
    )
}
