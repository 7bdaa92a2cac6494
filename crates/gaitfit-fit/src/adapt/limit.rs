//! A limit on the time of a whole fit.

use super::cost_result::CostFit;
use super::results::AdaptResults;
use super::setup::Setup;
use crate::Error;
use crate::run::RunFolder;
use crate::run::protocol::{Protocol, RESULT};
use crate::watch::{Event, Watch};
use gaitfit_adapt::fit::{FitError, MAX_SCANNED};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::ops::ControlFlow;
use std::time::Instant;

/// The share of the time that the search may take; corrections and intervals have the rest.
const SEARCH: f64 = 0.5;

/// How long a whole fit may take: its search, its correction and its intervals. What is not measured then is left out. Scores
/// and the report come after it.
#[derive(Clone, Copy, Debug)]
pub struct Limit {
    begun: Instant,
    seconds: f64,
}

impl Limit {
    /// A fit that begins now and takes at most `seconds`.
    pub fn new(seconds: f64) -> Self {
        Self { begun: Instant::now(), seconds }
    }

    /// The time of the search, s.
    pub(super) fn search_seconds(&self) -> f64 {
        SEARCH * self.seconds
    }

    /// Whether the time of the search is over.
    pub(super) fn search_over(&self) -> bool {
        self.begun.elapsed().as_secs_f64() >= self.search_seconds()
    }

    fn over(&self) -> bool {
        self.begun.elapsed().as_secs_f64() >= self.seconds
    }
}

/// Does `work`, which stops when the limit is over. Absent if it was stopped by the limit.
///
/// # Errors
/// Those of `work`; [`FitError::Cancelled`] if `watch` stopped it.
pub(super) fn within<T>(
    limit: Option<Limit>,
    watch: &Watch<'_>,
    work: impl FnOnce(&Watch<'_>) -> Result<T, FitError>,
) -> Result<Option<T>, FitError> {
    let Some(limit) = limit else { return work(watch).map(Some) };
    let callback = |event: Event<'_>| {
        watch.tell(event);
        match watch.stop() || limit.over() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    };
    match work(&Watch::new(&callback)) {
        // Cancelled though no one asked for it: by the limit.
        Err(FitError::Cancelled) if !watch.stop() => Ok(None),
        result => result.map(Some),
    }
}

/// Whether a limit cut a fit short.
fn cut_short(fit: &CostFit) -> bool {
    // A fit of more parameters has no intervals in any case.
    let unmeasured =
        fit.parameters.len() <= MAX_SCANNED && fit.parameters.iter().all(|one| one.interval.is_none());
    unmeasured || fit.runs.iter().any(|run| run.stop.is_none())
}

/// Takes the result away from a folder whose fit a limit cut short, unless the settings have the same limit as before: then the
/// fit continues.
///
/// # Errors
/// Files that are damaged or cannot be removed.
pub(super) fn reopen<A>(protocol: &Protocol<'_, A>, folder: &RunFolder, setup: &Setup) -> Result<(), Error>
where
    A: Clone + PartialEq + Serialize + DeserializeOwned,
{
    protocol.check()?;
    let Some(results) = protocol.finished::<AdaptResults>()? else { return Ok(()) };
    let before = protocol.saved()?.and_then(|saved| {
        saved.get("optimizer").and_then(|table| table.get("max_seconds")).and_then(toml::Value::as_float)
    });
    let limit = setup.config.optimizer.max_seconds;
    // With the same limit, a result that was cut short is what was asked for.
    let is_same = limit > 0.0 && before == Some(limit);
    if is_same || !results.fits.iter().any(cut_short) {
        return Ok(());
    }
    let path = folder.path().join(RESULT);
    std::fs::remove_file(&path)
        .map_err(|error| Error::failed(format!("cannot remove {}: {error}", path.display())))
}
