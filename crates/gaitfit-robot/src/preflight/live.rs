//! The loops that listen to a robot and move it. Turns come from a clock that is given; [`Beat`] is the real one.

use std::thread::sleep;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::flight::{Flight, Flown};
use super::imu::{self, ImuReport};
use super::joints::{self, JointReport};
use super::network::{self, NetworkReport};
use super::plan::Stage;
use super::tilt::Tilted;
use super::tilting::{Asked, Tilting};
use super::{Finding, Heard};
use crate::RobotError;
use crate::guard::Reason;
use crate::link::{FIRST_STATE, Link, TICK};
use crate::robot::Robot;
use crate::state::{Reading, Seal};

/// The clock of a loop.
pub trait Turns {
    /// Waits for the next turn. Returns the time since the loop began.
    fn next(&mut self) -> Duration;
}

/// Real time: 500 turns a second. Missed turns are left out.
pub struct Beat {
    begin: Instant,
    due: Duration,
}

impl Default for Beat {
    fn default() -> Self {
        Self { begin: Instant::now(), due: Duration::ZERO }
    }
}

impl Turns for Beat {
    fn next(&mut self) -> Duration {
        self.due += TICK;
        sleep(self.due.saturating_sub(self.begin.elapsed()));
        let now = self.begin.elapsed();
        // Turns in a row to catch up would send several commands at once.
        if now > self.due + TICK {
            self.due = now;
        }
        now
    }
}

/// Results of listening.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Listened {
    /// Arrival of states.
    pub network: NetworkReport,
    /// The joints, motor order.
    pub joints: Vec<JointReport>,
    /// The inertial unit; absent if too few states came.
    pub imu: Option<ImuReport>,
    /// Charge of the battery, %; absent where nothing of it is reported.
    pub charge: Option<u8>,
}

impl Listened {
    /// Examines states and returns what is wrong. `simulator`: checksum, counter and battery may be absent.
    pub fn new(heard: &[Heard], others: u64, robot: &Robot, simulator: bool) -> (Self, Vec<Finding>) {
        let mut findings = Vec::new();
        let network = network::network(heard, others);
        network::judge(&network, simulator, &mut findings);
        let mut listened = Self { network, joints: Vec::new(), imu: None, charge: None };
        // With so few states, means and noise would mislead. The network's findings already have this fault.
        if heard.len() < network::FEWEST {
            return (listened, findings);
        }
        listened.charge = heard.last().and_then(|one| one.state.battery).map(|battery| battery.charge);
        joints::judge_battery(heard, robot, simulator, &mut findings);
        listened.joints = joints::joints(heard, robot);
        joints::judge(&listened.joints, heard, robot, simulator, &mut findings);
        let mut unit = imu::imu(heard);
        imu::judge(&mut unit, heard, simulator, &mut findings);
        listened.imu = Some(unit);
        (listened, findings)
    }
}

/// Takes the messages that arrived. Returns how many commands of other programs were seen.
fn receive(
    link: &mut dyn Link,
    now: Duration,
    mut each: impl FnMut(Duration, &Reading),
) -> Result<u64, RobotError> {
    link.receive(now, &mut |age, reading| each(now.saturating_sub(age), reading)).map_err(RobotError::Broken)
}

fn heard_of(came: Duration, reading: &Reading) -> Heard {
    Heard { came, state: reading.state, seal: reading.seal }
}

/// Listens for `length` from the first state on, and sends nothing. Returns the states, and the number of commands of other
/// programs.
///
/// # Errors
/// A link that breaks, states of which a part never came, a reason of `stop`. Silence is no error: then there are no states.
pub fn listen(
    link: &mut dyn Link,
    turns: &mut dyn Turns,
    length: Duration,
    stop: &dyn Fn() -> Option<Reason>,
) -> Result<(Vec<Heard>, u64), RobotError> {
    let (mut heard, mut others) = (Vec::<Heard>::new(), 0);
    loop {
        let now = turns.next();
        // Asked at every turn, so that a person's stop does not wait for the listening to end.
        if let Some(reason) = stop() {
            return Err(RobotError::NotArmed(reason));
        }
        others += receive(link, now, |came, reading| heard.push(heard_of(came, reading)))?;
        let over = match heard.first() {
            Some(first) => now.saturating_sub(first.came) >= length,
            None => now >= FIRST_STATE,
        };
        if over {
            // States of which a part is missing say more than silence.
            if let (true, Some(what)) = (heard.is_empty(), link.lacks()) {
                return Err(RobotError::NotArmed(Reason::Lacks(what)));
            }
            return Ok((heard, others));
        }
    }
}

