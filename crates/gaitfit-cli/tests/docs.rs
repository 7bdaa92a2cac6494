//! Links of the documentation lead somewhere, and the book has every page.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common::root;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Pages of the repository: those at its root, of docs and of the examples.
fn pages() -> Vec<PathBuf> {
    let examples = ["examples", "examples/go2-ground", "examples/go2-demo", "examples/go2-stairs"];
    let folders = ["", "docs", "docs/api", "docs/results"].into_iter().chain(examples);
    let mut pages: Vec<PathBuf> = folders
        .flat_map(|folder| std::fs::read_dir(root().join(folder)).unwrap())
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "md"))
        .collect();
    pages.sort();
    pages
}

/// The lines of a page that are not in a code block, without code within them.
fn prose(text: &str) -> Vec<String> {
    let mut inside = false;
    let mut lines = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            inside = !inside;
        } else if !inside {
            // Every second part stands between backticks and is code.
            let parts = line.split('`').enumerate();
            lines.push(parts.filter(|(place, _)| place % 2 == 0).map(|(_, part)| part).collect());
        }
    }
    lines
}

/// Anchors of a page's headings, as GitHub makes them.
fn anchors(page: &Path) -> BTreeSet<String> {
    let text = std::fs::read_to_string(page).unwrap();
    let mut inside = false;
    let mut anchors = BTreeSet::new();
    for line in text.lines() {
        inside ^= line.trim_start().starts_with("```");
        if inside || !line.starts_with('#') {
            continue;
        }
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title.chars().filter(|letter| letter.is_alphanumeric() || " -_".contains(*letter));
        anchors.insert(kept.map(|letter| if letter == ' ' { '-' } else { letter }).collect());
    }
    anchors
}

/// The targets of a line's links and pictures.
fn targets(line: &str) -> impl Iterator<Item = &str> {
    line.split("](").skip(1).filter_map(|rest| rest.split([')', ' ']).next())
}

#[test]
fn every_link_leads_somewhere() {
    let mut dead = Vec::new();
    let mut links = 0;
    for page in pages() {
        let text = std::fs::read_to_string(&page).unwrap();
        for line in prose(&text) {
            for target in targets(&line).filter(|target| !target.contains("://")) {
                links += 1;
                let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
                let path = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
                let there = path.exists() && (anchor.is_empty() || anchors(&path).contains(anchor));
                if !there {
                    dead.push(format!("{}: {target}", page.strip_prefix(root()).unwrap().display()));
                }
            }
        }
    }
    assert!(dead.is_empty(), "dead links: {dead:#?}");
    // If the search for links breaks, it finds no dead ones. The count shows that.
    assert!(links > 100, "only {links} links were seen");
}

#[test]
fn the_book_has_every_page() {
    let summary = std::fs::read_to_string(root().join("docs/SUMMARY.md")).unwrap();
    let listed: BTreeSet<&str> = summary.lines().flat_map(targets).collect();
    let docs = root().join("docs");
    let there: BTreeSet<String> = pages()
        .iter()
        .filter_map(|page| Some(page.strip_prefix(&docs).ok()?.to_string_lossy().into_owned()))
        .filter(|name| name != "SUMMARY.md")
        .collect();
    let listed: BTreeSet<String> = listed.into_iter().map(str::to_owned).collect();
    assert_eq!(listed, there);
}

#[test]
fn links_of_the_book_stay_in_it() {
    let docs = root().join("docs");
    let mut outside = Vec::new();
    for page in pages().iter().filter(|page| page.starts_with(&docs)) {
        let text = std::fs::read_to_string(page).unwrap();
        for line in prose(&text) {
            for target in targets(&line).filter(|target| !target.contains("://") && !target.starts_with('#'))
            {
                let file = target.split('#').next().unwrap_or(target);
                let path = page.parent().unwrap().join(file).canonicalize().unwrap();
                if !path.starts_with(docs.canonicalize().unwrap()) {
                    outside.push(format!("{}: {target}", page.display()));
                }
            }
        }
    }
    assert!(outside.is_empty(), "the book has no page for {outside:#?}");
}

#[test]
fn pages_stay_short() {
    let docs = root().join("docs");
    let long: Vec<String> = pages()
        .iter()
        .filter(|page| page.parent() == Some(docs.as_path()))
        .filter_map(|page| {
            let words = std::fs::read_to_string(page).unwrap().split_whitespace().count();
            (words > 1_600).then(|| format!("{}: {words} words", page.display()))
        })
        .collect();
    assert!(long.is_empty(), "split these pages, or move measurements to docs/results: {long:#?}");
}
