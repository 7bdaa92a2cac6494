//! `gaitfit export`: looks at its input, a policy, a log or fitted parameters, and writes it for other programs.

mod log;
mod policy;
mod theta;

use crate::cli::Export;
use crate::exit::Failure;
use gaitfit::files;
use gaitfit_model::argument;
use std::path::Path;

/// Largest .toml file that is looked into, bytes.
const MAX_BYTES: u64 = 16 << 20;

/// The content of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Policy,
    Log,
    Theta,
}

impl Kind {
    /// By the file's ending; a .toml file is one of fitted parameters if it has an entry of them.
    fn from_path(path: &Path) -> Self {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        match ending.as_deref() {
            Some("csv") => Self::Log,
            Some("toml") if has_parameters(path) => Self::Theta,
            _ => Self::Policy,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Policy => "a policy",
            Self::Log => "a log",
            Self::Theta => "a file of fitted parameters",
        }
    }
}

/// Whether a readable .toml file has an entry of a theta.toml. A damaged one is left to its reader.
fn has_parameters(path: &Path) -> bool {
    // The reader of policies then says why it cannot be read.
    let Ok(text) = files::read_text(path, MAX_BYTES) else { return false };
    match text.parse::<toml::Table>() {
        Ok(table) => {
            ["parameter", "number"].iter().any(|key| table.get(*key).is_some_and(toml::Value::is_array))
        }
        // A damaged file: by a line that files of policies do not have. So the right reader reports the damage.
        Err(_) => text.lines().any(|line| line.trim_end() == "[[parameter]]"),
    }
}

/// Writes the file as its options ask, and prints what was written.
pub fn run(args: &Export) -> Result<(), Failure> {
    let kind = Kind::from_path(&args.file);
    allowed(args, kind)?;
    match kind {
        Kind::Policy => policy::run(args),
        Kind::Log => log::run(args),
        Kind::Theta => theta::run(args),
    }
}

/// Refuses options of another kind of file.
fn allowed(args: &Export, kind: Kind) -> Result<(), Failure> {
    use Kind::{Log, Policy, Theta};
    // One table of all options, so that a new option must say which kinds of file it is for.
    let given: [(&str, bool, &[Kind]); 11] = [
        ("--onnx", args.onnx.is_some(), &[Policy]),
        ("--safetensors", args.safetensors.is_some(), &[Policy]),
        ("--bundle", args.bundle.is_some(), &[Policy]),
        ("--cpp", args.cpp.is_some(), &[Policy]),
        ("--force", args.force, &[Policy]),
        ("--out", args.out.is_some(), &[Log, Theta]),
        ("--robot", args.robot.is_some(), &[Policy, Theta]),
        ("--lenient", args.lenient, &[Policy, Theta]),
        ("--step", args.step.is_some(), &[Theta]),
        ("--kp and --kd", args.kp.is_some(), &[Theta]),
        ("--policy", args.policy.is_some(), &[Theta]),
    ];
    if let Some((option, _, _)) = given.iter().find(|(_, given, kinds)| *given && !kinds.contains(&kind)) {
        let options = match kind {
            Policy => "a policy has --onnx, --safetensors, --bundle and --cpp",
            Log => "a log has --out FILE.mcap",
            Theta => "it has --out FOLDER, --robot, --kp and --kd, --policy, and --step",
        };
        return Err(Failure::usage(format!(
            "{} is {}, {option} is not for it: {options}",
            args.file.display(),
            kind.name()
        )));
    }
    Ok(())
}

/// The output that a log or fitted parameters need.
fn needed<'a>(args: &'a Export, example: &str) -> Result<&'a Path, Failure> {
    args.out.as_deref().ok_or_else(|| {
        Failure::usage(format!(
            "{}: name the output, for example: gaitfit export {} --out {example}",
            args.file.display(),
            argument(&args.file)
        ))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_file_says_what_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        };
        let theta = write("theta.toml", "format = 2\n[[parameter]]\nname = \"delay\"\n");
        let damaged = write("cut.toml", "format = 2\n[[parameter]]\nname = \"del");
        let policy = write("policy.toml", "file = \"a.onnx\"\n");
        let kinds = [&theta, &damaged, &policy].map(|path| Kind::from_path(path));
        assert_eq!(kinds, [Kind::Theta, Kind::Theta, Kind::Policy]);
        assert_eq!(Kind::from_path(Path::new("walk.CSV")), Kind::Log);
        assert_eq!(Kind::from_path(Path::new("walk.onnx")), Kind::Policy);
    }
}
