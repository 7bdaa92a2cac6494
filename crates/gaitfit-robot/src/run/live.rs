//! A run on the clock: each loop on a thread of its own.

use std::sync::{Mutex, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::board::Board;
use super::controller::Controller;
use super::delay::Delay;
use super::jitter::{Jitter, Lateness};
use super::sender::Sender;
use crate::RobotError;
use crate::guard::{Limits, Reason};
use crate::link::{FIRST_STATE, TICK};
use crate::state::RobotState;
use crate::supervisor::Phase;

/// How long to listen for other controllers before arming.
const LISTEN: Duration = Duration::from_secs(1);

/// Callbacks to the person beside the robot, and settings of a run.
pub struct Live<'a> {
    /// Asked once, when the robot is heard: whether to arm it. `false` ends the run.
    pub confirm: &'a mut dyn FnMut(&RobotState) -> bool,
    /// Told of each new phase.
    pub phase: &'a mut dyn FnMut(Phase),
    /// Asked all the time: a reason to stop.
    pub stop: &'a (dyn Fn() -> Option<Reason> + Sync),
    /// The policy's control period.
    pub control: Duration,
    /// Whether the program has real-time priority ([`real_time`]), for the summary.
    pub real_time: bool,
    /// The robot's limits, for the measurement of the delay.
    pub limits: Limits,
}

/// Asks the system for real-time priority, for this thread and those that it starts from now on: `false` where it refuses,
/// as it does without the right to (on Linux `CAP_SYS_NICE`, or `rtprio` in limits.conf).
pub fn real_time() -> bool {
    #[cfg(target_os = "linux")]
    {
        use thread_priority::{
            RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
            set_thread_priority_and_policy, thread_native_id,
        };
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        // The middle of Linux's range, 1 to 99.
        let Ok(value) = ThreadPriorityValue::try_from(50u8) else { return false };
        set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy)
            .is_ok()
    }
    #[cfg(not(target_os = "linux"))]
    thread_priority::set_current_thread_priority(thread_priority::ThreadPriority::Max).is_ok()
}

/// Summary of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The reason for damping; `None`: the robot walked to the end and lay down.
    pub reason: Option<String>,
    /// Whether it was armed.
    pub armed: bool,
    /// Whether the program had real-time priority.
    pub real_time: bool,
    /// Messages of the robot.
    pub states: u64,
    /// Messages while armed.
    pub armed_states: u64,
    /// Its rate, Hz, from the first to the last.
    pub state_hz: f64,
    /// Longest time between two messages while armed, ms.
    pub longest_gap_ms: f64,
    /// Commands sent.
    pub commands: u64,
    /// Outputs of the policy.
    pub outputs: u64,
    /// Whether it was a dry run: everything was computed and nothing sent.
    pub dry_run: bool,
    /// Commands while walking that the guard changed; none of a dry run, whose robot does not do what it is told.
    pub clamped: Option<u64>,
    /// Age of the state at the policy's outputs: mean, ms.
    pub state_age_ms: f64,
    /// The greatest, ms.
    pub oldest_state_ms: f64,
    /// Lateness of the loop that sends, µs.
    pub send_late_us: Lateness,
    /// Lateness of the policy's loop, µs.
    pub control_late_us: Lateness,
    /// Time from a command to a state with its torque in it.
    pub delay: Option<Delay>,
}

