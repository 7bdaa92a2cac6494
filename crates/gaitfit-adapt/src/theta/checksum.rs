//! The checksum of a `theta.toml`, and where its text is wrong.
//!
//! The sum is of the file's lines but its own, without comments of whole lines, empty lines and spaces at the ends. So
//! a note written into the file, or another way to end lines, changes nothing. Whoever edits a value deletes the sum.

use crate::checksum::Sum;
use gaitfit_model::escaped;

/// The key of the line.
const KEY: &str = "checksum";
/// Max characters of a parser's message.
const MAX_MESSAGE: usize = 400;

/// The checksum of a file's text, 64 hexadecimal digits.
pub(super) fn digest(text: &str) -> String {
    let mut sum = Sum::default();
    let counts = |line: &&str| !(line.is_empty() || line.starts_with('#') || is_own(line));
    text.lines().map(str::trim).filter(counts).for_each(|line| sum.text(line));
    sum.digits()
}

/// Whether a line is that of the checksum.
fn is_own(line: &str) -> bool {
    // Another key may begin with the same letters, so the equals sign must follow.
    line.strip_prefix(KEY).is_some_and(|rest| rest.trim_start().starts_with('='))
}

/// The text with its checksum after the first line.
pub(super) fn sealed(text: &str) -> String {
    let (first, rest) = text.split_once('\n').unwrap_or((text, ""));
    format!(
        "{first}\n# Delete the next line if you edit the values by hand.\n{KEY} = \"{}\"\n{rest}",
        digest(text)
    )
}

/// A message that states where and why a text is not a file of parameters.
pub(super) fn at(text: &str, error: &toml::de::Error) -> String {
    let message = escaped(error.message().trim_end(), MAX_MESSAGE);
    let Some(before) = error.span().and_then(|span| text.get(..span.start)) else { return message };
    let line = before.matches('\n').count() + 1;
    // Columns count characters, as editors show them, not bytes.
    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    format!("line {line}, column {column}: {message}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_and_line_ends_do_not_count_and_all_else_does() {
        let text = "format = 2\nrobot = \"go2\"\n\n[[parameter]]\nvalue = 0.25\n";
        let sealed = sealed(text);
        assert_eq!(digest(&sealed), digest(text));
        assert!(sealed.contains(&digest(text)), "{sealed}");
        assert_eq!(digest(&format!("# a note\n{}", sealed.replace('\n', "  \r\n"))), digest(text));
        for (from, to) in
            [("0.25", "0.26"), ("value = 0.25\n", ""), ("go2", "gp2"), ("[[parameter]]", "[[network]]")]
        {
            assert_ne!(digest(&sealed.replace(from, to)), digest(text), "{from}");
        }
    }
}
