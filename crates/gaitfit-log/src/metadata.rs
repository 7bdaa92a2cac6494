//! What a log says about itself besides samples: robot, rate, gains. From header comments, sidecar TOML
//! files and the caller's options.

use crate::{FindingKind, ImuSettings, LogError};
use gaitfit_model::{escaped, patterns, shown, shown_number, shown_path};
use indexmap::IndexMap;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// One number for every joint.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum PerJoint {
    /// One value for all joints.
    All(f64),
    /// One a joint, in the order of the file's `q_` columns.
    List(Vec<f64>),
    /// By joint name or pattern, for example `{ "*_hip" = 20, "*_calf" = 40 }`, as [`gaitfit_model::patterns`]
    /// says; every joint must match an entry.
    Named(IndexMap<String, f64>),
}

impl PerJoint {
    /// All values that it states: one, one a joint, or one an entry.
    pub fn values(&self) -> Vec<f64> {
        match self {
            PerJoint::All(value) => vec![*value],
            PerJoint::List(values) => values.clone(),
            PerJoint::Named(values) => values.values().copied().collect(),
        }
    }

    /// One value for each of `joints`; `what` names the quantity in the error, which says what does not fit.
    ///
    /// # Errors
    /// A list of another length, a joint that no entry matches, a value that is negative or not finite.
    pub fn resolve(&self, what: &str, joints: &[String]) -> Result<Vec<f64>, String> {
        let values = match self {
            PerJoint::All(value) => vec![*value; joints.len()],
            PerJoint::List(values) if values.len() == joints.len() => values.clone(),
            PerJoint::List(values) => {
                return Err(format!(
                    "{what} has {} entries for {} joints; give one a joint in the order of the q_ columns, one \
                     number for all, or a table by joint name",
                    values.len(),
                    joints.len()
                ));
            }
            PerJoint::Named(entries) => resolve_named(what, entries, joints)?,
        };
        // Checked after all forms are resolved, so that the message can name the joint.
        match values.iter().position(|value| !(value.is_finite() && *value >= 0.0)) {
            Some(i) => Err(format!(
                "{what} of {} is {}; gains are finite and not negative",
                shown(&joints[i]),
                shown_number(values[i])
            )),
            None => Ok(values),
        }
    }
}

/// Max number of entries of a table by joint name: each costs some microseconds.
const MAX_ENTRIES: usize = 1000;

fn resolve_named(what: &str, entries: &IndexMap<String, f64>, joints: &[String]) -> Result<Vec<f64>, String> {
    if entries.len() > MAX_ENTRIES {
        return Err(format!(
            "{what} has {} entries; give at most {MAX_ENTRIES}, or a list in the order of the q_ columns",
            entries.len()
        ));
    }
    let wrong = |error: patterns::PatternError| format!("{what}: {error}");
    let values = patterns::table(entries, "the log", joints).map_err(wrong)?;
    if let Some((lost, winner)) = patterns::without_effect(entries, "the log", joints).map_err(wrong)? {
        return Err(format!(
            "{what}: `{}` has no effect, because the later `{}` covers its joints too, and the last entry counts; put the \
             wider pattern first",
            shown(lost),
            shown(winner)
        ));
    }
    let given = |(value, joint): (Option<f64>, &String)| {
        value.ok_or_else(|| format!("{what}: no entry matches joint {}; add one", shown(joint)))
    };
    values.into_iter().zip(joints).map(given).collect()
}

/// Where one statement was found, for messages.
#[derive(Clone, Debug)]
pub(crate) struct Sourced<T> {
    pub value: T,
    pub place: String,
}

/// Statements collected so far; the first writer of a field wins, so sources are added strongest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct Metadata {
    pub robot: Option<Sourced<String>>,
    pub rate_hz: Option<Sourced<f64>>,
    pub kp: Option<Sourced<PerJoint>>,
    pub kd: Option<Sourced<PerJoint>>,
    pub velocity_joints: Option<Sourced<Vec<String>>>,
    pub fell: Option<Sourced<bool>>,
    pub target_lead_s: Option<Sourced<f64>>,
    pub target_lead_spread_s: Option<Sourced<f64>>,
    /// Physics step of the simulator that made the log, s.
    pub simulated_step_s: Option<Sourced<f64>>,
    /// Reading of the inertial unit's columns, key by key.
    pub imu: ImuSettings,
    /// Findings that do not forbid using the log.
    pub allow: Option<Sourced<Vec<FindingKind>>>,
}

