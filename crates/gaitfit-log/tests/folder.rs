//! Folders of logs: what they hold together, and links that lead nowhere.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_log::*;
use std::ops::ControlFlow;
use std::path::Path;

fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).unwrap();
}

fn summarise(folder: &Path) -> Result<FolderSummary, LogError> {
    let mut seen = Vec::new();
    let mut progress = |done, all| {
        seen.push((done, all));
        ControlFlow::Continue(())
    };
    let summary =
        summarise_folder(folder, &ReadOptions::default(), &|_| CheckSpec::default(), &mut progress)?;
    assert_eq!(seen, (0..=summary.logs.len()).map(|done| (done, summary.logs.len())).collect::<Vec<_>>());
    Ok(summary)
}

#[test]
fn a_folder_is_what_its_logs_share() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write(
        folder,
        "b.csv",
        "# robot = 'go2'\ntime,q_a,q_b,dq_a,dq_b\n0,1,2,0,0\n0.02,1,2,0,0\n0.04,1,nan,0,0\n",
    );
    write(folder, "a.csv", "# robot = 'go2'\ntime,q_b,q_c,dq_b,dq_c\n0,1,2,0,0\n0.0201,1,nan,0,0\n");
    write(folder, "c.CSV", "time,q_b,dq_b\n0,1,0\n5,nan,0\n10,1,0\n15,1,0\n");
    write(folder, "d.csv", "time,q_b\n");
    write(folder, "notes.txt", "no log");
    std::fs::create_dir(folder.join("old.csv")).unwrap();
    let summary = summarise(folder).unwrap();
    let names: Vec<_> =
        summary.logs.iter().map(|log| log.path.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["a.csv", "b.csv", "c.CSV", "d.csv"]);
    assert_eq!(summary.common_joints, ["b"]);
    assert_eq!(summary.other_joints.iter().map(String::as_str).collect::<Vec<_>>(), ["a", "c"]);
    assert_eq!(summary.robots.len(), 1);
    let rates: Vec<_> = summary.rates.iter().map(|rate| (rate.rate_hz.round(), rate.logs)).collect();
    assert_eq!(rates, [(50.0, 2), (200.0, 1)]);
    assert_eq!(summary.samples, 9);
    assert!((summary.duration_s - (0.0201 + 0.04 + 0.015)).abs() < 1e-12);
    let group = |kind| summary.findings.iter().find(|group| group.kind == kind).unwrap();
    let broken = group(FindingKind::NotFinite);
    assert_eq!((broken.severity, &broken.logs[..]), (Severity::Error, &[0, 1, 2][..]));
    assert_eq!(broken.joints.iter().map(String::as_str).collect::<Vec<_>>(), ["b", "c"]);
    assert_eq!(group(FindingKind::TimeUnit).logs, [2]);
    assert_eq!(summary.findings.last().unwrap().severity, Severity::Note, "the worst come first");
    let LogContent::Unreadable(why) = &summary.logs[3].content else { panic!("{:?}", summary.logs[3]) };
    assert!(why.contains("no column `dq_b`"), "{why}");
    let LogContent::Log { samples: 4, joints: 1, worst: Some(Severity::Error), .. } = summary.logs[2].content
    else {
        panic!("{:?}", summary.logs[2])
    };
}

#[test]
fn no_logs_and_stopping() {
    let folder = tempfile::tempdir().unwrap();
    let error = summarise(folder.path()).unwrap_err().to_string();
    assert!(error.contains("has no *.csv files"), "{error}");
    assert!(matches!(summarise(&folder.path().join("none")), Err(LogError::Io { .. })));
    write(folder.path(), "a.csv", "time,q_a,dq_a\n0,1,2\n0.01,3,4\n");
    let stop = &mut |_, _| ControlFlow::Break(());
    let stopped = summarise_folder(folder.path(), &ReadOptions::default(), &|_| CheckSpec::default(), stop);
    assert!(matches!(stopped, Err(LogError::Stopped)));
}

#[test]
fn what_excite_wrote_is_no_log() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["chirp.csv", "expected.csv", "log.csv"] {
        write(folder.path(), name, "time,q_a,dq_a\n0,1,2\n0.01,3,4\n");
    }
    assert_eq!(csv_files(folder.path()).unwrap().len(), 3, "without the script they may be anything");
    write(folder.path(), "play.py", "");
    assert_eq!(csv_files(folder.path()).unwrap(), [folder.path().join("log.csv")]);
}

#[cfg(unix)]
#[test]
fn links_are_followed_or_named_with_target_and_remedy() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let elsewhere = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write(elsewhere.path(), "real.csv", "time,q_a,dq_a\n0,1,2\n0.01,3,4\n");
    symlink(elsewhere.path().join("real.csv"), at("run.csv")).unwrap();
    assert_eq!(csv_files(folder.path()).unwrap(), [at("run.csv")]);
    for (target, problem) in
        [("gone/x.csv", "does not exist"), (".", "is a folder"), ("loop.csv", "cannot be reached")]
    {
        symlink(target, at("loop.csv")).unwrap();
        let error = csv_files(folder.path()).unwrap_err().to_string();
        for part in ["loop.csv: a link to", target, problem, "delete the link"] {
            assert!(error.contains(part), "{error}");
        }
        // The other logs are still summarised.
        let summary = summarise(folder.path()).unwrap();
        let LogContent::Unreadable(why) = &summary.logs[0].content else { panic!("{summary:?}") };
        assert!(why.contains(problem), "{why}");
        assert_eq!(summary.samples, 2);
        std::fs::remove_file(at("loop.csv")).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_is_named_and_not_opened() {
    let folder = tempfile::tempdir().unwrap();
    let made = std::process::Command::new("mkfifo").arg(folder.path().join("run.csv")).status().unwrap();
    assert!(made.success());
    let error = csv_files(folder.path()).unwrap_err().to_string();
    assert!(error.contains("run.csv: not a regular file"), "{error}");
    let summary = summarise(folder.path()).unwrap();
    assert!(matches!(summary.logs[0].content, LogContent::Unreadable(_)));
}
