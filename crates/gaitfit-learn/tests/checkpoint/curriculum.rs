//! Commands that grow: when, to what, and over checkpoints.

use super::*;
use gaitfit_learn::task::{CurriculumSettings, Interval};
use gaitfit_learn::{Growth, Tally};

const FIRST: [Interval; 3] = [[-0.1, 0.2], [0.0, 0.0], [-1.0, 1.0]];

/// Ranges begin with [`FIRST`] and grow as `tracking` or `iterations` say.
fn growing(tracking: Option<f64>, iterations: Option<u32>) -> Task {
    scene_with(|task| {
        let [x, y, _] = FIRST;
        task.command.standing = 0.0;
        task.command.curriculum =
            Some(CurriculumSettings { x: Some(x), y: Some(y), yaw: None, tracking, step: 0.4, iterations });
    })
}

/// The ends of what robots are commanded.
fn extremes(training: &mut Training<'_>) -> [Interval; 3] {
    let mut extremes = [[f64::MAX, f64::MIN]; 3];
    for robot in training.snapshots() {
        for ([low, high], command) in extremes.iter_mut().zip(robot.command.map(f64::from)) {
            (*low, *high) = (low.min(command), high.max(command));
        }
    }
    extremes
}

#[test]
fn ranges_go_from_the_first_to_the_last() {
    let scene = growing(None, Some(4));
    let ranges = |iteration| Growth::default().ranges(&scene, iteration);
    assert_eq!(ranges(0), FIRST);
    let half = ranges(2);
    for (k, wanted) in [[-0.55, 0.6], [-0.5, 0.5], [-1.0, 1.0]].into_iter().enumerate() {
        assert!((0..2).all(|end| (half[k][end] - wanted[end]).abs() < 1e-12), "{half:?}");
    }
    assert_eq!([ranges(4), ranges(400)], [[[-1.0, 1.0]; 3]; 2]);
    assert_eq!(Growth::default().level(&self::scene(), 3), None);
}

#[test]
fn robots_are_commanded_what_the_iteration_has() {
    let scene = growing(None, Some(4));
    let mut training = training(&scene);
    let mut widest = Vec::new();
    let first = extremes(&mut training);
    for ([low, high], [least, most]) in first.into_iter().zip(FIRST) {
        assert!(low >= least - 1e-6 && high <= most + 1e-6, "{first:?}");
        assert!(
            most - least < 0.1 || high - low > 0.9 * (most - least),
            "all of a range is drawn: {first:?}"
        );
    }
    while !training.finished() {
        let commands = training.iterate(2).unwrap().commands.unwrap();
        assert_eq!(commands.level, f64::from(training.iteration() - 1) / 4.0);
        assert!(commands.tracking.unwrap() > 0.0);
        let [x, ..] = extremes(&mut training);
        widest.push(x[1]);
    }
    assert!(widest.is_sorted() && widest[0] <= 0.2 + 1e-6 && widest[4] > 0.9, "{widest:?}");
}

/// 6 steps an iteration, commands for 5 steps, episodes of 15.
#[test]
fn ranges_grow_when_tracking_is_good() {
    let scene = growing(Some(0.8), None);
    let place = |name: &str| scene.reward_names().iter().position(|other| *other == name).unwrap();
    let weights: Vec<f32> = scene.reward_weights().map(|(_, weight)| weight).collect();
    // Mean values of the two tracking rewards over 100 steps, and steps that falls left over.
    let tally = |linear: f64, yaw: f64, lost_steps: f64| {
        let mut tally =
            Tally { steps: 100.0, terms: vec![0.0; weights.len()], lost_steps, ..Tally::default() };
        for (name, mean) in [("track_linear_velocity", linear), ("track_yaw_rate", yaw)] {
            tally.terms[place(name)] = f64::from(weights[place(name)]) * 100.0 * mean;
        }
        tally
    };
    let after = |growth: Growth, iteration: u32, steps: usize, tally: &Tally| {
        let mut growth = growth;
        let commands = growth.take(&scene, iteration, steps, tally).unwrap();
        (growth.steps, growth.last, commands.tracking.unwrap())
    };
    let (steps, last, tracking) = after(Growth::default(), 0, 6, &tally(0.9, 0.85, 0.0));
    assert!(
        (steps, last) == (1, 1) && (tracking - 0.85).abs() < 1e-9,
        "the worse of the two counts: {tracking}"
    );
    assert_eq!(after(Growth::default(), 0, 6, &tally(0.9, 0.75, 0.0)).0, 0);
    // 0.9 · 100 / (100 + 25) = 0.72: robots that fall track nothing from then on.
    let (steps, _, tracking) = after(Growth::default(), 0, 6, &tally(0.9, 0.9, 25.0));
    assert!(steps == 0 && (tracking - 0.72).abs() < 1e-9, "{tracking}");
    // Rollouts of 2 steps: all robots have new commands after three of them.
    let good = tally(0.9, 0.9, 0.0);
    let grown = Growth { steps: 1, last: 10 };
    assert_eq!([10, 11, 12].map(|iteration| after(grown, iteration, 2, &good).0), [1, 1, 2]);
    // Three steps of 0.4 are the whole way.
    let full = Growth { steps: 3, last: 0 };
    assert_eq!((full.level(&scene, 50), after(full, 50, 6, &good).0), (Some(1.0), 3));
    assert_eq!(full.ranges(&scene, 50), [[-1.0, 1.0]; 3]);
}

