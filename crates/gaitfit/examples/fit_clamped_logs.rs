//! Fits the simulator to a log of a robot whose base is clamped, as `gaitfit fit` does.
//!
//! Run it from the repository's root: `cargo run --release -p gaitfit --example fit_clamped_logs`.

use gaitfit::adapt::{self, Opening};
use gaitfit::run::RunFolder;
use gaitfit::settings::{self, AdaptConfig};
use gaitfit::watch::{Event, Watch};
use std::ops::ControlFlow;
use std::path::Path;

/// Fits with some changes of the settings, for example `optimizer.generations=5`. Results go into `runs`.
pub fn fit(root: &Path, runs: &Path, changes: &[&str]) -> Result<f64, Box<dyn std::error::Error>> {
    let file = root.join("examples/go2-demo/adapt.toml");
    let changes: Vec<String> = changes.iter().map(|&change| change.to_owned()).collect();
    let config: AdaptConfig = settings::load(Some(&file), &changes)?;
    let mut setup = Opening::new(&config, &file).open()?;

    // One callback hears of progress, and may stop the fit.
    let callback = |event: Event<'_>| {
        if let Event::Step(step) = event {
            eprintln!("generation {}: {}", step.done, step.state);
        }
        ControlFlow::Continue(())
    };
    let folder = RunFolder::fresh(runs, "example")?;
    let results = adapt::fit(&mut setup, &folder, &Watch::new(&callback))?;

    for parameter in &results.parameters {
        let estimate = &parameter.found;
        println!("{} = {:.4} {}", estimate.name, estimate.value, estimate.unit);
    }
    println!("cost {:.5}, report {}/report.html", results.cost, results.run_folder);
    Ok(results.cost)
}

#[allow(dead_code, reason = "the test calls `fit`")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    fit(Path::new("."), Path::new("runs"), &["optimizer.seeds=2"]).map(|_| ())
}
