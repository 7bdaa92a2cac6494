//! Damaged files, and how readers bear them: for tests alone.
//!
//! Readers of untrusted files must not panic, must end soon, and must not take more memory than a bound. [`attack`] draws
//! damaged files by [`Draws`], so that a failure repeats, and measures each reading. The mutations know the shapes of files:
//! [`bytes`] any file, [`text`] texts, [`pickle`] programs of pickle's stack machine, [`protobuf`] nested messages with
//! lengths that still fit, [`framed`] records with a length before them.
//!
//! [`peak`] sees what a thread allocates only in a program whose allocator is [`Counting`]:
//! `#[global_allocator] static ALLOCATOR: Counting = Counting;`. The targets of the folder `fuzz` read the same files with
//! the guidance of a fuzzer.

mod allocator;
mod attack;
mod draws;
mod mutate;
mod pickle;
mod protobuf;

pub use allocator::{Counting, peak};
pub use attack::{Bounds, Outcome, attack};
pub use draws::Draws;
pub use mutate::{bytes, framed, text};
pub use pickle::pickle;
pub use protobuf::protobuf;