/// The keys of header comments and sidecar files.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Statements {
    pub robot: Option<String>,
    pub rate_hz: Option<f64>,
    pub kp: Option<PerJoint>,
    pub kd: Option<PerJoint>,
    pub velocity_joints: Option<Vec<String>>,
    pub fell: Option<bool>,
    pub target_lead_s: Option<f64>,
    pub target_lead_spread_s: Option<f64>,
    pub simulated_step_s: Option<f64>,
    pub imu: Option<ImuSettings>,
    pub allow: Option<Vec<FindingKind>>,
    /// Free remarks of the recorder; not used.
    #[serde(rename = "notes")]
    pub _notes: Option<toml::Table>,
}

/// Max number of characters of what the TOML reader says.
const REASON: usize = 200;

const KEYS: [&str; 15] = [
    "robot",
    "rate_hz",
    "kp",
    "kd",
    "velocity_joints",
    "fell",
    "target_lead_s",
    "target_lead_spread_s",
    "simulated_step_s",
    "allow",
    "imu.order",
    "imu.frame",
    "imu.unit",
    "imu.negated",
    "imu.mounting",
];

impl Metadata {
    /// Takes what `statements` says and nothing stronger has said.
    pub fn add(&mut self, statements: Statements, place: &str) {
        fn fill<T>(slot: &mut Option<Sourced<T>>, value: Option<T>, place: &str) {
            if slot.is_none() {
                *slot = value.map(|value| Sourced { value, place: place.to_owned() });
            }
        }
        fill(&mut self.robot, statements.robot, place);
        fill(&mut self.rate_hz, statements.rate_hz, place);
        fill(&mut self.kp, statements.kp, place);
        fill(&mut self.kd, statements.kd, place);
        fill(&mut self.velocity_joints, statements.velocity_joints, place);
        fill(&mut self.fell, statements.fell, place);
        fill(&mut self.target_lead_s, statements.target_lead_s, place);
        fill(&mut self.target_lead_spread_s, statements.target_lead_spread_s, place);
        fill(&mut self.simulated_step_s, statements.simulated_step_s, place);
        fill(&mut self.allow, statements.allow, place);
        self.imu = self.imu.or(statements.imu.unwrap_or_default());
    }

