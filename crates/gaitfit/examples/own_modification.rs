//! A modification of your own: one number, the temperature of the gearboxes, changes friction and damping of all joints
//! together. The fit finds it from a log.

use gaitfit::adapt::Opening;
use gaitfit::settings::{self, AdaptConfig};
use gaitfit_adapt::fit::{Fit, FitOptions};
use gaitfit_adapt::{Entry, Modification, Theta, never};
use gaitfit_sim::Candidate;
use std::path::Path;

/// Grease: friction and viscous damping fall with temperature.
#[derive(Debug)]
struct Grease([Entry; 1]);

impl Grease {
    fn new(joints: &[String]) -> Self {
        Self([Entry {
            name: "gearbox_temperature".to_owned(),
            kind: "gearbox_temperature",
            unit: "°C".to_owned(),
            joints: joints.to_vec(),
            lower: 0.0,
            upper: 80.0,
            start: 20.0,
            deviation: 15.0,
        }])
    }
}

impl Modification for Grease {
    fn entries(&self) -> &[Entry] {
        &self.0
    }

    fn apply(&self, values: &[f64], _joints: &[String], candidate: &mut Candidate) {
        let thick = (-(values[0] - 20.0) / 30.0).exp();
        let robot = &mut candidate.robot;
        robot.frictionloss.iter_mut().for_each(|friction| *friction = 0.3 * thick);
        robot.damping.iter_mut().for_each(|damping| *damping = 0.3 * thick);
    }
}

/// Fits the temperature to the log of a clamped Go2.
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = Path::new("examples/go2-demo/adapt.toml");
    let config: AdaptConfig = settings::load(Some(file), &["simulation.timestep=0.005".to_owned()])?;
    let setup = Opening::new(&config, file).open()?;
    let simulator = setup.fit.simulator.as_ref();
    let theta = Theta::new(vec![Box::new(Grease::new(simulator.joints()))])?;
    let options = FitOptions { generations: 12, ..FitOptions::default() };
    let mut fit = Fit::new(simulator, &theta, &setup.costs, options)?;
    while fit.step(&never)?.is_some() {}
    let celsius = fit.outcomes()[0].values()[0];
    println!("the gearboxes are at {celsius:.1} °C");
    assert!(celsius > 0.0 && celsius < 80.0);
    Ok(())
}
