//! NumPy's files of one array (`.npy`): read without trusting them, and written
//! (<https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>).

mod dtype;

pub use dtype::DType;

/// First bytes of a file.
pub const MAGIC: &[u8] = b"\x93NUMPY";
/// Longest header, bytes: NumPy itself refuses longer ones.
const MAX_HEADER: usize = 10_000;
/// Max dimensions of an array that is read.
const MAX_DIMENSIONS: usize = 8;

/// Why bytes are not an array that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NpyError {
    /// No signature, or a header longer than NumPy's.
    #[error("no NumPy array: its header is missing or too long")]
    Header,
    /// The header's text is not what NumPy writes.
    #[error("a damaged header; save it again with numpy.save or numpy.savez")]
    Text,
    /// Fields with names.
    #[error("a structured array; save plain arrays, one a quantity")]
    Structured,
    /// Pickled objects.
    #[error("an array of Python objects; save numbers: np.asarray(x, dtype=float)")]
    Objects,
    /// Complex numbers, dates and the like.
    #[error("a type of numbers that is not read; save it as float: np.asarray(x, dtype=float)")]
    Type,
    /// More elements than there can be, or more than 8 dimensions.
    #[error("its shape is too large")]
    Shape,
    /// The file ends before its numbers do.
    #[error("cut short: fewer numbers than its shape says")]
    Cut,
}

/// An array in a file's bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Npy<'a> {
    /// Type of the elements.
    pub dtype: DType,
    /// Whether the first index moves fastest.
    pub fortran: bool,
    /// Length of each dimension; empty for one number.
    pub shape: Vec<usize>,
    /// Number of elements: the product of the shape.
    pub elements: usize,
    /// The elements' bytes.
    data: &'a [u8],
}

impl<'a> Npy<'a> {
    /// Reads the header, and checks that all elements are there. It takes no memory for them.
    ///
    /// # Errors
    /// [`NpyError`].
    pub fn parse(bytes: &'a [u8]) -> Result<Self, NpyError> {
        let rest = bytes.strip_prefix(MAGIC).ok_or(NpyError::Header)?;
        let ([major, _minor], rest) = rest.split_first_chunk::<2>().ok_or(NpyError::Header)?;
        let (length, rest) = match major {
            1 => {
                let (length, rest) = rest.split_first_chunk::<2>().ok_or(NpyError::Header)?;
                (usize::from(u16::from_le_bytes(*length)), rest)
            }
            _ => {
                let (length, rest) = rest.split_first_chunk::<4>().ok_or(NpyError::Header)?;
                (u32::from_le_bytes(*length) as usize, rest)
            }
        };
        let header = (length <= MAX_HEADER).then(|| rest.split_at_checked(length)).flatten();
        let (header, data) = header.ok_or(NpyError::Header)?;
        let header = Header::parse(std::str::from_utf8(header).map_err(|_| NpyError::Text)?)?;
        if header.descr.contains('O') {
            return Err(NpyError::Objects);
        }
        let dtype = DType::parse(header.descr).ok_or(NpyError::Type)?;
        let elements = header.shape.iter().try_fold(1usize, |product, size| product.checked_mul(*size));
        let elements = elements.ok_or(NpyError::Shape)?;
        let size = elements.checked_mul(dtype.bytes());
        let data = size.and_then(|size| data.get(..size)).ok_or(NpyError::Cut)?;
        Ok(Npy { dtype, fortran: header.fortran, shape: header.shape, elements, data })
    }

    /// The numbers in row-major order; `None` for words.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        numbers(self.data, self.dtype, &self.shape, self.elements, self.fortran)
    }

    /// The words in the file's order; `None` for numbers, or if they are not text.
    pub fn words(&self) -> Option<Vec<String>> {
        let size = self.dtype.bytes();
        if !self.dtype.is_text() || size == 0 {
            return None;
        }
        self.data.chunks_exact(size).map(|word| self.dtype.text(word)).collect()
    }
}

