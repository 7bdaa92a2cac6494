//! Progress on standard error: a live bar on a terminal, a plain line now and then elsewhere.

use crate::output::{harmless, note};
use gaitfit::watch::Work;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::time::Instant;

/// When plain lines are written.
#[derive(Clone, Copy, Debug)]
pub enum Lines {
    /// At most one in so many seconds.
    Seconds(u64),
    /// So many over the whole.
    Parts(usize),
}

/// Shows how far a run is.
pub struct Progress {
    bar: Option<ProgressBar>,
    /// The counted unit, in the singular.
    what: String,
    total: usize,
    /// Done before this process (resumed runs): these do not count in the time left.
    first: usize,
    /// The parts of the work, in the plural, for the speed.
    parts: String,
    lines: Lines,
    begun: Instant,
    counted: usize,
    said: Option<(Instant, usize)>,
}

impl Progress {
    /// Starts counting.
    pub fn new(work: Work<'_>, lines: Lines) -> Self {
        let Work { what, total, first, parts, .. } = work;
        let terminal = std::io::stderr().is_terminal();
        let bar = terminal.then(|| {
            let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("{bar:28} {prefix} {pos}/{len}  {msg}") {
                bar.set_style(style);
            }
            bar.set_prefix(what.to_owned());
            // A run that resumes begins where it stopped.
            bar.set_position(first as u64);
            bar
        });
        Self {
            bar,
            what: what.to_owned(),
            total,
            first,
            parts: parts.to_owned(),
            lines,
            begun: Instant::now(),
            counted: 0,
            said: None,
        }
    }

    /// `done` are finished, the last one with `counted` parts; `state` says how good it is so far.
    pub fn update(&mut self, done: usize, counted: usize, state: &str) {
        self.counted += counted;
        // The first report may come within one tick of the clock, and the time divides.
        let seconds = self.begun.elapsed().as_secs_f64().max(1e-9);
        let left =
            // By the mean speed of this process. A run that has just resumed has done nothing yet.
            seconds / done.saturating_sub(self.first).max(1) as f64 * self.total.saturating_sub(done) as f64;
        let speed = speed(self.counted as f64 / seconds);
        let state = harmless(state);
        // Searches often converge before their last generation.
        let bound = if self.what == "generation" { "at most " } else { "" };
        let text = format!("{state}  {speed} {}/s  {bound}{} left", self.parts, time(left));
        match &self.bar {
            Some(bar) => {
                bar.set_position(done as u64);
                bar.set_message(text);
            }
            None if self.due(done) => {
                self.said = Some((Instant::now(), done));
                note(&format!("{} {done}/{}  {text}", self.what, self.total));
            }
            None => {}
        }
    }

    fn due(&self, done: usize) -> bool {
        match (self.lines, self.said) {
            (Lines::Seconds(every), said) => said.is_none_or(|(said, _)| said.elapsed().as_secs() >= every),
            (Lines::Parts(parts), said) => {
                let part = |done: usize| parts * done / self.total.max(1);
                // One line, even if several parts were passed at once.
                part(done) > part(said.map_or(self.first, |(_, said)| said)) || done == self.total
            }
        }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// A speed with few digits.
fn speed(speed: f64) -> String {
    if speed < 1e4 { format!("{speed:.0}") } else { format!("{:.0} k", 1e-3 * speed) }
}

/// A time to wait.
fn time(seconds: f64) -> String {
    // Below two minutes, rounding to minutes would be too coarse.
    if seconds < 120.0 { format!("{seconds:.0} s") } else { format!("{:.0} min", seconds / 60.0) }
}
