//! A simulator of your own behind the trait: a pendulum in a few lines. The fit finds its damping and dry friction from
//! its angle and velocity alone.

use gaitfit_adapt::cost::{CostKind, Recorded, Reference};
use gaitfit_adapt::fit::{Fit, FitOptions, simulate_one};
use gaitfit_adapt::{
    Cancel, Consume, ParameterRule, Rollout, Signals, Simulator, SimulatorError, Theta, never,
};
use gaitfit_physics::JointParameter;
use std::sync::Arc;

struct Pendulum(Vec<String>);

impl Simulator for Pendulum {
    fn joints(&self) -> &[String] {
        &self.0
    }

    fn recordings(&self) -> usize {
        1
    }

    fn simulate(
        &self,
        _: &Theta,
        all: &[Rollout],
        consume: &Consume<'_>,
        stop: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        for (number, rollout) in all.iter().enumerate().take_while(|_| !stop()) {
            let [damping, friction] = rollout.values[..] else { continue };
            let (mut q, mut dq) = (1.5, 0.0);
            let (mut angles, mut velocities) = (Vec::new(), Vec::new());
            for step in 0..4000 {
                if step % 10 == 0 {
                    angles.push(q as f32);
                    velocities.push(dq as f32);
                }
                dq += 1e-3 * (-9.81 * f64::sin(q) - damping * dq - friction * f64::tanh(100.0 * dq));
                q += 1e-3 * dq;
            }
            consume(number, 0, Signals::of_joints(&angles, &velocities));
        }
        Ok(())
    }
}

/// Fits the pendulum and holds the result against the truth.
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let pendulum = Pendulum(vec!["swing".to_owned()]);
    let rules =
        [ParameterRule::new(JointParameter::Damping), ParameterRule::new(JointParameter::FrictionLoss)];
    let groups = [("arm".to_owned(), vec!["swing".to_owned()])];
    let theta = Theta::from_rules(&rules, &groups, pendulum.joints())?;
    // The "robot": the same pendulum with numbers that the fit does not know.
    let truth = [0.3, 0.12];
    let log = simulate_one(&pendulum, &theta, &truth)?.remove(0);
    let wide = |values: &[f32]| values.iter().map(|&value| f64::from(value)).collect();
    let recorded =
        Recorded { position: wide(&log.position), velocity: wide(&log.velocity), ..Recorded::default() };
    let reference = Arc::new(Reference::new(pendulum.0.clone(), &[recorded], 0)?);
    let costs = [CostKind::Wass.build(&reference, &pendulum)?];
    let mut fit = Fit::new(&pendulum, &theta, &costs, FitOptions::default())?;
    while fit.step(&never)?.is_some() {}
    for (found, truth) in fit.outcomes()[0].values().iter().zip(truth) {
        println!("{found:.4} for a truth of {truth}");
        assert!((found - truth).abs() < 1e-3, "{found} {truth}");
    }
    Ok(())
}
