//! Text and numbers from files, made safe and short for messages.

use std::path::Path;

/// Most characters of a text in a message.
const MAX_CHARS: usize = 60;
/// Most characters of a path in a message.
const MAX_PATH_CHARS: usize = 1000;

/// `text` for a message: at most 60 characters, the rest cut to `...`. Characters that control a terminal or turn the
/// direction of writing are escaped (`\u{1b}`), so that a file cannot write over what the program says.
pub fn shown(text: &str) -> String {
    escaped(text, MAX_CHARS)
}

/// `path` for a message, as [`shown`] but long enough for any path that one would type.
pub fn shown_path(path: &Path) -> String {
    escaped(&path.to_string_lossy(), MAX_PATH_CHARS)
}

/// `value` for a message: plain where that is short, else with an exponent (`1e300`, not three hundred digits).
pub fn shown_number(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || !size.is_finite() || (1e-5..1e15).contains(&size) {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

/// As [`shown`], cut to `max` characters.
pub fn escaped(text: &str, max: usize) -> String {
    let mut out = String::new();
    let (mut count, mut cut) = (0, 0);
    for c in text.chars() {
        let before = out.len();
        if commands(c) {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
        count += out[before..].chars().count();
        if count > max {
            out.truncate(cut);
            out.push_str("...");
            return out;
        }
        if count + 3 <= max {
            cut = out.len();
        }
    }
    out
}

/// Whether a character commands a terminal (control characters, among them the escape) or the order of writing.
pub(crate) fn commands(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}')
        || matches!(c, '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_are_cut_to_sixty_characters() {
        assert_eq!(shown(&"é".repeat(60)), "é".repeat(60));
        assert_eq!(shown(&"é".repeat(61)), format!("{}...", "é".repeat(57)));
        assert_eq!(shown(&"a".repeat(15 << 20)).len(), 60);
        assert!(shown(&"\u{1b}".repeat(1000)).len() <= 60);
        assert_eq!(shown(""), "");
    }

    #[test]
    fn nothing_in_a_text_commands_the_terminal() {
        assert_eq!(shown("a\u{1b}[2Jb\nc\u{9b}d\u{7f}"), "a\\u{1b}[2Jb\\nc\\u{9b}d\\u{7f}");
        assert_eq!(shown("left\u{202e}right\u{feff}"), "left\\u{202e}right\\u{feff}");
        assert_eq!(shown("Gelenk-ß_関節"), "Gelenk-ß_関節");
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(shown_number(-0.25), "-0.25");
        assert_eq!(shown_number(0.0), "0");
        assert_eq!(shown_number(1e300), "1e300");
        assert_eq!(shown_number(-1e-300), "-1e-300");
        assert_eq!(shown_number(f64::NAN), "NaN");
        assert!(shown_number(1.234_567_890_123_456e-300).len() < 30);
    }
}