/// Runs until the walk is over, or something stops it.
///
/// # Errors
/// No state within 15 s, what keeps the robot from being armed, logs that cannot be written before it moves.
pub fn live(
    sender: Sender<'_>,
    mut controller: Controller<'_>,
    ask: Live<'_>,
) -> Result<Summary, RobotError> {
    let begin = Instant::now();
    // Two loops share only the board: the one that sends must never wait for policy or disk.
    let board = Mutex::new(Board::default());
    let ended = Mutex::new(false);
    let (stop, over, real_time) = (ask.stop, &ended, ask.real_time);
    std::thread::scope(|scope| {
        let sending = std::thread::Builder::new()
            .name("send".to_owned())
            .spawn_scoped(scope, || send(sender, begin, &board, over, stop))
            .map_err(|error| RobotError::Thread(error.to_string()))?;
        let done = control(&mut controller, begin, &board, ask);
        // Whatever the outcome: the sending loop ends only by this.
        *lock(&ended) = true;
        let Ok(sender) = sending.join() else {
            return Err(RobotError::Thread("the loop that sends ended by itself".to_owned()));
        };
        let (armed, jitter, limits) = done?;
        let board = lock(&board);
        let count = controller.outputs.max(1) as f64;
        Ok(Summary {
            reason: board.reason.as_ref().map(ToString::to_string),
            armed,
            real_time,
            states: sender.states,
            armed_states: sender.armed_states,
            state_hz: sender.state_hz(),
            longest_gap_ms: 1e3 * sender.longest_gap.as_secs_f64(),
            commands: sender.commands,
            outputs: controller.outputs,
            dry_run: sender.is_dry(),
            clamped: (!sender.is_dry()).then_some(sender.clamped),
            state_age_ms: 1e3 * controller.ages.0 / count,
            oldest_state_ms: 1e3 * controller.ages.1,
            send_late_us: sender.jitter.lateness(),
            control_late_us: jitter.lateness(),
            delay: sender.trace.delay(&limits),
        })
    })
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Turns at a steady rate.
struct Beat {
    begin: Instant,
    due: Duration,
    period: Duration,
}

impl Beat {
    fn new(begin: Instant, period: Duration) -> Self {
        Self { begin, due: begin.elapsed(), period }
    }

    /// Waits for the next turn; when it was due, and when it is. Turns that were missed are left out.
    fn next(&mut self) -> (Duration, Duration) {
        self.due += self.period;
        let now = self.begin.elapsed();
        sleep(self.due.saturating_sub(now));
        let now = self.begin.elapsed();
        let due = self.due;
        // Turns in a row to catch up would send several commands at once.
        if now > self.due + self.period {
            self.due = now;
        }
        (due, now)
    }
}

/// The loop that sends; gives its work back.
fn send<'a>(
    mut sender: Sender<'a>,
    begin: Instant,
    board: &Mutex<Board>,
    ended: &Mutex<bool>,
    stop: &(dyn Fn() -> Option<Reason> + Sync),
) -> Sender<'a> {
    let mut beat = Beat::new(begin, TICK);
    // The policy's loop sets this when it is done, whatever its outcome.
    while !*lock(ended) {
        let (due, now) = beat.next();
        let mut board = lock(board);
        if let Some(reason) = stop() {
            board.stop = Some(reason);
        }
        // Asked before the turn, so that the turn that arms the robot does not count.
        let armed = board.phase != Phase::Idle;
        sender.cycle(now, &mut board);
        drop(board);
        if armed {
            sender.jitter.take(due, now);
        }
    }
    sender
}

/// The policy's loop: waits for the robot, asks, arms, walks. Whether it was armed.
fn control(
    controller: &mut Controller<'_>,
    begin: Instant,
    board: &Mutex<Board>,
    ask: Live<'_>,
) -> Result<(bool, Jitter, Limits), RobotError> {
    let mut jitter = Jitter::default();
    let refused = |reason| Err(RobotError::NotArmed(reason));
    let mut heard = None;
    loop {
        // First a good state, and then a second of listening: another controller would show.
        sleep(Duration::from_millis(10));
        let (state, reason, now) = {
            let board = lock(board);
            (board.state, board.reason.clone(), begin.elapsed())
        };
        if let Some(reason) = (ask.stop)() {
            return refused(reason);
        }
        if let (Some(reason), true) = (&reason, state.is_none()) {
            // Nothing good has come; what came is wrong.
            if now > FIRST_STATE {
                return refused(reason.clone());
            }
        }
        if state.is_some() {
            let since = *heard.get_or_insert(now);
            if now - since > LISTEN {
                break;
            }
        } else if now > FIRST_STATE {
            return refused(Reason::NoState);
        }
    }
    let (state, reason) = {
        let board = lock(board);
        (board.state, board.reason.clone())
    };
    if let Some(reason) = reason {
        return refused(reason);
    }
    let Some((_, state)) = state else { return refused(Reason::NoState) };
    // A person may take any time here; meanwhile the sending loop goes on to listen.
    if !(ask.confirm)(&state) {
        return Ok((false, jitter, ask.limits));
    }
    // What cannot be written is found before the robot moves.
    if let Err(error) = controller.open_logs() {
        controller.remove_logs();
        return Err(error);
    }
    lock(board).arm = true;
    let mut beat = Beat::new(begin, ask.control);
    let mut phase = Phase::Idle;
    let mut turns = 0;
    loop {
        let (due, now) = beat.next();
        jitter.take(due, now);
        // On a copy: a disk that lets the logs wait must not hold up the loop that sends.
        let mut seen = lock(board).clone();
        turns += 1;
        // The loop that sends arms or refuses within one of its turns; after so long it is gone.
        if seen.refused.is_some() || seen.phase == Phase::Idle && turns > 50 {
            controller.remove_logs();
            return refused(seen.refused.unwrap_or(Reason::NoState));
        }
        let done = controller.cycle(now, &mut seen);
        let mut board = lock(board);
        board.targets = seen.targets;
        // The loop that sends clears these flags; one that it has not seen yet must stay.
        board.slow_down |= seen.slow_down;
        board.lie_down |= seen.lie_down;
        // Logs that cannot be written stop the robot, and not this loop: it must follow until the robot lies.
        if let Err(error) = done {
            board.stop = Some(Reason::Log(error.to_string()));
        }
        drop(board);
        let (current, over) = (seen.phase, seen.over);
        if current != phase {
            phase = current;
            (ask.phase)(phase);
        }
        if over {
            return Ok((true, jitter, ask.limits));
        }
    }
}
