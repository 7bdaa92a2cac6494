//! Boxes and height fields as ground: where they are planes, they are a plane's ground; what is not computed is refused.

use gaitfit_model::{Model, ObstacleShape, ReadOptions, SelfContact, Shape, read_mjcf_str};
use gaitfit_physics::{Forward, PhysicsError, Preset, RowKind, Settings, Work, constraint_rows, state_from};

/// A robot of two balls, one on a leg, over a ground.
fn hopper(ground: &str) -> Model {
    let text = format!(
        r#"<mujoco><compiler angle="radian"/>
        <asset>
          <hfield name="level" nrow="5" ncol="6" size="5 5 1 1"/>
          <hfield name="slope" nrow="3" ncol="5" size="5 5 2 1" elevation="0 .25 .5 .75 1  0 .25 .5 .75 1  0 .25 .5 .75 1"/>
        </asset>
        <worldbody>{ground}
          <body pos="0 0 1"><freejoint/><geom name="trunk" size="0.1"/>
            <body><joint name="knee" axis="0 1 0"/><geom name="foot" size="0.05" pos="0.3 0 -0.2" mass="0.2"/></body>
          </body></worldbody></mujoco>"#
    );
    read_mjcf_str(&text, &ReadOptions::default()).unwrap()
}

fn settings(model: &Model) -> Settings {
    Settings::new(&model.options, Preset::Converged)
}

/// Accelerations and the next state with the base at these heights above x = 0.3, y = -0.2 and turned a little.
fn motions(model: &Model, heights: &[f64]) -> Vec<f64> {
    let mut forward = Forward::new(model, &settings(model)).unwrap();
    let mut all = Vec::new();
    for height in heights {
        let qpos = [0.3, -0.2, *height, 0.98, 0.1, -0.1, 0.13, 0.2];
        let found = forward.evaluate(&qpos, &[0.3, -0.4, -0.5, 0.2, 0.1, 0.3, -0.4], &[]).unwrap();
        all.extend(found.qacc.iter().chain(&found.next_qpos).chain(&found.next_qvel));
    }
    all
}

