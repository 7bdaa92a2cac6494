//! Lateness of a loop.

use std::time::Duration;

use serde::Serialize;

/// Max number of times that are kept: more than half an hour at 500 Hz.
const MAX_SAMPLES: usize = 1 << 20;

/// Lateness of each turn of a loop, µs.
#[derive(Clone, Debug, Default)]
pub struct Jitter {
    late: Vec<u32>,
}

/// Lateness of a loop's turns, µs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Lateness {
    /// Half of the turns were no later.
    pub p50: u32,
    /// 99 of 100 were no later.
    pub p99: u32,
    /// The latest.
    pub max: u32,
    /// Turns.
    pub turns: usize,
}

impl Jitter {
    /// A turn that was due at `due` came at `now`.
    pub fn take(&mut self, due: Duration, now: Duration) {
        // A longer run keeps its first turns, so memory stays bounded.
        if self.late.len() < MAX_SAMPLES {
            self.late.push(u32::try_from(now.saturating_sub(due).as_micros()).unwrap_or(u32::MAX));
        }
    }

    /// Quantiles of all turns.
    pub fn lateness(&self) -> Lateness {
        let mut late = self.late.clone();
        late.sort_unstable();
        let at = |part: f64| late.get(((late.len().max(1) - 1) as f64 * part).round() as usize).copied();
        let quantile = |part| at(part).unwrap_or(0);
        Lateness { p50: quantile(0.5), p99: quantile(0.99), max: quantile(1.0), turns: late.len() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_of_all_turns() {
        let mut jitter = Jitter::default();
        assert_eq!(jitter.lateness(), Lateness::default());
        for k in (0..=100).rev() {
            jitter.take(Duration::from_micros(500), Duration::from_micros(500 + 10 * k));
        }
        jitter.take(Duration::from_micros(500), Duration::ZERO);
        assert_eq!(jitter.lateness(), Lateness { p50: 500, p99: 990, max: 1000, turns: 102 });
    }
}
