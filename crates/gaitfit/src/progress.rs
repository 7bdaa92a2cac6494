//! Progress on standard error: a live bar on a terminal, a plain line now and then elsewhere.

use crate::output::note;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Time between plain lines.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// Shows how far a fit is.
pub struct Progress {
    bar: Option<ProgressBar>,
    total: usize,
    /// Generations done before this process (resumed runs) do not count in the time left.
    first: usize,
    begun: Instant,
    evaluations: usize,
    said: Option<Instant>,
}

impl Progress {
    /// Starts at generation `first` of `total`.
    pub fn new(total: usize, first: usize) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = terminal.then(|| {
            let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("{bar:28} {pos}/{len} generations  {msg}") {
                bar.set_style(style);
            }
            bar.set_position(first as u64);
            bar
        });
        Self { bar, total, first, begun: Instant::now(), evaluations: 0, said: None }
    }

    /// Generation `done` is finished, with `evaluations` candidates; `best` says how good it is so far.
    pub fn update(&mut self, done: usize, evaluations: usize, best: &str) {
        self.evaluations += evaluations;
        let seconds = self.begun.elapsed().as_secs_f64().max(1e-9);
        let left = seconds / (done - self.first).max(1) as f64 * self.total.saturating_sub(done) as f64;
        let text =
            format!("{best}  {:.0} evaluations/s  {left:.0} s left", self.evaluations as f64 / seconds);
        match &self.bar {
            Some(bar) => {
                bar.set_position(done as u64);
                bar.set_message(text);
            }
            None if self.said.is_none_or(|said| said.elapsed() >= LINE_EVERY) => {
                self.said = Some(Instant::now());
                note(&format!("generation {done}/{}  {text}", self.total));
            }
            None => {}
        }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
