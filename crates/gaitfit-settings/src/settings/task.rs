//! Tasks in configurations: a built-in one and what differs from it, and what of a built-in one is the Go2's alone.

use super::load::{MAX_BYTES, merge, taken, too_large};
use super::messages::{line_and_column, located};
use crate::Error;
use crate::files::read_text;
use crate::robot;
use gaitfit_learn::task::{TaskSettings, preset};
use gaitfit_model::{Model, shown};
use serde::{Deserialize, Serialize, Serializer};
use std::borrow::Cow;
use std::path::Path;
use toml::de::{DeTable, DeValue, Deserializer};
use toml::{Spanned, Table};

/// A task: a built-in one, and what differs from it. In the file both are in the table `[task]`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// The built-in task that it starts from.
    pub base: TaskName,
    /// All its settings, on the Go2.
    pub settings: TaskSettings,
    /// All its settings on another robot: nothing is taken from the built-in task that is the Go2's. `None` where the file
    /// leaves such a setting out.
    #[serde(default)]
    other: Option<TaskSettings>,
    /// Settings that another robot than the Go2 needs and the file leaves out.
    #[serde(default)]
    missing: Vec<String>,
}

impl PartialEq for Task {
    /// Compares the settings of the file, whichever robot it is for.
    fn eq(&self, other: &Self) -> bool {
        self.base == other.base && self.settings == other.settings
    }
}

/// A built-in task.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TaskName {
    /// Velocity tracking on flat ground at a trot.
    #[default]
    Velocity,
    /// Walking on the hind legs.
    Biped,
}

impl TaskName {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Velocity => "velocity",
            Self::Biped => "biped",
        }
    }
}

/// Settings of the built-in tasks that are the Go2's: another robot needs its own.
const ROBOT_KEYS: [&str; 10] = [
    "feet",
    "gait",
    "height",
    "swing_height",
    "policy.default_pose",
    "policy.action_scale",
    "policy.kp",
    "policy.kd",
    "fall.contacts",
    "fall.height",
];

impl Task {
    /// The settings on another robot than the Go2.
    ///
    /// # Errors
    /// That the file leaves some out, in words.
    pub fn own_settings(self) -> Result<TaskSettings, String> {
        self.other.ok_or_else(|| format!("it lacks {}", self.missing.join(", ")))
    }

    /// The settings for `model`, which are then those of the task.
    ///
    /// # Errors
    /// Another robot than the Go2 without settings of its own, in words. `file`: the robot's file, for the advice.
    pub fn settle(&mut self, model: &Model, file: Option<&str>) -> Result<(), String> {
        if robot::is_go2(model) {
            return Ok(());
        }
        match self.other.take() {
            // From here on the task has nothing of the Go2's.
            Some(settings) => self.settings = settings,
            None => {
                // A task that no file completed, such as the default, lacks all of them.
                let all = || ROBOT_KEYS.iter().map(|&key| key.to_owned()).collect();
                let missing = if self.missing.is_empty() { all() } else { std::mem::take(&mut self.missing) };
                return Err(not_the_go2(self.base.name(), model, file, &missing));
            }
        }
        Ok(())
    }
}

/// States which settings a robot needs of its own.
fn not_the_go2(base: &str, model: &Model, file: Option<&str>, missing: &[String]) -> String {
    let keys: Vec<String> = missing.iter().map(|key| format!("task.{key}")).collect();
    let file = file.map_or_else(|| "ROBOT".to_owned(), shown);
    format!(
        "the robot is `{}`, and the built-in task `{base}` has the Go2's {}; give the robot's own. `gaitfit init {file}` \
         writes a configuration that has them",
        shown(&model.name),
        keys.join(", ")
    )
}

