//! `draws.csv` of a fit: values of θ drawn from the interval in which the logs leave it, for trainings that shall hold in
//! all of it.

use crate::{Error, files};
use gaitfit_adapt::ThetaFile;
use gaitfit_model::{Model, shown, shown_number};
use gaitfit_sim::Candidate;
use std::path::{Path, PathBuf};

/// Name of the file, beside `theta.toml`.
const NAME: &str = "draws.csv";
/// Max size of the file in bytes, and max number of rows.
const MAX_BYTES: u64 = 16 << 20;
const MAX_ROWS: usize = 4096;

/// The file that belongs to a `theta.toml`.
pub fn beside(theta: &Path) -> PathBuf {
    theta.with_file_name(NAME)
}

/// The robots of the file at `path`, one a row: `base` of `model` with what `fit`, the fit of `theta`, says, and the
/// row's numbers in place of its own.
///
/// # Errors
/// A file that is not there, is no table of numbers, names other parameters than the fit, or holds a value without a
/// meaning; each says where.
pub fn candidates(
    path: &Path,
    base: &Candidate,
    fit: &ThetaFile,
    theta: &Path,
    model: &Model,
) -> Result<Vec<Candidate>, Error> {
    let text = files::read_text(path, MAX_BYTES).map_err(|source| gaitfit_run::Error::File {
        access: gaitfit_run::Access::Read,
        path: path.to_owned(),
        source,
        remedy: format!(
            "; `randomise_theta` needs the draws that a fit writes beside {}: fit again, or set it to false",
            theta.display()
        ),
    })?;
    let wrong = |problem: String| Error::content(path, problem);
    // Numbered before empty lines are left out, so that messages count as an editor does.
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let Some((_, header)) = lines.next() else {
        return Err(wrong("it is empty; a header with the names of parameters comes first".to_owned()));
    };
    let columns = columns(header, fit).map_err(wrong)?;
    let mut robots = Vec::new();
    for (number, line) in lines {
        if robots.len() == MAX_ROWS {
            return Err(wrong(format!("it has more than {MAX_ROWS} rows")));
        }
        let values =
            row(line, columns.len()).map_err(|problem| wrong(format!("line {}: {problem}", number + 1)))?;
        // A row replaces the fit's values; modifications and networks stay those of the fit.
        let mut drawn = fit.clone();
        for (column, value) in columns.iter().zip(values) {
            let Some(column) = *column else { continue };
            let parameter = &mut drawn.parameter[column];
            // A draw may lie beyond the bounds of the search.
            (parameter.value, parameter.lower, parameter.upper) = (value, None, None);
        }
        // Applied like a fit, so a row that makes no robot is refused by its line.
        let robot = drawn.apply(model, base.clone());
        robots.push(robot.map_err(|error| wrong(format!("line {}: {error}", number + 1)))?);
    }
    if robots.is_empty() {
        return Err(wrong("it has no rows below its header".to_owned()));
    }
    Ok(robots)
}

/// The parameter of each column; none of the weights of networks, which all robots of a training share. All of the fit's
/// parameters must be there, each once.
fn columns(header: &str, fit: &ThetaFile) -> Result<Vec<Option<usize>>, String> {
    let names = || fit.parameter.iter().map(|one| one.name.as_str()).collect::<Vec<_>>().join(", ");
    let mut columns = Vec::new();
    for name in header.split(',').map(str::trim) {
        // A network's weights are named by its kind and an underscore.
        let weight = |kind: &str| name.strip_prefix(kind).is_some_and(|rest| rest.starts_with('_'));
        let Some(place) = fit.parameter.iter().position(|one| one.name == name) else {
            if fit.network.iter().any(|network| weight(network.kind.name())) {
                columns.push(None);
                continue;
            }
            return Err(format!(
                "column `{}` is no parameter of the fit, which has {}",
                shown(name),
                names()
            ));
        };
        if columns.contains(&Some(place)) {
            return Err(format!("column `{}` is there twice", shown(name)));
        }
        columns.push(Some(place));
    }
    // A missing column would leave that parameter at the fit's value in all robots, unnoticed.
    match (0..fit.parameter.len()).find(|&place| !columns.contains(&Some(place))) {
        Some(missing) => Err(format!("it has no column `{}`", shown(&fit.parameter[missing].name))),
        None => Ok(columns),
    }
}

