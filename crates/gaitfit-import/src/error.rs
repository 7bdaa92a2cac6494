//! What can go wrong with an import, each with its place and remedy.

use crate::problem::Problem;
use gaitfit_log::LogError;
use gaitfit_model::{shown, shown_number, shown_path, shown_sentence};
use std::path::PathBuf;

/// Failure to import a log.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}; check the path, its permissions and the free space", shown_path(.path))]
    Io {
        /// The file.
        path: PathBuf,
        /// The action that failed.
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A folder, pipe or device, or a folder that is no ROS 2 bag.
    #[error("{}: not a regular file, and no folder with .mcap or .db3 files; name a log or a ROS 2 bag", shown_path(.path))]
    NotAFile {
        /// The path given.
        path: PathBuf,
    },
    /// The file is larger than is taken into memory.
    #[error("{}: larger than {limit} bytes; cut the recording, or raise `max_bytes` if there is memory for it", shown_path(.path))]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// `Options::max_bytes`.
        limit: u64,
    },
    /// No kind of file that is read.
    #[error(
        "{}: the file's first bytes are of no kind that is read: MCAP, ROS 2 bag (.db3), npy, npz, pickle, PyTorch, \
         Parquet, Arrow, HDF5, CSV", shown_path(.path)
    )]
    UnknownKind {
        /// The file.
        path: PathBuf,
    },
    /// A kind of file that is recognised and not read.
    #[error("{}: {what} is not read here; {}", shown_path(.path), shown_sentence(remedy))]
    Refused {
        /// The file.
        path: PathBuf,
        /// Kind of the file.
        what: &'static str,
        /// Command that converts it, or advice.
        remedy: String,
    },
    /// The file's content does not fit its kind.
    #[error("{}: {kind}: {}", shown_path(.path), shown_sentence(&problem.to_string()))]
    Content {
        /// The file.
        path: PathBuf,
        /// Its kind.
        kind: &'static str,
        /// The fault, and what to do.
        problem: Problem,
    },
    /// The mapping says something that the file does not have, or that cannot be.
    #[error("mapping: {}", shown_sentence(problem))]
    Mapping {
        /// What, and what to do.
        problem: String,
    },
    /// Nothing in the files is a joint's position.
    #[error(
        "no joint positions were recognised; found {}; say which are positions with `[columns] position = ...` in a \
         mapping file",
        shown_sentence(found)
    )]
    NoPositions {
        /// The streams and columns that there are.
        found: String,
    },
    /// Joints are numbered and nobody says which number is which joint.
    #[error(
        "the file numbers its joints from 0 to {} and does not name them; give `joints = [...]` in that order in a mapping \
         file, the robot whose order they have by `--robot`, or the policy that moved them by `--policy`", .count.saturating_sub(1)
    )]
    NoJointNames {
        /// Number of numbered joints.
        count: usize,
    },
    /// Motors that nobody names move.
    #[error(
        "motors {} move, and only {named} are named ({}): is it another robot's recording? Give that robot by `--robot`, or \
         name all motors in `joints = [...]` of a mapping file, number 0 first",
        shown(motors),
        shown(names)
    )]
    MotorsBeyond {
        /// Their numbers.
        motors: String,
        /// Number of motors that have names.
        named: usize,
        /// Source of the names, and the first and last of them.
        names: String,
    },
    /// Joints that have other quantities, or numbers among others that do, have no positions.
    #[error(
        "positions of {have} joints, and {} has none though {}; give all joints their positions, or leave {} out of the file",
        shown(joint),
        shown(why),
        shown(joint)
    )]
    JointMissing {
        /// Number of joints that have positions.
        have: usize,
        /// The first joint without one.
        joint: String,
        /// The quantity that shows that there is such a joint.
        why: String,
    },
    /// A stream that the caller asked for is not there.
    #[error(
        "nothing is called `{}`, which `--take` or `streams.take` names; there is {}",
        shown(wanted),
        shown_sentence(found)
    )]
    NoSuchStream {
        /// The name asked for.
        wanted: String,
        /// The streams or columns that there are.
        found: String,
    },
    /// A clock offset that shifts nothing.
    #[error(
        "the clock offset (`--clock-offset`, `clock_offset_s`) shifts streams against the one with the joints' positions, and \
         there is no other; leave it out"
    )]
    NothingToShift,
    /// Two streams say the same quantity.
    #[error(
        "`{}` is in {} and in {}; name the ones to take by `--take`, or by `streams.take` of a mapping file",
        shown(what),
        shown(first),
        shown(second)
    )]
    Ambiguous {
        /// The column.
        what: String,
        /// One stream.
        first: String,
        /// The other.
        second: String,
    },
    /// Positions jump to exactly 0 and back.
    #[error(
        "{}: in {zero} of {samples} samples the positions of all joints are exactly 0, between samples where they are not (after \
         {times}, … s): two publishers write to it, such as a joint_state_publisher beside the driver; record without the \
         second, or leave its rows out by `drop_zeros = true` under [streams] of a mapping file",
        shown(stream)
    )]
    TwoPublishers {
        /// The stream.
        stream: String,
        /// Samples with zeros.
        zero: usize,
        /// All samples.
        samples: usize,
        /// Times of the first, s since the first sample.
        times: String,
    },
    /// A stream's clock cannot be used.
    #[error("{}: {}", shown(stream), shown_sentence(problem))]
    Clock {
        /// The stream.
        stream: String,
        /// The fault of its times, and what to do.
        problem: String,
    },
    /// Two streams were recorded at different times.
    #[error(
        "{} has times from {} s to {} s and {} from {} s to {} s: they do not overlap; were they recorded together, and by \
         one clock? `clock_offset_s` in a mapping file shifts the second", shown(first), shown_number(first_s[0]),
        shown_number(first_s[1]), shown(second), shown_number(second_s[0]), shown_number(second_s[1])
    )]
    NoOverlap {
        /// The stream with the positions.
        first: String,
        /// Its first and last time, s.
        first_s: [f64; 2],
        /// The other.
        second: String,
        /// Its first and last time, s.
        second_s: [f64; 2],
    },
    /// The trajectory, or a CSV file of gaitfit's own, is refused by the log's reader.
    #[error(transparent)]
    Log(#[from] LogError),
}
