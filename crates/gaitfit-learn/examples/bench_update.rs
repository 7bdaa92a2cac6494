//! Times one PPO update and prints the figures as JSON:
//! `cargo run --release -p gaitfit-learn --example bench_update -- [THREADS] [REPEATS]`.
//! 4,096 environments × 24 steps, actor 45-128-128-128-12, critic 48-128-128-128-1, 5 epochs × 4 minibatches.

use gaitfit_learn::ppo::{Settings, Widths, bench};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(|text| text.parse::<usize>());
    let threads = arguments.next().unwrap_or(Ok(2))?;
    let repeats = arguments.next().unwrap_or(Ok(5))?;
    let widths = Widths { observation: 45, critic_observation: 48, action: 12 };
    let timing = bench::time_updates(&Settings::default(), widths, [16, 256, 24], threads, repeats)?;
    println!("{}", serde_json::to_string(&timing)?);
    Ok(())
}
