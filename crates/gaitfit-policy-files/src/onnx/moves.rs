//! Operators on constants that only move numbers: exporters cut and join weights in the graph.

use super::attributes::Attributes;
use super::constant::Constant;

/// Max number of axes of a constant whose numbers are moved.
const MAX_AXES: usize = 8;

/// The result of `operator` on constants, of at most `max` numbers; `None` where it is not one of these, or does not fit its
/// inputs.
pub(super) fn moved(
    operator: &str,
    inputs: &[&Constant],
    attributes: &Attributes,
    max: usize,
) -> Option<Constant> {
    let first = *inputs.first()?;
    // Without numbers an axis may be as long as a file likes to say.
    if first.dims.len() > MAX_AXES || first.values.is_empty() {
        return None;
    }
    match operator {
        "Slice" => slice(first, inputs, attributes, max),
        "Expand" => expand(first, &inputs.get(1)?.values, max),
        "Flatten" => {
            let many = first.dims.len() as i64;
            let place = attributes.integer("axis", 1);
            let place = if place < 0 { place.checked_add(many)? } else { place };
            let (ahead, behind) = first.dims.split_at_checked(usize::try_from(place).ok()?)?;
            shaped(first, vec![ahead.iter().product(), behind.iter().product()])
        }
        "Concat" => concat(inputs, axis(attributes.integer("axis", 0), first.dims.len())?, max),
        "Gather" => {
            gather(first, inputs.get(1)?, axis(attributes.integer("axis", 0), first.dims.len())?, max)
        }
        "Unsqueeze" => {
            let axes = axes(inputs, attributes)?;
            let many = first.dims.len() + axes.len();
            let axes: Vec<usize> = axes.into_iter().map(|one| axis(one, many)).collect::<Option<_>>()?;
            // Places that are not new take the old lengths in their order.
            let mut old = first.dims.iter();
            let dims =
                (0..many).map(|place| if axes.contains(&place) { Some(1) } else { old.next().copied() });
            shaped(first, dims.collect::<Option<_>>()?)
        }
        "Squeeze" => {
            let many = first.dims.len();
            let listed = axes(inputs, attributes).unwrap_or_default();
            let gone: Vec<usize> = listed.into_iter().map(|one| axis(one, many)).collect::<Option<_>>()?;
            // Without a list, all axes of length one go.
            let stays = |place: usize, length: usize| match gone.is_empty() {
                true => length != 1,
                false => !gone.contains(&place),
            };
            let dims = first.dims.iter().enumerate().filter(|&(place, &length)| stays(place, length));
            shaped(first, dims.map(|(_, &length)| length).collect())
        }
        "Reshape" => reshape(first, &inputs.get(1)?.values),
        "Transpose" => {
            let many = first.dims.len();
            // Without an order, ONNX turns the axes round.
            let order: Vec<usize> = match attributes.list("perm") {
                Some(order) => order.iter().map(|&place| axis(place, many)).collect::<Option<_>>()?,
                None => (0..many).rev().collect(),
            };
            transpose(first, &order)
        }
        _ => None,
    }
}

/// The place of an axis, which a negative number counts from the end.
fn axis(number: i64, many: usize) -> Option<usize> {
    let many = i64::try_from(many).ok()?;
    let place = if number < 0 { number + many } else { number };
    (0..many).contains(&place).then_some(place as usize)
}

/// Axes as an attribute (old operator sets) or as the second input.
fn axes(inputs: &[&Constant], attributes: &Attributes) -> Option<Vec<i64>> {
    let given = || inputs.get(1).map(|axes| axes.values.iter().map(|&one| one as i64).collect());
    let listed: Vec<i64> = attributes.list("axes").map(<[i64]>::to_vec).or_else(given)?;
    (listed.len() <= MAX_AXES).then_some(listed)
}

/// Returns the same numbers in another shape; `None` if it has another count.
fn shaped(constant: &Constant, dims: Vec<usize>) -> Option<Constant> {
    let count = dims.iter().try_fold(1_usize, |count, &length| count.checked_mul(length))?;
    (count == constant.values.len()).then(|| Constant {
        dims,
        values: constant.values.clone(),
        whole: constant.whole,
    })
}

