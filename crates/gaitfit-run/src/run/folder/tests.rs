//! Tests of run folders.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;

#[test]
fn a_second_run_gets_its_own_folder_and_the_latest_is_found() {
    let runs = tempfile::tempdir().unwrap();
    assert!(RunFolder::latest(runs.path(), "a").unwrap().is_none());
    let first = RunFolder::fresh(runs.path(), "a").unwrap();
    first.write("theta.toml", b"one").unwrap();
    let second = RunFolder::fresh(runs.path(), "a").unwrap();
    assert_eq!((first.name().as_str(), second.name().as_str()), ("a", "a-2"));
    assert_eq!(first.read("theta.toml").unwrap().as_deref(), Some("one"));
    assert_eq!(second.read("theta.toml").unwrap(), None);
    let busy = RunFolder::latest(runs.path(), "a").unwrap_err();
    assert!(busy.to_string().contains("another process"), "{busy}");
    // Folders of processes that are gone: a lock dropped here may live on for a moment in what another test starts.
    for name in ["b", "b-2"] {
        fs::create_dir(runs.path().join(name)).unwrap();
    }
    assert_eq!(RunFolder::latest(runs.path(), "b").unwrap().unwrap().name(), "b-2");
    assert_eq!(RunFolder::only(runs.path(), "b").unwrap().name(), "b");
    assert_eq!(RunFolder::only(runs.path(), "c").unwrap().name(), "c");
}

#[test]
fn a_missing_number_hides_no_later_run() {
    let runs = tempfile::tempdir().unwrap();
    for name in ["a", "a-3", "a-007", "a-b", "a-1"] {
        fs::create_dir(runs.path().join(name)).unwrap();
    }
    // A file, and the run of another name.
    fs::write(runs.path().join("a-9"), "").unwrap();
    fs::create_dir(runs.path().join("a-8")).unwrap();
    fs::write(runs.path().join("a-8/config.toml"), "name = \"a-8\"\n").unwrap();
    assert_eq!(RunFolder::latest(runs.path(), "a").unwrap().unwrap().name(), "a-3");
    assert_eq!(RunFolder::fresh(runs.path(), "a").unwrap().name(), "a-4", "a new run is the latest");
    fs::remove_dir(runs.path().join("a")).unwrap();
    fs::write(runs.path().join("a-3/config.toml"), "name = \"a\"\n").unwrap();
    fs::remove_dir_all(runs.path().join("a-4")).unwrap();
    assert_eq!(RunFolder::latest(runs.path(), "a").unwrap().unwrap().name(), "a-3");
    assert_eq!(RunFolder::latest(runs.path(), "a-8").unwrap().unwrap().name(), "a-8");
}

#[cfg(unix)]
#[test]
fn a_folder_exchanged_for_another_is_an_error_and_gets_nothing() {
    let runs = tempfile::tempdir().unwrap();
    let folder = RunFolder::fresh(runs.path(), "a").unwrap();
    folder.write("checkpoint.json", b"own").unwrap();
    fs::rename(folder.path(), runs.path().join("aside")).unwrap();
    let gone = folder.write("checkpoint.json", b"own").unwrap_err().to_string();
    assert!(gone.contains("no longer the folder of this run"), "{gone}");
    // Another run, with a lock of its own.
    fs::create_dir(runs.path().join("a")).unwrap();
    fs::write(runs.path().join("a/.lock"), "").unwrap();
    for error in [
        folder.write("checkpoint.json", b"own").unwrap_err(),
        folder.append("metrics.jsonl", "own").unwrap_err(),
        folder.make("seed-1").unwrap_err(),
        folder.read("checkpoint.json").unwrap_err(),
    ] {
        assert!(error.to_string().contains("exchanged for another"), "{error}");
    }
    assert_eq!(fs::read_dir(runs.path().join("a")).unwrap().count(), 1);
    fs::remove_dir_all(runs.path().join("a")).unwrap();
    fs::rename(runs.path().join("aside"), folder.path()).unwrap();
    folder.write("checkpoint.json", b"own again").unwrap();
}

#[test]
fn a_write_replaces_the_whole_file_and_leaves_nothing_behind() {
    let runs = tempfile::tempdir().unwrap();
    let folder = RunFolder::fresh(runs.path(), "a").unwrap();
    folder.write("x", b"a long first version").unwrap();
    folder.write("x", b"short").unwrap();
    folder.append("x", " tail").unwrap();
    assert_eq!(folder.read("x").unwrap().as_deref(), Some("short tail"));
    let names: Vec<_> =
        fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 2, "{names:?}");
}

#[test]
fn what_a_killed_run_left_unfinished_is_swept_and_other_runs_are_not() {
    let runs = tempfile::tempdir().unwrap();
    let killed = runs.path().join("a");
    for name in ["seed-1", "round-1/adapt"] {
        fs::create_dir_all(killed.join(name)).unwrap();
    }
    let left = ["seed-1/.writing-x", ".writing-y", "round-1/adapt/.writing-z"];
    for name in ["round-1/adapt/.lock", "seed-1/whole"].iter().chain(&left) {
        fs::write(killed.join(name), "half").unwrap();
    }
    let folder = RunFolder::latest(runs.path(), "a").unwrap().unwrap();
    let there = |name: &str| folder.path().join(name).exists();
    assert_eq!(left.map(there), [false, false, true]);
    assert!(there("seed-1/whole"));
}

#[test]
fn names_that_leave_the_folder_are_refused() {
    for name in ["", ".", "..", "../a", "a/b", ".a"] {
        assert!(check_name(name).is_err(), "{name}");
    }
    assert!(check_name("go2-air_1.5").is_ok());
    let error = check_name(&"a".repeat(300)).unwrap_err().to_string();
    assert!(error.contains("has 300 bytes") && error.len() < 200, "{error}");
}

#[cfg(unix)]
#[test]
fn pipes_and_folders_in_place_of_a_runs_files_are_named_and_not_opened() {
    let runs = tempfile::tempdir().unwrap();
    let folder = RunFolder::fresh(runs.path(), "a").unwrap();
    let pipe = |path: PathBuf| std::process::Command::new("mkfifo").arg(path).status().unwrap().success();
    assert!(pipe(folder.path().join("checkpoint.json")));
    fs::create_dir(folder.path().join("manifest.json")).unwrap();
    for (name, error) in [
        ("checkpoint.json", folder.read("checkpoint.json").unwrap_err()),
        ("manifest.json", folder.read_bytes("manifest.json").unwrap_err()),
        ("checkpoint.json", folder.append("checkpoint.json", "x").unwrap_err()),
        ("checkpoint.json", folder.sync("checkpoint.json").unwrap_err()),
    ] {
        let error = error.to_string();
        assert!(error.contains(name) && error.contains("not a regular file; "), "{error}");
    }
    fs::create_dir(runs.path().join("c")).unwrap();
    assert!(["config.toml", ".lock"].iter().all(|name| pipe(runs.path().join("c").join(name))));
    let error = RunFolder::latest(runs.path(), "c").unwrap_err().to_string();
    assert!(error.contains(".lock: not a regular file"), "{error}");
}

#[test]
fn a_file_in_the_way_is_named() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let error = RunFolder::fresh(file.path(), "a").unwrap_err();
    assert!(error.to_string().contains(&file.path().display().to_string()), "{error}");
    assert!(error.to_string().contains("--set runs="), "{error}");
}
