//! A program with all the processes that it starts: one group, signalled as one, which ends when this process ends,
//! however it ends.

use std::time::Duration;

#[cfg(unix)]
pub use unix::Group;

#[cfg(not(unix))]
pub use other::Group;

/// Interval between checks whether a program has ended, or must stop.
pub const LOOK: Duration = Duration::from_millis(20);

#[cfg(unix)]
mod unix {
    use super::LOOK;
    use rustix::process::{
        Pid, Signal, kill_process, kill_process_group, test_kill_process, test_kill_process_group,
    };
    use std::io::Write;
    use std::os::unix::process::CommandExt;
    use std::process::{Child, Command, ExitStatus, Stdio};
    use std::time::{Duration, Instant};

    /// Waits for the end of the process that holds the other side of its standard input, then ends the group or process
    /// that it was given, politely at first. A second line says that it has ended.
    /// It waits five seconds before it kills, as long as this program does. If this process is killed in the moment between the
    /// program's start and the line with its number, nobody ends the program.
    const GUARD: &str = "trap '' HUP INT QUIT TERM
read -r group || exit 0
read -r ended && exit 0
kill -TERM $group 2>/dev/null || exit 0
for second in 1 2 3 4 5; do
  sleep 1
  kill -0 $group 2>/dev/null || exit 0
done
kill -KILL $group 2>/dev/null";

    /// A running program and what it started.
    pub struct Group {
        /// The program itself.
        pub child: Child,
        id: Pid,
        /// Whether it is in this program's own group: it is signalled by itself.
        alone: bool,
        guard: Child,
        ended: Option<ExitStatus>,
    }

    impl Group {
        /// Starts a program as the first process of a group of its own.
        ///
        /// # Errors
        /// A program that cannot be started, or no `sh` to guard it.
        pub fn start(command: &mut Command) -> std::io::Result<Self> {
            Self::start_in(command.process_group(0), false)
        }

        /// Starts a program that asks the person at this program's terminal: only this program's group may read from it.
        /// What the program starts is its own to end.
        ///
        /// # Errors
        /// As [`Group::start`].
        pub fn start_at_terminal(command: &mut Command) -> std::io::Result<Self> {
            Self::start_in(command, true)
        }

        fn start_in(command: &mut Command, alone: bool) -> std::io::Result<Self> {
            // The guard must hold no pipe of this program open: readers would wait for its end.
            let null = Stdio::null;
            // Started before the program: once that runs, the guard lacks nothing but its number.
            let mut guard = Command::new("sh");
            // In a group of its own too: a Ctrl-C at the terminal must not end the guard before the program.
            guard.args(["-c", GUARD]).stdin(Stdio::piped()).stdout(null()).stderr(null()).process_group(0);
            let mut guard = guard.spawn()?;
            match command.spawn() {
                Ok(child) => {
                    let id = Pid::from_child(&child);
                    let mut group = Self { child, id, alone, guard, ended: None };
                    // `kill` takes a group's number with a minus.
                    let sign = if alone { "" } else { "-" };
                    group.tell(&format!("{sign}{}\n", id.as_raw_nonzero()))?;
                    Ok(group)
                }
                Err(error) => {
                    // Its input ends without a line, so the guard leaves without ending anything.
                    drop(guard.stdin.take());
                    guard.wait()?;
                    Err(error)
                }
            }
        }

        fn tell(&mut self, line: &str) -> std::io::Result<()> {
            self.guard.stdin.as_mut().map_or(Ok(()), |pipe| pipe.write_all(line.as_bytes()))
        }

        /// How the program itself ended, if it has.
        ///
        /// # Errors
        /// A process that cannot be waited for.
        pub fn ended(&mut self) -> std::io::Result<Option<ExitStatus>> {
            if self.ended.is_none() {
                self.ended = self.child.try_wait()?;
            }
            Ok(self.ended)
        }

        /// Ends what is left of the group: asks first, and kills after `patience`. `meanwhile` is called while it waits.
        pub fn end(&mut self, patience: Duration, mut meanwhile: impl FnMut()) {
            // The first process counts as there until it is waited for.
            let mut there = |group: &mut Self| {
                let _ = group.ended();
                meanwhile();
                match group.alone {
                    // Once it has been waited for, its number may be another's.
                    true => group.ended.is_none() && test_kill_process(group.id).is_ok(),
                    false => test_kill_process_group(group.id).is_ok(),
                }
            };
            // Errors are let go: the process may have ended in this moment.
            let signal = |group: &Self, signal: Signal| match group.alone {
                true => kill_process(group.id, signal),
                false => kill_process_group(group.id, signal),
            };
            // A group that has ended by itself is not signalled: its number may be another's by now.
            if there(self) {
                let _ = signal(self, Signal::TERM);
            }
            let begun = Instant::now();
            while there(self) {
                if begun.elapsed() >= patience {
                    let _ = signal(self, Signal::KILL);
                    break;
                }
                std::thread::sleep(LOOK);
            }
            // Waited for, or it would stay as a zombie.
            if self.ended.is_none() {
                self.ended = self.child.wait().ok();
            }
        }
    }

    impl Drop for Group {
        fn drop(&mut self) {
            self.end(Duration::ZERO, || ());
            // The second line; the guard then leaves without ending anything.
            let _ = self.tell("ended\n");
            drop(self.guard.stdin.take());
            let _ = self.guard.wait();
        }
    }
}

#[cfg(not(unix))]
mod other {
    use std::process::{Child, Command, ExitStatus};
    use std::time::Duration;

    /// A running program.
    pub struct Group {
        /// The program itself.
        pub child: Child,
    }

    impl Group {
        /// Starts a program.
        ///
        /// # Errors
        /// A program that cannot be started.
        pub fn start(command: &mut Command) -> std::io::Result<Self> {
            command.spawn().map(|child| Self { child })
        }

        /// As [`Group::start`].
        ///
        /// # Errors
        /// A program that cannot be started.
        pub fn start_at_terminal(command: &mut Command) -> std::io::Result<Self> {
            Self::start(command)
        }

        /// How the program ended, if it has.
        ///
        /// # Errors
        /// A process that cannot be waited for.
        pub fn ended(&mut self) -> std::io::Result<Option<ExitStatus>> {
            self.child.try_wait()
        }

        /// Ends the program.
        pub fn end(&mut self, _patience: Duration, mut meanwhile: impl FnMut()) {
            meanwhile();
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }

    impl Drop for Group {
        fn drop(&mut self) {
            self.end(Duration::ZERO, || ());
        }
    }
}
