//! The whole method on walking logs, as `gaitfit loop` does it: fit, fine-tune, evaluate.
//!
//! Run it from the repository's root: `cargo run --release -p gaitfit --example walking_loop`.

use gaitfit::loop_::{self, Setup};
use gaitfit::settings::{self, LoopConfig};
use gaitfit::watch::{Event, Watch};
use std::ops::ControlFlow;
use std::path::Path;

/// Runs the loop with some changes of the settings. Returns the new policy's file.
pub fn run(root: &Path, changes: &[&str]) -> Result<String, Box<dyn std::error::Error>> {
    let file = root.join("examples/go2-ground/loop.toml");
    let changes: Vec<String> = changes.iter().map(|&change| change.to_owned()).collect();
    let mut config: LoopConfig = settings::load(Some(&file), &changes)?;
    config.name = Some("example".to_owned());
    config.check(&file)?;
    let setup = Setup::open(config, &file, gaitfit::machine::threads())?;

    let callback = |event: Event<'_>| {
        if let Event::Stage(text) | Event::Note(text) = event {
            eprintln!("{text}");
        }
        ControlFlow::Continue(())
    };
    let results = loop_::run(&setup, "example", false, &Watch::new(&callback))?;

    for one in &results.evaluations {
        let evaluation = &one.evaluation;
        let error = evaluation.linear_velocity_error;
        println!("{} on {}: {:.3} ± {:.3} m/s", evaluation.policy, one.on, error.mean, error.ci95);
    }
    Ok(results.policy)
}

#[allow(dead_code, reason = "the test calls `run`")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("the new policy is {}", run(Path::new("."), &[])?);
    Ok(())
}
