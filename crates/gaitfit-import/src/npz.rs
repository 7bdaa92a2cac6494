//! npy and npz files of NumPy.

use crate::archive_error::{ArchiveError, ArrayProblem};
use crate::arrays::{Array, Arrays, count};
use crate::budget::{Budget, read_all};
use crate::dtype::DType;
use crate::problem::Problem;
use std::io::Cursor;
use zip::ZipArchive;

/// Longest header of an array, bytes: NumPy itself refuses longer ones.
const MAX_HEADER: usize = 10_000;
/// Max number of files in an archive.
pub(crate) const MAX_ENTRIES: usize = 10_000;

/// The arrays of an npz archive. Arrays of Python objects are refused: they are pickles.
pub(crate) fn read_npz(bytes: &[u8], budget: &mut Budget) -> Result<Arrays, Problem> {
    let zip = |error: zip::result::ZipError| ArchiveError::Zip(error.to_string());
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(zip)?;
    if archive.len() > MAX_ENTRIES {
        return Err(ArchiveError::ManyFiles(archive.len()).into());
    }
    let mut arrays = Arrays::default();
    for i in 0..archive.len() {
        let entry = archive.by_index(i).map_err(zip)?;
        let name = entry.name().map_err(zip)?.trim_end_matches(".npy").to_owned();
        let content = read_all(entry, budget, "zip")?;
        add(&name, &content, &mut arrays, budget)?;
    }
    Ok(arrays)
}

/// Reads one npy file as the array `name`.
pub(crate) fn add(name: &str, bytes: &[u8], arrays: &mut Arrays, budget: &mut Budget) -> Result<(), Problem> {
    let wrong = |problem| ArchiveError::Array { name: name.to_owned(), problem };
    let refuse = |problem| Err(wrong(problem).into());
    // Version 1 states the header's length in 2 bytes, later ones in 4.
    let length = match bytes.get(6) {
        Some(1) => bytes.get(8..10).map(|two| usize::from(u16::from_le_bytes([two[0], two[1]]))),
        _ => bytes.get(8..12).map(|four| u32::from_le_bytes([four[0], four[1], four[2], four[3]]) as usize),
    };
    if !bytes.starts_with(b"\x93NUMPY") || length.is_none_or(|length| length > MAX_HEADER) {
        return refuse(ArrayProblem::NoHeader);
    }
    // Brackets in brackets take the header's parser long.
    let header_end = bytes.len().min(12 + length.unwrap_or(0));
    if bytes[..header_end].iter().filter(|byte| matches!(byte, b'(' | b'[' | b'{')).count() > 64 {
        return refuse(ArrayProblem::Structured);
    }
    // The header's parser multiplies the sizes without looking.
    if !small_enough(&String::from_utf8_lossy(&bytes[..header_end])) {
        return refuse(ArrayProblem::Shape);
    }
    let mut rest = bytes;
    let header =
        npyz::NpyHeader::from_reader(&mut rest).map_err(|error| wrong(ArrayProblem::Header(error)))?;
    let dtype = match header.dtype() {
        npyz::DType::Plain(plain) if plain.uses_pickled_array() => {
            return refuse(ArrayProblem::Objects);
        }
        npyz::DType::Plain(plain) => DType::parse(&plain.to_string()),
        _ => None,
    };
    let Some(dtype) = dtype else {
        return refuse(ArrayProblem::Type);
    };
    let shape: Option<Vec<usize>> = header.shape().iter().map(|size| usize::try_from(*size).ok()).collect();
    let Some(shape) = shape.filter(|shape| shape.len() <= 8) else { return refuse(ArrayProblem::Shape) };
    // Counted against the bytes that are there, before memory is taken.
    let elements =
        count(&shape).filter(|count| count.checked_mul(dtype.bytes()).is_some_and(|n| n <= rest.len()));
    let Some(elements) = elements else { return refuse(ArrayProblem::CutShort) };
    budget.take_values(elements)?;
    if dtype.is_text() {
        let words: Option<Vec<String>> = match dtype.bytes() {
            // Words of no letters (`<U0`) have no bytes.
            0 => None,
            size => rest.chunks_exact(size).take(elements).map(|word| dtype.text(word)).collect(),
        };
        match words {
            Some(words) => arrays.words.insert(name.to_owned(), words),
            None => return refuse(ArrayProblem::Words),
        };
        return Ok(());
    }
    let fortran = header.order() == npyz::Order::Fortran;
    let data = numbers(rest, dtype, &shape, elements, fortran);
    match data {
        Some(data) => arrays.numbers.insert(name.to_owned(), Array { shape, data }),
        None => return refuse(ArrayProblem::Torn),
    };
    Ok(())
}

/// Whether the sizes in a header's text have a product.
fn small_enough(header: &str) -> bool {
    let shape = header.split_once("'shape'").or_else(|| header.split_once("\"shape\""));
    let sizes =
        shape.and_then(|(_, after)| after.split_once('(')).and_then(|(_, after)| after.split_once(')'));
    // A header without a shape is left to the parser.
    let Some((sizes, _)) = sizes else { return true };
    // Python 2 wrote sizes as `10L`.
    let sizes =
        sizes.split(',').map(|size| size.trim().trim_end_matches('L')).filter(|size| !size.is_empty());
    sizes.map(str::parse::<u64>).try_fold(1u64, |product, size| product.checked_mul(size.ok()?)).is_some()
}

/// The numbers of an array in row-major order.
pub(crate) fn numbers(
    bytes: &[u8],
    dtype: DType,
    shape: &[usize],
    elements: usize,
    fortran: bool,
) -> Option<Vec<f64>> {
    let size = dtype.bytes();
    // Chunks of 0 bytes would panic.
    let plain: Option<Vec<f64>> =
        bytes.chunks_exact(size.max(1)).take(elements).map(|number| dtype.number(number)).collect();
    let plain = plain.filter(|plain| plain.len() == elements)?;
    if !fortran || shape.len() < 2 {
        return Some(plain);
    }
    // In Fortran's order the first axis runs fastest; the loop below walks in C's order, the last axis fastest.
    let mut strides = Vec::with_capacity(shape.len());
    let mut stride = 1;
    for size in shape {
        strides.push(stride);
        stride *= size;
    }
    let mut out = Vec::with_capacity(elements);
    let mut place = vec![0usize; shape.len()];
    for _ in 0..elements {
        out.push(plain[place.iter().zip(&strides).map(|(i, stride)| i * stride).sum::<usize>()]);
        for axis in (0..shape.len()).rev() {
            place[axis] += 1;
            if place[axis] < shape[axis] {
                break;
            }
            place[axis] = 0;
        }
    }
    Some(out)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn shapes_without_a_product_are_refused() {
        assert!(small_enough("{'descr': '<f8', 'shape': (40, 12), }"));
        assert!(small_enough("{'descr': '<f8', 'shape': (), }"));
        for shape in ["(4294967296, 4294967296)", "(99999999999999999999,)", "(-1, 2)"] {
            assert!(!small_enough(&format!("{{'descr': '<f8', 'shape': {shape}, }}")), "{shape}");
            let text = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
            let length = u16::try_from(text.len()).unwrap().to_le_bytes();
            let file = [b"\x93NUMPY\x01\x00".as_slice(), &length, text.as_bytes(), &[0; 96]].concat();
            let result = add("q", &file, &mut Arrays::default(), &mut Budget::new(1000, 1000));
            assert!(result.is_err(), "{shape}");
        }
    }
}