fn reshape(constant: &Constant, asked: &[f64]) -> Option<Constant> {
    if asked.len() > MAX_AXES {
        return None;
    }
    let mut dims: Vec<usize> = Vec::new();
    let mut open = None;
    for (place, &length) in asked.iter().enumerate() {
        dims.push(match length {
            -1.0 if open.is_none() => {
                // Its length follows from the others; until then it counts as one.
                open = Some(place);
                1
            }
            // In ONNX, 0 keeps the length that the axis had.
            0.0 => *constant.dims.get(place)?,
            length if length > 0.0 => length as usize,
            _ => return None,
        });
    }
    if let Some(place) = open {
        let known = dims.iter().try_fold(1_usize, |count, &length| count.checked_mul(length))?;
        dims[place] = constant.values.len().checked_div(known)?;
    }
    shaped(constant, dims)
}

/// Blocks along an axis: how many runs of numbers there are, and how many numbers one step of the axis has.
fn blocks(dims: &[usize], axis: usize) -> (usize, usize) {
    (dims[..axis].iter().product(), dims[axis + 1..].iter().product())
}

/// The steps `places` of an axis, one after the other.
fn taken(constant: &Constant, axis: usize, places: &[usize], max: usize) -> Option<Constant> {
    let (runs, wide) = blocks(&constant.dims, axis);
    let long = constant.dims[axis];
    let count = runs.checked_mul(wide)?.checked_mul(places.len())?;
    if count > max || places.iter().any(|&place| place >= long) {
        return None;
    }
    let mut values = Vec::with_capacity(count);
    for run in 0..runs {
        for &place in places {
            let from = (run * long + place) * wide;
            values.extend_from_slice(constant.values.get(from..from + wide)?);
        }
    }
    let mut dims = constant.dims.clone();
    dims[axis] = places.len();
    Some(Constant { dims, values, whole: constant.whole })
}

/// `Slice` with its limits as inputs, or as attributes as before operator set 10; in steps of one or backwards.
fn slice(constant: &Constant, inputs: &[&Constant], attributes: &Attributes, max: usize) -> Option<Constant> {
    let given = |number: usize, key: &str| -> Option<Vec<f64>> {
        let listed = attributes.list(key).map(|list| list.iter().map(|&one| one as f64).collect());
        inputs.get(number).map(|input| input.values.clone()).or(listed)
    };
    let (starts, ends) = (given(1, "starts")?, given(2, "ends")?);
    let (axes, steps) = (given(3, "axes"), given(4, "steps"));
    let many = constant.dims.len();
    let cut = starts.len();
    if cut != ends.len() || cut > MAX_AXES {
        return None;
    }
    let mut slice = constant.clone();
    for number in 0..cut {
        // Without a list the first axes are cut, in their order.
        let named = match &axes {
            Some(axes) => *axes.get(number)? as i64,
            None => number as i64,
        };
        let axis = axis(named, many)?;
        let step = steps.as_ref().map_or(Some(1.0), |steps| steps.get(number).copied())?;
        let long = slice.dims[axis];
        let places: Vec<usize> = match step {
            1.0 => range(starts[number], ends[number], long).collect(),
            step if step > 1.0 => range(starts[number], ends[number], long).step_by(step as usize).collect(),
            // The whole axis backwards, as a flip is exported.
            -1.0 if (starts[number] == -1.0 || starts[number] >= long as f64 - 1.0)
                && ends[number] < -(long as f64) =>
            {
                (0..long).rev().collect()
            }
            _ => return None,
        };
        slice = taken(&slice, axis, &places, max)?;
    }
    Some(slice)
}