fn row(line: &str, columns: usize) -> Result<Vec<f64>, String> {
    let mut values = Vec::with_capacity(columns);
    for word in line.split(',').map(str::trim) {
        match word.parse::<f64>() {
            Ok(value) if value.is_finite() => values.push(value),
            Ok(value) => return Err(format!("{} is not finite", shown_number(value))),
            Err(_) => return Err(format!("`{}` is no number", shown(word))),
        }
    }
    if values.len() != columns {
        return Err(format!("it has {} numbers, and the header {columns} names", values.len()));
    }
    Ok(values)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    const THETA: &str = "format = 2\nrobot = \"go2\"\n[[parameter]]\nname = \"frictionloss_hip\"\n\
        kind = \"frictionloss\"\njoints = [\"FL_hip_joint\"]\nvalue = 0.2\nlower = 0.0\nupper = 0.25\n\
        [[parameter]]\nname = \"torque_noise\"\nkind = \"torque_noise\"\nvalue = 1.0\n";

    /// The robots of a file with this text, or why there are none.
    fn read(text: Option<&str>) -> Result<Vec<Candidate>, String> {
        let folder = tempfile::tempdir().unwrap();
        let theta = folder.path().join("theta.toml");
        let path = beside(&theta);
        if let Some(text) = text {
            std::fs::write(&path, text).unwrap();
        }
        let model = crate::robot::go2().unwrap();
        let fit = ThetaFile::parse(THETA).unwrap();
        candidates(&path, &Candidate::nominal(&model), &fit, &theta, &model)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn each_row_is_a_robot_with_its_numbers() {
        let robots = read(Some("torque_noise, frictionloss_hip\n0.5,0.1\n\n1.5,0.3\n")).unwrap();
        assert_eq!(robots.len(), 2);
        let numbers = |robot: &Candidate| (robot.torque_noise, robot.robot.frictionloss[0]);
        assert_eq!(numbers(&robots[0]), (0.5, 0.1));
        assert_eq!(numbers(&robots[1]), (1.5, 0.3), "a draw may lie beyond the bounds of the search");
    }

    #[test]
    fn what_is_no_table_of_the_fits_parameters_is_refused_by_place() {
        for (text, words) in [
            (None, ["draws.csv", "randomise_theta"]),
            (Some(""), ["draws.csv", "empty"]),
            (Some("frictionloss_hip,torque_noise\n"), ["draws.csv", "no rows"]),
            (Some("frictionloss_hip\n0.1\n"), ["no column", "torque_noise"]),
            (
                Some("frictionloss_hip,torque_noise,mass\n0.1,1,2\n"),
                ["`mass`", "frictionloss_hip, torque_noise"],
            ),
            (Some("frictionloss_hip,torque_noise,torque_noise\n0.1,1,2\n"), ["`torque_noise`", "twice"]),
            (Some("frictionloss_hip,torque_noise\n0.1\n"), ["line 2", "1 numbers"]),
            (Some("frictionloss_hip,torque_noise\n0.1,1\n0.1,nan\n"), ["line 3", "not finite"]),
            (Some("frictionloss_hip,torque_noise\n0.1,x\n"), ["line 2", "`x` is no number"]),
            (Some("frictionloss_hip,torque_noise\n-0.1,1\n"), ["line 2", "frictionloss_hip"]),
        ] {
            let error = read(text).unwrap_err();
            assert!(words.iter().all(|word| error.contains(word)), "{text:?}: {error}");
        }
        let many = format!("frictionloss_hip,torque_noise\n{}", "0.1,1\n".repeat(MAX_ROWS + 1));
        assert!(read(Some(&many)).unwrap_err().contains("more than 4096 rows"));
    }
}
