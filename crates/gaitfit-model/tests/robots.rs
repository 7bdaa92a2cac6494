//! Robot files of other projects: which are read plainly, which leniently, which are refused and why.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::path::{Path, PathBuf};

use gaitfit_model::{Model, ModelError, ReadOptions, read};

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/robots").join(name)
}

fn robot(name: &str, lenient: bool) -> Result<Model, ModelError> {
    read(&file(name), &ReadOptions { lenient, add_floor: true, ..ReadOptions::default() })
}

/// File, joints, contact pairs with the ground, and how many things were added or mended.
const PLAIN: [(&str, usize, usize, usize); 20] = [
    ("menagerie_anybotics_anymal_c/anymal_c.xml", 12, 44, 1),
    ("menagerie_anybotics_anymal_c/scene.xml", 12, 44, 0),
    ("menagerie_unitree_a1/a1.xml", 12, 37, 1),
    ("menagerie_unitree_a1/scene.xml", 12, 37, 0),
    ("playground_apollo/apollo_mjx_feetonly.xml", 32, 2, 1),
    ("playground_apollo/scene_mjx_feetonly_flat_terrain.xml", 32, 2, 0),
    ("playground_g1/g1_mjx_feetonly.xml", 29, 2, 1),
    ("playground_g1/g1_mjx_feetonly_restricted.xml", 29, 2, 1),
    ("playground_g1/scene_mjx_feetonly_flat_terrain.xml", 29, 2, 0),
    ("playground_go1/go1_mjx.xml", 12, 30, 1),
    ("playground_go1/go1_mjx_feetonly.xml", 12, 4, 1),
    ("playground_go1/go1_mjx_fullcollisions.xml", 12, 30, 1),
    ("playground_go1/scene_mjx_feetonly_flat_terrain.xml", 12, 4, 0),
    ("playground_h1/h1_mjx_feetonly.xml", 19, 6, 1),
    ("playground_spot/spot_mjx.xml", 12, 18, 1),
    ("playground_spot/spot_mjx_feetonly.xml", 12, 4, 1),
    ("playground_t1/t1_mjx_feetonly.xml", 23, 8, 1),
    ("playground_t1/scene_mjx_feetonly_flat_terrain.xml", 23, 8, 0),
    ("urdf/a1.urdf", 12, 13, 1),
    ("urdf/anymal_c.urdf", 12, 13, 6),
];

#[test]
#[ignore = "needs robot files of other projects in ../shared"]
fn shared_robots_that_read_plainly() {
    let mut all = Vec::new();
    for (name, ..) in PLAIN {
        let model = robot(name, false).unwrap_or_else(|error| panic!("{name}: {error}"));
        all.push((name, model.joints.len(), model.pairs.len(), model.changed.len()));
        assert!(model.warnings().is_empty(), "{name}: {:?}", model.warnings());
        assert!(model.left_out().len() < 20, "{name}: {:#?}", model.left_out());
    }
    assert_eq!(all, PLAIN, "{all:?}");
}

#[test]
#[ignore = "needs robot files of other projects in ../shared"]
fn shared_robots_that_are_refused_and_why() {
    for (name, why, warned) in [
        (
            "menagerie_agility_cassie/cassie.xml",
            "\"left-achilles-rod\": ball joints",
            "\"left-achilles-rod\"",
        ),
        (
            "unitree_g1/g1_29dof.xml",
            "25 geoms of the robot are such, 12 others touch the ground",
            "colliding meshes",
        ),
        ("unitree_h1/h1.xml", "\"not_use_body\": a second moving body", "18 colliding meshes"),
    ] {
        let error = robot(name, false).unwrap_err();
        assert!(matches!(error, ModelError::Unsupported { .. }), "{name}: {error}");
        assert!(error.to_string().contains(why), "{name}: {error}");
        let warnings = robot(name, true).unwrap().warnings();
        assert!(warnings.iter().any(|warning| warning.contains(warned)), "{name}: {warnings:?}");
    }
}