/// `Expand`: axes of length one are repeated, and new ones stand before the others.
fn expand(constant: &Constant, asked: &[f64], max: usize) -> Option<Constant> {
    if asked.len() > MAX_AXES {
        return None;
    }
    let asked: Vec<usize> = asked.iter().map(|&length| length as usize).collect();
    let many = asked.len().max(constant.dims.len());
    let mut expanded = constant.clone();
    // Axes are aligned at their ends, so missing ones are put in front.
    while expanded.dims.len() < many {
        expanded.dims.insert(0, 1);
    }
    for (axis, &length) in (many - asked.len()..).zip(&asked) {
        match (expanded.dims[axis], length) {
            (_, 1) => {}
            (own, length) if own == length => {}
            (1, length) => {
                // Before the list of places is made: a file may ask for any length.
                expanded.values.len().checked_mul(length).filter(|&count| count <= max)?;
                expanded = taken(&expanded, axis, &vec![0; length], max)?;
            }
            _ => return None,
        }
    }
    Some(expanded)
}

/// The steps of a slice along an axis of `long` steps: negative limits count from the end, limits beyond it are the end.
pub(super) fn range(start: f64, end: f64, long: usize) -> std::ops::Range<usize> {
    let place = |limit: f64| {
        let limit = if limit < 0.0 { limit + long as f64 } else { limit };
        // ONNX bounds limits beyond an end: exporters write the largest whole number for "to the end".
        limit.clamp(0.0, long as f64) as usize
    };
    place(start)..place(end)
}

/// `Gather` of a list of places, or of one, which takes the axis away.
fn gather(constant: &Constant, places: &Constant, axis: usize, max: usize) -> Option<Constant> {
    let long = constant.dims[axis] as f64;
    let place = |&place: &f64| {
        let place = if place < 0.0 { place + long } else { place };
        (0.0..long).contains(&place).then_some(place as usize)
    };
    let listed: Vec<usize> = places.values.iter().map(place).collect::<Option<_>>()?;
    let mut rows = taken(constant, axis, &listed, max)?;
    // A single index takes its axis away, a list of indices keeps it.
    match places.dims.len() {
        0 => {
            rows.dims.remove(axis);
            Some(rows)
        }
        1 => Some(rows),
        _ => None,
    }
}

fn concat(inputs: &[&Constant], axis: usize, max: usize) -> Option<Constant> {
    let first = inputs.first()?;
    let alike = |one: &&Constant| {
        let mut dims = one.dims.clone();
        let fits = dims.len() == first.dims.len();
        if fits {
            dims[axis] = first.dims[axis];
        }
        dims == first.dims
    };
    let total = inputs.iter().try_fold(0_usize, |sum, one| sum.checked_add(one.values.len()))?;
    if total > max || !inputs.iter().all(alike) {
        return None;
    }
    let (runs, wide) = blocks(&first.dims, axis);
    let mut values = Vec::with_capacity(total);
    // In row-major order the blocks of all inputs alternate, once a run.
    for run in 0..runs {
        for one in inputs {
            let long = one.dims[axis] * wide;
            values.extend_from_slice(one.values.get(run * long..(run + 1) * long)?);
        }
    }
    let mut dims = first.dims.clone();
    dims[axis] = inputs.iter().map(|one| one.dims[axis]).sum();
    Some(Constant { dims, values, whole: first.whole })
}

fn transpose(constant: &Constant, order: &[usize]) -> Option<Constant> {
    let many = constant.dims.len();
    // An order that names an axis twice would take some numbers twice and leave others out.
    let mut sorted = order.to_vec();
    sorted.sort_unstable();
    if sorted != (0..many).collect::<Vec<usize>>() {
        return None;
    }
    let stride = |axis: usize| constant.dims[axis + 1..].iter().product::<usize>();
    let dims: Vec<usize> = order.iter().map(|&axis| constant.dims[axis]).collect();
    let strides: Vec<usize> = order.iter().map(|&axis| stride(axis)).collect();
    let mut values = Vec::with_capacity(constant.values.len());
    // The place of a number in the result, axis by axis from the last one on, gives its place in the source.
    for number in 0..constant.values.len() {
        let (mut rest, mut from) = (number, 0);
        for (length, stride) in dims.iter().zip(&strides).rev() {
            from += rest % length * stride;
            rest /= length;
        }
        values.push(*constant.values.get(from)?);
    }
    Some(Constant { dims, values, whole: constant.whole })
}
