//! Makes tables of a path.

use crate::arrays::{self, Arrays};
use crate::budget::{Budget, unzstd};
use crate::kind::{Kind, kind};
use crate::known::WALK_THESE_WAYS;
use crate::mapping::Mapping;
use crate::problem::Problem;
use crate::ros::Messages;
use crate::table::Source;
use crate::{ImportError, Options, db3, mcap, npz, pickle, text, torch, walk_these_ways};
#[cfg(feature = "all-formats")]
use crate::{arrow, hdf5, parquet};
use gaitfit_log::column_names::{BASE_POSITION, BASE_QUATERNION, BASE_RATES, BASE_VELOCITY, COMMAND, MOTION};
use gaitfit_log::{ReadOptions, read_csv_report, stated};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Max number of files of a bag's folder.
const MAX_FILES: usize = 1000;

/// Reads a file or a bag's folder.
pub(crate) fn source(path: &Path, options: &Options) -> Result<Source, ImportError> {
    // Unpacked data may be larger than the file, but not without limit.
    let most_bytes = usize::try_from(options.max_bytes.saturating_mul(4)).unwrap_or(usize::MAX);
    let mut budget = Budget::new(options.max_values, most_bytes);
    let mapping = &options.mapping;
    if path.is_dir() {
        return bag(path, options, &mut budget);
    }
    let mut bytes = read(path, options.max_bytes)?;
    let mut kind = kind(&bytes).ok_or_else(|| ImportError::UnknownKind { path: path.to_owned() })?;
    // A packed file is looked at once more, and only once.
    if kind == Kind::Zstd {
        bytes = unzstd(&bytes, &mut budget).map_err(|problem| content(path, kind, problem))?;
        kind = crate::kind::kind(&bytes).ok_or_else(|| ImportError::UnknownKind { path: path.to_owned() })?;
    }
    // A rate is what such a log may lack.
    let only_rate = Mapping { rate_hz: mapping.rate_hz, every: mapping.every, ..Mapping::default() };
    // A log of gaitfit's own has comments and sidecar files that the plain reader of tables does not know.
    if kind == Kind::Text && mapping == &only_rate && is_own(&bytes) {
        drop(bytes);
        return read_log(path, options);
    }
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let refused = |what, remedy: String| Err(ImportError::Refused { path: path.to_owned(), what, remedy });
    let source = match kind {
        Kind::Mcap => {
            let mut messages = Messages::new(mapping);
            mcap::read(&bytes, &mut messages, &mut budget).and_then(|cut| finish(messages, kind, cut))
        }
        Kind::Sqlite => {
            let mut messages = Messages::new(mapping);
            db3::read(&bytes, &mut messages, &mut budget).and_then(|()| finish(messages, kind, false))
        }
        Kind::Npz => npz::read_npz(&bytes, &mut budget)
            .and_then(|arrays| arrays::source(&name, kind.name(), arrays, mapping, &mut budget)),
        Kind::Npy => {
            let mut arrays = Arrays::default();
            npz::add("array", &bytes, &mut arrays, &mut budget)
                .and_then(|()| arrays::source(&name, kind.name(), arrays, mapping, &mut budget))
        }
        Kind::Torch => torch::read(&bytes, &mut budget)
            .and_then(|arrays| arrays::source(&name, kind.name(), arrays, mapping, &mut budget)),
        Kind::Pickle => pickled(&name, &bytes, mapping, &mut budget),
        Kind::Text => {
            let stated = stated(path, std::str::from_utf8(&bytes).unwrap_or_default())?;
            // The caller's rate wins over that of the file.
            let rate_hz = mapping.rate_hz.or(stated.rate_hz);
            let mapping = Mapping { rate_hz, ..mapping.clone() };
            text::read(&name, &bytes, &mapping, &mut budget).map(|source| Source {
                robot: source.robot.or_else(|| stated.robot.clone()),
                velocity_joints: stated.velocity_joints.clone(),
                simulated_step: source.simulated_step.or(stated.simulated_step),
                stated,
                ..source
            })
        }
        #[cfg(feature = "all-formats")]
        Kind::Parquet => parquet::read(&bytes, &mut budget)
            .and_then(|frame| frame.source(&name, kind.name(), mapping, &mut budget)),
        #[cfg(feature = "all-formats")]
        Kind::Arrow => arrow::read(&bytes, &mut budget)
            .and_then(|frame| frame.source(&name, kind.name(), mapping, &mut budget)),
        #[cfg(feature = "all-formats")]
        Kind::Hdf5 => hdf5::read(&bytes, &mut budget)
            .and_then(|arrays| arrays::source(&name, kind.name(), arrays, mapping, &mut budget)),
        #[cfg(not(feature = "all-formats"))]
        Kind::Parquet | Kind::Arrow | Kind::Hdf5 => return refused(kind.name(), to_npz(kind, &bytes)),
        Kind::Feather1 => {
            return refused(
                "a Feather file of the first version",
                "write it again: python -c \"import pandas; pandas.read_feather('log.feather').to_parquet('log.parquet')\""
                    .into(),
            );
        }
        Kind::Matlab => {
            return refused(
                kind.name(),
                "convert it in Python: `import scipy.io, numpy; f = scipy.io.loadmat('log.mat')` and \
                 `numpy.savez('log.npz', **{k: v for k, v in f.items() if k[0] != '_'})`"
                    .into(),
            );
        }
        Kind::TorchLegacy => {
            return refused(
                "a file of torch.save before version 1.6",
                "save it again: torch.save(torch.load('log.pt', weights_only=True), 'new.pt')".into(),
            );
        }
        Kind::Ros1 => {
            return refused("a ROS 1 bag", "convert it: rosbags-convert --src log.bag --dst log".into());
        }
        Kind::Zstd => Err(Problem::PackedTwice),
    };
    source.map_err(|problem| content(path, kind, problem))
}

