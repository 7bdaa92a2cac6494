//! Before a run on a robot: its own program for walking, the motion service, must release the motors.

use crate::exit::{Exit, Failure};
use crate::output::note;
use gaitfit_robot::link::{MotionMode, MotionSwitcher};
use std::io::BufRead;
use std::time::Duration;

/// Max time in which the service must be found and answer (on a busy machine it was found in 2.5 s), and in which it must release
/// the motors.
const ANSWER: Duration = Duration::from_secs(6);
const RELEASE: Duration = Duration::from_secs(15);
/// The word that a person types to release it.
const WORD: &str = "release";
/// What to do if it cannot be released from here.
const BY_HAND: &str = "switch it off in the vendor's app, or with its SDK (MotionSwitcherClient.ReleaseMode), and run again; \
                       nothing was sent to the motors";

/// Releases the motion service of the robot on `interface`, or finds that it is released. `hangs`: the robot must hang meanwhile.
pub fn released(interface: &str, domain: u16, yes: bool, hangs: bool) -> Result<(), Failure> {
    let mut switcher = MotionSwitcher::open(interface, domain).map_err(super::run::usage)?;
    // Silence is no fault, as a robot may have no such service; an error may hide one that still moves the
    // motors.
    let name = match switcher.check(ANSWER).map_err(Failure::failed)? {
        MotionMode::Released => {
            note("the robot's motion service is released");
            return Ok(());
        }
        MotionMode::Silent => {
            note(&format!(
                "no motion service answered within {} s; the run continues unless another program commands the motors",
                ANSWER.as_secs()
            ));
            return Ok(());
        }
        MotionMode::Error(code) => {
            return Err(Failure::failed(format!(
                "the robot's motion service answers with error {code}, so it may still move the motors: {BY_HAND}"
            )));
        }
        MotionMode::Active(name) => name,
    };
    note(&format!(
        "The robot's motion service is active (mode `{name}`). It must be released before a policy may walk the robot, and \
         then nothing holds the robot up: {}",
        if hangs {
            "it must hang."
        } else {
            "it must lie on its belly, or hang. Lay it down with its remote or the app first."
        }
    ));
    let when = if hangs { "when it hangs" } else { "when it lies on the ground" };
    // The word must be typed: after the release nothing holds the robot up.
    if !yes {
        note(&format!("Type `{WORD}` and Enter {when}; anything else ends."));
        let mut line = String::new();
        if std::io::stdin().lock().read_line(&mut line).is_err() || line.trim() != WORD {
            return Err(Failure {
                exit: Exit::Check,
                message: "not released; nothing was sent to the motors".to_owned(),
            });
        }
    }
    match switcher.release(RELEASE).map_err(Failure::failed)? {
        MotionMode::Released => {
            note("the motion service is released");
            Ok(())
        }
        MotionMode::Active(name) => Err(Failure::failed(format!(
            "the motion service stays active (mode `{name}`) {} s after the request to release it: {BY_HAND}",
            RELEASE.as_secs()
        ))),
        MotionMode::Silent => Err(Failure::failed(format!(
            "the motion service stopped answering as it was released: {BY_HAND}"
        ))),
        MotionMode::Error(code) => Err(Failure::failed(format!(
            "the motion service answers its release with error {code}: {BY_HAND}"
        ))),
    }
}