    /// One header comment, without its `#`. Returns the key of a `key = value` line that means nothing here.
    pub fn add_comment(&mut self, comment: &str, place: &str) -> Result<Option<String>, LogError> {
        let refuse = |problem: String| LogError::Metadata { place: place.to_owned(), problem };
        // Other programs write comments of their own: only lines that look like settings are looked at.
        let Some((key, _)) = comment.split_once('=') else { return Ok(None) };
        let key = key.trim();
        let is_key = !key.is_empty() && key.chars().all(|c| c.is_alphanumeric() || "_-.".contains(c));
        if !is_key {
            return Ok(None);
        }
        // A key that is nearly one of a log's is a mistake; any other is passed on to be reported.
        if !KEYS.contains(&key) {
            let folded: String = key.to_lowercase().chars().filter(|c| c.is_alphanumeric()).collect();
            let meant = match folded.as_str() {
                "robot" | "robotname" => "robot",
                "rate" | "ratehz" | "hz" | "frequency" | "samplerate" => "rate_hz",
                "kp" | "pgain" => "kp",
                "kd" | "dgain" => "kd",
                "fell" | "fall" | "fallen" => "fell",
                "lead" | "leads" | "targetlead" | "targetleads" => "target_lead_s",
                "simulatedstep" | "simulatedsteps" | "simulatorstep" => "simulated_step_s",
                other => match slip(other) {
                    Some(meant) => meant,
                    None => return Ok(Some(key.to_owned())),
                },
            };
            return Err(refuse(format!("`{}` is not a key of log headers; write `{meant} = …`", shown(key))));
        }
        let statements: Statements = toml::from_str(comment).map_err(|error| {
            refuse(format!(
                "`{}` is not TOML for `{key}`: {}; write for example `# robot = \"go2\"`, `# rate_hz = 200`, \
                 `# fell = true`, `# kp = 25` or `# kp = {{ \"*_hip\" = 20, \"*_thigh\" = 20, \"*_calf\" = 40 }}`, one a line",
                shown(comment.trim()),
                escaped(error.message(), REASON)
            ))
        })?;
        // TOML refuses a key twice in one text, but each comment line is a text of its own.
        let repeated = match key {
            "robot" => self.robot.as_ref().map(|said| &said.place),
            "rate_hz" => self.rate_hz.as_ref().map(|said| &said.place),
            "kp" => self.kp.as_ref().map(|said| &said.place),
            "kd" => self.kd.as_ref().map(|said| &said.place),
            "target_lead_s" => self.target_lead_s.as_ref().map(|said| &said.place),
            "target_lead_spread_s" => self.target_lead_spread_s.as_ref().map(|said| &said.place),
            "simulated_step_s" => self.simulated_step_s.as_ref().map(|said| &said.place),
            "velocity_joints" => self.velocity_joints.as_ref().map(|said| &said.place),
            "fell" => self.fell.as_ref().map(|said| &said.place),
            "allow" => self.allow.as_ref().map(|said| &said.place),
            _ => None,
        };
        if let Some(first) = repeated {
            return Err(refuse(format!("`{key}` is stated twice, first at {first}; keep one")));
        }
        self.add(statements, place);
        Ok(None)
    }

    /// Fills what `other`, a weaker source, says and `self` does not.
    pub fn or(self, other: Metadata) -> Metadata {
        Metadata {
            robot: self.robot.or(other.robot),
            rate_hz: self.rate_hz.or(other.rate_hz),
            kp: self.kp.or(other.kp),
            kd: self.kd.or(other.kd),
            velocity_joints: self.velocity_joints.or(other.velocity_joints),
            fell: self.fell.or(other.fell),
            target_lead_s: self.target_lead_s.or(other.target_lead_s),
            target_lead_spread_s: self.target_lead_spread_s.or(other.target_lead_spread_s),
            simulated_step_s: self.simulated_step_s.or(other.simulated_step_s),
            imu: self.imu.or(other.imu),
            allow: self.allow.or(other.allow),
        }
    }
}

/// The key that `folded`, a key in small letters and digits alone, is one slip away from: a letter too many or too few, two
/// swapped, or, in a longer word, another letter.
fn slip(folded: &str) -> Option<&'static str> {
    KEYS.into_iter().find(|key| {
        let key: String = key.chars().filter(|c| c.is_alphanumeric()).collect();
        // Short words are a letter from many others, so a replaced letter in them is no slip.
        let replaced = strsim::hamming(&key, folded).is_ok_and(|letters| letters == 1);
        key.len() > 3 && strsim::damerau_levenshtein(&key, folded) == 1 && (!replaced || key.len() > 5)
    })
}

/// Statements of a log's comments and of the files beside it, for readers of other kinds of text.
#[derive(Clone, Debug, Default)]
pub struct Stated {
    /// The robot's name.
    pub robot: Option<String>,
    /// Samples a second.
    pub rate_hz: Option<f64>,
    /// Position gains, N·m/rad, and where they are stated.
    pub kp: Option<(PerJoint, String)>,
    /// Velocity gains, N·m·s/rad, and where they are stated.
    pub kd: Option<(PerJoint, String)>,
    /// Joints whose targets are velocities.
    pub velocity_joints: Vec<String>,
    /// Physics step of the simulator that made the log, s.
    pub simulated_step: Option<f64>,
}

