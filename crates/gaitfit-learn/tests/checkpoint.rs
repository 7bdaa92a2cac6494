//! Checkpoints: what is taken up again goes on with the same bits, and what does not fit is refused.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

#[path = "checkpoint/curriculum.rs"]
mod curriculum;

use gaitfit_learn::task::{
    Ended, Environment, Kinds, Task, TaskSettings, TerrainKind, TerrainSettings, UserTerms,
};
use gaitfit_learn::{CheckpointError, Origin, Tally, Training, TrainingError, TrainingSettings, ppo};
use gaitfit_physics::Preset;
use gaitfit_policy_files::weights;

const SETTINGS: TrainingSettings = TrainingSettings { environments: 270, steps: 6, iterations: 5 };

fn scene() -> Task {
    scene_with(|_| ())
}

fn scene_on(terrain: Option<TerrainSettings>) -> Task {
    scene_with(|task| task.terrain = terrain.clone())
}

fn scene_with(change: impl Fn(&mut TaskSettings)) -> Task {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    let model = gaitfit_model::read(path.as_ref(), &Default::default()).unwrap();
    // Episodes, commands and pushes shorter than the training, so that their clocks matter.
    let mut task = TaskSettings { episode_seconds: 0.3, ..TaskSettings::default() };
    task.command.seconds = 0.1;
    task.push.seconds = 0.2;
    change(&mut task);
    Task::new(&model, &task, Preset::Fast).unwrap()
}

fn training(scene: &Task) -> Training<'_> {
    let ppo = ppo::Settings { normalise_observations: true, ..ppo::Settings::default() };
    let learner = Training::fresh_learner(scene, &ppo, 7).unwrap();
    Training::new(scene, None, &SETTINGS, learner, 7).unwrap()
}

fn origin() -> Origin {
    Origin { robot: "go2".to_owned(), model: "m".to_owned(), settings: "s".to_owned(), seed: 7 }
}

fn policy(training: &Training<'_>) -> Vec<u8> {
    weights::write(&training.policy("s", "test")).unwrap()
}

/// As a GPU hands a training over: robots and learner, without a file.
#[test]
fn handed_over_robot_by_robot_it_ends_with_the_same_bits() {
    let scene = scene();
    let mut whole = training(&scene);
    for _ in 0..2 {
        whole.iterate(2).unwrap();
    }
    let mut other = training(&scene);
    let learner = whole.learner();
    let tensors = learner.tensors();
    let find = |name: &str| tensors.iter().find(|(own, _)| *own == name).map(|(_, numbers)| *numbers);
    other.learner_mut().restore(find, &learner.scalars()).unwrap();
    let snapshots = whole.snapshots();
    assert_eq!(snapshots.len(), SETTINGS.environments);
    assert!(snapshots.iter().any(|one| one.robot.fresh) && snapshots.iter().any(|one| one.returns[1] > 2.0));
    assert!(
        other.set_snapshots(2, whole.growth(), &snapshots[1..]).unwrap_err().to_string().contains("fewer")
    );
    other.set_snapshots(2, whole.growth(), &snapshots).unwrap();
    assert_eq!(other.snapshots(), snapshots);
    assert_eq!(other.iterate(1).unwrap().tally, whole.iterate(2).unwrap().tally);
    assert!(policy(&other) == policy(&whole));
    let mut foreign = snapshots;
    foreign[7].robot.torque.pop();
    assert!(other.set_snapshots(2, whole.growth(), &foreign).is_err());
}

#[test]
fn resumed_after_any_iteration_it_ends_with_the_same_bits() {
    resumes(&scene());
}

#[test]
fn resumed_on_stairs_it_ends_with_the_same_bits() {
    let terrain = TerrainSettings {
        levels: 4,
        columns: 2,
        size: 4.0,
        border: 1.0,
        ..TerrainSettings::with_kind(Kinds::One(TerrainKind::Stairs))
    };
    let tallies = resumes(&scene_on(Some(terrain)));
    // Nobody walks yet: levels sink from their mean of 1.5, episode by episode.
    let means: Vec<f64> = tallies.iter().map(|tally| tally.levels / tally.steps).collect();
    assert!(means[0] > 1.0 && means[0] < 2.0 && means[4] < 0.7 * means[0], "{means:?}");
}

fn resumes(scene: &Task) -> Vec<Tally> {
    let mut whole = training(scene);
    let mut saved = vec![whole.save(&origin(), 0.5).unwrap()];
    let mut tallies = Vec::new();
    assert!(!whole.policy_trained());
    while !whole.finished() {
        tallies.push(whole.iterate(2).unwrap().tally);
        saved.push(whole.save(&origin(), 0.5).unwrap());
    }
    assert!(whole.policy_trained());
    assert!(tallies.iter().any(|tally| tally.episodes > tally.falls), "no episode timed out");
    for (done, bytes) in saved.iter().enumerate() {
        let mut resumed = training(scene);
        assert_eq!(resumed.restore(bytes, &origin()).unwrap(), 0.5);
        assert_eq!(resumed.iteration() as usize, done);
        assert!(resumed.save(&origin(), 0.5).unwrap() == *bytes, "saved again, it is another checkpoint");
        while !resumed.finished() {
            let tally = resumed.iterate(1).unwrap().tally;
            assert_eq!(tally, tallies[resumed.iteration() as usize - 1], "resumed after {done}");
        }
        assert!(policy(&resumed) == policy(&whole), "resumed after {done}");
    }
    tallies
}