/// Follows a person who tilts the robot. `ask` gets what the person must do next. Returns the turns.
///
/// # Errors
/// A link that breaks, a reason of `stop`, no state, a turn that nobody made within 30 s.
pub fn tilt(
    link: &mut dyn Link,
    turns: &mut dyn Turns,
    ask: &mut dyn FnMut(Asked),
    stop: &dyn Fn() -> Option<Reason>,
) -> Result<Vec<Tilted>, RobotError> {
    let mut tilting = Tilting::new();
    // The last state counts from 0, so a robot that never sends ends the waiting too.
    let (mut asked, mut last) = (None, Duration::ZERO);
    loop {
        let now = turns.next();
        if let Some(reason) = stop() {
            return Err(RobotError::NotArmed(reason));
        }
        receive(link, now, |came, reading| {
            // A damaged message may hold any orientation.
            if reading.seal != Seal::Wrong {
                tilting.take(heard_of(came, reading));
                last = came;
            }
        })?;
        // A robot that is switched off meanwhile ends the waiting.
        if now.saturating_sub(last) > FIRST_STATE {
            return Err(RobotError::NotArmed(Reason::NoState));
        }
        tilting.advance(now);
        let wanted = tilting.asked();
        if asked != Some(wanted) {
            asked = Some(wanted);
            ask(wanted);
        }
        match wanted {
            Asked::Done => return Ok(tilting.turns()),
            Asked::TooLate(motion) => return Err(RobotError::NotTilted(motion.words())),
            _ => {}
        }
    }
}

/// How long the loop listens to a robot before it arms it.
const BEFORE: Duration = Duration::from_secs(1);

/// Moves a robot that hangs. `report` gets each new stage. Returns what was sent and heard, however the motion ended.
///
/// # Errors
/// A robot that must not be armed; then nothing was sent.
pub fn fly(
    link: &mut dyn Link,
    turns: &mut dyn Turns,
    mut flight: Flight,
    report: &mut dyn FnMut(Stage),
    stop: &dyn Fn() -> Option<Reason>,
) -> Result<Flown, RobotError> {
    let (mut first, mut stage) = (None, Stage::Idle);
    loop {
        let now = turns.next();
        if let Some(reason) = stop() {
            // Nothing was sent yet, so the robot need not be damped.
            if stage == Stage::Idle {
                return Err(RobotError::NotArmed(reason));
            }
            flight.stop(now, reason);
        }
        match receive(link, now, |came, reading| {
            first.get_or_insert(came);
            flight.read(came, reading);
        }) {
            Ok(0) => {}
            Ok(_) => flight.stop(now, Reason::SecondController),
            Err(problem) => flight.stop(now, Reason::Link(problem.to_string())),
        }
        if let Some(what) = link.lacks() {
            flight.lacks(now, what);
        }
        // Before it moves it listens for a while: another controller would show.
        if stage == Stage::Idle {
            match first {
                Some(first) if now.saturating_sub(first) >= BEFORE => flight.arm(now)?,
                None if now >= FIRST_STATE => {
                    let reason = flight.refused().cloned();
                    return Err(RobotError::NotArmed(reason.unwrap_or(Reason::NoState)));
                }
                _ => continue,
            }
        }
        if let Some(command) = flight.tick(now)
            && let Err(problem) = link.send(&command)
        {
            flight.stop(now, Reason::Link(problem));
        }
        // After the command, which may have changed the stage.
        if flight.stage() != stage {
            stage = flight.stage();
            report(stage);
        }
        if flight.is_over(now) {
            return Ok(flight.flown());
        }
    }
}
