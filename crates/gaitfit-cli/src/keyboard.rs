//! The keyboard of the terminal while a robot walks: each key at once and unseen, and the terminal as it was afterwards.

use crate::exit::Failure;
use crate::output::{self, note};
use crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use crossterm::terminal;
use gaitfit_robot::guard::Reason;
use gaitfit_robot::run::{Key, Steering};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::mpsc::Receiver;
use std::thread::JoinHandle;
use std::time::Duration;

/// The keys, explained to the person.
pub const KEYS: &str = "W S or ↑ ↓: ahead, back.  A D or ← →: turn.  J L: aside.  Space: stand.  Q: lie down.  Esc: damping, \
                        the robot sinks";

/// Max time of a look at the keyboard.
const LOOK: Duration = Duration::from_millis(50);

/// Why the keyboard stopped the robot. 0: it did not; 1: a key did; 2: the terminal is gone; 3: Ctrl-C or the like.
static STOPPED: AtomicU8 = AtomicU8::new(0);
const BY_KEY: u8 = 1;
const LOST: u8 = 2;
const INTERRUPTED: u8 = 3;

/// Whether the robot is to be damped, and why.
pub fn stopped() -> Option<Reason> {
    match STOPPED.load(Ordering::SeqCst) {
        0 => None,
        BY_KEY => Some(Reason::Operator),
        LOST => Some(Reason::TerminalLost),
        _ => Some(Reason::Signal),
    }
}

/// Lines that the person types from now on. Without a terminal to type them the robot is stopped.
pub fn lines() -> Receiver<String> {
    let (sender, receiver) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
        // The input has ended: nobody can stop the robot from here any more.
        stop(LOST);
    });
    receiver
}

/// The keyboard, listened to. When it is dropped the terminal is as it was.
pub struct Keyboard {
    thread: Option<JoinHandle<()>>,
    over: std::sync::Arc<std::sync::atomic::AtomicBool>,
}

impl Keyboard {
    /// Listens from now on: keys steer.
    pub fn listen(steering: Steering) -> Result<Self, Failure> {
        let failed = |error: std::io::Error| Failure::failed(format!("the keyboard cannot be read: {error}"));
        terminal::enable_raw_mode().map_err(failed)?;
        output::raw(true);
        let over = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
        // Made before the thread: if that cannot start, dropping this one restores the terminal.
        let mut keyboard = Self { thread: None, over: over.clone() };
        let listen = move || {
            while !over.load(Ordering::SeqCst) {
                match event::poll(LOOK).and_then(|is| if is { event::read().map(Some) } else { Ok(None) }) {
                    // Some terminals also report releases, which would press each key twice.
                    Ok(Some(Event::Key(key))) if key.kind != KeyEventKind::Release => pressed(&steering, key),
                    Ok(_) => {}
                    Err(_) => return stop(LOST),
                }
            }
        };
        keyboard.thread =
            Some(std::thread::Builder::new().name("keyboard".to_owned()).spawn(listen).map_err(failed)?);
        Ok(keyboard)
    }
}

impl Drop for Keyboard {
    fn drop(&mut self) {
        self.over.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            // It ends within one look at the keyboard. A thread that still reads would take keys from the shell.
            let _ = thread.join();
        }
        // A terminal that is gone needs no mending.
        let _ = terminal::disable_raw_mode();
        output::raw(false);
    }
}

/// The first reason stays.
fn stop(why: u8) {
    // The first reason stays, because it is the one that is printed.
    let _ = STOPPED.compare_exchange(0, why, Ordering::SeqCst, Ordering::SeqCst);
}

fn pressed(steering: &Steering, key: KeyEvent) {
    match wanted(key) {
        Some(Wanted::Steer(key)) => {
            let [ahead, left, turn] = steering.press(key);
            match key {
                Key::LieDown => note("it comes to rest and lies down"),
                _ => note(&format!("vx {ahead:+.2} m/s   vy {left:+.2} m/s   wz {turn:+.2} rad/s")),
            }
        }
        Some(Wanted::Stop(why)) => stop(why),
        None => {}
    }
}

/// The action of a key.
#[derive(Debug, PartialEq, Eq)]
enum Wanted {
    Steer(Key),
    Stop(u8),
}

fn wanted(key: KeyEvent) -> Option<Wanted> {
    // The terminal sends no signals now: what would have been one is one.
    if key.modifiers.contains(KeyModifiers::CONTROL) {
        // Terminals send Ctrl-\ as the byte 0x1C, which crossterm reports as Ctrl-4.
        return matches!(key.code, KeyCode::Char('c' | 'z' | '\\' | '4' | 'd'))
            .then_some(Wanted::Stop(INTERRUPTED));
    }
    Some(Wanted::Steer(match key.code {
        KeyCode::Esc => return Some(Wanted::Stop(BY_KEY)),
        KeyCode::Char('w' | 'W') | KeyCode::Up => Key::Ahead,
        KeyCode::Char('s' | 'S') | KeyCode::Down => Key::Back,
        KeyCode::Char('a' | 'A') | KeyCode::Left => Key::TurnLeft,
        KeyCode::Char('d' | 'D') | KeyCode::Right => Key::TurnRight,
        KeyCode::Char('j' | 'J') => Key::Left,
        KeyCode::Char('l' | 'L') => Key::Right,
        KeyCode::Char(' ') => Key::Halt,
        KeyCode::Char('q' | 'Q') => Key::LieDown,
        _ => return None,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_steer_and_what_would_be_a_signal_stops() {
        let pressed = |code| wanted(KeyEvent::new(code, KeyModifiers::NONE));
        let with_control = |letter| wanted(KeyEvent::new(KeyCode::Char(letter), KeyModifiers::CONTROL));
        assert_eq!(pressed(KeyCode::Up), Some(Wanted::Steer(Key::Ahead)));
        assert_eq!(pressed(KeyCode::Char('Q')), Some(Wanted::Steer(Key::LieDown)));
        assert_eq!(pressed(KeyCode::Esc), Some(Wanted::Stop(BY_KEY)));
        assert_eq!(pressed(KeyCode::Char('x')), None);
        assert_eq!(with_control('c'), Some(Wanted::Stop(INTERRUPTED)));
        assert_eq!(with_control('w'), None);
    }
}
