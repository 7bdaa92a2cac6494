//! Policies with a memory: what only a memory can learn, rollouts that updates compute again, resumed trainings.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_learn::ppo::{
    Diagnostics, End, Exploration, Learner, MemorySettings, Recorder, Samples, SamplesError, Settings,
    UpdateError, Widths,
};
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_learn::{Origin, Training, TrainingSettings};
use gaitfit_physics::Preset;
use gaitfit_policy::network::{Cell, Memory, Recurrent, Scratch};
use gaitfit_policy::{Front, Policy};
use gaitfit_policy_files::weights;
use gaitfit_random::{Purpose, Stream};

const WIDTHS: Widths = Widths { observation: 1, critic_observation: 1, action: 1 };
/// Steps of an episode, and of a rollout: episodes end within rollouts, and go on over their ends.
const EPISODE: u32 = 9;
const STEPS: usize = 12;

/// Robots that see a number of 1 or −1 in an episode's first step, and are paid for showing it to its end.
struct Cue {
    cue: Vec<f32>,
    age: Vec<u32>,
    episodes: u32,
}

impl Cue {
    fn new(robots: usize) -> Self {
        let mut cue = Self { cue: vec![0.0; robots], age: vec![0; robots], episodes: 0 };
        for index in 0..robots {
            cue.restart(index);
            cue.age[index] = index as u32 % EPISODE;
        }
        cue
    }

    fn restart(&mut self, index: usize) {
        self.episodes += 1;
        let draw = Stream::new(1, Purpose::RESET).step(self.episodes).uniform_f32(0);
        (self.cue[index], self.age[index]) = (if draw < 0.5 { -1.0 } else { 1.0 }, 0);
    }

    fn observe(&self, rows: &mut [f32]) {
        for ((row, &cue), &age) in rows.iter_mut().zip(&self.cue).zip(&self.age) {
            *row = if age == 0 { cue } else { 0.0 };
        }
    }

    fn step(&mut self, action: &[f32], reward: &mut [f32]) -> Vec<End> {
        let mut ends = Vec::new();
        for (index, reward) in reward.iter_mut().enumerate() {
            *reward = -(action[index] - self.cue[index]).powi(2);
            self.age[index] += 1;
            ends.push(match self.age[index] {
                // Half of the robots are cut off, the others' episodes are over.
                EPISODE.. if index % 2 == 0 => End::Truncated,
                EPISODE.. => End::Terminated,
                _ => End::No,
            });
        }
        ends
    }

    fn rollout(&mut self, learner: &Learner, recorder: &mut Recorder, number: u32) {
        recorder.begin();
        for step in 0..STEPS as u32 {
            let (observation, critic_observation) = recorder.observations();
            self.observe(observation);
            self.observe(critic_observation);
            recorder.act(learner, number * STEPS as u32 + step + 1);
            let (action, reward) = recorder.exchange();
            let ends = self.step(action, reward);
            recorder.end(learner, &ends, |rows| self.observe(rows));
            for (index, _) in ends.iter().enumerate().filter(|(_, end)| **end != End::No) {
                self.restart(index);
            }
        }
        recorder.finish(learner, |rows| self.observe(rows));
    }
}

fn settings(cell: Cell) -> Settings {
    Settings {
        actor_hidden: vec![16],
        critic_hidden: vec![16],
        initial_std: 0.5,
        gamma: 0.9,
        minibatches: 2,
        memory: Some(MemorySettings { cell, width: 12, layers: 1 }),
        ..Settings::default()
    }
}

/// Iterations of the cue's training: the last diagnostics.
fn train(learner: &mut Learner, robots: usize, iterations: u32, threads: usize) -> Diagnostics {
    let mut recorder = Recorder::new(Samples::new(STEPS, robots, WIDTHS), Exploration::new(5, 0));
    let mut cue = Cue::new(robots);
    let mut last = Diagnostics::default();
    for iteration in 0..iterations {
        cue.rollout(learner, &mut recorder, iteration);
        last = learner.update(std::slice::from_mut(&mut recorder.samples), iteration, threads).unwrap();
    }
    last
}

/// Mean squared distance from the cue over an episode, without exploration, for both cues.
fn distance(learner: &Learner) -> f32 {
    let ([mut memory, _], mut scratch) = (learner.blank_memories(2), Scratch::new());
    let (mut sum, mut action) = (0.0, [0.0; 2]);
    for step in 0..EPISODE {
        let seen = if step == 0 { [1.0, -1.0] } else { [0.0; 2] };
        learner.means_with(2, &seen, &mut memory, &mut action, &mut scratch);
        sum += (action[0] - 1.0).powi(2) + (action[1] + 1.0).powi(2);
    }
    sum / (2 * EPISODE) as f32
}

