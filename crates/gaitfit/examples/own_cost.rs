//! A cost of your own: how far the root mean squares of the joint velocities are from the robot's.

use gaitfit::adapt::Opening;
use gaitfit::settings::{self, AdaptConfig};
use gaitfit_adapt::{Signals, cost::*, fit::*, never};
use std::path::Path;

/// The robot's root mean squares, one a joint, rad/s.
struct Energy(Vec<f64>);

impl Cost for Energy {
    fn name(&self) -> &str {
        "energy"
    }

    fn lost(&self) -> f64 {
        self.0.len() as f64
    }

    fn begin(&self) -> Box<dyn Accumulator + '_> {
        Box::new(Sums(&self.0, 0.0))
    }
}

struct Sums<'a>(&'a [f64], f64);

impl Accumulator for Sums<'_> {
    fn add(&mut self, _recording: usize, simulated: Signals<'_>) -> Result<(), CostError> {
        let wide: Vec<f64> = simulated.velocity.iter().map(|&x| f64::from(x)).collect();
        let pairs = rms(&wide, self.0.len()).zip(self.0);
        self.1 += pairs.map(|(simulated, robot)| (simulated / robot - 1.0).abs()).sum::<f64>();
        Ok(())
    }

    fn finish(&mut self) -> Result<Breakdown, CostError> {
        Ok(Breakdown::of_total(std::mem::take(&mut self.1)))
    }
}

/// The root mean square of each column.
fn rms(rows: &[f64], columns: usize) -> impl Iterator<Item = f64> {
    let square = move |column| rows.iter().skip(column).step_by(columns).map(|x| x * x).sum::<f64>();
    (0..columns).map(move |column| (square(column) * columns as f64 / rows.len() as f64).sqrt())
}

/// Fits a clamped Go2 with the cost, which falls.
pub fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = Path::new("examples/go2-demo/adapt.toml");
    let config: AdaptConfig = settings::load(Some(file), &["simulation.timestep=0.005".to_owned()])?;
    let setup = Opening::new(&config, file).open()?;
    let robot = rms(&setup.fit.logs[0].trajectory.velocity, setup.fit.reference.joints().len());
    let costs: [Box<dyn Cost>; 1] = [Box::new(Energy(robot.collect()))];
    let few = FitOptions { generations: 15, ..FitOptions::default() };
    let mut fit = Fit::new(setup.fit.simulator.as_ref(), &setup.theta, &costs, few)?;
    let first = fit.step(&never)?.ok_or("no generation")?;
    while fit.step(&never)?.is_some() {}
    assert!(fit.outcomes()[0].best_cost < 0.7 * first.runs[0].best);
    Ok(())
}
