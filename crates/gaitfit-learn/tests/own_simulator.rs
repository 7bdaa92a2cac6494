//! PPO on samples of a simulator that is not ours: a mass on a line that is to be brought to rest at 0.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_learn::ppo::{End, Exploration, Learner, Recorder, Samples, Settings, Widths};
use gaitfit_policy::network::Scratch;
use gaitfit_random::{Purpose, Stream};

const MASSES: usize = 32;
const STEPS: usize = 32;
/// Time step, s.
const DT: f32 = 0.1;
/// Steps of an episode.
const EPISODE: u32 = 60;

/// Masses of 1 kg, each with its place (m), velocity (m/s) and age (steps).
struct Line {
    masses: Vec<(f32, f32, u32)>,
    episodes: u32,
}

impl Line {
    fn new() -> Self {
        let mut line = Self { masses: vec![(0.0, 0.0, 0); MASSES], episodes: 0 };
        (0..MASSES).for_each(|index| line.restart(index));
        line
    }

    fn restart(&mut self, index: usize) {
        self.episodes += 1;
        let draw = Stream::new(1, Purpose::RESET).step(self.episodes).uniform_f32(0);
        self.masses[index] = (2.0 * draw - 1.0, 0.0, 0);
    }

    fn observe(&self, rows: &mut [f32]) {
        for (row, &(place, velocity, _)) in rows.chunks_exact_mut(2).zip(&self.masses) {
            row.copy_from_slice(&[place, velocity]);
        }
    }

    /// Pushes each mass with its force, N; pays for being near 0 and slow.
    fn step(&mut self, forces: &[f32], rewards: &mut [f32]) -> Vec<End> {
        let one = |((mass, force), reward): ((&mut (f32, f32, u32), &f32), &mut f32)| {
            let force = force.clamp(-3.0, 3.0);
            mass.1 += force * DT;
            mass.0 += mass.1 * DT;
            mass.2 += 1;
            *reward = -DT * (mass.0 * mass.0 + 0.1 * mass.1 * mass.1 + 0.01 * force * force);
            match *mass {
                (place, _, _) if place.abs() > 3.0 => End::Terminated,
                (_, _, EPISODE..) => End::Truncated,
                _ => End::No,
            }
        };
        self.masses.iter_mut().zip(forces).zip(rewards).map(one).collect()
    }
}

#[test]
fn a_mass_learns_to_come_to_rest() {
    let settings = Settings {
        actor_hidden: vec![32],
        critic_hidden: vec![32],
        gamma: 0.95,
        initial_std: 0.5,
        ..Settings::default()
    };
    let widths = Widths { observation: 2, critic_observation: 2, action: 1 };
    let mut learner = Learner::new(settings, widths, 5).unwrap();
    let mut recorder = Recorder::new(Samples::new(STEPS, MASSES, widths), Exploration::new(5, 0));
    let mut line = Line::new();
    let mut paid = Vec::new();
    for iteration in 0..60 {
        recorder.begin();
        let mut sum = 0.0;
        for step in 0..STEPS as u32 {
            let (observation, critic_observation) = recorder.observations();
            line.observe(observation);
            line.observe(critic_observation);
            recorder.act(&learner, iteration * STEPS as u32 + step + 1);
            let (forces, rewards) = recorder.exchange();
            let ends = line.step(forces, rewards);
            sum += rewards.iter().sum::<f32>();
            recorder.end(&learner, &ends, |rows| line.observe(rows));
            for (index, _) in ends.iter().enumerate().filter(|(_, end)| **end != End::No) {
                line.restart(index);
            }
        }
        recorder.finish(&learner, |rows| line.observe(rows));
        learner.update(std::slice::from_mut(&mut recorder.samples), iteration, 1).unwrap();
        paid.push(sum / (STEPS * MASSES) as f32);
    }
    let mean = |paid: &[f32]| paid.iter().sum::<f32>() / paid.len() as f32;
    let (before, after) = (mean(&paid[..5]), mean(&paid[55..]));
    assert!(after > 0.5 * before, "pay went from {before} to {after}");

    // Without exploration a mass at 0.8 m stands near 0 after six seconds.
    let (mut place, mut velocity, mut force, mut scratch) = (0.8f32, 0.0f32, [0.0], Scratch::new());
    for _ in 0..60 {
        learner.means(1, &[place, velocity], &mut force, &mut scratch);
        velocity += force[0].clamp(-3.0, 3.0) * DT;
        place += velocity * DT;
    }
    assert!(place.abs() < 0.1 && velocity.abs() < 0.1, "it stands at {place} m with {velocity} m/s");
}

/// A critic of bias 2 alone, so that every state is worth 2.
#[test]
fn what_is_cut_off_is_paid_by_the_critic_and_what_is_over_is_not() {
    let settings =
        Settings { actor_hidden: vec![], critic_hidden: vec![], gamma: 0.5, ..Settings::default() };
    let widths = Widths { observation: 1, critic_observation: 1, action: 1 };
    let (actor, critic) = settings.shapes(widths).unwrap();
    let network =
        |shape, parameters: &[f32]| gaitfit_policy::network::Network::new(shape, parameters).unwrap();
    let networks = (network(actor, &[0.0, 0.0]), network(critic, &[0.0, 2.0]));
    let learner = Learner::with_networks(settings, widths, 1, networks.0, networks.1, vec![0.0]).unwrap();
    let mut recorder = Recorder::new(Samples::new(1, 3, widths), Exploration::new(1, 0));
    recorder.begin();
    recorder.act(&learner, 1);
    recorder.exchange().1.copy_from_slice(&[1.0, 10.0, 100.0]);
    recorder.end(&learner, &[End::No, End::Truncated, End::Terminated], |rows| rows.fill(7.0));
    recorder.finish(&learner, |rows| rows.fill(7.0));
    // γ V = 0.5 · 2.
    assert_eq!(recorder.samples.reward, [1.0, 11.0, 100.0]);
    assert_eq!(recorder.samples.done, [0.0, 1.0, 1.0]);
    assert_eq!((&recorder.samples.value, &recorder.samples.last_value), (&vec![2.0; 3], &vec![2.0; 3]));
}
