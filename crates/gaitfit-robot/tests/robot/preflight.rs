//! Preflight against a simulated robot that hangs, sound or with a fault that is injected: no finding of a sound one, and each
//! fault by its name. The clock is given.

#[path = "preflight/ages.rs"]
mod ages;
#[path = "preflight/bench.rs"]
mod bench;
#[path = "preflight/faults.rs"]
mod faults;
#[path = "preflight/flights.rs"]
mod flights;