/// Returns the command that makes an npz file of a kind that this build does not read.
#[cfg(any(test, not(feature = "all-formats")))]
fn to_npz(kind: Kind, bytes: &[u8]) -> String {
    let columns = |read: &str| {
        format!(
            "import numpy, pandas, pyarrow; t = {read}; numpy.savez('log.npz', **{{k: numpy.array(v.tolist()) if \
             v.dtype.kind != 'M' else (v - v[0]).dt.total_seconds() for k, v in t.items()}})"
        )
    };
    let python = match kind {
        Kind::Hdf5 => {
            "import h5py, numpy; a = {}; h5py.File('log.h5').visititems(lambda k, d: a.update({k: d[()]}) if \
             hasattr(d, 'shape') else None); numpy.savez('log.npz', **a)"
                .to_owned()
        }
        Kind::Arrow if bytes.starts_with(crate::kind::ARROW_MESSAGE) => {
            columns("pyarrow.ipc.open_stream(open('log.arrow', 'rb')).read_pandas()")
        }
        Kind::Arrow => columns("pandas.read_feather('log.arrow')"),
        _ => columns("pandas.read_parquet('log.parquet')"),
    };
    format!(
        "convert it: `python -c \"{python}\"`; or build gaitfit so that it reads it: `cargo install --path \
         crates/gaitfit-cli --features all-formats`"
    )
}

fn content(path: &Path, kind: Kind, problem: Problem) -> ImportError {
    ImportError::Content { path: path.to_owned(), kind: kind.name(), problem }
}

fn finish(messages: Messages<'_>, kind: Kind, cut: bool) -> Result<Source, Problem> {
    let mut source = messages.finish(kind.name())?;
    if cut {
        source.assumed.push("the recording was cut off; it is read as far as it goes".into());
    }
    Ok(source)
}

/// Reads a regular file, at most `limit` bytes of it.
fn read(path: &Path, limit: u64) -> Result<Vec<u8>, ImportError> {
    let io = |action| move |source| ImportError::Io { path: path.to_owned(), action, source };
    let metadata = std::fs::metadata(path).map_err(io("look at the file"))?;
    if !metadata.is_file() {
        return Err(ImportError::NotAFile { path: path.to_owned() });
    }
    let file = std::fs::File::open(path).map_err(io("open the file"))?;
    let mut bytes = Vec::new();
    // One byte more shows that the file is too large.
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(io("read the file"))?;
    if bytes.len() as u64 > limit {
        return Err(ImportError::TooLarge { path: path.to_owned(), limit });
    }
    Ok(bytes)
}

/// A folder of MCAP or db3 files: one recording, split by size or time.
fn bag(folder: &Path, options: &Options, budget: &mut Budget) -> Result<Source, ImportError> {
    let io = |source| ImportError::Io { path: folder.to_owned(), action: "list the folder", source };
    let mut files: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().to_lowercase());
        if [".mcap", ".db3", ".mcap.zstd", ".db3.zstd"].iter().any(|ending| name.ends_with(ending)) {
            files.push(path);
        }
        // A part of a recording would look like all of it.
        if files.len() > MAX_FILES {
            return Err(ImportError::Refused {
                path: folder.to_owned(),
                what: "a bag of more than 1000 files",
                remedy:
                    "join its files (`ros2 bag convert`), or import some of them from a folder of their own"
                        .into(),
            });
        }
    }
    // bag_2 comes before bag_10.
    files.sort_by_key(|path| (path.as_os_str().len(), path.clone()));
    if files.is_empty() {
        return Err(ImportError::NotAFile { path: folder.to_owned() });
    }
    // One reader for all files: topics go on from one to the next.
    let mut messages = Messages::new(&options.mapping);
    let mut cut = false;
    let mut storage = Kind::Mcap;
    for path in &files {
        let mut bytes = read(path, options.max_bytes)?;
        if kind(&bytes) == Some(Kind::Zstd) {
            bytes = unzstd(&bytes, budget).map_err(|problem| content(path, Kind::Zstd, problem))?;
        }
        let read = match kind(&bytes) {
            Some(Kind::Mcap) => mcap::read(&bytes, &mut messages, budget).map(|was| cut |= was),
            Some(Kind::Sqlite) => {
                storage = Kind::Sqlite;
                db3::read(&bytes, &mut messages, budget)
            }
            _ => return Err(ImportError::UnknownKind { path: path.clone() }),
        };
        read.map_err(|problem| content(path, storage, problem))?;
    }
    finish(messages, storage, cut).map_err(|problem| content(folder, storage, problem))
}

