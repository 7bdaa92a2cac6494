//! Choice of the numbers that a graph's inputs take, by their widths.

use gaitfit_model::shown;
use gaitfit_policy::{Frames, Inputs, Interface, PolicyError, Taken, invalid};

/// Returns the numbers that inputs take which a description does not name, by their widths: `None` is a width
/// that the file leaves open.
///
/// # Errors
/// Widths that are neither that of the row nor of the present frame.
pub(super) fn guessed(
    interface: &Interface,
    open: &[(String, Option<usize>)],
) -> Result<Inputs, PolicyError> {
    let width = |frames: Frames| Ok::<_, PolicyError>(Taken::Frames(frames).places(interface)?.len());
    let widths = [Frames::All, Frames::Present, Frames::Past]
        .map(|frames| width(frames).map(|width| (frames, width)))
        .into_iter()
        .collect::<Result<Vec<_>, _>>()?;
    let mut inputs = Inputs::new();
    for (name, wanted) in open {
        // Without a history the whole row and its present frame are as wide: the whole row comes first.
        let fits = widths.iter().find(|(_, width)| Some(*width) == *wanted);
        // One input of any width takes everything.
        let frames = match (fits, open) {
            (Some((frames, _)), _) => *frames,
            (None, [_]) if wanted.is_none() => Frames::All,
            _ => {
                let name = shown(name);
                let takes = wanted.map_or("any number of".to_owned(), |width| width.to_string());
                let described = interface.describe(&interface.observation);
                let present = widths[1].1;
                return Err(invalid(format!(
                    "its input {name} takes {takes} numbers; the observation is {described}, {present} in its present frame. \
                     Say what it takes in a TOML file, for example inputs = {{ {name} = \"present\" }} (or \"all\", \"past\", \
                     or a list of quantities; docs/policies-foreign.md)"
                )));
            }
        };
        inputs.insert(name.clone(), Taken::Frames(frames));
    }
    Ok(inputs)
}