#[test]
fn resumed_with_growing_commands_it_ends_with_the_same_bits() {
    for scene in [growing(Some(0.01), None), growing(None, Some(3))] {
        let mut whole = training(&scene);
        let mut saved = vec![whole.save(&origin(), 0.5).unwrap()];
        let mut iterations = Vec::new();
        while !whole.finished() {
            let iteration = whole.iterate(2).unwrap();
            iterations.push((iteration.tally, iteration.commands));
            saved.push(whole.save(&origin(), 0.5).unwrap());
        }
        let levels: Vec<f64> = iterations.iter().map(|(_, commands)| commands.unwrap().level).collect();
        assert!(levels[0] == 0.0 && levels[4] == 1.0 && levels.is_sorted(), "{levels:?}");
        for (done, bytes) in saved.iter().enumerate() {
            let mut resumed = training(&scene);
            resumed.restore(bytes, &origin()).unwrap();
            assert!(resumed.save(&origin(), 0.5).unwrap() == *bytes, "saved again, it is another checkpoint");
            while !resumed.finished() {
                let iteration = resumed.iterate(1).unwrap();
                let wanted = &iterations[resumed.iteration() as usize - 1];
                assert_eq!(&(iteration.tally, iteration.commands), wanted, "resumed after {done}");
            }
            assert!(policy(&resumed) == policy(&whole), "resumed after {done}");
        }
    }
}

#[test]
fn without_growth_nothing_changes() {
    let scene = scene();
    let plain = training(&scene).save(&origin(), 0.0).unwrap();
    assert!(!plain.windows(6).any(|bytes| bytes == b"growth"), "checkpoints are as they were");
    // Ranges that begin as they end.
    let same = scene_with(|task| task.command.curriculum = Some(toml::from_str("tracking = 0.5").unwrap()));
    let [plain, same] = [scene, same].map(|scene| {
        let mut training = training(&scene);
        (0..2).map(|_| training.iterate(2).unwrap().tally).collect::<Vec<_>>()
    });
    assert_eq!(plain, same);
}

#[test]
fn growth_that_contradicts_itself_is_refused() {
    let model = gaitfit_model::builtin::go2().unwrap();
    for (text, words) in [
        ("x = [-0.1, 0.1]", &["command.curriculum must have one of `tracking` and `iterations`"][..]),
        ("tracking = 0.8\niterations = 10", &["must have one of"]),
        ("tracking = 1.5", &["curriculum.tracking is 1.5", "at most 1"]),
        ("tracking = 0.8\nstep = 0.0", &["curriculum.step is 0"]),
        ("iterations = 0", &["curriculum.iterations is 0"]),
        ("iterations = 9\nx = [-2.0, 0.0]", &["curriculum.x is [-2, 0]", "inside task.command.x, [-1, 1]"]),
        ("iterations = 9\nyaw = [0.5, 0.1]", &["curriculum.yaw is [0.5, 0.1]"]),
        ("iterations = 9\nyaw = [nan, 0.1]", &["curriculum.yaw is [NaN, 0.1]"]),
    ] {
        let mut task = TaskSettings::default();
        task.command.curriculum = Some(toml::from_str(text).unwrap());
        let error = Task::new(&model, &task, Preset::Fast).map(|_| ()).unwrap_err().to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{text}: {error}");
    }
    // Nothing measures tracking.
    let scene = scene_with(|task| {
        task.command.curriculum = Some(toml::from_str("tracking = 0.8").unwrap());
        task.rewards.retain(|name, _| !name.starts_with("track"));
    });
    let learner = Training::fresh_learner(&scene, &ppo::Settings::default(), 7).unwrap();
    let error = Training::new(&scene, None, &SETTINGS, learner, 7).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("command.curriculum.tracking") && error.contains("track_yaw_rate"), "{error}");
}