/// Turns `[task]` of a configuration into the fields of [`Task`]: the base's settings with those of the file upon them.
pub(super) fn complete(table: &mut DeTable<'_>) {
    let Some(task) = table.get_mut("task") else { return };
    let span = task.span();
    let mut given = match task.get_mut() {
        DeValue::Table(given) => std::mem::take(given),
        // `task = "biped"` is short for its base alone.
        DeValue::String(_) => {
            let base = taken(task.get_mut());
            DeTable::from_iter([(key("base", &span), Spanned::new(span.clone(), base))])
        }
        _ => return,
    };
    // The name of the built-in task is no setting of a task, so it must not be laid upon the settings.
    let base = given.remove("base");
    let name = base.as_ref().and_then(|base| base.get_ref().as_str()).unwrap_or_default();
    // An unknown name is refused when the table is read, with its place.
    let text = preset(name).or_else(|| preset(TaskName::default().name())).unwrap_or_default();
    let parsed = || DeTable::parse(text).map(Spanned::into_inner).unwrap_or_default();
    // The robot is not known yet, so both readings are prepared: on the Go2, and on another robot.
    let missing: Vec<&str> = missing(&given);
    let mut fields = DeTable::new();
    if missing.is_empty() {
        let mut other = without_robot(parsed());
        merge(&mut other, given.clone());
        fields.insert(key("other", &span), Spanned::new(span.clone(), DeValue::Table(other)));
    } else {
        let names = missing.into_iter().map(|name| {
            let text = DeValue::String(Cow::Borrowed(name));
            Spanned::new(span.clone(), text)
        });
        let names = DeValue::Array(names.collect());
        fields.insert(key("missing", &span), Spanned::new(span.clone(), names));
    }
    let mut settings = parsed();
    merge(&mut settings, given);
    let base = base.unwrap_or_else(|| {
        Spanned::new(span.clone(), DeValue::String(Cow::Borrowed(TaskName::default().name())))
    });
    fields.insert(key("base", &span), base);
    fields.insert(key("settings", &span), Spanned::new(span.clone(), DeValue::Table(settings)));
    *task.get_mut() = DeValue::Table(fields);
}

