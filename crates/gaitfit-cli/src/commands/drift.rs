//! `gaitfit drift`: the table of drift trials from their filled forms, policies side by side.

use crate::cli;
use crate::exit::Failure;
use crate::output::{self, note};
use crate::table::table;
use gaitfit::evaluate::of_few;
use gaitfit_robot::drift::{Form, Measured};
use gaitfit_view::Estimate;
use serde::Serialize;

/// The measurements of a policy, as `--json` prints them.
#[derive(Serialize)]
struct Policy {
    policy: String,
    form: String,
    directions: Vec<Direction>,
    /// Over all trials that did not fall: m, and size of the heading's error, rad.
    distance: Estimate,
    heading: Estimate,
    fell: usize,
    not_made: usize,
}

/// A direction's trials: where the robot ended minus where it should have, m, m, rad, and how far off that is, m.
#[derive(Serialize)]
struct Direction {
    direction: String,
    trials: usize,
    fell: usize,
    x: Estimate,
    y: Estimate,
    heading: Estimate,
    distance: Estimate,
}

/// Reads the forms and prints the table.
pub fn run(args: &cli::Drift) -> Result<(), Failure> {
    let mut policies = Vec::new();
    for path in &args.forms {
        let form = Form::read(path).map_err(Failure::failed)?;
        if form.empty > 0 {
            note(&format!("{}: {} rows are not filled in; they do not count", path.display(), form.empty));
        }
        policies.push(policy(form, path.display().to_string()));
    }
    if args.json {
        return output::print_json(&policies);
    }
    output::print(&text(&policies))
}

fn policy(form: Form, path: String) -> Policy {
    // Directions in the order in which the form has them.
    let mut names: Vec<&str> = Vec::new();
    for trial in &form.trials {
        if !names.contains(&trial.direction.as_str()) {
            names.push(&trial.direction);
        }
    }
    // Each direction by itself: a robot may drift ahead and not aside.
    let directions = names.iter().map(|name| {
        let trials: Vec<&Measured> = form.trials.iter().filter(|trial| trial.direction == *name).collect();
        // A trial without an error is one in which the robot fell: its end says nothing of the drift.
        let part =
            |part: usize| estimate(trials.iter().filter_map(|trial| trial.error.map(|error| error[part])));
        Direction {
            direction: (*name).to_owned(),
            trials: trials.len(),
            fell: trials.iter().filter(|trial| trial.error.is_none()).count(),
            x: part(0),
            y: part(1),
            heading: part(2),
            distance: estimate(trials.iter().filter_map(|trial| trial.distance())),
        }
    });
    let directions: Vec<Direction> = directions.collect();
    let trials = || form.trials.iter();
    Policy {
        form: path,
        directions,
        distance: estimate(trials().filter_map(Measured::distance)),
        // The size: over all directions, turns to the left and to the right would cancel.
        heading: estimate(trials().filter_map(|trial| trial.error.map(|error| error[2].abs()))),
        fell: trials().filter(|trial| trial.error.is_none()).count(),
        not_made: form.empty,
        policy: form.policy,
    }
}

fn estimate(numbers: impl Iterator<Item = f64>) -> Estimate {
    of_few(&numbers.collect::<Vec<_>>())
}

fn text(policies: &[Policy]) -> String {
    let header = ["command", "policy", "trials", "fell", "x, m", "y, m", "heading, rad", "distance, m"];
    let mut rows = table(&header, &[2, 3, 4, 5, 6, 7]);
    let mut directions: Vec<&str> = Vec::new();
    for one in policies.iter().flat_map(|policy| &policy.directions) {
        if !directions.contains(&one.direction.as_str()) {
            directions.push(&one.direction);
        }
    }
    // Rows of one direction stand together, so that policies are compared line by line.
    for direction in directions {
        for policy in policies {
            // Forms may have different directions. A direction that a form lacks has no row for its policy.
            let Some(one) = policy.directions.iter().find(|one| one.direction == direction) else { continue };
            rows.add_row([
                direction.to_owned(),
                policy.policy.clone(),
                one.trials.to_string(),
                one.fell.to_string(),
                shown(one.x, true),
                shown(one.y, true),
                shown(one.heading, true),
                shown(one.distance, false),
            ]);
        }
    }
    for policy in policies {
        rows.add_row([
            "all".to_owned(),
            policy.policy.clone(),
            policy.directions.iter().map(|one| one.trials).sum::<usize>().to_string(),
            policy.fell.to_string(),
            String::new(),
            String::new(),
            shown(policy.heading, false),
            shown(policy.distance, false),
        ]);
    }
    format!(
        "Drift: stand, command for 4 s, stand; final place minus the place of the command, mean ± 95 %\n{rows}\nx \
         ahead, y and heading to the left, seen from the start of the command; the last rows have the size of the \
         heading. Falls are counted apart.\n"
    )
}

fn shown(estimate: Estimate, signed: bool) -> String {
    let Estimate { mean, ci95 } = estimate;
    let mean = match (mean.is_nan(), signed) {
        (true, _) => return "–".to_owned(),
        (_, true) => format!("{mean:+.3}"),
        (_, false) => format!("{mean:.3}"),
    };
    // One trial says nothing of how far others differ.
    if ci95.is_finite() { format!("{mean} ± {ci95:.3}") } else { mean }
}
