//! One robot under the commands of many logs.

use gaitfit_policy::Policy;
use gaitfit_policy::follow::{Job, Script, Track};
use gaitfit_policy::walker::Walker;

use super::{Begin, Candidates, FitError, Subject, Tables, Tracks};
use crate::runtime::Device;

/// As [`gaitfit_policy::follow::follow`] of one job, on a GPU: calls `consume(script, track)` once for each track, from any thread,
/// in any order. Motions differ from the CPU's by rounding. Once `cancel` returns true, it returns soon, without the missing
/// tracks.
///
/// # Errors
/// A policy that the GPU does not run, resets, a robot that cannot be, or a failure of the GPU.
pub fn follow(
    device: &Device,
    walker: &Walker,
    policy: &Policy,
    scripts: &[Script],
    job: &Job,
    threads: usize,
    consume: &(dyn Fn(usize, &Track) + Sync),
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<(), FitError> {
    if job.reset_every.is_some() {
        return Err(FitError::Unsupported("resets of logs".to_owned()));
    }
    let tables = Tables::walk(walker, policy, scripts)?.for_logs(0);
    let begin = |script: &Script| Begin { earlier: 0, start: script.begins(job.seed).clone() };
    let begins = [scripts.iter().map(begin).collect()];
    let joints = walker.joints.len();
    let consume = |_: usize, script: usize, tracks: Tracks<'_>| consume(script, &tracks.log(joints));
    let mut candidates = Candidates::new(device, tables, threads)?;
    candidates.make_logs(Subject::Walk(walker, policy), std::slice::from_ref(job), &begins, &consume, cancel)
}
