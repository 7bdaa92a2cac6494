//! The CSV writer: exact numbers, atomic replacement.

use crate::column_names::{BASE_POSITION, BASE_QUATERNION, BASE_RATES, BASE_VELOCITY, COMMAND, MOTION};
use crate::{LogError, Trajectory};
use gaitfit_model::shown;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Writes `trajectory` so that [`read_csv`](crate::read_csv) gives the same numbers back, bit for bit (NaN as
/// NaN), with robot, rate, gains, lead of the targets, a simulator's step and whether it fell in header comments.
///
/// Atomic: a temporary file in the same folder, synced, then renamed. On any error what was at `path` before
/// is still there. Errors: a trajectory that fails [`Trajectory::validate`], a joint name that a header cannot
/// carry, no samples, and the system's refusals (full disk, no folder).
pub fn write_csv(path: &Path, trajectory: &Trajectory) -> Result<(), LogError> {
    trajectory.validate()?;
    if trajectory.is_empty() {
        return Err(LogError::NoSamples { path: path.to_owned() });
    }
    // Names with commas or line ends would change the columns.
    check_names(trajectory.robot.as_deref(), &trajectory.joints)?;
    let failed = |action: &'static str| {
        move |source| LogError::Io {
            path: path.to_owned(),
            action,
            source,
            remedy: "what was there before is unchanged; check the folder, its permissions, the free space and `ulimit -f`",
        }
    };
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".gaitfit-log-");
    #[cfg(unix)]
    {
        // Temporary files are private by default; a log is an ordinary file, subject to the umask.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    // Beside the log, because a rename is atomic only within one file system.
    let mut file = builder.tempfile_in(folder).map_err(failed("create a temporary file beside it"))?;
    let mut out = BufWriter::new(file.as_file_mut());
    write_to(&mut out, trajectory).and_then(|()| out.flush()).map_err(failed("write the log"))?;
    // The writer borrows the file, which is synced next.
    drop(out);
    file.as_file().sync_all().map_err(failed("write the log to the disk"))?;
    file.persist(path).map_err(|error| failed("put the written log in place")(error.error))?;
    // The rename itself must survive a power cut; not every platform lets a folder be opened.
    #[cfg(unix)]
    std::fs::File::open(folder)
        .and_then(|folder| folder.sync_all())
        .map_err(failed("sync the log's folder"))?;
    Ok(())
}

/// Checks that a log's header can carry these names.
///
/// # Errors
/// [`LogError::Shape`] that names the joint or the robot, and the remedy.
pub fn check_names(robot: Option<&str>, joints: &[String]) -> Result<(), LogError> {
    let odd = |joint: &&String| {
        joint.trim() != *joint || joint.contains(|c: char| c.is_control() || c == ',' || c == '"')
    };
    if let Some(joint) = joints.iter().find(odd) {
        return Err(LogError::Shape {
            what: format!("joint `{}`", shown(joint)),
            problem: "a CSV header cannot carry this name; use letters, digits and underscores".into(),
        });
    }
    match robot.filter(|robot| robot.contains(|c: char| c.is_control())) {
        Some(robot) => Err(LogError::Shape {
            what: format!("robot name `{}`", shown(robot)),
            problem: "a comment line cannot carry this name; use one line of text".into(),
        }),
        None => Ok(()),
    }
}

/// A channel's column names and its values, one row a sample.
type Columns<'a> = (Vec<String>, &'a [f64]);

fn write_to(out: &mut impl Write, trajectory: &Trajectory) -> std::io::Result<()> {
    // Comments stand above the header, where readers look for settings.
    if let Some(robot) = &trajectory.robot {
        writeln!(out, "# robot = {}", toml::Value::from(robot.as_str()))?;
    }
    writeln!(out, "# rate_hz = {:?}", trajectory.rate_hz)?;
    if trajectory.fell {
        writeln!(out, "# fell = true")?;
    }
    if let Some(lead) = &trajectory.lead {
        writeln!(out, "# target_lead_s = {:?}", lead.seconds)?;
        writeln!(out, "# target_lead_spread_s = {:?}", lead.spread)?;
    }
    if let Some(step) = trajectory.simulated_step {
        writeln!(out, "# simulated_step_s = {step:?}")?;
    }
    if let Some(gains) = &trajectory.gains {
        writeln!(out, "# kp = {:?}", gains.kp)?;
        writeln!(out, "# kd = {:?}", gains.kd)?;
    }
    if !trajectory.velocity_joints.is_empty() {
        let names = trajectory.velocity_joints.iter().map(|name| toml::Value::from(name.as_str()));
        writeln!(out, "# velocity_joints = {}", toml::Value::Array(names.collect()))?;
    }

    let named = |prefix: &str| -> Vec<String> {
        trajectory.joints.iter().map(|joint| format!("{prefix}{joint}")).collect()
    };
    let fixed = |names: &[&str]| -> Vec<String> { names.iter().map(|name| name.to_string()).collect() };
    let base = trajectory.base.as_ref();
    let time = vec!["time".to_owned()];
    let channels: Vec<Columns> = [
        (time, Some(&trajectory.time)),
        (named("q_"), Some(&trajectory.position)),
        (named("dq_"), Some(&trajectory.velocity)),
        (named("qdes_"), trajectory.target.as_ref()),
        (named("act_"), trajectory.action.as_ref()),
        (fixed(&COMMAND), trajectory.command.as_ref()),
        (fixed(&MOTION), trajectory.motion.as_ref()),
        (fixed(&BASE_POSITION), base.and_then(|base| base.position.as_ref())),
        (fixed(&BASE_QUATERNION), base.and_then(|base| base.quaternion.as_ref())),
        (fixed(&BASE_VELOCITY), base.and_then(|base| base.linear_velocity.as_ref())),
        (fixed(&BASE_RATES), base.and_then(|base| base.angular_velocity.as_ref())),
    ]
    .into_iter()
    .filter_map(|(names, values)| Some((names, values?.as_slice())))
    .collect();

    let header: Vec<&str> = channels.iter().flat_map(|(names, _)| names).map(String::as_str).collect();
    writeln!(out, "{}", header.join(","))?;
    for sample in 0..trajectory.len() {
        let mut separator = "";
        for (names, values) in &channels {
            let width = names.len();
            for value in &values[sample * width..(sample + 1) * width] {
                // `{:?}` prints the shortest text that reads back to the same bits.
                write!(out, "{separator}{value:?}")?;
                separator = ",";
            }
        }
        writeln!(out)?;
    }
    Ok(())
}
