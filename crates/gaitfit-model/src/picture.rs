//! Heights of a height field in a PNG picture.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use png::{BitDepth, ColorType, Decoder, Limits, Transformations};

// The largest height field in four channels of 16 bits is 8 MiB before compression.
/// Largest file, bytes.
const MAX_BYTES: u64 = 64 << 20;

/// Reads the heights of the picture at `path` as MuJoCo does: rows, columns and, row by row from the lowest line, the grey
/// values 0 to 255. Of 16 bits the upper ones count, of colours the red.
///
/// # Errors
/// In words: no PNG file, or more than `max` points.
pub(crate) fn read(path: &Path, max: usize) -> Result<(usize, usize, Vec<f32>), String> {
    let size = std::fs::metadata(path).map_err(|error| error.to_string())?;
    if !size.is_file() || size.len() > MAX_BYTES {
        return Err(format!("not a regular file of at most {MAX_BYTES} bytes"));
    }
    let file = BufReader::new(File::open(path).map_err(|error| error.to_string())?);
    // Four channels of two bytes a point, and as much for the decoder itself.
    let mut decoder = Decoder::new_with_limits(file, Limits { bytes: 16 * max + (1 << 20) });
    // Palettes become colours, fewer bits become 8, and of 16 bits the lower ones go.
    decoder.set_transformations(Transformations::EXPAND | Transformations::STRIP_16);
    let wrong = |error: png::DecodingError| format!("not a PNG picture that can be read: {error}");
    let mut reader = decoder.read_info().map_err(wrong)?;
    let (columns, rows) = (reader.info().width as usize, reader.info().height as usize);
    // Asked before memory is taken for the points.
    if rows.saturating_mul(columns) > max {
        return Err(format!("it has {columns} × {rows} points; at most {max} may be"));
    }
    let Some(size) = reader.output_buffer_size() else { return Err("it is too large".to_owned()) };
    let mut bytes = vec![0; size];
    let info = reader.next_frame(&mut bytes).map_err(wrong)?;
    if info.bit_depth != BitDepth::Eight || info.color_type == ColorType::Indexed {
        return Err("its colours are of a kind that is not read; save it in grey, 8 bits".to_owned());
    }
    let (channels, line) = (info.color_type.samples(), info.line_size);
    let lines = bytes.chunks(line.max(1)).take(rows).collect::<Vec<_>>();
    // MuJoCo's first row is the lowest line of the picture.
    let values = lines.iter().rev().flat_map(|line| line.chunks_exact(channels).take(columns));
    let data: Vec<f32> = values.filter_map(|point| point.first()).map(|&grey| f32::from(grey)).collect();
    if data.len() != rows * columns {
        return Err("it ends before its last line".to_owned());
    }
    Ok((rows, columns, data))
}
