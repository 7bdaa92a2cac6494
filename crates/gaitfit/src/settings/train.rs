//! The configuration of `gaitfit train`: its settings and their defaults. `gaitfit config train` prints them.

use super::Preset;
use super::load::{Configuration, merge, taken};
use gaitfit_learn::TrainingSettings;
use gaitfit_learn::ppo;
use gaitfit_learn::task::{TaskSettings, preset};
use serde::{Deserialize, Serialize, Serializer};
use std::borrow::Cow;
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table};

/// All settings of one training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainConfig {
    /// Name of the run and of its folder; the configuration file's stem, or else the task's name, when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Robot file (MJCF or URDF); the built-in Go2 when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<String>,
    /// Drop what the engine does not honour in the robot file instead of refusing it.
    pub lenient: bool,
    /// Folder that holds the run folders.
    pub runs: String,
    /// One training each, one after the other.
    pub seeds: Vec<u64>,
    /// Seconds between checkpoints.
    pub checkpoint_seconds: f64,
    /// Solver effort of the physics.
    #[serde(with = "super::preset")]
    pub preset: Preset,
    /// How much is trained.
    pub train: TrainingSettings,
    /// Networks and optimisation.
    pub ppo: ppo::Settings,
    /// What is trained.
    pub task: Task,
}

/// A task: a built-in one, and what differs from it. In the file both are in the table `[task]`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// The built-in task that it starts from.
    pub base: TaskName,
    /// All its settings.
    pub settings: TaskSettings,
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

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            name: None,
            robot: None,
            lenient: false,
            runs: "runs".to_owned(),
            seeds: vec![1],
            checkpoint_seconds: 30.0,
            preset: Preset::Fast,
            train: TrainingSettings::default(),
            ppo: ppo::Settings::default(),
            task: Task::default(),
        }
    }
}

impl Configuration for TrainConfig {
    const PRINTED_BY: &'static str = "gaitfit config train";
    const EXAMPLE: &'static str = "train.iterations=600";

    /// Turns `[task]` into `base` and `settings`, the base's with those of the file upon them.
    fn complete(table: &mut DeTable<'_>) {
        let Some(task) = table.get_mut("task") else { return };
        let span = task.span();
        let mut own = match task.get_mut() {
            DeValue::Table(own) => std::mem::take(own),
            // `task = "biped"` is short for its base alone.
            DeValue::String(_) => {
                let base = taken(task.get_mut());
                DeTable::from_iter([(key("base", &span), Spanned::new(span.clone(), base))])
            }
            _ => return,
        };
        let base = own.remove("base");
        let name = base.as_ref().and_then(|base| base.get_ref().as_str()).unwrap_or_default();
        // An unknown name is refused when the table is read, with its place.
        let text = preset(name).or_else(|| preset(TaskName::default().name())).unwrap_or_default();
        let mut settings = DeTable::parse(text).map(Spanned::into_inner).unwrap_or_default();
        merge(&mut settings, own);
        let base = base.unwrap_or_else(|| {
            Spanned::new(span.clone(), DeValue::String(Cow::Borrowed(TaskName::default().name())))
        });
        let settings = Spanned::new(span.clone(), DeValue::Table(settings));
        *task.get_mut() = DeValue::Table(DeTable::from_iter([
            (key("base", &span), base),
            (key("settings", &span), settings),
        ]));
    }
}

fn key(name: &'static str, span: &std::ops::Range<usize>) -> Spanned<Cow<'static, str>> {
    Spanned::new(span.clone(), Cow::Borrowed(name))
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
