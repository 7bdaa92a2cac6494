//! Globs: patterns over names and over paths of files.
//!
//! `*` stands for any letters, `?` for one, `[FR]` and `[a-c]` for one of a list, `[!FR]` for one that is not in it,
//! `{hip,calf}` for one of some patterns, and `\` before a letter for that letter. In patterns over paths `*`, `?` and
//! lists do not cross folders; `**` as a whole component of a path does.
//!
//! A pattern is a machine with one state a letter, and all states that a text can be in are followed at once (Thompson,
//! 1968). So no pattern takes longer than its length times the text's.

/// Why a text is no pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GlobError {
    /// `[` without `]`.
    #[error("a list of letters that begins with [ has no ]")]
    Class,
    /// `[b-a]`.
    #[error("the range {0}-{1} ends before it begins")]
    Range(char, char),
    /// `{` without `}`.
    #[error("a list of words that begins with {{ has no }}")]
    Open,
    /// `}` without `{`.
    #[error("a }} has no {{ before it")]
    Close,
    /// `\` at the end.
    #[error("a \\ at the end has no letter behind it")]
    Escape,
}

#[derive(Clone, Debug, PartialEq)]
enum State {
    Letter(char),
    /// Any letter.
    One,
    Class {
        negated: bool,
        ranges: Vec<(char, char)>,
    },
    /// Any number of letters.
    Any,
    /// Any number of letters, folders among them.
    Deep,
    /// Goes on at all of these states.
    Fork(Vec<usize>),
}

/// A pattern.
#[derive(Clone, Debug)]
pub struct Glob {
    states: Vec<State>,
    /// Whether it is a pattern over paths.
    paths: bool,
}

/// A list of words that is being read: its fork, and the ends of the words so far.
struct Words {
    fork: usize,
    ends: Vec<usize>,
}

impl Glob {
    /// A pattern over names: `*` stands for anything.
    ///
    /// # Errors
    /// [`GlobError`].
    pub fn new(text: &str) -> Result<Self, GlobError> {
        Self::compile(text, false)
    }

    /// A pattern over paths of files.
    ///
    /// # Errors
    /// [`GlobError`].
    pub fn paths(text: &str) -> Result<Self, GlobError> {
        Self::compile(text, true)
    }

    fn compile(text: &str, paths: bool) -> Result<Self, GlobError> {
        let mut states: Vec<State> = Vec::new();
        let mut open: Vec<Words> = Vec::new();
        let letters: Vec<char> = text.chars().collect();
        let mut at = 0;
        while let Some(&letter) = letters.get(at) {
            at += 1;
            match letter {
                '*' if paths && whole_component(&letters, at - 1) => {
                    at += 1;
                    if letters.get(at) == Some(&'/') {
                        // No folder, or some folders with their slash.
                        at += 1;
                        let here = states.len();
                        states.push(State::Fork(vec![here + 1, here + 3]));
                        states.extend([State::Deep, State::Letter('/')]);
                    } else {
                        states.push(State::Deep);
                    }
                }
                '*' => states.push(State::Any),
                '?' => states.push(State::One),
                '[' => {
                    let (class, after) = class(&letters, at)?;
                    states.push(class);
                    at = after;
                }
                '{' => {
                    open.push(Words { fork: states.len(), ends: Vec::new() });
                    states.push(State::Fork(vec![states.len() + 1]));
                }
                ',' if !open.is_empty() => {
                    if let Some(words) = open.last_mut() {
                        words.ends.push(states.len());
                        states.push(State::Fork(Vec::new()));
                        let begin = states.len();
                        if let State::Fork(begins) = &mut states[words.fork] {
                            begins.push(begin);
                        }
                    }
                }
                '}' => {
                    let words = open.pop().ok_or(GlobError::Close)?;
                    for end in words.ends {
                        states[end] = State::Fork(vec![states.len()]);
                    }
                }
                '\\' => {
                    states.push(State::Letter(*letters.get(at).ok_or(GlobError::Escape)?));
                    at += 1;
                }
                other => states.push(State::Letter(other)),
            }
        }
        if open.is_empty() { Ok(Self { states, paths }) } else { Err(GlobError::Open) }
    }

    /// Whether it matches the whole text.
    pub fn matches(&self, text: &str) -> bool {
        let mut now = vec![false; self.states.len() + 1];
        let mut pending = vec![0];
        self.reach(&mut now, &mut pending);
        for letter in text.chars() {
            let mut next = vec![false; self.states.len() + 1];
            for (place, state) in self.states.iter().enumerate().filter(|(place, _)| now[*place]) {
                let inside = !(self.paths && letter == '/');
                let (stays, passes) = match state {
                    State::Letter(wanted) => (false, letter == *wanted),
                    State::One => (false, inside),
                    State::Class { negated, ranges } => {
                        let listed = ranges.iter().any(|(first, last)| (*first..=*last).contains(&letter));
                        (false, inside && listed != *negated)
                    }
                    State::Any => (inside, false),
                    State::Deep => (true, false),
                    State::Fork(_) => (false, false),
                };
                if stays || passes {
                    pending.push(place + usize::from(passes));
                }
            }
            self.reach(&mut next, &mut pending);
            now = next;
        }
        now[self.states.len()]
    }

