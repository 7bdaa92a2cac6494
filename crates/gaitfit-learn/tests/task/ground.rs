//! Uneven ground: its heights, where robots start, and heights above it.

use super::task_common::{calm, go2, scene, step};
use gaitfit_learn::task::{
    Cell, Course, Ended, Environment, Kinds, Task, TaskSettings, TerrainKind, TerrainSettings,
};
use gaitfit_model::{HeightField, Model, ReadOptions, Shape, Surface, read_mjcf_str};
use gaitfit_physics::Preset;

/// Three levels of pits and pyramids, small enough for a test.
fn small(kind: TerrainKind) -> TerrainSettings {
    TerrainSettings {
        levels: 3,
        columns: 2,
        size: 4.0,
        border: 1.0,
        step_height: [0.05, 0.15],
        start_level: 2,
        ..TerrainSettings::with_kind(Kinds::One(kind))
    }
}

fn on(terrain: TerrainSettings) -> TaskSettings {
    TaskSettings { terrain: Some(terrain), ..calm() }
}

/// The field's number nearest to x, y.
fn number(field: &HeightField, x: f64, y: f64) -> f64 {
    let [along_x, along_y] = field.steps();
    let column = ((x + field.half_size[0]) / along_x).round() as usize;
    let row = ((y + field.half_size[1]) / along_y).round() as usize;
    field.heights[row * field.columns + column]
}

#[test]
fn steps_and_slopes_have_the_sizes_of_the_settings() {
    let (course, field) = Course::new(&small(TerrainKind::Stairs)).unwrap();
    assert_eq!((field.columns, field.rows), (3 * 80 + 41, 2 * 80 + 41));
    for level in 0..3 {
        let height = [0.05, 0.1, 0.15][level];
        for column in 0..2 {
            let cell = Cell { level, column };
            assert!((course.difficulty(cell) - height).abs() < 1e-12);
            let [x, y] = course.middle(cell);
            // 0.75 m from the middle the first of four steps of 0.3 m begins; the cell ends at 2 m.
            let sign = if column == 0 { -1.0 } else { 1.0 };
            for (out, left) in [(0.0, 4.0), (0.7, 4.0), (0.8, 3.0), (1.0, 3.0), (1.1, 2.0), (1.7, 0.0)] {
                for (dx, dy) in [(out, 0.0), (-out, 0.3), (0.2, -out)] {
                    let found = number(&field, x + dx, y + dy);
                    assert!((found - sign * left * height).abs() < 1e-12, "{cell:?} {out}: {found}");
                }
            }
            // A pit is climbed out of.
            assert_eq!(course.is_pit(cell), column == 0);
        }
    }
    let (course, field) = Course::new(&small(TerrainKind::Slopes)).unwrap();
    let cell = Cell { level: 2, column: 1 };
    let [x, y] = course.middle(cell);
    assert!((number(&field, x, y) - 0.4 * 1.25).abs() < 1e-12);
    assert!((number(&field, x + 1.0, y) - 0.4).abs() < 1e-9, "a slope of 0.4 over the last metre");
    let edge = [0.0, 3.0 * 2.0 + 0.9];
    assert_eq!(number(&field, edge[1], edge[0]), 0.0, "the border is level");
}

#[test]
fn rough_ground_is_its_seeds_and_keeps_its_height() {
    let settings = small(TerrainKind::Rough);
    let (course, field) = Course::new(&settings).unwrap();
    assert_eq!(field, Course::new(&settings).unwrap().1);
    assert_ne!(field, Course::new(&TerrainSettings { seed: 2, ..settings }).unwrap().1);
    for level in 0..3 {
        let cell = Cell { level, column: 0 };
        let [x, y] = course.middle(cell);
        let heights =
            (-38..38).flat_map(|i| (-38..38).map(move |j| (0.05 * f64::from(i), 0.05 * f64::from(j))));
        let heights: Vec<f64> = heights.map(|(dx, dy)| number(&field, x + dx, y + dy)).collect();
        let most = heights.iter().fold(0.0, |most: f64, height| most.max(height.abs()));
        let amplitude = course.difficulty(cell);
        assert!(most <= amplitude && most > 0.9 * amplitude, "level {level}: {most} of {amplitude}");
        let mean = heights.iter().sum::<f64>() / heights.len() as f64;
        assert!(mean.abs() < 0.15 * amplitude, "level {level}: {mean}");
    }
}

