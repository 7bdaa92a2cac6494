//! `gaitfit forward`: arrays in and out.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, run};
use npyz::WriterBuilder;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

type Arrays = BTreeMap<String, (Vec<u64>, Vec<f64>)>;

fn save(path: &Path, arrays: &Arrays) {
    let mut archive = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    for (name, (shape, values)) in arrays {
        archive.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
        let mut bytes = Vec::new();
        let mut writer =
            npyz::WriteOptions::new().default_dtype().shape(shape).writer(&mut bytes).begin_nd().unwrap();
        writer.extend(values.iter().copied()).unwrap();
        writer.finish().unwrap();
        archive.write_all(&bytes).unwrap();
    }
    archive.finish().unwrap();
}

fn load(path: &Path) -> Arrays {
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let names: Vec<String> = archive.file_names().map(|name| name.unwrap().into_owned()).collect();
    names
        .iter()
        .map(|name| {
            let file = npyz::NpyFile::new(archive.by_name(name).unwrap()).unwrap();
            (
                name.trim_end_matches(".npy").to_owned(),
                (file.shape().to_vec(), file.into_vec::<f64>().unwrap()),
            )
        })
        .collect()
}

/// Two states of the Go2: falling freely high above the ground, at rest and spinning.
fn states() -> Arrays {
    let mut qpos = vec![0.0; 2 * 19];
    let mut qvel = vec![0.0; 2 * 18];
    for row in 0..2 {
        qpos[row * 19 + 2] = 5.0;
        qpos[row * 19 + 3] = 1.0;
        for leg in 0..4 {
            qpos[row * 19 + 7 + 3 * leg + 1] = 0.9;
            qpos[row * 19 + 7 + 3 * leg + 2] = -1.5;
        }
    }
    qvel[18 + 5] = 2.0;
    let zeros = vec![0.0; 2 * 12];
    [("qpos", 19, qpos), ("qvel", 18, qvel), ("ctrl", 12, zeros)]
        .into_iter()
        .map(|(name, width, values)| (name.to_owned(), (vec![2, width], values)))
        .collect()
}

#[test]
fn a_fall_through_the_air_is_what_physics_says() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("states.npz"), folder.path().join("out.npz"));
    save(&input, &states());
    let done = run(&["forward", "assets/go2.xml", input.to_str().unwrap(), output.to_str().unwrap()]);
    assert_eq!(done.status.code(), Some(0), "{}", errors(&done));
    let arrays = load(&output);
    let shapes: Vec<(&str, &[u64])> =
        arrays.iter().map(|(name, (shape, _))| (name.as_str(), &shape[..])).collect();
    let expected: [(&str, &[u64]); 5] = [
        ("M", &[2, 18, 18]),
        ("next_qpos", &[2, 19]),
        ("next_qvel", &[2, 18]),
        ("qacc", &[2, 18]),
        ("qfrc_bias", &[2, 18]),
    ];
    assert_eq!(shapes, expected);
    let mass = &arrays["M"].1;
    for i in 0..18 {
        for j in 0..18 {
            assert!((mass[18 * i + j] - mass[18 * j + i]).abs() < 1e-12);
        }
    }
    assert!((mass[0] - 15.206).abs() < 1e-3, "the linear block is the robot's mass");
    // A robot at rest in the air falls with g and does nothing else.
    let qacc = &arrays["qacc"].1[..18];
    for (index, value) in qacc.iter().enumerate() {
        let expected = if index == 2 { -9.81 } else { 0.0 };
        assert!((value - expected).abs() < 1e-9, "qacc[{index}] = {value}");
    }
    assert!((arrays["qfrc_bias"].1[2] - mass[0] * 9.81).abs() < 1e-9);
}

#[test]
fn wrong_states_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("states.npz"), folder.path().join("out.npz"));
    let refused = |states: &Arrays, words: &[&str]| {
        save(&input, states);
        let done = run(&["forward", "assets/go2.xml", input.to_str().unwrap(), output.to_str().unwrap()]);
        assert_eq!(done.status.code(), Some(1));
        for word in words {
            assert!(errors(&done).contains(word), "`{word}` is not in: {}", errors(&done));
        }
        assert!(!output.exists());
    };
    save(&input, &states());
    let states_file = input.to_str().unwrap();
    let done = run(&["forward", "assets/go2.xml", states_file, states_file]);
    assert_eq!(done.status.code(), Some(2));
    assert!(errors(&done).contains("would replace a file that this command reads"), "{}", errors(&done));
    let mut missing = states();
    missing.remove("ctrl");
    refused(&missing, &["no array `ctrl`", "qpos, qvel"]);
    let mut short = states();
    short.get_mut("qvel").unwrap().0 = vec![3, 12];
    refused(&short, &["qvel has shape [3, 12]", "[2, 18]"]);
    let mut scalar = states();
    *scalar.get_mut("qpos").unwrap() = (vec![], vec![0.0]);
    refused(&scalar, &["qpos has shape []"]);
    let mut nan = states();
    nan.get_mut("qpos").unwrap().1[19 + 4] = f64::NAN;
    refused(&nan, &["qpos[1, 4] is NaN"]);
    let mut flat = states();
    flat.get_mut("qpos").unwrap().1[3] = 0.0;
    refused(&flat, &["row 0", "quaternion"]);
}