/// `elements` numbers of `bytes`, in row-major order; with `fortran` their first index moves fastest. `None` if there are
/// fewer, or words.
pub fn numbers(
    bytes: &[u8],
    dtype: DType,
    shape: &[usize],
    elements: usize,
    fortran: bool,
) -> Option<Vec<f64>> {
    let size = dtype.bytes();
    let plain: Option<Vec<f64>> =
        bytes.chunks_exact(size.max(1)).take(elements).map(|number| dtype.number(number)).collect();
    let plain = plain.filter(|plain| plain.len() == elements)?;
    if !fortran || shape.len() < 2 {
        return Some(plain);
    }
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

/// A file with numbers in row-major order, byte for byte as `numpy.save` writes it.
///
/// `values` has as many numbers as the product of `shape`.
pub fn bytes(shape: &[usize], values: &[f64]) -> Vec<u8> {
    debug_assert_eq!(shape.iter().product::<usize>(), values.len());
    let mut sizes = shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    if shape.len() == 1 {
        sizes.push(',');
    }
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({sizes}), }}");
    // NumPy leaves room for a first dimension that grows to 21 digits, then 1 to 64 spaces that align the numbers.
    let grown = shape.first().map_or(0, |first| 21usize.saturating_sub(first.to_string().len()));
    header.push_str(&" ".repeat(grown));
    let begun = MAGIC.len() + 4 + header.len() + 1;
    header.push_str(&" ".repeat(64 - begun % 64));
    header.push('\n');
    let mut out = MAGIC.to_vec();
    out.extend([1, 0]);
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.as_bytes());
    out.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    out
}

/// What a header says: a dictionary as Python writes it.
struct Header<'a> {
    descr: &'a str,
    fortran: bool,
    shape: Vec<usize>,
}

impl<'a> Header<'a> {
    fn parse(text: &'a str) -> Result<Self, NpyError> {
        let damaged = NpyError::Text;
        let mut rest = text.trim().strip_prefix('{').ok_or(damaged)?.trim_start();
        let (mut descr, mut fortran, mut shape) = (None, None, None);
        while !rest.starts_with('}') {
            let (key, after) = quoted(rest).ok_or(damaged)?;
            let value = after.trim_start().strip_prefix(':').ok_or(damaged)?.trim_start();
            rest = match key {
                "descr" if value.starts_with(['[', '(', '{']) => return Err(NpyError::Structured),
                "descr" => {
                    let (text, after) = quoted(value).ok_or(damaged)?;
                    descr = Some(text);
                    after
                }
                "fortran_order" => {
                    let is = value.starts_with("True");
                    fortran = Some(is);
                    value.strip_prefix(if is { "True" } else { "False" }).ok_or(damaged)?
                }
                "shape" => {
                    let (sizes, after) =
                        value.strip_prefix('(').and_then(|value| value.split_once(')')).ok_or(damaged)?;
                    shape = Some(dimensions(sizes)?);
                    after
                }
                _ => return Err(damaged),
            };
            rest = rest.trim_start();
            match rest.strip_prefix(',') {
                Some(after) => rest = after.trim_start(),
                None if !rest.starts_with('}') => return Err(damaged),
                None => {}
            }
        }
        let header = descr.zip(fortran).zip(shape).ok_or(damaged)?;
        let ((descr, fortran), shape) = header;
        Ok(Header { descr, fortran, shape })
    }
}

/// A text in quotes, and what follows.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    text[1..].split_once(quote)
}