#[test]
fn kinds_share_the_columns() {
    let settings: TerrainSettings =
        toml::from_str("kind = { stairs = 2, flat = 1, rough = 1 }\ncolumns = 8").unwrap();
    let (course, _) = Course::new(&settings).unwrap();
    let kinds: Vec<_> = (0..8).map(|column| course.kind(Cell { level: 0, column })).collect();
    let [stairs, flat, rough] = [TerrainKind::Stairs, TerrainKind::Flat, TerrainKind::Rough];
    assert_eq!(kinds, [stairs, stairs, stairs, stairs, flat, flat, rough, rough]);
    let error = toml::from_str::<TerrainSettings>("kind = \"steps\"").unwrap_err().to_string();
    assert!(error.contains("`steps`") && error.contains("flat, slopes, stairs, rough"), "{error}");
    let error = toml::from_str::<TerrainSettings>("kind = { steps = 1 }").unwrap_err().to_string();
    assert!(error.contains("`steps`"), "{error}");
}

/// Robots stand on their cells: the feet touch, at their radius above the numbers of the field.
#[test]
fn robots_start_and_stand_on_their_cells() {
    let model = go2();
    for kind in [TerrainKind::Stairs, TerrainKind::Rough] {
        let settings = on(small(kind));
        let (course, field) = Course::new(settings.terrain.as_ref().unwrap()).unwrap();
        let scene = scene(&settings);
        assert_eq!(scene.walker.model().joints, model.joints);
        let count = 12;
        let mut environment = Environment::new(&scene, None, 3, 0, count).unwrap();
        let levels: Vec<usize> = (0..count).map(|index| environment.cell(index).unwrap().level).collect();
        assert!((0..3).all(|level| levels.contains(&level)), "{levels:?}");
        let mut lowest = f64::INFINITY;
        for number in 1..=60 {
            let (_, ended) = step(&mut environment, number, 0.0);
            assert_eq!(ended, vec![Ended::No; count], "{kind:?}, step {number}");
        }
        for index in 0..count {
            let cell = environment.cell(index).unwrap();
            assert_eq!(cell.column, index % 2);
            let base = &environment.motion().base_position[3 * index..];
            let off: Vec<f64> = (0..2).map(|k| f64::from(base[k]) - course.middle(cell)[k]).collect();
            assert!(off.iter().all(|off| off.abs() < 0.45), "{kind:?} {index}: {off:?}");
            assert!(
                environment.feet(index).iter().filter(|foot| foot.touching).count() >= 3,
                "{kind:?} {index}"
            );
            for foot in environment.feet(index) {
                let [x, y, z] = foot.place.map(f64::from);
                let near = number(&field, x, y);
                let slack = if kind == TerrainKind::Stairs { 2e-3 } else { 0.03 };
                assert!(
                    (z - f64::from(foot.height) - near).abs() < slack,
                    "{kind:?} {index}: {foot:?}, not {near}"
                );
                // Feet of 22 mm sink in by up to 15 mm, as on a plane.
                assert!((0.005..0.035).contains(&foot.height), "{kind:?} {index}: {foot:?}");
            }
            lowest = lowest.min(f64::from(base[2]));
        }
        // In the deepest pit the base is below the world's zero, and the robot has not fallen.
        assert!(kind == TerrainKind::Rough || lowest < -0.2, "{lowest}");
    }
}

