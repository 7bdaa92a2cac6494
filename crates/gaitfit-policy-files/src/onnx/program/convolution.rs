//! Convolutions along one or two axes, as the histories of RMA and the like go through: the numbers under each place of
//! the kernel become a row, and the rows are multiplied by the weights.

use super::{Program, Value};
use crate::onnx::attributes::Attributes;
use crate::onnx::node_error::{NodeError, misfit, unread};
use crate::onnx::proto::Node;
use gaitfit_policy::graph::{Binary, Operator};

/// Sizes along one axis.
struct Axis {
    length: usize,
    kernel: usize,
    stride: usize,
    dilation: usize,
    before: usize,
    outputs: usize,
}

impl Program {
    pub(super) fn convolution(&mut self, node: &Node, attributes: &Attributes) -> Result<(), NodeError> {
        let x = self.value(node, 0)?;
        let weight =
            self.constant(node, 1).ok_or(NodeError::NotConstant("its weight is not a constant"))?.clone();
        let ([1, channels, lengths @ ..], [outputs, each, kernels @ ..]) = (&x.dims[..], &weight.dims[..])
        else {
            return Err(misfit(format!(
                "its input has the shape {:?}, its weight {:?}",
                x.dims, weight.dims
            )));
        };
        let (channels, outputs, each) = (*channels, *outputs, *each);
        let groups = usize::try_from(attributes.integer("group", 1)).unwrap_or(0);
        let fits = groups > 0
            && channels == each.saturating_mul(groups)
            && outputs > 0
            && outputs.is_multiple_of(groups)
            && lengths.len() == kernels.len()
            && matches!(lengths.len(), 1 | 2)
            && weight.values.iter().all(|x| x.is_finite());
        if !fits {
            return Err(unread(format!(
                "its input has the shape {:?}, its weight {:?} in {groups} groups; along one or two axes convolutions are run",
                x.dims, weight.dims
            )));
        }
        let axes = axes(attributes, lengths, kernels)?;
        let along: Vec<usize> = axes.iter().map(|axis| axis.outputs).collect();
        let places: usize = along.iter().product();
        // Numbers under the kernel at one place, over the channels of one group.
        let window = each * kernels.iter().product::<usize>();
        // Channels that one group gives.
        let high = outputs / groups;
        // Checked before tables of this size are made.
        super::shapes::count(&[places, window]).ok_or(misfit("its windows have too many numbers"))?;
        // Padding is taken from this one number.
        let zero = Value { operand: self.place(vec![0.0])?, dims: vec![1] };
        let mut parts = Vec::new();
        // Each group of channels has weights of its own, so it is a product of its own.
        for group in 0..groups {
            let table = table(&axes, group * each..(group + 1) * each);
            let rows = self.step(Operator::Take(table), &[&x, &zero], vec![places, window])?;
            let rows_of_weight = &weight.values[group * high * window..(group + 1) * high * window];
            let numbers: Vec<f32> = rows_of_weight.iter().map(|&x| x as f32).collect();
            let numbers = crate::layers::transpose(&numbers, high, window);
            let w = Value { operand: self.place(numbers)?, dims: vec![window, high] };
            parts.push(self.by_constant(&rows, &w, high)?);
        }
        // From places × channels of each group to channels × places.
        let turned = (0..outputs).flat_map(|channel| {
            let (group, within) = (channel / high, channel % high);
            (0..places).map(move |place| [group as u32, (place * high + within) as u32])
        });
        let turned = Operator::Take(turned.collect());
        let dims = [&[1, outputs][..], &along].concat();
        let mut value = self.step(turned, &parts.iter().collect::<Vec<_>>(), dims)?;
        if Self::has(node, 2) {
            let mut bias = self.value(node, 2)?;
            // Axes of length one behind the channels let the bias reach all places.
            bias.dims.extend(along.iter().map(|_| 1));
            value = self.both(Binary::Add, &value, &bias)?;
        }
        self.give(node, 0, value)
    }
}

