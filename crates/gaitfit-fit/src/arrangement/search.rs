//! The search: the best single change, then the best further one, as long as each helps much.

use super::orders::Limbs;
use super::{Arrangement, Change, changes};
use gaitfit_policy::Interface;

/// Max number of changes in one arrangement.
const MAX_CHANGES: usize = 3;
/// Number of arrangements that the search follows at the same time: a change may help only together with another one.
const FOLLOWED: usize = 2;
/// A further change must make the measure smaller by this factor.
const HELPS: f64 = 0.8;

/// The arrangement with the smallest measure, and the measures of the given one and of this one. `measure` returns the
/// measure of each arrangement that it gets. `with_logs`, `derived`: see [`changes`] and [`Arrangement::with`]. A
/// measure below `enough` ends the search. `more`: further changes to try on an arrangement.
pub(super) fn search(
    interface: &Interface,
    limbs: &Limbs,
    [with_logs, derived]: [bool; 2],
    enough: f64,
    measure: &dyn Fn(&[Arrangement]) -> Vec<f64>,
    more: &dyn Fn(&Arrangement) -> Vec<Change>,
) -> (Arrangement, [f64; 2]) {
    let given = Arrangement::new(interface);
    let before = measure(std::slice::from_ref(&given)).first().copied().unwrap_or(f64::INFINITY);
    let mut followed = vec![(given.clone(), before)];
    let mut best = (given, before);
    for taken in 0..MAX_CHANGES {
        let mut tried: Vec<Arrangement> = Vec::new();
        for (arrangement, _) in &followed {
            let changes =
                changes(&arrangement.interface, limbs, with_logs).into_iter().chain(more(arrangement));
            tried.extend(changes.map(|change| arrangement.with(&change, derived)));
        }
        // All candidates of a round at once, because `measure` uses all threads.
        let measured = measure(&tried);
        let mut ranked: Vec<(Arrangement, f64)> =
            // An arrangement that does not give a policy for this robot has no measure.
            tried.into_iter().zip(measured).filter(|(_, value)| value.is_finite()).collect();
        // The sort is stable: of arrangements that fit alike, the one that was tried first is taken.
        ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
        ranked.truncate(FOLLOWED);
        let Some((arrangement, value)) = ranked.first() else { break };
        let helps = *value < HELPS * best.1;
        if helps {
            best = (arrangement.clone(), *value);
        // One change alone may not help, see [`FOLLOWED`].
        } else if taken > 0 {
            break;
        }
        if best.1 < enough {
            break;
        }
        followed = ranked;
    }
    let after = best.1;
    (best.0, [before, after])
}
