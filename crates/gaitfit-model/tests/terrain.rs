//! Height fields and boxes of the world.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_model::{Ground, Model, ModelError, ObstacleShape, ReadOptions, read, read_mjcf_str};

fn text(asset: &str, ground: &str, geom: &str) -> String {
    format!(
        r#"<mujoco><compiler angle="radian" meshdir="data"/><asset>{asset}</asset><worldbody>{ground}
        <body name="base" pos="0 0 1"><freejoint/><geom name="trunk" {geom}/><body><joint name="knee"/>
        <geom name="foot" size="0.05"/></body></body></worldbody></mujoco>"#
    )
}

const FIELD: &str =
    r#"<hfield name="f" nrow="3" ncol="4" size="3 2 0.5 0.1" elevation="1 2 3 4  5 6 7 8  9 10 11 13"/>"#;
const GROUND: &str = r#"<geom name="ground" type="hfield" hfield="f" pos="1 2 3" friction="0.4" solref="0.01 1" priority="1"/>"#;

fn strict(text: &str) -> Result<Model, ModelError> {
    read_mjcf_str(text, &ReadOptions { add_floor: true, ..Default::default() })
}

fn lenient(text: &str) -> Model {
    read_mjcf_str(text, &ReadOptions { lenient: true, ..Default::default() }).unwrap()
}

#[test]
fn a_height_field_has_its_rows_from_low_to_high_y() {
    let model = strict(&text(FIELD, GROUND, "size=\"0.1\"")).unwrap();
    assert!(model.planes.is_empty() && model.changed.is_empty(), "it is the floor");
    let ObstacleShape::Field(field) = &model.obstacles[0].shape else { panic!("{:?}", model.obstacles) };
    assert_eq!((field.rows, field.columns, field.half_size), (3, 4, [3.0, 2.0]));
    assert_eq!(field.steps(), [2.0, 2.0]);
    // MuJoCo brings elevations to 0 ... 1 in single precision.
    let want = [9, 10, 11, 13, 5, 6, 7, 8, 1, 2, 3, 4].map(|z: i16| f64::from(f32::from(z - 1) / 12.0) * 0.5);
    assert_eq!(field.heights, want);
    assert_eq!((model.obstacles[0].name.as_str(), model.obstacles[0].pos), ("ground", [1.0, 2.0, 3.0]));
    let grounds: Vec<Ground> = model.pairs.iter().map(|pair| pair.ground).collect();
    assert_eq!(grounds, [Ground::Obstacle { obstacle: 0 }; 2]);
    assert_eq!((model.pairs[0].friction[0], model.pairs[0].solref), (0.4, [0.01, 1.0]));
    assert_eq!(model.summary().obstacles, ["ground"]);
    let json = serde_json::to_value(&model.pairs[0]).unwrap();
    assert_eq!(json["plane"]["obstacle"], 0);
}

