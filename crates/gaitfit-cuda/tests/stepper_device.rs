//! Environments on a GPU under actions from outside, against the CPU's.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::rollout_device::along_a_motion;
use gaitfit_cuda::rollout::{RolloutError, Shown, Stepper};
use gaitfit_cuda::runtime::{Buffer, Device};
use gaitfit_learn::task::{Ended, Environment, Task, TaskSettings, TerrainSettings, preset};
use gaitfit_model::Model;
use gaitfit_physics::Preset;
use gaitfit_policy::{Quantity, Term};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::Candidate;

const SEED: u64 = 11;
/// No multiple of a tile's environments.
const ENVIRONMENTS: usize = 301;
const STEPS: u32 = 50;

fn go2() -> Model {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    gaitfit_model::read(path.as_ref(), &Default::default()).unwrap()
}

fn settings(name: &str) -> TaskSettings {
    toml::from_str(preset(name).unwrap()).unwrap()
}

/// Differences of the rows of two arrays, the largest of each, in order of size.
fn differences(got: &[f32], want: &[f32], width: usize, kept: &[bool]) -> Vec<f32> {
    assert_eq!(got.len(), want.len());
    let rows = got.chunks_exact(width).zip(want.chunks_exact(width)).zip(kept);
    let largest = |(got, want): (&[f32], &[f32])| {
        got.iter().zip(want).fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs()))
    };
    let mut all: Vec<f32> = rows.filter(|(_, kept)| **kept).map(|(rows, _)| largest(rows)).collect();
    all.sort_by(f32::total_cmp);
    all
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_steps_under_given_actions_are_the_cpus() {
    let device = Device::open(0).unwrap();
    for name in ["velocity", "biped", "uneven ground", "earlier action", "motion"] {
        let mut settings = settings(if name == "biped" { "biped" } else { "velocity" });
        if name == "uneven ground" {
            settings.terrain = Some(TerrainSettings { levels: 4, columns: 2, ..TerrainSettings::default() });
        }
        if name == "earlier action" {
            settings.policy.observation.insert(0, Term::new(Quantity::EarlierAction));
        }
        // Episodes end by time within the steps.
        settings.episode_seconds = 30.0 * settings.control_dt;
        let task = match name {
            "motion" => along_a_motion(|task| task.clone_from(&settings)),
            _ => Task::new(&go2(), &settings, Preset::Fast).unwrap(),
        };
        let nominal = [Candidate::nominal(&go2())];
        let mut cpu = Environment::new(&task, None, SEED, 0, ENVIRONMENTS).unwrap();
        cpu.stagger();
        let mut gpu = Stepper::new(&device, &task, &nominal, ENVIRONMENTS, SEED, true).unwrap();
        let read = |gpu: &Stepper<'_>, shown| gpu.array(shown).unwrap().read().unwrap();
        let (width, actions) = (task.walker.interface.observation_width(), task.walker.joints.len());
        let mut want = vec![0.0; ENVIRONMENTS * width];
        let mut critic = vec![0.0; ENVIRONMENTS * task.walker.interface.critic_width()];
        cpu.observe(0, &mut want);
        let mut kept = vec![true; ENVIRONMENTS];
        let start = differences(&read(&gpu, Shown::Observation), &want, width, &kept);
        assert!(start[ENVIRONMENTS - 1] < 1e-5, "{name}: starts differ by {}", start[ENVIRONMENTS - 1]);
        let noise = Stream::new(5, Purpose::BOOTSTRAP);
        let buffer = Buffer::<f32>::new(&device, "actions", ENVIRONMENTS * actions).unwrap();
        let (mut ends, mut reward) = (0, vec![0.0; ENVIRONMENTS]);
        for step in 0..STEPS {
            let draw =
                |k: usize| 0.3 * noise.normal(step * (ENVIRONMENTS * actions) as u32 + k as u32) as f32;
            let action: Vec<f32> = (0..ENVIRONMENTS * actions).map(draw).collect();
            buffer.write(gpu.stream(), &action).unwrap();
            let places = [Shown::Observation, Shown::Reward, Shown::Ended]
                .map(|shown| gpu.array(shown).unwrap().address());
            let stepped = gpu.step((&buffer).into()).unwrap();
            let again = [Shown::Observation, Shown::Reward, Shown::Ended]
                .map(|shown| gpu.array(shown).unwrap().address());
            assert_eq!(places, again);
            let mut ended = vec![Ended::No; ENVIRONMENTS];
            cpu.step(step, &action, &mut reward, &mut ended);
            let mut last = vec![0.0; ENVIRONMENTS * width];
            cpu.observe(step + 1, &mut last);
            cpu.begin_episodes(step, &ended);
            cpu.observe(step + 1, &mut want);
            cpu.observe_critic(&mut critic);
            let (fell, late) = (read(&gpu, Shown::Terminated), read(&gpu, Shown::Truncated));
            let any = read(&gpu, Shown::Ended);
            assert_eq!(stepped.ended, any.iter().filter(|&&one| one != 0.0).count());
            assert_eq!(stepped.diverged, 0);
            ends += stepped.ended;
            // A robot that fell in one simulation and not in the other has parted for good.
            for (e, ended) in ended.iter().enumerate() {
                let of = (fell[e] != 0.0, late[e] != 0.0);
                assert_eq!(any[e] != 0.0, of.0 || of.1);
                kept[e] &= of == (matches!(ended, Ended::Fall | Ended::Diverged), *ended == Ended::TimeOut);
            }
            let observations = differences(&read(&gpu, Shown::Observation), &want, width, &kept);
            let rewards = differences(&read(&gpu, Shown::Reward), &reward, 1, &kept);
            let finals: Vec<bool> = kept.iter().zip(&ended).map(|(k, e)| *k && *e != Ended::No).collect();
            let finals = differences(&read(&gpu, Shown::LastObservation), &last, width, &finals);
            let commands = read(&gpu, Shown::Commands);
            for (e, command) in cpu.commands().iter().enumerate().filter(|(e, _)| kept[*e]) {
                assert_eq!(&commands[3 * e..3 * e + 3], command, "{name}, step {step}, environment {e}");
            }
            let at = |all: &[f32], share: f64| all.get((all.len() as f64 * share) as usize).copied();
            if step < 3 || step % 10 == 9 {
                println!(
                    "{name}, step {step}: {} together; observations apart by {:?} (half), {:?} (9 of 10), rewards {:?}, {:?}, \
                     last observations {:?}",
                    observations.len(),
                    at(&observations, 0.5),
                    at(&observations, 0.9),
                    at(&rewards, 0.5),
                    at(&rewards, 0.9),
                    at(&finals, 0.5)
                );
            }
            assert!(
                observations.len() * 100 >= ENVIRONMENTS * 90,
                "{name}, step {step}: {} together",
                observations.len()
            );
            // As robots of other processors do, these drift apart.
            let most = if step < 3 { 5e-3 } else { 0.1 };
            assert!(at(&observations, 0.5).unwrap() < most, "{name}, step {step}");
        }
        assert!(ends > ENVIRONMENTS, "{name}: {ends} episodes ended");
    }
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_actions_are_checked_and_arrays_outlive_the_stepper() {
    let device = Device::open(0).unwrap();
    let task = Task::new(&go2(), &settings("velocity"), Preset::Fast).unwrap();
    let nominal = [Candidate::nominal(&go2())];
    let mut stepper = Stepper::new(&device, &task, &nominal, 5, SEED, false).unwrap();
    let before = stepper.state().unwrap();
    let mut numbers = vec![0.0f32; 5 * 12];
    numbers[2 * 12 + 3] = f32::NAN;
    let wrong = Buffer::from_slice(&device, "actions", &numbers).unwrap();
    let error = stepper.step((&wrong).into()).unwrap_err();
    let said = matches!(&error, RolloutError::Action { environment: 2, joint } if joint == "FR_hip_joint");
    assert!(said, "{error}");
    assert!(stepper.state().unwrap() == before, "a step that was refused has moved robots");
    numbers[2 * 12 + 3] = 1e30;
    let large = Buffer::from_slice(&device, "actions", &numbers).unwrap();
    // The reward for smooth actions overflows.
    let stepped = stepper.step((&large).into()).unwrap();
    assert_eq!((stepped.ended, stepped.diverged, stepper.first_diverged().unwrap()), (1, 1, Some(2)));
    let last = stepper.array(Shown::LastObservation).unwrap();
    let width = last.shape()[1];
    assert!(last.read().unwrap()[2 * width..3 * width].iter().all(|&number| number == 0.0));
    stepper.restart().unwrap();
    assert!(stepper.state().unwrap().0.iter().all(|one| one.steps == 0 && one.robot.fresh));
    let observation = stepper.array(Shown::Observation).unwrap();
    let numbers = observation.read().unwrap();
    drop(stepper);
    assert_eq!(observation.read().unwrap(), numbers);
}
