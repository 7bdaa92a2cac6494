//! A simulator of your own behind the trait: a pendulum. The fit finds its damping and dry friction.

use gaitfit_adapt::cost::{CostKind, Recorded, Reference};
use gaitfit_adapt::fit::{Fit, FitOptions, simulate_one};
use gaitfit_adapt::*;
use gaitfit_physics::JointParameter::{Damping, FrictionLoss};
use std::sync::Arc;

struct Pendulum(Identity);

impl Simulator for Pendulum {
    fn identity(&self) -> &Identity {
        &self.0
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
            let (mut q, mut dq, mut angles, mut velocities) = (1.5, 0.0, Vec::new(), Vec::new());
            for _ in 0..400 {
                angles.push(q as f32);
                velocities.push(dq as f32);
                dq += 0.01 * (-9.81 * f64::sin(q) - damping * dq - friction * f64::tanh(100.0 * dq));
                q += 0.01 * dq;
            }
            consume(number, 0, Signals::of_joints(&angles, &velocities));
        }
        Ok(())
    }
}

/// Fits the pendulum and holds the result against the truth.
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let pendulum = Pendulum(Identity::new(vec!["swing".to_owned()], 1));
    let groups = [("arm".to_owned(), vec!["swing".to_owned()])];
    let theta =
        Theta::from_rules(&[Damping, FrictionLoss].map(ParameterRule::new), &groups, pendulum.joints())?;
    let truth = [0.3, 0.12];
    let log = simulate_one(&pendulum, &theta, &truth, Resets::Never)?.remove(0);
    let recorded = Recorded::of_joints(&log.position, &log.velocity);
    let reference = Arc::new(Reference::new(pendulum.0.joints.clone(), &[recorded], 0)?);
    let costs = [CostKind::Wass.build(&reference, &pendulum)?];
    let mut fit = Fit::new(&pendulum, &theta, &costs, FitOptions::default())?;
    while fit.step(&never)?.is_some() {}
    let values = fit.outcomes()[0].values();
    println!("{values:.4?} for a truth of {truth:?}");
    assert!(values.iter().zip(truth).all(|(value, truth)| (value - truth).abs() < 1e-3));
    Ok(())
}
