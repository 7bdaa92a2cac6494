//! The library's errors as Python's.

use gaitfit::{Error, ErrorKind, brief};
use pyo3::PyErr;
use pyo3::exceptions::{PyException, PyFileNotFoundError, PyKeyboardInterrupt, PyValueError};

pyo3::create_exception!(
    gaitfit,
    GaitfitError,
    PyException,
    "A stage of gaitfit could not continue; the text says why, and what to do."
);

pyo3::create_exception!(
    gaitfit,
    Stopped,
    GaitfitError,
    "The progress function returned False, or max_seconds were over, so the stage stopped. A fit, a training or a loop keeps what is done in its run \
     folder, ``run_folder``; of a training also each seed's policy so far, ``seed-1/policy.safetensors``. Other stages keep \
     nothing, and ``run_folder`` is ``None``."
);

/// An error of the library. One that stopped because it was asked to is Python's own `KeyboardInterrupt`, and a file that is
/// missing its `FileNotFoundError`.
pub fn to_py_err(error: &Error) -> PyErr {
    match error {
        Error::Run(error) if error.kind() == ErrorKind::Interrupted => {
            PyKeyboardInterrupt::new_err(text(error))
        }
        _ => failed(error),
    }
}

/// A wrong argument.
pub fn value(message: impl ToString) -> PyErr {
    PyValueError::new_err(text(message))
}

/// Anything else that failed.
pub fn failed(message: impl ToString) -> PyErr {
    let text = text(message);
    // Errors of the library keep only the text of what the system says, or say themselves where they looked.
    let looked = text.contains("does not exist") && text.contains("the folder its path starts from");
    // A policy that is a function of Python is no file that could be there.
    let missing = (looked && !text.contains("`the function ") && !text.contains("/the function "))
        || text.contains("(os error 2)");
    if missing { PyFileNotFoundError::new_err(text) } else { GaitfitError::new_err(text) }
}

/// What a message about a log says if the log has no gains, as a table has none.
const NO_GAINS: &str = "the log does not state its PD gains";

fn text(message: impl ToString) -> String {
    let mut text = in_python(&brief(&message.to_string())).replace("train.environments", "train.num_envs");
    if text.contains("unknown field") {
        text = text.replace("`environments`", "`num_envs`");
    }
    // Without a configuration's file errors begin with "settings"; logs are none.
    if let Some(rest) =
        text.strip_prefix("settings: ").filter(|rest| rest.starts_with("the log") || rest.starts_with("log "))
    {
        text = rest.to_owned();
    }
    if text.contains(NO_GAINS) {
        text.push_str(" A table gets them by `Log.from_dataframe(table, kp=25.0, kd=0.5)`.");
    }
    text
}

/// A message with arguments and settings as Python has them: `resume=True` for `--resume`, `settings["a.b"]=1` for
/// `--set a.b=1`, `seconds` for `--seconds`. Commands in backquotes stay as they are.
pub fn in_python(message: &str) -> String {
    let parts = message.split('`').enumerate().map(|(number, part)| {
        let is_command = number % 2 == 1 && part.starts_with("gaitfit");
        if is_command { part.to_owned() } else { arguments(part) }
    });
    parts.collect::<Vec<_>>().join("`")
}

fn arguments(mut rest: &str) -> String {
    let mut text = String::new();
    let mut after_setting = false;
    while let Some(at) = rest.find("--") {
        let (before, option) = rest.split_at(at);
        let length =
            option[2..].bytes().take_while(|letter| letter.is_ascii_lowercase() || *letter == b'-').count();
        let (name, behind) = option[2..].split_at(length);
        let is_option = !name.is_empty() && !before.ends_with(|letter: char| letter.is_alphanumeric());
        if !is_option {
            text.push_str(before);
            text.push_str(&option[..2 + length]);
            rest = behind;
            continue;
        }
        // "`seconds` (--seconds)" names the setting already.
        if before.ends_with('(') && behind.starts_with(')') {
            text.push_str(before.trim_end_matches('(').trim_end());
            rest = &behind[1..];
            continue;
        }
        // Two settings stand side by side: a comma ends the value of the first.
        match after_setting && name == "set" && before.split_whitespace().count() == 1 {
            true => text.push_str(&format!("{}, ", before.trim_end())),
            false => text.push_str(before),
        }
        after_setting = name == "set";
        rest = behind;
        match name {
            "resume" => text.push_str("resume=True"),
            "set" => rest = setting(behind, &mut text),
            _ => text.push_str(&name.replace('-', "_")),
        }
    }
    text.push_str(rest);
    text
}

/// What follows `--set`: `KEY=VALUE`, also in quotes, or something else.
fn setting<'a>(behind: &'a str, text: &mut String) -> &'a str {
    let bare = behind.trim_start();
    let (quoted, bare) = match bare.strip_prefix('\'') {
        Some(inside) => (true, inside),
        None => (false, bare),
    };
    let is_key = |letter: char| letter.is_alphanumeric() || letter == '_' || letter == '.';
    let length = bare.find(|letter| !is_key(letter)).unwrap_or(bare.len());
    let Some(value) = bare[length..].strip_prefix('=').filter(|_| length > 0) else {
        text.push_str("settings");
        return behind;
    };
    text.push_str(&format!("settings[\"{}\"]=", &bare[..length]));
    match value.split_once('\'').filter(|_| quoted) {
        Some((value, rest)) => {
            text.push_str(value);
            rest
        }
        None => value,
    }
}
