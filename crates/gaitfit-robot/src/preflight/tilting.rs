//! Follows a person who tilts the robot by hand: when a turn begins and ends. Pure: times are given.

use std::time::Duration;

use gaitfit_model::rotation::{Quat, dot};

use super::Heard;
use super::tilt::{Motion, Tilted};
use super::turned::{orientation, turn_between};

/// A turn counts if it is at least this large and is held still, rad: the 20° that the person is asked for.
const ENOUGH: f64 = 0.35;
/// Rate below which the robot counts as still, rad/s: a person holds it.
const STILL: f64 = 0.25;
/// Time for which it must be still.
const HELD: Duration = Duration::from_millis(400);
/// How long a person has for each turn.
const PATIENCE: Duration = Duration::from_secs(30);
/// Min time between two turns, in which the person brings the robot back.
const BETWEEN: Duration = Duration::from_secs(3);

/// The next thing that the person must do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// Hold the robot level and still.
    Level,
    /// Make this turn, and hold it.
    Turn(Motion),
    /// Nothing more: all turns are made.
    Done,
    /// Nothing more: this turn was not made in time.
    TooLate(Motion),
}

/// Follows a person's turns.
#[derive(Clone, Debug)]
pub struct Tilting {
    asked: Asked,
    since: Duration,
    next: usize,
    still_since: Option<Duration>,
    last: Option<(Duration, Quat)>,
    heard: Vec<Heard>,
    turns: Vec<Tilted>,
}

impl Default for Tilting {
    fn default() -> Self {
        Self::new()
    }
}

impl Tilting {
    /// Begins with a robot that is held level.
    pub fn new() -> Self {
        Self {
            asked: Asked::Level,
            since: Duration::ZERO,
            next: 0,
            still_since: None,
            last: None,
            heard: Vec::new(),
            turns: Vec::new(),
        }
    }

    /// Returns what the person must do now.
    pub fn asked(&self) -> Asked {
        self.asked
    }

    /// The turns that were made.
    pub fn turns(self) -> Vec<Tilted> {
        self.turns
    }

    /// A message came.
    pub fn take(&mut self, one: Heard) {
        let Some(q) = orientation(one.state.quaternion) else { return };
        let still = match &self.last {
            Some((before, from)) if one.came > *before => {
                let turn = turn_between(*from, q);
                let seconds = (one.came - *before).as_secs_f64();
                if seconds < 0.02 {
                    // Too short for a rate: noise.
                    None
                } else {
                    Some(dot(turn, turn).sqrt() / seconds < STILL)
                }
            }
            Some(_) => None,
            // The first message: the robot is still until the next one shows a turn.
            None => Some(true),
        };
        // Between such messages the older one stays the reference.
        if let Some(still) = still {
            self.last = Some((one.came, q));
            match still {
                true => drop(self.still_since.get_or_insert(one.came)),
                false => self.still_since = None,
            }
        }
        // The turn is over once it is large enough and the robot is still again.
        if let Asked::Turn(motion) = self.asked {
            self.heard.push(one);
            let begun = self.heard.first().and_then(|first| orientation(first.state.quaternion));
            let turn = begun.map_or([0.0; 3], |from| turn_between(from, q));
            if dot(turn, turn).sqrt() > ENOUGH && self.is_still(one.came) {
                self.turns.push(Tilted { motion, heard: std::mem::take(&mut self.heard) });
                self.next += 1;
                self.ask(Asked::Level, one.came);
            }
        }
        self.advance(one.came);
    }

    /// The time is `now`: a person may be too late.
    pub fn advance(&mut self, now: Duration) {
        let waited = now.saturating_sub(self.since);
        match self.asked {
            Asked::Level if self.next == Motion::ALL.len() => self.ask(Asked::Done, now),
            Asked::Level if waited > BETWEEN && self.is_still(now) => {
                self.ask(Asked::Turn(Motion::ALL[self.next]), now);
            }
            // Nobody holds it still. The next turn is requested all the same.
            Asked::Level if waited > PATIENCE => self.ask(Asked::Turn(Motion::ALL[self.next]), now),
            Asked::Turn(motion) if waited > PATIENCE => self.ask(Asked::TooLate(motion), now),
            _ => {}
        }
    }

    fn is_still(&self, now: Duration) -> bool {
        self.still_since.is_some_and(|since| now.saturating_sub(since) >= HELD)
    }

    fn ask(&mut self, asked: Asked, now: Duration) {
        (self.asked, self.since) = (asked, now);
        self.heard.clear();
    }
}