/// What the comment lines (`# key = value`) before the header of `text`, the file at `path`, and the files `<stem>.toml` and
/// `log.toml` beside it state. The comments win. A `<stem>.toml` that is no such file does not count.
///
/// # Errors
/// A value that is not TOML or not of its key's type; a key that is nearly one of a log's.
pub fn stated(path: &Path, text: &str) -> Result<Stated, LogError> {
    let mut comments = Metadata::default();
    // Editors of Windows put a mark of the encoding before the first line.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    for (number, line) in text.lines().enumerate() {
        match line.strip_prefix('#') {
            // Other programs write comments of their own.
            Some(comment) => {
                comments.add_comment(comment, &format!("{}:{}", shown_path(path), number + 1))?;
            }
            None if line.trim().is_empty() => {}
            None => break,
        }
    }
    // A recording's `<stem>.toml` may be anything, such as the mapping that describes it.
    // Each source is read whole; then the first that states a number wins, in the order below.
    let beside = |sidecar: PathBuf| -> Result<Metadata, LogError> {
        let mut metadata = Metadata::default();
        if sidecar != path && sidecar.is_file() {
            metadata.add(read_sidecar(&sidecar)?, &shown_path(&sidecar));
        }
        Ok(metadata)
    };
    let of_stem = beside(path.with_extension("toml")).unwrap_or_default();
    let metadata = comments.or(of_stem).or(beside(path.with_file_name("log.toml"))?);
    let placed = |stated: Sourced<PerJoint>| (stated.value, stated.place);
    Ok(Stated {
        robot: metadata.robot.map(|said| said.value),
        rate_hz: metadata.rate_hz.map(|said| said.value),
        kp: metadata.kp.map(placed),
        kd: metadata.kd.map(placed),
        velocity_joints: metadata.velocity_joints.map(|said| said.value).unwrap_or_default(),
        simulated_step: metadata.simulated_step_s.map(|said| said.value),
    })
}

/// Where and why a text is not TOML of the right kind.
fn reason(text: &str, error: &toml::de::Error) -> String {
    let line =
        error.span().and_then(|span| text.get(..span.start)).map(|before| before.matches('\n').count() + 1);
    let place = line.map_or(String::new(), |line| format!("line {line}: "));
    format!("{place}{}", escaped(error.message(), REASON))
}

/// Largest sidecar file, bytes: it holds a handful of numbers.
const SIDECAR_LIMIT: u64 = 1 << 20;

/// Reads `<stem>.toml` and then `log.toml` beside `path`, where they exist. Returns the files used.
pub(crate) fn read_sidecars(path: &Path) -> Result<(Metadata, Vec<PathBuf>), LogError> {
    let mut metadata = Metadata::default();
    let mut used = Vec::new();
    for sidecar in [path.with_extension("toml"), path.with_file_name("log.toml")] {
        // A log may itself end in .toml, and `log.csv` has one sidecar under both names.
        if sidecar == path || used.contains(&sidecar) || !sidecar.is_file() {
            continue;
        }
        metadata.add(read_sidecar(&sidecar)?, &shown_path(&sidecar));
        used.push(sidecar);
    }
    Ok((metadata, used))
}

/// The settings in a file beside a log.
fn read_sidecar(sidecar: &Path) -> Result<Statements, LogError> {
    let io = |source| LogError::Io {
        path: sidecar.to_owned(),
        action: "read the log's sidecar file",
        source,
        remedy: "check its permissions, or read without sidecar files",
    };
    let refuse = |problem: String| LogError::Metadata { place: shown_path(sidecar), problem };
    // Asked before reading, so that a wrong file is not loaded into memory.
    if sidecar.metadata().map_err(io)?.len() > SIDECAR_LIMIT {
        return Err(refuse(format!(
            "larger than {SIDECAR_LIMIT} bytes; a log's sidecar holds only gains, rate and robot"
        )));
    }
    let text = std::fs::read_to_string(sidecar).map_err(io)?;
    toml::from_str(&text).map_err(|error| {
        refuse(format!(
            "{}. A log's sidecar has the keys robot, rate_hz, kp, kd, fell, target_lead_s, target_lead_spread_s, \
             simulated_step_s, allow and the tables imu (order, frame, unit, negated, mounting) and notes. If this file is \
             something else, rename it, or read without sidecar files",
            reason(&text, &error)
        ))
    })
}
