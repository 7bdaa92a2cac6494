//! `gaitfit forward`: one physics step at given states, for holding the engine against another.

mod npz;

use crate::exit::Failure;
use gaitfit::files::{self, Output};
use gaitfit::robot;
use gaitfit_model::Model;
use gaitfit_physics::{Forward, PhysicsError, Settings};
use npz::{Array, read, write};

/// Evaluates every state of the input and writes the results, row by row.
pub fn run(args: &crate::cli::Forward) -> Result<(), Failure> {
    let out = Output { path: &args.out, option: "the output", ending: None };
    files::check(&[out], [args.model.as_path(), &args.states])?;
    let model = robot::as_written(&args.model, args.lenient)?;
    let states = read(&args.states, &["qpos", "qvel", "ctrl"])?;
    let rows = states.first().map_or(0, |array| array.rows);
    let widths = [("qpos", model.nq()), ("qvel", model.nv()), ("ctrl", model.nu())];
    for (array, (name, width)) in states.iter().zip(widths) {
        check(array, name, rows, width, args)?;
    }
    let [qpos, qvel, ctrl] = &states[..] else {
        return Err(Failure::failed("the input does not hold three arrays"));
    };
    // Before memory is taken: mass matrices grow with the square of the joints.
    bounded(&model, rows, args)?;
    let settings = Settings::new(&model.options, args.preset.into());
    let mut forward = Forward::new(&model, &settings)
        .map_err(|error| Failure::failed(format!("{}: {error}", args.model.display())))?;
    let out = evaluate(&model, &mut forward, rows, qpos, qvel, ctrl)
        .map_err(|(row, error)| Failure::failed(format!("{}: row {row}: {error}", args.states.display())))?;
    // Inputs were finite, so a number that is not has overflowed on the way.
    for (name, array) in &out {
        if let Some(bad) = array.values.iter().position(|value| !value.is_finite()) {
            // Matrices count as rows of nv² numbers here.
            let width = array.values.len() / rows.max(1);
            return Err(Failure::failed(format!(
                "{}: row {}: {name} overflows; take smaller positions, velocities or controls",
                args.states.display(),
                bad / width.max(1)
            )));
        }
    }
    write(&args.out, &out)
}

/// Most values of all results together: 1 GiB.
const MAX_VALUES: u64 = 1 << 27;

/// Refuses more states than results fit into memory.
fn bounded(model: &Model, rows: usize, args: &crate::cli::Forward) -> Result<(), Failure> {
    let (nq, nv) = (model.nq() as u64, model.nv() as u64);
    // M; then qfrc_bias, qacc and next_qvel; then next_qpos. At least 1, because a robot without joints would
    // divide by 0.
    let each = (nv * nv + 3 * nv + nq).max(1);
    if rows as u64 <= MAX_VALUES / each {
        return Ok(());
    }
    Err(Failure::failed(format!(
        "{}: {rows} states of {} would give {each} values each; give at most {} states in one file",
        args.states.display(),
        model.name,
        MAX_VALUES / each
    )))
}

/// Refuses arrays that are not `rows × width` finite numbers.
fn check(
    array: &Array,
    name: &str,
    rows: usize,
    width: usize,
    args: &crate::cli::Forward,
) -> Result<(), Failure> {
    let shown = args.states.display();
    if array.shape != [rows, width] {
        let shape = &array.shape;
        return Err(Failure::failed(format!(
            "{shown}: {name} has shape {shape:?}, but {} needs [{rows}, {width}]: rows are states, in MuJoCo's \
             layout and joint order",
            args.model.display()
        )));
    }
    match array.values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(bad) => Err(Failure::failed(format!(
            "{shown}: {name}[{}, {}] is {}; states must be finite",
            // `width` is above 0 here: an array of width 0 has no value that could be bad.
            bad / width,
            bad % width,
            array.values[bad]
        ))),
    }
}

fn evaluate(
    model: &Model,
    forward: &mut Forward,
    rows: usize,
    qpos: &Array,
    qvel: &Array,
    ctrl: &Array,
) -> Result<Vec<(&'static str, Array)>, (usize, PhysicsError)> {
    let (nq, nv, nu) = (model.nq(), model.nv(), model.nu());
    let mut out: [(&'static str, Array); 5] = [
        ("M", Array::empty(&[rows, nv, nv])),
        ("qfrc_bias", Array::empty(&[rows, nv])),
        ("qacc", Array::empty(&[rows, nv])),
        ("next_qpos", Array::empty(&[rows, nq])),
        ("next_qvel", Array::empty(&[rows, nv])),
    ];
    for row in 0..rows {
        let columns = |width: usize| row * width..(row + 1) * width;
        let (q, v, u) = (columns(nq), columns(nv), columns(nu));
        let result = forward
            .evaluate(&qpos.values[q], &qvel.values[v], &ctrl.values[u])
            .map_err(|error| (row, error))?;
        let parts = [result.mass, result.qfrc_bias, result.qacc, result.next_qpos, result.next_qvel];
        for ((_, array), part) in out.iter_mut().zip(parts) {
            array.values.extend(part);
        }
    }
    Ok(out.into())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use clap::Parser;

    #[test]
    fn results_that_fit_into_no_memory_are_refused_before_they_are_made() {
        let line = ["gaitfit", "forward", "go2.xml", "states.npz", "out.npz"];
        let crate::cli::Command::Forward(args) = crate::cli::Cli::parse_from(line).command else { panic!() };
        let model = robot::go2().unwrap();
        // 18 degrees of freedom: 324 + 54 + 19 values a state.
        assert!(bounded(&model, (1 << 27) / 397, &args).is_ok());
        let error = bounded(&model, (1 << 27) / 397 + 1, &args).unwrap_err();
        assert!(error.message.contains("states.npz") && error.message.contains("at most 338079"), "{error}");
    }
}