    /// Marks the pending states and those that are reached from them without a letter.
    fn reach(&self, marked: &mut [bool], pending: &mut Vec<usize>) {
        while let Some(place) = pending.pop() {
            if std::mem::replace(&mut marked[place], true) {
                continue;
            }
            match self.states.get(place) {
                Some(State::Fork(places)) => pending.extend(places),
                Some(State::Any | State::Deep) => pending.push(place + 1),
                _ => {}
            }
        }
    }
}

/// Whether `**` stands at `at` alone between slashes or ends.
fn whole_component(letters: &[char], at: usize) -> bool {
    let begins = at == 0 || letters[at - 1] == '/';
    begins && letters.get(at + 1) == Some(&'*') && matches!(letters.get(at + 2), None | Some('/'))
}

/// A list of letters whose `[` is before `at`, and the place after its `]`.
fn class(letters: &[char], mut at: usize) -> Result<(State, usize), GlobError> {
    let negated = matches!(letters.get(at), Some('!' | '^'));
    at += usize::from(negated);
    let mut ranges = Vec::new();
    loop {
        let first = *letters.get(at).ok_or(GlobError::Class)?;
        // A ] at the beginning is a letter.
        if first == ']' && !ranges.is_empty() {
            return Ok((State::Class { negated, ranges }, at + 1));
        }
        let last = match (letters.get(at + 1), letters.get(at + 2)) {
            (Some('-'), Some(&last)) if last != ']' => {
                at += 2;
                last
            }
            _ => first,
        };
        if last < first {
            return Err(GlobError::Range(first, last));
        }
        ranges.push((first, last));
        at += 1;
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn names_are_matched() {
        for (pattern, yes, no) in [
            ("*_hip", &["FL_hip", "_hip", "a/b_hip"][..], &["hip", "FL_hip_joint", ""][..]),
            ("F?_*", &["FL_hip", "FR_"], &["FL", "RL_hip", "F_hip"]),
            ("[FR][!R]_hip", &["FL_hip", "RL_hip"], &["FR_hip", "HL_hip"]),
            ("joint_[0-4]", &["joint_0", "joint_4"], &["joint_5", "joint_"]),
            ("[]x-]", &["]", "x", "-"], &["[", ""]),
            ("*_{hip,calf}", &["FL_hip", "FL_calf"], &["FL_thigh", "FL_"]),
            ("{a,b{c,d}*,}x", &["ax", "bcx", "bd_x", "x"], &["bx", "cx"]),
            ("a,b", &["a,b"], &["a"]),
            ("\\*\\{", &["*{"], &["ab"]),
            ("", &[""], &["a"]),
            ("*", &["", "ü/x"], &[]),
            ("?", &["ü"], &["", "ab"]),
            ("**x", &["x", "a/x"], &["xa"]),
        ] {
            let glob = Glob::new(pattern).unwrap();
            yes.iter().for_each(|text| assert!(glob.matches(text), "{pattern} {text}"));
            no.iter().for_each(|text| assert!(!glob.matches(text), "{pattern} {text}"));
        }
    }

    #[test]
    fn only_two_stars_cross_folders() {
        for (pattern, yes, no) in [
            ("logs/*.csv", &["logs/a.csv"][..], &["logs/b/a.csv", "logs/a.txt", "a.csv"][..]),
            ("logs/**/*.csv", &["logs/a.csv", "logs/b/a.csv", "logs/b/c/a.csv"], &["logsb/a.csv", "a.csv"]),
            ("**/a.csv", &["a.csv", "b/a.csv", "b/c/a.csv"], &["ba.csv", "b/a.csvx"]),
            ("logs/**", &["logs/a", "logs/a/b"], &["log/a"]),
            ("a?b", &["axb"], &["a/b"]),
            ("a[!x]b", &["ayb"], &["a/b", "axb"]),
            ("{x,y}/run_*/a**.csv", &["y/run_1/a.csv", "x/run_/ab.csv"], &["x/run_1/a/b.csv"]),
        ] {
            let glob = Glob::paths(pattern).unwrap();
            yes.iter().for_each(|text| assert!(glob.matches(text), "{pattern} {text}"));
            no.iter().for_each(|text| assert!(!glob.matches(text), "{pattern} {text}"));
        }
    }

    #[test]
    fn what_is_no_pattern_is_refused() {
        for (pattern, error) in [
            ("[FR", GlobError::Class),
            ("[]", GlobError::Class),
            ("[b-a]", GlobError::Range('b', 'a')),
            ("{hip", GlobError::Open),
            ("hip}", GlobError::Close),
            ("hip\\", GlobError::Escape),
        ] {
            assert_eq!(Glob::new(pattern).unwrap_err(), error, "{pattern}");
        }
    }

    #[test]
    fn no_pattern_takes_long() {
        let pattern = "{*a,*b}".repeat(200);
        assert!(!Glob::new(&pattern).unwrap().matches(&format!("{}c", "ab".repeat(2000))));
        let deep = format!("{}x{}", "{".repeat(10_000), "}".repeat(10_000));
        assert!(Glob::new(&deep).unwrap().matches("x"));
    }
}