fn key(name: &'static str, span: &std::ops::Range<usize>) -> Spanned<Cow<'static, str>> {
    Spanned::new(span.clone(), Cow::Borrowed(name))
}

/// Returns the settings of [`ROBOT_KEYS`] that are not in `own`.
fn missing(own: &DeTable<'_>) -> Vec<&'static str> {
    let given = |path: &str| match path.split_once('.') {
        None => own.contains_key(path),
        Some((table, key)) => match own.get(table).map(Spanned::get_ref) {
            Some(DeValue::Table(inner)) => inner.contains_key(key),
            // Something else is refused when the table is read.
            Some(_) => true,
            None => false,
        },
    };
    ROBOT_KEYS.into_iter().filter(|path| !given(path)).collect()
}

/// A built-in task without what is the Go2's.
fn without_robot(mut table: DeTable<'_>) -> DeTable<'_> {
    for path in ROBOT_KEYS {
        match path.split_once('.') {
            None => {
                table.remove(path);
            }
            Some((inner, key)) => {
                if let Some(DeValue::Table(inner)) = table.get_mut(inner).map(Spanned::get_mut) {
                    inner.remove(key);
                }
            }
        }
    }
    table
}

impl Serialize for Task {
    /// As the file has it: the settings beside their base.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut table = Table::new();
        table.insert("base".to_owned(), self.base.name().into());
        let settings = Table::try_from(&self.settings).map_err(serde::ser::Error::custom)?;
        table.extend(settings);
        table.serialize(serializer)
    }
}

/// Reads the settings of a file and lays them upon those of the text `under`, key by key: the file need not have all.
/// A file that has all of them is taken as it is; one that names a `base` lies upon that built-in task instead. In a
/// configuration of a training it is the table `[task]` that counts. `model`: the robot; one that is not the Go2 takes
/// nothing of the Go2's.
///
/// # Errors
/// A file that cannot be read, or settings that there are not, with file, line and column.
pub fn load_task(path: &Path, under: &str, model: &Model) -> Result<TaskSettings, Error> {
    if !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
        return Err(Error::settings(format!(
            "{}: a task is a .toml file, or the name of a built-in one, velocity or biped",
            path.display()
        )));
    }
    let text = read_text(path, MAX_BYTES)
        .map_err(|error| Error::settings(format!("cannot read {}: {error}", path.display())))?;
    let located = |error| located(path, &text, &error);
    let whole = |table| TaskSettings::deserialize(Deserializer::from(Spanned::new(0..0, table)));
    let mut given = DeTable::parse(&text).map_err(located)?.into_inner();
    if let Some((wrong, place)) = too_large("", &given) {
        return Err(Error::settings(format!("{}{}: {wrong}", path.display(), line_and_column(&text, place))));
    }
    // A configuration of a training has the task in a table.
    if let Some(DeValue::Table(task)) = given.get_mut("task").map(Spanned::get_mut) {
        given = std::mem::take(task);
    }
    let base = given.remove("base");
    let under = match base.as_ref().map(|base| (base.span(), base.get_ref().as_str())) {
        // A file with all settings needs nothing below it.
        // A clone, because the reading takes the table, which is needed again if settings are missing.
        None => match whole(given.clone()) {
            Ok(settings) => return Ok(settings),
            Err(_) => DeTable::parse(under),
        },
        Some((span, name)) => {
            let Some(built_in) = name.and_then(preset) else {
                return Err(Error::settings(format!(
                    "{}{}: `base` must be the name of a built-in task, \"velocity\" or \"biped\"",
                    path.display(),
                    line_and_column(&text, span.start)
                )));
            };
            let missing = missing(&given);
            // Pose, gains and contacts of a built-in task are the Go2's own.
            if robot::is_go2(model) {
                DeTable::parse(built_in)
            } else if missing.is_empty() {
                DeTable::parse(built_in).map(|table| {
                    let span = table.span();
                    Spanned::new(span, without_robot(table.into_inner()))
                })
            } else {
                let missing: Vec<String> = missing.into_iter().map(str::to_owned).collect();
                let wrong = not_the_go2(name.unwrap_or_default(), model, None, &missing);
                return Err(Error::settings(format!("{}: {wrong}", path.display())));
            }
        }
    };
    let mut table = under.map(Spanned::into_inner).unwrap_or_default();
    merge(&mut table, given);
    whole(table).map_err(located)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::settings::{TrainConfig, load};
    use std::io::Write;

    fn train(text: &str) -> Result<TrainConfig, Error> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        load(Some(file.path()), &[])
    }

    fn go2() -> Model {
        gaitfit_model::builtin::go2().unwrap()
    }

    /// The Go2's joints under another name.
    fn a1() -> Model {
        Model { name: "a1".to_owned(), ..go2() }
    }

    #[test]
    fn a_task_begins_with_its_base_and_changes_it_key_by_key() {
        let none: TrainConfig = load(None, &[]).unwrap();
        let config = train("[task.rewards]\ngait = 2.5\n[task.command]\nx = [0.0, 0.5]\n").unwrap();
        assert_eq!(config.task.settings.rewards["gait"], 2.5);
        assert_eq!(config.task.settings.command.x, [0.0, 0.5]);
        assert_eq!(config.task.settings.command.y, none.task.settings.command.y);
        let weight = "track_yaw_rate";
        assert_eq!(config.task.settings.rewards[weight], none.task.settings.rewards[weight]);
        let biped = train("[task]\nbase = \"biped\"\nheight = 0.4\n").unwrap();
        assert_eq!((biped.task.settings.posture, biped.task.settings.height), ([-1.0, 0.0, 0.0], 0.4));
        assert_eq!(train("task = \"biped\"\n").unwrap().task.settings.posture, [-1.0, 0.0, 0.0]);
        let set: TrainConfig = load(None, &["task.base=biped".to_owned()]).unwrap();
        assert_eq!(set, train("task = \"biped\"\n").unwrap());
    }

    #[test]
    fn a_tasks_file_lies_upon_a_base() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.toml");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            load_task(&path, preset("biped").unwrap(), &go2())
        };
        let parse = |text: &str| toml::from_str::<TaskSettings>(text).unwrap();
        let (velocity, biped) = (parse(preset("velocity").unwrap()), parse(preset("biped").unwrap()));
        let few = read("height = 0.4\n[command]\nx = [0.0, 0.5]\n").unwrap();
        assert_eq!((few.height, few.command.x, few.posture), (0.4, [0.0, 0.5], biped.posture));
        assert_eq!(few.rewards, biped.rewards);
        let named = read("base = \"velocity\"\nheight = 0.4\n").unwrap();
        assert_eq!((named.height, named.posture), (0.4, velocity.posture));
        assert_eq!(read(preset("velocity").unwrap()).unwrap(), velocity, "a whole task is taken as it is");
        for (text, words) in [
            ("\nhight = 1\n", [":2:1:", "Did you mean `height`?"]),
            ("[command]\nz = 1\n", [":2:1:", "unknown field `z`"]),
            ("base = \"bipe\"\n", [":1:8:", "`base`"]),
            ("height = 18446744073709551615\n", [":1:10:", "`height`"]),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(words.iter().all(|word| error.contains(word)), "{text}: {error}");
        }
    }

    /// What another robot must state.
    const TASK: &str = "feet = [\"FL_foot\"]\ngait = []\nheight = 0.4\nswing_height = 0.1\n[policy]\naction_scale = 0.5\n\
                       kp = { \"*\" = 20, \"*_calf\" = 30 }\nkd = 1\ndefault_pose = { \"*_calf\" = -1 }\n\
                       [fall]\ncontacts = []\nheight = 0.2\n";

    fn task(prefix: &str) -> String {
        TASK.replace("[policy]", &format!("[{prefix}policy]")).replace("[fall]", &format!("[{prefix}fall]"))
    }

    #[test]
    fn nothing_of_the_go2_reaches_another_robot() {
        let mut none = train("").unwrap();
        let error = none.task.settle(&a1(), Some("a1.xml")).unwrap_err();
        for word in ["`a1`", "task.feet", "task.policy.kp", "task.fall.height", "`gaitfit init a1.xml`"] {
            assert!(error.contains(word), "{error}");
        }
        let mut few = train("[task]\nfeet = [\"FL_foot\"]\n[task.policy]\nkp = 20.0\n").unwrap();
        let error = few.task.settle(&a1(), None).unwrap_err();
        assert!(!error.contains("task.feet,") && !error.contains("task.policy.kp,"), "{error}");
        assert!(error.contains("task.policy.kd"), "{error}");

        let mut all = train(&format!("[task]\n{}", task("task."))).unwrap();
        all.task.settle(&a1(), None).unwrap();
        let settings = &all.task.settings;
        assert_eq!(settings.policy.default_pose.keys().collect::<Vec<_>>(), ["*_calf"]);
        assert_eq!((settings.gait.len(), settings.fall.contacts.len()), (0, 0));
        assert_eq!(settings.episode_seconds, train("").unwrap().task.settings.episode_seconds);
        let mut go2s = train("").unwrap();
        go2s.task.settle(&go2(), None).unwrap();
        assert_eq!(go2s.task.settings, TaskSettings::default());
    }

    #[test]
    fn a_tasks_file_of_another_robot_takes_nothing_of_the_go2() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.toml");
        let read = |text: &str, model: &Model| {
            std::fs::write(&path, text).unwrap();
            load_task(&path, preset("biped").unwrap(), model)
        };
        let error = read("base = \"velocity\"\nheight = 0.4\n", &a1()).unwrap_err().to_string();
        assert!(error.contains("task.policy.default_pose") && !error.contains("task.height"), "{error}");
        let plain = read(&format!("base = \"velocity\"\n{TASK}"), &a1()).unwrap();
        assert_eq!(plain.policy.default_pose.len(), 1);
        let training = format!("robot = \"a1.xml\"\n[task]\nbase = \"velocity\"\n{}", task("task."));
        assert_eq!(read(&training, &a1()).unwrap(), plain, "the task of a training's configuration");
    }

    #[test]
    fn tables_are_cleared_on_request() {
        let config = train(
            "[task.policy.default_pose]\nclear = true\n\"*_calf\" = -1.0\n[task.rewards]\nclear = true\ngait = 1.0\n\
             [task.start]\npose = { clear = true }\n[task.policy.kp]\nclear = false\n\"*\" = 20\n",
        );
        let settings = config.unwrap().task.settings;
        assert_eq!(settings.policy.default_pose.len(), 1);
        assert_eq!(settings.rewards.keys().collect::<Vec<_>>(), ["gait"]);
        assert!(settings.start.pose.is_empty());
        assert_eq!(settings.policy.kp.entries(), [(Some("*"), 20.0)]);
    }
}
