//! Drift trials of a run: when each begins, and their form.

use crate::cli::Run;
use crate::exit::Failure;
use crate::keyboard;
use crate::output::note;
use gaitfit_robot::drift::form;
use gaitfit_robot::run::{Next, RUN, Trial};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError};

/// The place of the form. No fit takes it for a log there.
pub fn form_path(args: &Run) -> PathBuf {
    args.out.join(RUN).join("drift.csv")
}

/// Writes the empty form.
pub fn write_form(args: &Run, trials: &[Trial]) -> Result<(), Failure> {
    let path = form_path(args);
    let made = path.parent().map_or(Ok(()), std::fs::create_dir_all);
    made.map_err(|error| Failure::failed(format!("cannot make the folder of {}: {error}", path.display())))?;
    Ok(gaitfit::files::write(&path, form(&args.policy.display().to_string(), trials).as_bytes())?)
}

/// Has a person begin each trial with Enter; where nobody is asked it begins after the pause.
pub fn next<'a>(args: &'a Run, trials: &'a [Trial]) -> impl FnMut(usize, f64) -> Next + 'a {
    let mut typed: Option<Receiver<String>> = None;
    move |number, waited| {
        let Some(trial) = trials.get(number) else { return Next::End };
        if waited == 0.0 {
            let [vx, vy, wz] = trial.command;
            let ask = match args.link.yes || args.link.dry_run {
                true => String::new(),
                false => " Mark where it stands; Enter begins, q and Enter end.".to_owned(),
            };
            note(&format!(
                "trial {} of {}: {} ({vx} m/s, {vy} m/s, {wz} rad/s).{ask}",
                number + 1,
                trials.len(),
                trial.direction
            ));
        }
        if args.link.yes || args.link.dry_run {
            // Nobody marks the floor in a simulator, so the robot only has to come to rest.
            return if waited >= args.link.pause() { Next::Begin } else { Next::Wait };
        }
        // Not before: until it is armed the word is read elsewhere.
        let typed = typed.get_or_insert_with(keyboard::lines);
        if waited == 0.0 {
            // Input that was typed during the last trial does not begin one.
            typed.try_iter().for_each(drop);
        }
        match typed.try_recv() {
            Ok(line) if line.trim().eq_ignore_ascii_case("q") => Next::End,
            Ok(_) => Next::Begin,
            Err(TryRecvError::Empty) => Next::Wait,
            // Nobody can type any more, so no further trial may begin.
            Err(TryRecvError::Disconnected) => Next::End,
        }
    }
}
