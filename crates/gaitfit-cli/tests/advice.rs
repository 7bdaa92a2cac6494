//! Commands of the documentation that need no hardware and take no time are run as they stand, in a folder that has the
//! repository's robots and examples.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, root};
use std::path::Path;
use std::process::Command;

/// Commands that take no time.
const QUICK: [&str; 6] = ["config", "doctor", "init", "inspect", "sensitivity", "reproduce list"];

/// Lines of the `sh` blocks of a page.
fn lines(page: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(page).unwrap();
    let mut inside = false;
    let mut lines = Vec::new();
    for line in text.lines().map(str::trim) {
        if line.starts_with("```") {
            // A fence ends a block of any language. Only one that names a shell begins a block here.
            inside = !inside && line == "```sh";
        } else if inside {
            lines.push(line.to_owned());
        }
    }
    lines
}

/// Whether the files that a line reads are in the repository.
fn has_its_files(line: &str) -> bool {
    let names_one = |word: &str| {
        word.contains('/') || [".xml", ".toml", ".csv", ".urdf"].iter().any(|end| word.ends_with(end))
    };
    let words: Vec<&str> = line.split('#').next().unwrap_or_default().split_whitespace().collect();
    let written = |at: usize| at > 0 && ["--out", "--plot", ">"].contains(&words[at - 1]);
    words.iter().enumerate().all(|(at, word)| written(at) || !names_one(word) || root().join(word).exists())
}

#[test]
fn quick_commands_of_the_documentation_run() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["assets", "examples", "experiments"] {
        std::os::unix::fs::symlink(root().join(name), folder.path().join(name)).unwrap();
    }
    let program = Path::new(env!("CARGO_BIN_EXE_gaitfit")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let mut pages: Vec<_> =
        std::fs::read_dir(root().join("docs")).unwrap().map(|page| page.unwrap().path()).collect();
    pages.retain(|page| page.extension().is_some_and(|ending| ending == "md"));
    pages.push(root().join("README.md"));
    pages.sort();
    let mut count = 0;
    for line in pages.iter().flat_map(|page| lines(page)) {
        let line = line.replace("cargo run --release -- ", "gaitfit ");
        let quick = QUICK.iter().any(|command| {
            line.starts_with(&format!("gaitfit {command} ")) || line == format!("gaitfit {command}")
        });
        if !quick || !has_its_files(&line) {
            continue;
        }
        let output = Command::new("sh")
            .args(["-c", &line])
            .env("PATH", &path)
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert!(output.status.success(), "{line}: {}\n{}", output.status, errors(&output));
        count += 1;
    }
    assert!(count >= 6, "only {count} commands were run");
}
