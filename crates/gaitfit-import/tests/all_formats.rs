//! Parquet, Arrow and HDF5, which the feature `all-formats` reads. `tools/make_import_fixtures.py` wrote the files.

#![allow(clippy::unwrap_used)]

use crate::common::{JOINTS, apart, fixture, read};
use crate::formats::{reference, same};
use gaitfit_import::{Options, import};

#[test]
fn every_kind_of_file_gives_the_same_trajectory() {
    for (name, mapping, gains) in [
        ("motion.parquet", "", false),
        ("lists.parquet", JOINTS, false),
        ("motion.arrow", "", false),
        ("lists.arrow", JOINTS, false),
        ("stream.arrow", "", false),
        ("motion.h5", "", true),
    ] {
        let imported = read(name, mapping).unwrap_or_else(|error| panic!("{name}: {error}"));
        same(&imported, true, gains, 0.0);
    }
}

/// Every encoding of numbers gives the same numbers as the CSV file: dictionaries, differences, split bytes, runs of bits,
/// durations.
#[test]
fn encodings_of_parquet_are_read() {
    let read = |name: &str| read(name, "").unwrap().trajectory;
    let (trajectory, want) = (read("kinds.parquet"), read("kinds.csv"));
    assert_eq!((&trajectory.joints, trajectory.rate_hz), (&want.joints, 200.0));
    assert_eq!((&trajectory.position, &trajectory.velocity), (&want.position, &want.velocity));
    assert!(apart(&trajectory.time, &want.time) < 1e-12);
    assert!(want.position.iter().any(|q| *q > 10.0) && want.velocity.contains(&1.0));
}

#[test]
fn one_of_several_episodes_is_named() {
    let rate = "rate_hz = 200\n";
    let error = read("episodes.h5", &format!("{rate}{JOINTS}")).unwrap_err().to_string();
    assert!(
        error.contains("data/demo_0/") && error.contains("data/demo_1/") && error.contains("--take"),
        "{error}"
    );
    for (episode, scale) in [("data/demo_0", 1.0), ("data/demo_1", 0.5)] {
        let mapping = format!("{rate}{JOINTS}[streams]\ntake = ['{episode}']");
        let log = read("episodes.h5", &mapping).unwrap().trajectory;
        let want = reference(&log);
        let scaled = |values: &[f64]| values.iter().map(|value| scale * value).collect::<Vec<_>>();
        assert_eq!(log.position, scaled(&want.position), "{episode}");
        assert_eq!(log.velocity, scaled(&want.velocity));
        assert_eq!(log.action.unwrap(), scaled(want.target.as_ref().unwrap()));
    }
    let error = read("episodes.h5", JOINTS).unwrap_err().to_string();
    assert!(error.contains("same quantity"), "{error}");
    let error =
        read("episodes.h5", &format!("{JOINTS}[streams]\ntake = ['data/demo_0']")).unwrap_err().to_string();
    assert!(error.contains("rate_hz"), "{error}");
}

/// Arrow's files are read as far as they go, Parquet's from their end.
#[test]
fn files_that_were_cut_off() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut");
    let half = |name: &str| {
        let bytes = std::fs::read(fixture(name)).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
        import(&[&path], &Options::default())
    };
    let imported = half("stream.arrow").unwrap();
    assert_eq!(imported.trajectory.len(), 16);
    assert!(imported.report.assumed.iter().any(|line| line.contains("cut off")));
    let error = half("motion.parquet").unwrap_err().to_string();
    assert!(error.contains("cut off") && error.contains("from their end"), "{error}");
}
