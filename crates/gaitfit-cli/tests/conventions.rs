//! Conventions of the tests on which `.ci/run` relies: without them, some tests would not run, and nobody would notice.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common::root;
use std::path::{Path, PathBuf};

/// Prefixes of the names of ignored tests: what a test needs, or why `.ci/run` leaves it out.
const NEEDS: [&str; 10] =
    ["shared_", "node_", "chromium_", "python_", "torch_", "cxx_", "nvrtc_", "gpu_", "long_", "timing_"];

/// All Rust files below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(sources(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            files.push(path);
        }
    }
    files
}

#[test]
fn names_of_ignored_tests_begin_with_what_they_need() {
    let (mut ignored, mut wrong) = (0, Vec::new());
    for file in sources(&root().join("crates")) {
        let text = std::fs::read_to_string(&file).unwrap();
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        for (at, _) in lines.iter().enumerate().filter(|(_, line)| line.starts_with("#[ignore")) {
            let name = lines[at..].iter().find_map(|line| line.strip_prefix("fn ")).unwrap_or_default();
            ignored += 1;
            if !NEEDS.iter().any(|need| name.starts_with(need)) {
                wrong.push(format!("{}: {name}", file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "see CONTRIBUTING.md for the beginnings of names: {wrong:#?}");
    // If the search breaks, it finds nothing wrong. The count shows that.
    assert!(ignored > 50, "only {ignored} ignored tests were seen");
}

#[test]
fn crates_whose_documentation_is_not_tested_have_no_code_in_it() {
    for entry in std::fs::read_dir(root().join("crates")).unwrap() {
        let folder = entry.unwrap().path();
        let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap_or_default();
        if !manifest.contains("doctest = false") {
            continue;
        }
        for file in sources(&folder.join("src")) {
            let text = std::fs::read_to_string(&file).unwrap();
            let comment = |line: &&str| line.starts_with("///") || line.starts_with("//!");
            let fences = text.lines().map(str::trim).filter(comment).filter(|line| line.contains("```"));
            // Other languages are not compiled, and a fence that ends a block names none.
            let other = ["```toml", "```text", "```ignore"];
            let (begun, code) = fences.enumerate().fold((0, 0), |(begun, code), (at, line)| {
                // Fences come in pairs: one opens a block, the next one ends it.
                let opens = at % 2 == 0;
                let compiled = opens && !other.iter().any(|language| line.contains(language));
                (begun + usize::from(opens), code + usize::from(compiled))
            });
            assert_eq!(code, 0, "{}: {begun} blocks; remove `doctest = false` of its crate", file.display());
        }
    }
}