#[test]
fn a_memory_learns_to_show_what_it_saw_and_a_perceptron_cannot() {
    for cell in [Cell::Gru, Cell::Lstm] {
        let mut learner = Learner::new(settings(cell), WIDTHS, 5).unwrap();
        train(&mut learner, 64, 60, 2);
        assert!(distance(&learner) < 0.1, "{cell:?}: {}", distance(&learner));
    }
    // Where all that is seen is 0, the best is to show 0: 8 of 9 steps cost 1.
    let mut learner = Learner::new(Settings { memory: None, ..settings(Cell::Gru) }, WIDTHS, 5).unwrap();
    train(&mut learner, 64, 60, 2);
    assert!(distance(&learner) > 0.8, "{}", distance(&learner));
}

#[test]
fn an_update_computes_the_rollout_again_from_what_was_remembered() {
    for cell in [Cell::Gru, Cell::Lstm] {
        let once = Settings { epochs: 1, minibatches: 1, normalise_observations: true, ..settings(cell) };
        let mut learner = Learner::new(once, WIDTHS, 5).unwrap();
        let mut recorder = Recorder::new(Samples::new(STEPS, 40, WIDTHS), Exploration::new(5, 0));
        let mut cue = Cue::new(40);
        for number in 0..3 {
            cue.rollout(&learner, &mut recorder, number);
            let mut forgetful = recorder.samples.clone();
            let report = learner.update(std::slice::from_mut(&mut recorder.samples), number, 1).unwrap();
            // Before the first step the policy is the one that sampled.
            assert!(report.kl.abs() < 1e-10 && report.approx_kl_k1.abs() < 1e-6, "{cell:?}: {report:?}");
            // From another memory it is another policy.
            let numbers = vec![0.5; forgetful.actor_memory.numbers().len()];
            assert!(forgetful.actor_memory.set_numbers(&numbers));
            let mut other = Learner::new(learner.settings().clone(), WIDTHS, 5).unwrap();
            let report = other.update(&mut [forgetful], number, 1).unwrap();
            assert!(report.kl > 1e-6, "{cell:?}: {report:?}");
        }
    }
}

#[test]
fn neither_threads_nor_the_cut_into_tiles_of_a_rollout_change_a_bit() {
    for cell in [Cell::Gru, Cell::Lstm] {
        let bits = |threads: usize| {
            let mut learner = Learner::new(settings(cell), WIDTHS, 5).unwrap();
            let report = train(&mut learner, 90, 3, threads);
            let memory: Vec<f32> =
                learner.memory_tensors().iter().flat_map(|(_, values)| values.iter().copied()).collect();
            (learner.tensors().map(|(_, values)| values.to_vec()), memory, report)
        };
        let one = bits(1);
        assert!(one.1.iter().any(|&x| x != 0.0));
        for threads in [2, 5] {
            assert!(bits(threads) == one, "{cell:?}, {threads} threads");
        }
    }
}

#[test]
fn samples_that_a_memory_cannot_learn_from_are_refused() {
    let mut learner = Learner::new(settings(Cell::Gru), WIDTHS, 5).unwrap();
    let refuse = |learner: &mut Learner, samples: Samples| {
        let error = learner.update(&mut [samples], 0, 1).unwrap_err();
        (error.to_string(), error)
    };
    let (text, _) = refuse(&mut learner, Samples::new(4, 8, WIDTHS));
    assert!(text.contains("`actor_memory` of tile 0 holds 0 numbers") && text.contains("has 12"), "{text}");
    let with = |robots: usize, of: usize| {
        let mut samples = Samples::new(4, robots, WIDTHS);
        [samples.actor_memory, samples.critic_memory] = learner.blank_memories(of);
        samples
    };
    let (few, other, mut broken) = (with(1, 1), with(8, 7), with(8, 8));
    let mut numbers = broken.critic_memory.numbers();
    numbers[3] = f32::NAN;
    assert!(broken.critic_memory.set_numbers(&numbers));
    let (text, error) = refuse(&mut learner, few);
    assert_eq!(error, UpdateError::Samples(SamplesError::TooFewRobots { robots: 1, minibatches: 2 }));
    assert!(text.contains("whole robots"), "{text}");
    assert!(refuse(&mut learner, other).0.contains("`actor_memory`"));
    assert!(refuse(&mut learner, broken).0.contains("`critic_memory` is NaN"));
    for (memory, word) in [
        (MemorySettings { width: 0, ..MemorySettings::default() }, "`memory.width` is 0: give 1 to 1024"),
        (MemorySettings { layers: 9, ..MemorySettings::default() }, "`memory.layers` is 9: give 1 to 8"),
    ] {
        let error = Settings { memory: Some(memory), ..Settings::default() }.check().unwrap_err();
        assert!(error.to_string().contains(word), "{error}");
    }
}

const TRAINING: TrainingSettings = TrainingSettings { environments: 270, steps: 6, iterations: 4 };

fn scene() -> Task {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    let model = gaitfit_model::read(path.as_ref(), &Default::default()).unwrap();
    let task = TaskSettings { episode_seconds: 0.3, ..TaskSettings::default() };
    Task::new(&model, &task, Preset::Fast).unwrap()
}