#[test]
fn a_snapshot_that_is_refused_changes_nothing() {
    let scene = scene(&on(small(TerrainKind::Stairs)));
    let mut environment = Environment::new(&scene, None, 5, 0, 1).unwrap();
    let before = environment.snapshot(0);
    // Its way fits, and its robot does not.
    let mut other = before.clone();
    other.way[1] += 1.0;
    other.robot.state.pop();
    assert!(environment.set_snapshot(0, &other).is_err());
    assert_eq!(environment.snapshot(0), before);
}

/// The first step of an episode that begins in its midst, far from the origin, is no leap of the feet.
#[test]
fn feet_do_not_come_from_the_origin() {
    let scene = scene(&on(small(TerrainKind::Stairs)));
    let mut environment = Environment::new(&scene, None, 3, 0, 12).unwrap();
    environment.stagger();
    step(&mut environment, 1, 0.0);
    for index in 0..12 {
        assert!(environment.feet(index).iter().all(|foot| foot.speed < 5.0), "{:?}", environment.feet(index));
    }
}

#[test]
fn falls_and_rewards_count_heights_from_the_ground_there() {
    let mut settings = on(small(TerrainKind::Stairs));
    settings.rewards.values_mut().for_each(|weight| *weight = 0.0);
    settings.rewards["height"] = 1.0;
    (settings.start.tilt, settings.start.joint_position) = (0.0, 0.0);
    let paid = |settings: &TaskSettings| {
        let scene = scene(settings);
        let mut environment = Environment::new(&scene, None, 3, 0, 12).unwrap();
        step(&mut environment, 1, 0.0)
    };
    // All stand on level ground, at heights that differ by 0.6 m: all are paid alike.
    let (rewards, ended) = paid(&settings);
    assert!(rewards.iter().all(|reward| (reward - rewards[0]).abs() < 1e-5), "{rewards:?}");
    let flat = paid(&TaskSettings { terrain: None, ..settings.clone() }).0[0];
    assert!((rewards[0] - flat).abs() < 1e-4, "{} and {flat} on a plane", rewards[0]);
    assert_eq!(ended, [Ended::No; 12]);
    // Above the height at which they stand all have fallen.
    settings.fall.height = 0.5;
    assert_eq!(paid(&settings).1, [Ended::Fall; 12]);
}

#[test]
fn an_episode_ends_at_the_edge_of_the_ground() {
    let terrain = TerrainSettings {
        levels: 1,
        columns: 1,
        start_level: 0,
        size: 0.5,
        platform: 0.0,
        ..small(TerrainKind::Flat)
    };
    let mut settings = on(terrain);
    settings.push = gaitfit_learn::task::PushSettings { seconds: 0.02, velocity: 3.0 };
    let scene = scene(&settings);
    let mut environment = Environment::new(&scene, None, 3, 0, 16).unwrap();
    let mut left = 0;
    for number in 1..=20 {
        let (_, ended) = step(&mut environment, number, 0.0);
        for (index, ended) in ended.iter().enumerate() {
            let place = &environment.motion().base_position[3 * index..];
            let outside = place[0].abs().max(place[1].abs()) > 0.75;
            assert!(*ended == Ended::Fall || (*ended == Ended::TimeOut) == outside, "{place:?}: {ended:?}");
            left += usize::from(*ended == Ended::TimeOut);
        }
        environment.begin_episodes(number, &ended);
    }
    assert!(left > 0, "none was pushed to the edge");
}