#[test]
fn level_and_sloping_ground_is_a_plane() {
    let cases = [
        (
            r#"<geom type="plane" size="0 0 1"/>"#,
            [r#"<geom type="box" size="5 5 1" pos="0 0 -1"/>"#, r#"<geom type="hfield" hfield="level"/>"#],
            0.0,
        ),
        (
            r#"<geom type="plane" size="0 0 1" pos="0 0 1" euler="0 -0.19739555984988078 0"/>"#,
            [
                r#"<frame pos="0 0 1" euler="0 -0.19739555984988078 0"><geom type="box" size="5 5 1" pos="0 0 -1"/></frame>"#,
                r#"<geom type="hfield" hfield="slope"/>"#,
            ],
            1.06,
        ),
    ];
    for (plane, others, ground) in cases {
        // In the air, one ball in touch, both, and the leg's ball below the surface.
        let heights = [0.6, 0.2, 0.12, 0.08].map(|height| height + ground);
        let want = motions(&hopper(plane), &heights);
        for other in others {
            let model = hopper(other);
            assert_eq!((model.planes.len(), model.obstacles.len(), model.pairs.len()), (0, 1, 2));
            let got = motions(&model, &heights);
            let worst =
                got.iter().zip(&want).map(|(a, b)| (a - b).abs() / b.abs().max(1.0)).fold(0.0, f64::max);
            assert!(worst < 1e-11, "{other}: {worst}");
        }
        let airborne = motions(&hopper(plane), &heights[..1]);
        assert!(
            (airborne[2] + 9.81).abs() < 1.0 && (want[airborne.len() + 2] + 9.81).abs() > 1.0,
            "no contact"
        );
    }
}

/// Parallel rods touch in two points; accelerations of MuJoCo 4.0.0.
#[test]
fn parallel_rods_touch_twice() {
    let text = r#"<mujoco><option timestep="0.005"/><worldbody><body pos="0 0 1">
        <body pos="0 0.05 0"><joint axis="1 0 0" damping="0.1"/>
          <geom type="capsule" size="0.03" fromto="-0.1 0 -0.3 0.1 0 -0.3"/></body>
        <body pos="0.06 -0.05 0"><joint axis="1 0 0"/>
          <geom type="capsule" size="0.03" fromto="-0.1 0 -0.3 0.1 0 -0.3"/></body>
        </body></worldbody></mujoco>"#;
    let model = read_mjcf_str(text, &ReadOptions::default()).unwrap();
    let (model, _) = model.touching_itself(&SelfContact::File).unwrap();
    let mut forward = Forward::new(&model, &settings(&model)).unwrap();
    let state = state_from(forward.tree(), &[-0.07, 0.075], &[-0.3, 0.2]).unwrap();
    let rows = constraint_rows(forward.tree(), forward.params(), &state, &mut Work::new(forward.tree()));
    let points: std::collections::BTreeSet<usize> = rows
        .iter()
        .map(|row| if let RowKind::SelfContact(0, point) = row.kind { point } else { panic!() })
        .collect();
    assert_eq!(points.len(), 2);
    let found = forward.evaluate(&[-0.07, 0.075], &[-0.3, 0.2], &[]).unwrap();
    for (got, want) in found.qacc.iter().zip([44.68554897270969, -37.725605111583356]) {
        assert!((got - want).abs() < 1e-10, "{got}, not {want}");
    }
}

#[test]
fn what_is_not_computed_is_refused() {
    let mut model = hopper(r#"<geom name="step" type="box" size="5 5 1" pos="0 0 -1"/>"#);
    model.geoms[0].shape = Shape::Box { half_size: [0.1; 3] };
    let refused = Forward::new(&model, &settings(&model)).err().unwrap();
    assert!(matches!(&refused, PhysicsError::ObstacleShape { geom, .. } if geom == "trunk"), "{refused}");

    // Cells of 2 and 2.5 m hold balls of up to 1 m.
    let mut model = hopper(r#"<geom name="ground" type="hfield" hfield="level"/>"#);
    model.geoms[1].shape = Shape::Sphere { radius: 1.0 };
    assert!(Forward::new(&model, &settings(&model)).is_ok());
    model.geoms[1].shape = Shape::Sphere { radius: 1.01 };
    let refused = Forward::new(&model, &settings(&model)).err().unwrap();
    assert!(matches!(&refused, PhysicsError::FieldCells { geom, .. } if geom == "foot"), "{refused}");

    let field = |model: &mut Model, change: fn(&mut gaitfit_model::HeightField)| {
        let ObstacleShape::Field(field) = &mut model.obstacles[0].shape else { panic!() };
        change(field);
    };
    for change in [
        (|field| field.rows = 2) as fn(&mut gaitfit_model::HeightField),
        |field| field.heights.truncate(7),
        |field| field.heights[3] = f64::NAN,
        |field| field.half_size[1] = 0.0,
    ] {
        let mut model = hopper(r#"<geom name="ground" type="hfield" hfield="level"/>"#);
        field(&mut model, change);
        let refused = Forward::new(&model, &settings(&model)).err().unwrap();
        assert!(refused.to_string().contains("height field `ground`"), "{refused}");
    }
}

/// Guards look at the greatest heights by blocks of cells. Where blocks begin must not matter: the same hills on grids that
/// begin elsewhere, with a tower far away, give the same motions.
#[test]
fn hills_are_the_same_wherever_their_grid_begins() {
    let step = 0.1;
    let height = |i: i64, j: i64| {
        let tower = if (i, j) == (55, 55) { 5.0 } else { 0.0 };
        tower + 0.3 * ((0.7 * i as f64).sin() * (0.9 * j as f64).cos()).max(0.0)
    };
    let on = |first: [i64; 2]| {
        let mut model = hopper(r#"<geom type="hfield" hfield="level"/>"#);
        for geom in &mut model.geoms {
            geom.shape = Shape::Sphere { radius: 0.05 };
        }
        let (columns, rows) = (80, 90);
        let heights = (0..rows).flat_map(|r| (0..columns).map(move |c| height(first[0] + c, first[1] + r)));
        let half = [columns, rows].map(|count| 0.5 * step * (count - 1) as f64);
        model.obstacles[0].pos = [step * first[0] as f64 + half[0], step * first[1] as f64 + half[1], 0.0];
        model.obstacles[0].shape = ObstacleShape::Field(gaitfit_model::HeightField {
            rows: rows as usize,
            columns: columns as usize,
            half_size: half,
            heights: heights.collect(),
        });
        Forward::new(&model, &settings(&model)).unwrap()
    };
    let mut grids = [[-20, -20], [-19, -18], [-18, -17], [-21, -19]].map(on);
    let mut touched = 0;
    for k in 0..150 {
        let (x, y) = (0.037 * f64::from(k) - 1.0, 0.9 * (0.31 * f64::from(k)).sin());
        for z in [0.06, 0.2, 0.3, 0.34, 0.36, 0.5] {
            let qpos = [x, y, z, 0.98, 0.1, -0.1, 0.13, 0.2];
            let motions = grids.each_mut().map(|grid| {
                grid.evaluate(&qpos, &[0.3, -0.4, -0.5, 0.2, 0.1, 0.3, -0.4], &[]).unwrap().qacc.clone()
            });
            touched += usize::from((motions[0][2] + 9.81).abs() > 2.0);
            for other in &motions[1..] {
                let worst = other.iter().zip(&motions[0]).map(|(a, b)| (a - b).abs() / b.abs().max(1.0));
                let worst = worst.fold(0.0, f64::max);
                assert!(worst < 1e-7, "at {x}, {y}, {z}: {worst}");
            }
        }
    }
    assert!((150..750).contains(&touched), "{touched} of 900");
}