#[test]
fn what_does_not_fit_is_refused() {
    let scene = scene();
    let mut training = training(&scene);
    let bytes = training.save(&origin(), 0.0).unwrap();
    for (changed, word) in [
        (Origin { robot: "a1".to_owned(), ..origin() }, "robot `go2`"),
        (Origin { model: "n".to_owned(), ..origin() }, "has changed"),
        (Origin { settings: "t".to_owned(), ..origin() }, "settings"),
        (Origin { seed: 8, ..origin() }, "seed 7"),
    ] {
        let error = training.restore(&bytes, &changed).unwrap_err();
        assert!(error.to_string().contains(word), "{error}");
        assert!(matches!(error, CheckpointError::Foreign(_)));
    }
    for length in (0..bytes.len()).step_by(bytes.len() / 50) {
        let error = training.restore(&bytes[..length], &origin()).unwrap_err();
        assert!(matches!(error, CheckpointError::Damaged(_)), "{length}: {error}");
    }
    // Of another number of robots, under the same name.
    let learner = Training::fresh_learner(&scene, training.learner().settings(), 7).unwrap();
    let settings = TrainingSettings { environments: 200, ..SETTINGS };
    let mut smaller = Training::new(&scene, None, &settings, learner, 7).unwrap();
    assert!(smaller.restore(&bytes, &origin()).is_err());
}

/// A function of the caller may let an episode go on beyond its time.
#[test]
fn episodes_beyond_their_time_are_taken_up_if_a_function_may_make_them() {
    let mut scene = scene_with(|task| task.episode_seconds = 0.04);
    let beyond = {
        let mut environment = Environment::new(&scene, None, 7, 0, 1).unwrap();
        let (mut reward, mut ended) = ([0.0], [Ended::No]);
        for step in 0..4 {
            environment.step(step, &[0.0; 12], &mut reward, &mut ended);
        }
        let saved = environment.save();
        assert!(saved.steps == [4] && environment.restore(&saved).is_err());
        saved
    };
    scene.user_terms = Some(UserTerms::new(|_, _, _| true));
    let mut environment = Environment::new(&scene, None, 7, 0, 1).unwrap();
    environment.restore(&beyond).unwrap();
    assert!(environment.save() == beyond);
}

#[test]
fn a_flipped_bit_anywhere_is_refused() {
    let scene = scene();
    let mut training = training(&scene);
    let bytes = training.save(&origin(), 0.0).unwrap();
    // The length, the metadata with the checksum and some tensors' places; then the tensors, evenly.
    let places = (0..1500).step_by(5).chain((1500..bytes.len()).step_by(bytes.len() / 200));
    for (k, place) in places.enumerate() {
        let mut flipped = bytes.clone();
        flipped[place] ^= 1 << (k % 8);
        let error = training.restore(&flipped, &origin()).unwrap_err();
        assert!(error.to_string().contains("checkpoint"), "bit {} of byte {place}: {error}", k % 8);
    }
    // An edited value, of the same length.
    let text = "\\\"iteration\\\":0";
    let place = bytes.windows(text.len()).position(|window| window == text.as_bytes()).unwrap();
    let mut edited = bytes.clone();
    edited[place + text.len() - 1] = b'3';
    let error = training.restore(&edited, &origin()).unwrap_err().to_string();
    assert!(error.contains("checksum"), "{error}");
    training.restore(&bytes, &origin()).unwrap();
}

/// A few robots that come apart have fallen; more than one in a hundred, and the training ends.
#[test]
fn robots_that_diverge_have_fallen_unless_they_are_many() {
    let scene = scene();
    let mut training = training(&scene);
    let mut robots = training.snapshots();
    let fast = |robots: &mut Vec<_>, which: usize| {
        let robot: &mut gaitfit_learn::task::Snapshot = &mut robots[which];
        robot.robot.state[7] = 2e3;
    };
    // Two of 270, one in each tile.
    [7, 260].into_iter().for_each(|which| fast(&mut robots, which));
    training.set_snapshots(0, training.growth(), &robots).unwrap();
    let tally = training.iterate(2).unwrap().tally;
    assert_eq!((tally.diverged, tally.steps), (2.0, 270.0 * 6.0));
    assert!(tally.falls >= 2.0 && tally.reward.is_finite() && tally.tracking[0] < tally.steps, "{tally:?}");
    let mut robots = training.snapshots();
    let calm = |robot: &gaitfit_sim::RobotState| {
        robot.state.iter().chain(&robot.tracked).all(|x| x.is_finite()) && robot.state[7].abs() < 10.0
    };
    assert!(robots.iter().all(|one| calm(&one.robot)), "they began anew");

    [260, 5, 9].into_iter().for_each(|which| fast(&mut robots, which));
    training.set_snapshots(1, training.growth(), &robots).unwrap();
    let before = policy(&training);
    let error = training.iterate(2).unwrap_err();
    assert!(
        matches!(
            error,
            TrainingError::Diverged { iteration: 1, robots: 3, environment: 5, step: 0, term: None }
        ),
        "{error}"
    );
    assert!(error.to_string().contains("task.substeps"), "{error}");
    assert_eq!(policy(&training), before);
}