fn pickled(name: &str, bytes: &[u8], mapping: &Mapping, budget: &mut Budget) -> Result<Source, Problem> {
    let pickle = pickle::read(bytes, budget)?;
    // A pickle outside of an archive has no files that hold tensors.
    let mut none = |_: &str, _: &mut Budget| Err(pickle::PickleError::NoStorage.into());
    let arrays = pickle::arrays(&pickle, &mut none, budget)?;
    let Some(deployment) = walk_these_ways::deployment(&pickle, &arrays) else {
        return arrays::source(name, Kind::Pickle.name(), arrays, mapping, budget);
    };
    let mut source = arrays::source(name, "walk-these-ways", deployment.arrays, mapping, budget)?;
    source.usual_joints = Some(&WALK_THESE_WAYS);
    source.gains = deployment.gains;
    source.assumed.extend(deployment.assumed);
    source.left_out.extend(deployment.left_out);
    Ok(source)
}

/// Whether a CSV file has the header of gaitfit's own logs.
fn is_own(bytes: &[u8]) -> bool {
    // The header is near the beginning, below comments.
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let start = &bytes[..bytes.len().min(1 << 16)];
    let text = String::from_utf8_lossy(start);
    let header = text.lines().find(|line| !line.starts_with('#') && !line.trim().is_empty()).unwrap_or("");
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let joint = names.iter().find_map(|name| name.strip_prefix("q_"));
    // Numbered joints need names, which the plain reader of tables finds.
    let named = joint.is_some_and(|joint| {
        joint.parse::<u16>().is_err() && names.contains(&format!("dq_{joint}").as_str())
    });
    named && names.iter().any(|name| *name == "time" || name.starts_with("time_"))
}

/// Reads a log of gaitfit's own as its reader does, with comments and sidecar files.
fn read_log(path: &Path, options: &Options) -> Result<Source, ImportError> {
    let rate_hz = options.mapping.rate_hz;
    let every = options.mapping.every.unwrap_or(1);
    let read = ReadOptions { max_bytes: options.max_bytes, rate_hz, every, ..ReadOptions::default() };
    let (log, report) = read_csv_report(path, &read)?;
    let mut source = Source { kind: "CSV log of gaitfit", ..Source::default() };
    source.assumed.extend(report.even_rows.iter().map(|even| format!("{}: {even}", path.display())));
    source.left_out.extend(report.ignored.iter().map(|column| format!("{}: {}", column.name, column.reason)));
    // Columns under the names that other readers give them, so that other files can be joined to the log.
    let mut table = crate::table::Table {
        name: path.display().to_string(),
        clock: "the time column",
        time: log.time.clone(),
        ..Default::default()
    };
    let mut add = |names: Vec<String>, values: Option<&Vec<f64>>| {
        let width = names.len();
        for (i, name) in names.into_iter().enumerate() {
            if let Some(values) = values {
                table.columns.insert(name, values.iter().skip(i).step_by(width).copied().collect());
            }
        }
    };
    let named = |prefix: &str| log.joints.iter().map(|joint| format!("{prefix}{joint}")).collect::<Vec<_>>();
    let fixed = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    add(named("q_"), Some(&log.position));
    add(named("dq_"), Some(&log.velocity));
    add(named("qdes_"), log.target.as_ref());
    add(named("act_"), log.action.as_ref());
    add(fixed(&COMMAND), log.command.as_ref());
    add(fixed(&MOTION), log.motion.as_ref());
    let base = log.base.clone().unwrap_or_default();
    add(fixed(&BASE_POSITION), base.position.as_ref());
    add(fixed(&BASE_QUATERNION), base.quaternion.as_ref());
    add(fixed(&BASE_VELOCITY), base.linear_velocity.as_ref());
    add(fixed(&BASE_RATES), base.angular_velocity.as_ref());
    source.noticed = report.noticed;
    source.robot = log.robot.clone();
    source.fell = log.fell;
    source.lead = log.lead;
    source.velocity_joints = log.velocity_joints.clone();
    source.simulated_step = log.simulated_step;
    // Its reader has taken one row of `every` already.
    source.thinned = every > 1;
    source.gains = log.gains.map(|gains| (gains.kp, gains.kd));
    source.tables.push(table);
    Ok(source)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_that_a_build_may_lack_are_named_with_a_conversion() {
        for (kind, bytes, reader) in [
            (Kind::Parquet, &b"PAR1"[..], "pandas.read_parquet"),
            (Kind::Arrow, b"ARROW1\0\0", "pandas.read_feather"),
            (Kind::Arrow, &[0xff; 8], "pyarrow.ipc.open_stream"),
            (Kind::Hdf5, b"\x89HDF", "h5py.File"),
        ] {
            let remedy = to_npz(kind, bytes);
            assert!(remedy.contains(reader) && remedy.contains("numpy.savez('log.npz'"), "{remedy}");
            assert!(remedy.contains("--features all-formats"), "{remedy}");
        }
    }
}