/// Sizes between brackets; Python 2 wrote them with an L behind.
fn dimensions(text: &str) -> Result<Vec<usize>, NpyError> {
    let sizes = text.split(',').map(|size| size.trim().trim_end_matches('L')).filter(|size| !size.is_empty());
    let sizes: Vec<usize> =
        sizes.map(|size| size.parse().map_err(|_| NpyError::Shape)).collect::<Result<_, _>>()?;
    if sizes.len() > MAX_DIMENSIONS { Err(NpyError::Shape) } else { Ok(sizes) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        [MAGIC, &[1, 0], &(header.len() as u16).to_le_bytes(), header.as_bytes(), data].concat()
    }

    /// The bytes of `np.save(file, np.array([[1.5, -2.0]]))` with NumPy 2.
    #[test]
    fn bytes_are_those_of_numpy() {
        let mut want =
            b"\x93NUMPY\x01\0v\0{'descr': '<f8', 'fortran_order': False, 'shape': (1, 2), }".to_vec();
        want.resize(127, b' ');
        want.push(b'\n');
        want.extend(1.5f64.to_le_bytes());
        want.extend((-2.0f64).to_le_bytes());
        assert_eq!(bytes(&[1, 2], &[1.5, -2.0]), want);
    }

    #[test]
    fn what_is_written_is_read_again() {
        for shape in [vec![], vec![6], vec![2, 3], vec![1, 2, 3], vec![0, 4]] {
            let count = shape.iter().product::<usize>();
            let values: Vec<f64> = (0..count).map(|i| (i as f64).exp()).collect();
            let bytes = bytes(&shape, &values);
            assert_eq!((bytes.len() - 8 * count) % 64, 0);
            let array = Npy::parse(&bytes).unwrap();
            assert_eq!((&array.shape, array.numbers().unwrap()), (&shape, values));
        }
    }

    #[test]
    fn headers_of_other_writers_are_read() {
        let data: Vec<u8> = (0..6i16).flat_map(i16::to_be_bytes).collect();
        let bytes = file("{\"shape\": (2L, 3L), 'fortran_order': True, 'descr': '>i2'}\n", &data);
        let array = Npy::parse(&bytes).unwrap();
        assert_eq!(array.numbers().unwrap(), [0.0, 2.0, 4.0, 1.0, 3.0, 5.0]);
        let words = file("{'descr': '|S2', 'fortran_order': False, 'shape': (2,), }", b"abc\0");
        let array = Npy::parse(&words).unwrap();
        assert_eq!((array.words().unwrap(), array.numbers()), (vec!["ab".to_owned(), "c".to_owned()], None));
    }

    #[test]
    fn what_is_not_an_array_is_refused_by_name() {
        let head = |descr: &str, shape: &str| {
            file(&format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}"), &[0; 96])
        };
        for (bytes, error) in [
            (head("'<f8'", "(3, 5)"), NpyError::Cut),
            (head("'<f8'", "(4294967296, 4294967296)"), NpyError::Shape),
            (head("'<f8'", "(99999999999999999999,)"), NpyError::Shape),
            (head("'<f8'", "(-1, 2)"), NpyError::Shape),
            (head("'<f8'", "(1, 1, 1, 1, 1, 1, 1, 1, 1)"), NpyError::Shape),
            (head("'|O'", "(3,)"), NpyError::Objects),
            (head("'<c16'", "(3,)"), NpyError::Type),
            (head("[('a', '<f8')]", "(3,)"), NpyError::Structured),
            (head("'<f8", "(3,)"), NpyError::Text),
            (file("{'descr': '<f8', 'shape': (1,)}", &[0; 8]), NpyError::Text),
            (file("{'descr': '<f8' 'shape': (1,)}", &[0; 8]), NpyError::Text),
            (file("", &[]), NpyError::Text),
            (file("é", &[]), NpyError::Text),
            (b"\x93NUMPY\x01".to_vec(), NpyError::Header),
            (b"\x93NUMPY\x02\0\xff\xff\xff\xff{".to_vec(), NpyError::Header),
            (b"PK".to_vec(), NpyError::Header),
        ] {
            let text = String::from_utf8_lossy(&bytes).into_owned();
            assert_eq!(Npy::parse(&bytes), Err(error), "{text}");
        }
    }
}
