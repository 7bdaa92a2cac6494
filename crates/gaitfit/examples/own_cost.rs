//! A cost of your own: how far the root mean squares of the joint velocities are from the robot's. It knows neither time
//! nor distributions. A clamped Go2 is fitted with it.

use gaitfit::adapt::Setup;
use gaitfit::settings::{self, AdaptConfig};
use gaitfit_adapt::cost::{Accumulator, Breakdown, Cost, CostError};
use gaitfit_adapt::fit::{Fit, FitOptions};
use gaitfit_adapt::{Signals, never};
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
        self.1 += rms(&wide, self.0.len())
            .zip(self.0)
            .map(|(found, robot)| (found / robot - 1.0).abs())
            .sum::<f64>();
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

/// Fits with the cost. Returns its best value after one generation and at the end.
pub fn run(root: &Path) -> Result<[f64; 2], Box<dyn std::error::Error>> {
    let file = root.join("examples/go2-demo/adapt.toml");
    let config: AdaptConfig = settings::load(Some(&file), &["simulation.timestep=0.005".to_owned()])?;
    let setup = Setup::open(&config, &file, None)?;
    let simulator = setup.fit.simulator.as_ref();
    let robot = rms(&setup.fit.logs[0].trajectory.velocity, simulator.joints().len()).collect();
    let costs: [Box<dyn Cost>; 1] = [Box::new(Energy(robot))];
    let options = FitOptions { generations: 15, seeds: vec![1], ..FitOptions::default() };
    let mut fit = Fit::new(simulator, &setup.theta, &costs, options)?;
    let first = fit.step(&never)?.ok_or("no generation")?.runs[0].best;
    while fit.step(&never)?.is_some() {}
    println!("cost {first:.4} after one generation, {:.4} at the end", fit.outcomes()[0].best_cost);
    Ok([first, fit.outcomes()[0].best_cost])
}

#[allow(dead_code, reason = "the test calls `run`")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    run(Path::new(".")).map(|_| ())
}
