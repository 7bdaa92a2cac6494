//! Messages about a configuration that is wrong: the place, and the name that was meant.

use crate::Error;
use crate::short_numbers;
use gaitfit_model::escaped;
use std::path::Path;

/// Max number of characters of a message, and of a `--set` in one.
pub const MAX_MESSAGE: usize = 4000;
pub const MAX_SET: usize = 200;

/// A text for a message: without control characters, and without numbers of hundreds of digits.
pub fn tamed(text: &str, max: usize) -> String {
    escaped(&short_numbers(text), max)
}

/// Returns the message of the TOML reader, with the nearest known name.
pub fn explained(error: &toml::de::Error) -> String {
    let message = error.message().trim_end();
    format!("{}{}", tamed(&in_words(message), MAX_MESSAGE), nearest(message))
}

/// A message with what a number must be in words instead of the name of a type: "expected u32".
fn in_words(message: &str) -> String {
    // The reader's messages end in the name of a Rust type, which users need not know.
    let Some((before, name)) = message.rsplit_once("expected ") else { return message.to_owned() };
    let max = match name {
        "u8" => Some(u64::from(u8::MAX)),
        "u32" => Some(u64::from(u32::MAX)),
        // Whole numbers of TOML end below the largest `u64`, so no greatest value is named.
        "u64" | "usize" => None,
        "a nonzero u32" | "a nonzero u64" | "a nonzero usize" => {
            return format!("{before}expected a whole number above 0");
        }
        "f64" => return format!("{before}expected a number"),
        name if name.starts_with("struct ") => {
            return format!("{before}expected a table of settings, such as {{ key = value }}");
        }
        _ => return message.to_owned(),
    };
    let max = max.map_or_else(|| " or more".to_owned(), |max| format!(" to {max}"));
    format!("{before}expected a whole number, 0{max}")
}

/// The paragraph for an error at a place of the file.
pub fn located(path: &Path, text: &str, error: &toml::de::Error) -> Error {
    let place = error.span().map(|span| line_and_column(text, span.start)).unwrap_or_default();
    Error::settings(format!("{}{place}: {}", path.display(), explained(error)))
}

/// The place of a byte of a file, `:line:column`.
pub fn line_and_column(text: &str, offset: usize) -> String {
    // A place within a character has no text before it; the message then names the first line.
    let before = text.get(..offset.min(text.len())).unwrap_or_default();
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    format!(":{line}:{column}")
}

/// Tables that only the configuration of a loop has.
pub const OF_LOOPS: [&str; 4] = ["adapt", "target", "finetune", "controls"];

/// Tables and keys that only the configuration of a fit has, and of a training.
const OF_FITS: [&str; 8] =
    ["parameter", "number", "costs", "groups", "gains", "validate", "base", "optimizer"];
const OF_TRAININGS: [&str; 2] = ["ppo", "task"];

/// Keys that only the configuration of a loop has.
const KEYS_OF_LOOPS: [&str; 3] = ["held_out", "rounds", "improvement"];

/// Names the command for a configuration whose key `unknown` the present command lacks: `known` are the
/// present command's keys.
fn meant_for(unknown: &str, known: &[&str]) -> Option<&'static str> {
    // The keys of the present command tell which command it is.
    let trains = known.contains(&"ppo");
    let (loops, fits) = (known.contains(&"finetune"), known.contains(&"parameter"));
    if fits && KEYS_OF_LOOPS.contains(&unknown) {
        return Some(". This is a setting of a loop: run `gaitfit loop` with its configuration");
    }
    if unknown == "format" && (trains || loops || fits || known.contains(&"rewards")) {
        return Some(". This looks like a file of fitted parameters: give it as --theta");
    }
    if trains && (OF_LOOPS.contains(&unknown) || ["policy", "logs"].contains(&unknown)) {
        Some(
            ". This looks like the configuration of a fine-tuning, a loop or a fit of walks, which `gaitfit finetune`, \
             `gaitfit loop` and `gaitfit fit` take",
        )
    } else if (trains || loops) && OF_FITS.contains(&unknown) {
        Some(". This looks like the configuration of a fit: run `gaitfit fit` with it")
    } else if (loops || fits) && OF_TRAININGS.contains(&unknown) {
        Some(". This looks like the configuration of a training: run `gaitfit train` with it")
    } else {
        None
    }
}

/// The known name nearest to the unknown one in a message such as "unknown field `a`, expected one of `b`, `c`".
fn nearest(message: &str) -> String {
    if !message.starts_with("unknown ") {
        return String::new();
    }
    // Texts between backquotes are every second part: first the unknown name, then the known ones.
    let mut quoted = message.split('`').skip(1).step_by(2);
    let Some(unknown) = quoted.next() else { return String::new() };
    let known: Vec<&str> = quoted.collect();
    if let Some(command) = meant_for(unknown, &known) {
        return command.to_owned();
    }
    if OF_LOOPS.contains(&unknown) {
        return ". This looks like the configuration of a loop: run `gaitfit loop` with it, or `gaitfit fit` to fit its logs alone".to_owned();
    }
    let scored = known.into_iter().map(|known| (strsim::jaro_winkler(unknown, known), known));
    match scored.max_by(|a, b| a.0.total_cmp(&b.0)) {
        // Below 0.6 the nearest name has little in common with the unknown one, and would mislead.
        Some((score, known)) if score > 0.6 => format!(". Did you mean `{known}`?"),
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::{in_words, nearest};

    #[test]
    fn a_configuration_of_another_command_names_it() {
        let of_train = "unknown field `policy`, expected one of `robot`, `ppo`, `task`";
        assert!(nearest(of_train).contains("`gaitfit loop`"), "{}", nearest(of_train));
        let of_loop = "unknown field `parameter`, expected one of `policy`, `finetune`";
        assert!(nearest(of_loop).contains("`gaitfit fit`"), "{}", nearest(of_loop));
        let of_fit = "unknown field `ppo`, expected one of `parameter`, `policy`";
        assert!(nearest(of_fit).contains("`gaitfit train`"), "{}", nearest(of_fit));
        let of_fit = "unknown field `held_out`, expected one of `parameter`, `odd_joints`";
        assert!(nearest(of_fit).contains("a setting of a loop"), "{}", nearest(of_fit));
        let of_task = "unknown field `format`, expected one of `command`, `rewards`";
        assert!(nearest(of_task).contains("--theta"), "{}", nearest(of_task));
        assert!(
            in_words("invalid type: integer `1`, expected struct FallsConfig")
                .ends_with("a table of settings, such as { key = value }")
        );
        assert_eq!(
            nearest("unknown field `seed`, expected one of `seeds`, `ppo`"),
            ". Did you mean `seeds`?"
        );
    }
}