fn axes(attributes: &Attributes, lengths: &[usize], kernels: &[usize]) -> Result<Vec<Axis>, NodeError> {
    let many = lengths.len();
    let list = |key: &str, other: usize, count: usize| -> Result<Vec<usize>, NodeError> {
        let Some(given) = attributes.list(key) else { return Ok(vec![other; count]) };
        // The bound is far beyond any observation; it keeps the sums below from overflowing.
        let numbers: Option<Vec<usize>> =
            given.iter().map(|&one| usize::try_from(one).ok().filter(|&one| one <= 1 << 16)).collect();
        numbers
            .filter(|numbers| numbers.len() == count)
            .ok_or_else(|| misfit(format!("its {key} are {given:?}")))
    };
    let (strides, dilations, pads) =
        (list("strides", 1, many)?, list("dilations", 1, many)?, list("pads", 0, 2 * many)?);
    let padded = attributes.text("auto_pad");
    let mut axes = Vec::new();
    for axis in 0..many {
        let (length, kernel, stride, dilation) =
            (lengths[axis], kernels[axis], strides[axis], dilations[axis]);
        // The length that the kernel covers, with the gaps between its numbers.
        let reach = kernel.saturating_sub(1).saturating_mul(dilation).saturating_add(1);
        if kernel == 0 || stride == 0 || dilation == 0 || length == 0 {
            return Err(misfit("its kernel, strides or dilations are zero"));
        }
        let (before, after) = match padded {
            b"" | b"NOTSET" => (pads[axis], pads[many + axis]),
            b"VALID" => (0, 0),
            b"SAME_UPPER" | b"SAME_LOWER" => {
                // As ONNX has it: as many outputs as inputs over the stride, rounded up; an odd zero goes to
                // the named side.
                let all = ((length.div_ceil(stride) - 1) * stride + reach).saturating_sub(length);
                let less = all / 2;
                if padded == b"SAME_UPPER" { (less, all - less) } else { (all - less, less) }
            }
            _ => return Err(unread("its auto_pad is not known")),
        };
        let whole = before + length + after;
        if whole < reach {
            return Err(misfit(format!("its kernel reaches over {reach} of {whole} numbers")));
        }
        let outputs = (whole - reach) / stride + 1;
        axes.push(Axis { length, kernel, stride, dilation, before, outputs });
    }
    Ok(axes)
}

/// For each place of the kernel, and each number under it, where it is taken from: the input, or the zero beside it.
fn table(axes: &[Axis], channels: std::ops::Range<usize>) -> Vec<[u32; 2]> {
    let sizes = |size: fn(&Axis) -> usize| axes.iter().map(size).collect::<Vec<usize>>();
    let (outputs, kernels) = (sizes(|axis| axis.outputs), sizes(|axis| axis.kernel));
    let whole: usize = axes.iter().map(|axis| axis.length).product();
    let mut table = Vec::new();
    for place in 0..outputs.iter().product() {
        let place = spread(place, &outputs);
        for channel in channels.clone() {
            for number in 0..kernels.iter().product() {
                let number = spread(number, &kernels);
                let mut at = Some(0);
                for ((axis, &place), &number) in axes.iter().zip(&place).zip(&number) {
                    // Places before the first number and behind the last are padding.
                    let along = (place * axis.stride + number * axis.dilation).checked_sub(axis.before);
                    let along = along.filter(|&along| along < axis.length);
                    at = at.zip(along).map(|(at, along)| at * axis.length + along);
                }
                table.push(at.map_or([1, 0], |at| [0, (channel * whole + at) as u32]));
            }
        }
    }
    table
}

/// The place along each axis of a number in an array of these sizes.
fn spread(number: usize, sizes: &[usize]) -> Vec<usize> {
    let mut rest = number;
    // Row-major: the last axis turns fastest.
    let mut places: Vec<usize> = sizes
        .iter()
        .rev()
        .map(|&size| {
            let place = rest % size;
            rest /= size;
            place
        })
        .collect();
    places.reverse();
    places
}