/// Steps of boxes in the robot's own file: no settings are needed.
#[test]
fn a_robot_files_own_ground_counts() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    let text = std::fs::read_to_string(path).unwrap();
    let step_up = r#"<geom type="box" size="3 3 0.1" pos="0 0 0.05" priority="0"/></worldbody>"#;
    let text = text.replace("</worldbody>", step_up);
    let model = read_mjcf_str(&text, &ReadOptions { lenient: true, ..ReadOptions::default() }).unwrap();
    let task = Task::new(&model, &calm(), Preset::Fast).unwrap();
    let mut environment = Environment::new(&task, None, 3, 0, 2).unwrap();
    for number in 1..=50 {
        let (_, ended) = step(&mut environment, number, 0.0);
        assert_eq!(ended, [Ended::No; 2]);
    }
    for foot in environment.feet(0) {
        assert!(foot.touching && (0.005..0.03).contains(&foot.height) && foot.place[2] > 0.15, "{foot:?}");
    }
    let error = Task::new(&model, &on(small(TerrainKind::Flat)), Preset::Fast).err().unwrap().to_string();
    assert!(error.contains("task.terrain") && error.contains("its own"), "{error}");
}

#[test]
fn what_cannot_be_ground_is_refused_by_setting() {
    let refused = |model: &Model, terrain: TerrainSettings| {
        Task::new(model, &on(terrain), Preset::Fast).err().unwrap().to_string()
    };
    let model = go2();
    let base = || small(TerrainKind::Stairs);
    for (terrain, setting) in [
        (TerrainSettings { size: f64::NAN, ..base() }, "task.terrain.size"),
        (TerrainSettings { levels: 0, ..base() }, "task.terrain.levels"),
        (TerrainSettings { columns: 1_000_000, ..base() }, "task.terrain.columns"),
        (TerrainSettings { step_height: [0.1, -0.1], ..base() }, "task.terrain.step_height"),
        (TerrainSettings { step_depth: [0.0, 0.3], ..base() }, "task.terrain.step_depth"),
        (TerrainSettings { slope: [0.0, f64::INFINITY], ..base() }, "task.terrain.slope"),
        (TerrainSettings { border: 0.2, ..base() }, "task.terrain.border"),
        (
            TerrainSettings {
                kind: Kinds::Shares([(TerrainKind::Flat, 0.0)].into_iter().collect()),
                ..base()
            },
            "task.terrain.kind",
        ),
        (
            TerrainSettings {
                kind: Kinds::Shares([(TerrainKind::Flat, f64::NAN)].into_iter().collect()),
                ..base()
            },
            "task.terrain.kind",
        ),
        (TerrainSettings { levels: 200, columns: 200, ..base() }, "task.terrain.cell"),
        // A foot of the Go2 has a radius of 22 mm.
        (TerrainSettings { cell: 0.04, ..base() }, "task.terrain.cell"),
    ] {
        let error = refused(&model, terrain);
        assert!(error.starts_with(setting), "{setting}: {error}");
    }
    // A flat field has no steps and no drawn heights, whose defaults are shorter than its cells.
    let flat = || TerrainSettings { cell: 1.0, ..small(TerrainKind::Flat) };
    assert!(Course::new(&flat()).is_ok() && Task::new(&model, &on(flat()), Preset::Fast).is_ok());
    // A platform as wide as the area, whose edge of 1.4 m is rounded to whole cells.
    let wide = TerrainSettings { size: 1.4, cell: 1.0, platform: 1.26, ..small(TerrainKind::Slopes) };
    assert!(refused(&model, wide).starts_with("task.terrain.platform"));
    let error = refused(&model, TerrainSettings { cell: 1.0, ..small(TerrainKind::Rough) });
    assert!(error.starts_with("task.terrain.rough_distance"), "{error}");
    let mut boots = model.clone();
    for geom in boots.geoms.iter_mut().filter(|geom| geom.name == "FL_foot") {
        geom.shape = Shape::Box { half_size: [0.03, 0.02, 0.02] };
    }
    let error = refused(&boots, base());
    assert!(error.contains("`FL_foot` is a box") && error.contains("spheres"), "{error}");
    let flat = Task::new(&boots, &calm(), Preset::Fast).unwrap();
    assert!(flat.walker.ground().is_none() && Surface::new(&boots).unwrap().is_none());
}
