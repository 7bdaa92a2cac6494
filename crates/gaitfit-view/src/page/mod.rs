//! Parts that all report pages share: head, style sheet, read-out script, and the rules of escaping.

mod doubts;
mod links;

pub(crate) use doubts::{ShownDoubt, doubts, is_severe};
pub(crate) use links::{ShownLink, links};

use crate::chart::STYLE;
use crate::format::{clean, clean_prose, duration};
use crate::{ReportError, Setting};
use minijinja::value::Serde;
use minijinja::{AutoEscape, Environment, UndefinedBehavior};
use serde::Serialize;

/// Settings and warnings listed at most.
const MAX_LINES: usize = 500;

/// Fills in a template that extends `base.html`.
pub(crate) fn render(template: &str, page: impl Serialize) -> Result<String, ReportError> {
    filled_in(template, page).map_err(|error| ReportError::Template(error.into()))
}

fn filled_in(template: &str, page: impl Serialize) -> Result<String, minijinja::Error> {
    let mut environment = Environment::new();
    // Names of logs and joints come from files: everything is escaped but the crate's own pictures.
    environment.set_auto_escape_callback(|_| AutoEscape::Html);
    // A name that a template has and the data lacks is an error here, and not an empty place on the page.
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.add_global("style", format!("{STYLE}{}", include_str!("style.css")));
    environment.add_global("script", include_str!("script.js"));
    environment.add_template("base.html", include_str!("base.html"))?;
    environment.add_template("macros.html", include_str!("macros.html"))?;
    environment.add_template("parts.html", include_str!("parts.html"))?;
    environment.add_template("player.html", include_str!("../replay/player.html"))?;
    environment.add_template("motion.html", include_str!("../replay/motion.html"))?;
    environment.add_template("page.html", template)?;
    environment.get_template("page.html")?.render(Serde(page))
}

/// A number worth large print.
#[derive(Serialize)]
pub(crate) struct Number {
    pub value: String,
    pub unit: String,
    pub what: String,
}

/// Sentences fit to print, not too many of them.
pub(crate) fn lines(list: &[String]) -> Vec<String> {
    list.iter().take(MAX_LINES).map(|s| clean_prose(s)).collect()
}

/// Settings fit to print, not too many of them.
pub(crate) fn settings(list: &[Setting]) -> Vec<Setting> {
    let cleaned = |s: &Setting| Setting { name: clean(&s.name), value: clean_prose(&s.value) };
    list.iter().take(MAX_LINES).map(cleaned).collect()
}

/// Makes the facts at the head of a page: the time of the whole run, s, then the caller's facts.
pub(crate) fn facts(wall_seconds: f64, list: &[Setting]) -> Vec<Setting> {
    let time = Setting { name: "Wall time".into(), value: duration(wall_seconds) };
    [time].into_iter().chain(settings(list)).collect()
}