#[test]
fn a_field_without_elevation_is_level_and_boxes_stand_in_the_world() {
    let level = r#"<hfield name="f" nrow="3" ncol="3" size="1 1 1 1"/>"#;
    let ground = r#"<geom type="hfield" hfield="f"/><geom name="floor" type="plane" size="1 1 1"/>
        <body pos="1 0 0" euler="0 0 1.5707963267948966"><geom name="step" type="box" size="1 2 3" pos="0 1 0"/></body>
        <geom name="sign" type="box" size="1 1 1" contype="4" conaffinity="8"/>"#;
    let model = strict(&text(level, ground, "size=\"0.1\"")).unwrap();
    let ObstacleShape::Field(field) = &model.obstacles[0].shape else { panic!() };
    assert_eq!(field.heights, [0.0; 9]);
    assert_eq!(model.obstacles[1].shape, ObstacleShape::Box { half_size: [1.0, 2.0, 3.0] });
    assert!(model.obstacles[1].pos.iter().zip([0.0, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-15));
    assert_eq!((model.obstacles.len(), model.planes.len(), model.pairs.len()), (2, 1, 6));
    assert!(model.dropped.iter().any(|d| d.what.contains("\"sign\"") && d.why.contains("meets")));
    let json = serde_json::to_value(&model.pairs).unwrap();
    assert!(json.as_array().unwrap().iter().any(|pair| pair["plane"] == 0));
}

#[test]
fn what_touches_no_obstacle_here_is_refused_and_leniently_left_out() {
    for geom in ["type=\"box\" size=\"0.1 0.1 0.1\"", "type=\"cylinder\" size=\"0.1 0.1\""] {
        let step = r#"<geom name="step" type="box" size="1 1 1"/><geom type="plane" size="1 1 1"/>"#;
        let error = strict(&text("", step, geom)).unwrap_err();
        assert!(matches!(error, ModelError::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains("\"trunk\"") && error.to_string().contains("\"step\""), "{error}");
        let model = lenient(&text("", step, geom));
        // Both geoms on the plane, the ball on the box too.
        assert_eq!((model.pairs.len(), model.obstacles.len()), (3, 1));
        assert!(
            model.warnings().iter().any(|warning| warning.contains("\"trunk\"")),
            "{:?}",
            model.warnings()
        );
    }
    assert_eq!(
        strict(&text("", GROUND, "size=\"0.1\"")).unwrap_err().to_string().matches("\"f\"").count(),
        1
    );
    for (asset, what) in [
        (r#"<hfield name="f" file="hills.png" size="1 1 1 1"/>"#, "folder"),
        (r#"<hfield name="f" nrow="2" ncol="9" size="1 1 1 1"/>"#, "2 × 9"),
        (
            r#"<hfield name="f" nrow="3" ncol="3" size="1 1 1 1" elevation="1 1 1 1 1 1 1 1 1e60"/>"#,
            "too large",
        ),
    ] {
        let all = text(asset, GROUND, "size=\"0.1\"");
        let error = strict(&all).unwrap_err();
        assert!(
            matches!(error, ModelError::Unsupported { .. }) && error.to_string().contains(what),
            "{error}"
        );
        assert!(lenient(&all).obstacles.is_empty());
        // A field that nothing uses is no reason to refuse the robot.
        let flat = text(asset, r#"<geom type="plane" size="1 1 1"/>"#, "size=\"0.1\"");
        assert!(strict(&flat).is_ok());
    }
    for asset in [
        r#"<hfield name="f" nrow="3" ncol="3" size="1 1 1 1" elevation="1 2 3"/>"#,
        r#"<hfield name="f" nrow="3" ncol="3" size="1 1 0 1"/>"#,
        r#"<hfield name="f" nrow="3" ncol="3"/>"#,
    ] {
        let error = strict(&text(asset, GROUND, "size=\"0.1\"")).unwrap_err();
        assert!(matches!(error, ModelError::Invalid { .. }), "{error}");
    }
    for (rows, columns) in [(2048, 2048), (i32::MAX, i32::MAX)] {
        let asset = format!(r#"<hfield name="f" nrow="{rows}" ncol="{columns}" size="1 1 1 1"/>"#);
        let error = strict(&text(&asset, GROUND, "size=\"0.1\"")).unwrap_err();
        assert!(matches!(error, ModelError::TooLarge { .. }), "{error}");
    }
}

#[test]
fn heights_come_from_mujocos_binary_files() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("data")).unwrap();
    let asset = r#"<hfield name="f" file="hills.bin" size="1 1 2 1"/>"#;
    let path = folder.path().join("robot.xml");
    std::fs::write(&path, text(asset, GROUND, "size=\"0.1\"")).unwrap();
    let hills = folder.path().join("data/hills.bin");
    let model = || read(&path, &ReadOptions::default());
    assert!(model().unwrap_err().to_string().contains("hills.bin"));
    let mut bytes: Vec<u8> = [3i32, 3].iter().flat_map(|count| count.to_le_bytes()).collect();
    bytes.extend((0..9).flat_map(|z| (z as f32 - 4.0).to_le_bytes()));
    std::fs::write(&hills, &bytes).unwrap();
    let read = model().unwrap();
    let ObstacleShape::Field(field) = &read.obstacles[0].shape else { panic!() };
    assert_eq!((field.heights[0], field.heights[4], field.heights[8]), (0.0, 1.0, 2.0));
    for wrong in [&bytes[..40], &bytes[..4], &[&bytes[..], &[0; 4]].concat()[..], &[0xff; 44][..]] {
        std::fs::write(&hills, wrong).unwrap();
        let error = model().unwrap_err().to_string();
        assert!(error.contains("MuJoCo's format"), "{error}");
    }
}

/// MuJoCo 4.0 gives these numbers for these pictures: the lowest line first, of 16 bits the upper ones, of colours the red.
#[test]
fn heights_come_from_pictures_as_mujoco_reads_them() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("data")).unwrap();
    let asset = r#"<hfield name="f" file="hills.png" size="1 1 255 1"/>"#;
    let path = folder.path().join("robot.xml");
    std::fs::write(&path, text(asset, GROUND, "size=\"0.1\"")).unwrap();
    let hills = folder.path().join("data/hills.png");
    let grey: [u8; 12] = [0, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 255];
    let wanted = [80.0, 90.0, 100.0, 255.0, 40.0, 50.0, 60.0, 70.0, 0.0, 10.0, 20.0, 30.0];
    let write = |color: png::ColorType, depth: png::BitDepth, bytes: &[u8]| {
        let mut encoder = png::Encoder::new(std::fs::File::create(&hills).unwrap(), 4, 3);
        encoder.set_color(color);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(bytes).unwrap();
    };
    let model = || read(&path, &ReadOptions::default());
    for (color, depth, point) in [
        (png::ColorType::Grayscale, png::BitDepth::Eight, (|z| vec![z]) as fn(u8) -> Vec<u8>),
        (png::ColorType::Grayscale, png::BitDepth::Sixteen, |z| vec![z, 200]),
        (png::ColorType::GrayscaleAlpha, png::BitDepth::Eight, |z| vec![z, 77]),
        (png::ColorType::Rgb, png::BitDepth::Eight, |z| vec![z, 200, 40]),
    ] {
        let bytes: Vec<u8> = grey.iter().flat_map(|&z| point(z)).collect();
        write(color, depth, &bytes);
        let read = model().unwrap();
        let ObstacleShape::Field(field) = &read.obstacles[0].shape else { panic!() };
        assert_eq!((field.rows, field.columns), (3, 4));
        let near = field
            .heights
            .iter()
            .zip(wanted)
            .all(|(found, wanted): (&f64, f64)| (found - wanted).abs() < 1e-4);
        assert!(near, "{color:?}: {:?}", field.heights);
    }
    // A picture cut short, none at all, and one with more points than a field may have.
    let whole = std::fs::read(&hills).unwrap();
    for bytes in [&whole[..whole.len() / 2], b"not a picture", &[]] {
        std::fs::write(&hills, bytes).unwrap();
        let error = model().unwrap_err().to_string();
        assert!(error.contains("hills.png"), "{error}");
    }
    let mut large = whole;
    large[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
    // The header's checksum, of 65,536 × 65,536 points.
    let mut crc = 0xffff_ffff_u32;
    for byte in &large[12..29] {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    large[29..33].copy_from_slice(&(!crc).to_be_bytes());
    std::fs::write(&hills, &large).unwrap();
    let error = model().unwrap_err().to_string();
    assert!(error.contains("65536 × 65536") || error.contains("large"), "{error}");
}