fn origin() -> Origin {
    Origin { robot: "go2".to_owned(), model: "m".to_owned(), settings: "s".to_owned(), seed: 7 }
}

fn training<'a>(scene: &'a Task, cell: Cell, from: Option<&Policy>) -> Training<'a> {
    let ppo = Settings {
        normalise_observations: from.is_none(),
        memory: Some(MemorySettings { cell, width: 8, layers: 2 }),
        ..settings(cell)
    };
    let learner = match from {
        None => Training::fresh_learner(scene, &ppo, 7),
        Some(policy) => Training::learner_from(scene, &ppo, policy, 7),
    };
    Training::new(scene, None, &TRAINING, learner.unwrap(), 7).unwrap()
}

#[test]
fn a_training_with_a_memory_resumes_to_the_same_bits() {
    let scene = scene();
    let bytes = |training: &Training<'_>| weights::write(&training.policy("s", "test")).unwrap();
    for cell in [Cell::Gru, Cell::Lstm] {
        let mut whole = training(&scene, cell, None);
        let mut saved = vec![whole.save(&origin(), 0.5).unwrap()];
        while !whole.finished() {
            whole.iterate(2).unwrap();
            saved.push(whole.save(&origin(), 0.5).unwrap());
        }
        for (done, state) in saved.iter().enumerate() {
            let mut resumed = training(&scene, cell, None);
            resumed.restore(state, &origin()).unwrap();
            assert!(resumed.save(&origin(), 0.5).unwrap() == *state, "saved again, it is another checkpoint");
            while !resumed.finished() {
                resumed.iterate(1).unwrap();
            }
            assert!(bytes(&resumed) == bytes(&whole), "{cell:?}, resumed after {done}");
        }
        // As a GPU hands it over: robots, what they remember, and the learner, without a file.
        let (mut from, mut to) = (training(&scene, cell, None), training(&scene, cell, None));
        from.iterate(2).unwrap();
        let tensors: Vec<(String, Vec<f32>)> = from
            .learner()
            .tensors()
            .into_iter()
            .map(|(name, values)| (name.to_owned(), values.to_vec()))
            .chain(from.learner().memory_tensors().into_iter().map(|(name, values)| (name, values.to_vec())))
            .collect();
        let find = |name: &str| tensors.iter().find(|(own, _)| own == name).map(|(_, numbers)| &numbers[..]);
        to.learner_mut().restore(find, &from.learner().scalars()).unwrap();
        to.set_snapshots(1, from.growth(), &from.snapshots()).unwrap();
        let [actor, critic] = from.memories();
        assert!(to.set_memories(&[actor[1..].to_vec(), critic.clone()]).is_err());
        to.set_memories(&[actor.clone(), critic]).unwrap();
        assert!(actor.len() == to.memories()[0].len() && actor.iter().any(|x| *x != 0.0));
        assert_eq!(to.iterate(1).unwrap().tally, from.iterate(2).unwrap().tally);
        assert!(bytes(&to) == bytes(&from), "{cell:?}: handed over, it ends elsewhere");
        // Other recurrent layers do not take it up.
        let other = if cell == Cell::Gru { Cell::Lstm } else { Cell::Gru };
        let error = training(&scene, other, None).restore(&saved[2], &origin()).unwrap_err().to_string();
        assert!(error.contains("adam.first") || error.contains("memory"), "{error}");
    }
}

#[test]
fn a_policy_with_a_memory_is_trained_further_with_its_critic_or_a_new_one() {
    let scene = scene();
    let mut first = training(&scene, Cell::Lstm, None);
    first.iterate(2).unwrap();
    let policy = first.policy("s", "test");
    let read = weights::read(&weights::write(&policy).unwrap()).unwrap();
    assert_eq!(read, policy);
    let shape = |memory: Option<&Recurrent>| memory.map(|memory| (memory.cell, memory.shape().hidden));
    assert_eq!(shape(policy.critic_memory.as_ref()), Some((Cell::Lstm, vec![8, 8])));
    // The settings ask for a GRU; the policy's layers count.
    let mut further = training(&scene, Cell::Gru, Some(&read));
    assert_eq!(further.policy("s", "test").front, policy.front);
    assert_eq!(further.learner().critic_memory(), policy.critic_memory.as_ref());
    further.iterate(2).unwrap();
    let after = further.policy("s", "test");
    assert!(matches!(&after.front, Some(Front::Recurrent(_))) && after.front != policy.front);
    assert_ne!(after.critic_memory, policy.critic_memory);
    let alone = Policy { critic: None, critic_memory: None, critic_normaliser: None, ..policy };
    let mut further = training(&scene, Cell::Gru, Some(&alone));
    assert_eq!(shape(further.learner().critic_memory()), Some((Cell::Lstm, vec![8, 8])));
    further.iterate(2).unwrap();
    assert!(
        further.learner().blank_memories(3).iter().all(|memory: &Memory| memory.environments() == Some(3))
    );
}
