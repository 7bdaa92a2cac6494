//! Standard output: text and JSON. A reader that went away (`gaitfit … | head`) is not an error.

use crate::exit::Failure;
use serde::Serialize;
use std::borrow::Cow;
use std::io::{ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};

/// Prints text for people. Control characters, which names in files may hold, are shown escaped, and numbers of hundreds of
/// digits with an exponent.
pub fn print(text: &str) -> Result<(), Failure> {
    print_bytes(harmless(&gaitfit::short_numbers(text)).as_bytes())
}

/// Prints bytes as they are.
pub fn print_bytes(bytes: &[u8]) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::failed(format!("cannot write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Prints the commands that usually come next, one a line.
pub fn next(commands: &[String]) -> Result<(), Failure> {
    print(&commands.iter().map(|command| format!("next: {command}\n")).collect::<String>())
}

/// Prints `document` as one JSON document.
pub fn print_json<T: Serialize>(document: &T) -> Result<(), Failure> {
    let mut text = serde_json::to_string_pretty(document)
        .map_err(|error| Failure::failed(format!("cannot write the result as JSON: {error}")))?;
    text.push('\n');
    // JSON itself lets some characters stand that steer a terminal.
    print_bytes(escaped(&text, |letter| format!("\\u{:04x}", u32::from(letter))).as_bytes())
}

/// Prints a line of progress or advice on standard error; a closed standard error is ignored.
pub fn note(text: &str) {
    let text = gaitfit::brief(text);
    let text = harmless(&text);
    // A terminal whose keys are read one by one does not go back to the line's start by itself.
    let _ = match RAW.load(Ordering::SeqCst) {
        true => write!(std::io::stderr().lock(), "{}\r\n", text.replace('\n', "\r\n")),
        false => writeln!(std::io::stderr().lock(), "{text}"),
    };
}

/// Says what computes, one line a device.
pub fn devices(devices: &gaitfit::device::Devices) {
    devices.all().iter().for_each(|device| note(&device.line()));
}

/// Whether the terminal's keys are read one by one.
static RAW: AtomicBool = AtomicBool::new(false);

/// From now on the terminal's keys are read one by one, or no longer.
pub fn raw(raw: bool) {
    RAW.store(raw, Ordering::SeqCst);
}

/// The text without characters that steer a terminal: those are shown escaped.
pub fn harmless(text: &str) -> Cow<'_, str> {
    escaped(text, |letter| letter.escape_unicode().to_string())
}

fn escaped(text: &str, escape: impl Fn(char) -> String) -> Cow<'_, str> {
    // Line breaks and tabs belong to tables. Other control characters can move the cursor or change colours.
    let steers = |letter: char| letter.is_control() && letter != '\n' && letter != '\t' || is_bidi(letter);
    if !text.chars().any(steers) {
        return Cow::Borrowed(text);
    }
    // Room for a few escapes, so that most texts need one allocation.
    let mut shown = String::with_capacity(text.len() + 16);
    for letter in text.chars() {
        if steers(letter) {
            shown.push_str(&escape(letter));
        } else {
            shown.push(letter);
        }
    }
    Cow::Owned(shown)
}

/// Whether a character turns the direction of the text around it.
fn is_bidi(letter: char) -> bool {
    // Embeddings, overrides and isolates of Unicode's bidirectional algorithm. A name with one could show a file's
    // ending in the wrong place.
    matches!(letter, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::harmless;

    #[test]
    fn what_steers_a_terminal_is_escaped_and_the_rest_is_not() {
        let tables = "joint  rad\n──────\nFL_hip\t0.1 ± 0.2 N·m\n";
        assert_eq!(harmless(tables), tables);
        assert_eq!(
            harmless("a\u{1b}[31mb\rc\u{9b}\u{202e}d\u{7f}"),
            "a\\u{1b}[31mb\\u{d}c\\u{9b}\\u{202e}d\\u{7f}"
        );
    }
}
