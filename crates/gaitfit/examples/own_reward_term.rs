//! A reward term of your own: the robot is paid for keeping its base at 0.30 m. A few iterations of PPO train with it.

use gaitfit_learn::task::{Moment, Task, TaskSettings};
use gaitfit_learn::{Training, TrainingSettings, ppo};
use gaitfit_physics::Preset;

/// exp(−(height − 0.30 m)² / (5 cm)²): 1 at the wanted height.
fn crouch(moment: &Moment<'_>) -> f32 {
    let off = (moment.height - 0.30) / 0.05;
    (-off * off).exp()
}

/// Trains for some iterations and returns what the last one paid for the term, a second.
pub fn train(environments: usize, iterations: u32) -> Result<f64, Box<dyn std::error::Error>> {
    let model = gaitfit::robot::go2()?;
    let task = Task::new(&model, &TaskSettings::default(), Preset::Fast)?.with_term("crouch", 2.0, crouch)?;
    let settings = TrainingSettings { environments, steps: 24, iterations };
    let ppo = ppo::Settings::default();
    let learner = Training::fresh_learner(&task, &ppo, 1)?;
    let mut training = Training::new(&task, None, &settings, learner, 1)?;
    let mut paid = 0.0;
    while !training.finished() {
        let iteration = training.iterate(gaitfit::machine::threads())?;
        let place = task.reward_names().iter().position(|&name| name == "crouch").ok_or("no such term")?;
        paid = iteration.tally.terms[place] / iteration.tally.steps / task.walker.interface.control_dt;
        println!("iteration {}: {paid:.3} a second for crouching", iteration.number);
    }
    Ok(paid)
}

#[allow(dead_code, reason = "the test calls `train`")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    train(512, 20).map(|_| ())
}
