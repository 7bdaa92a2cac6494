//! Minimum of a function of one number.

/// How far the minimum may be from a first guess, in steps of the delays. The delays tried before are every second
/// one, so a single minimum is less than 2 steps away.
const NEAR: f64 = 3.0;

/// Place of the minimum of `cost` within [`NEAR`] steps of `best`, from 0 to `last`, by golden sections.
pub(crate) fn lowest(cost: &impl Fn(f64) -> f64, best: f64, last: f64) -> f64 {
    // (√5 − 1)/2: one of the two inner points is an inner point of the next interval, so a round costs one
    // evaluation.
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let (mut low, mut high) = ((best - NEAR).max(0.0), (best + NEAR).min(last));
    let mut inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
    let mut costs = inner.map(cost);
    // Nine rounds narrow 6 steps to 0.618⁹ · 6 = 0.08 steps, 0.16 ms at the usual step. The joint solution refines
    // the delay.
    for _ in 0..9 {
        if costs[0] < costs[1] {
            high = inner[1];
            inner = [high - GOLDEN * (high - low), inner[0]];
            costs = [cost(inner[0]), costs[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + GOLDEN * (high - low)];
            costs = [costs[1], cost(inner[1])];
        }
    }
    0.5 * (low + high)
}
