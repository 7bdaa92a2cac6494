//! Static ground that is not flat: boxes and height fields, and the height fields of a file's assets.

use std::collections::HashMap;

use serde::Serialize;

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::options::Compiler;
use crate::picture;
use crate::shown::{shown, shown_path};
use crate::xml::Element;

/// The part of the world that a pair's geom may touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Ground {
    /// Index into `planes`.
    Plane(usize),
    /// A box or a height field.
    Obstacle {
        /// Index into `obstacles`.
        obstacle: usize,
    },
}

/// A static box or height field of the world.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Obstacle {
    /// Name.
    pub name: String,
    /// Position in the world, m.
    pub pos: [f64; 3],
    /// Orientation in the world, wxyz.
    pub quat: [f64; 4],
    /// Shape and size.
    pub shape: ObstacleShape,
}

/// Shape of an obstacle.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ObstacleShape {
    /// Box.
    Box {
        /// Half sizes along its axes, m.
        half_size: [f64; 3],
    },
    /// Height field.
    Field(HeightField),
}

/// Heights over a grid (MuJoCo's `hfield`). Column `c` of row `r` stands at x = −X + 2 X c / (columns − 1) and
/// y = −Y + 2 Y r / (rows − 1), with X, Y the half sizes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HeightField {
    /// Vertices along y.
    pub rows: usize,
    /// Vertices along x.
    pub columns: usize,
    /// Half sizes along x and y, m.
    pub half_size: [f64; 2],
    /// Heights, m: row by row from the lowest y, each from the lowest x.
    pub heights: Vec<f64>,
}

// 1024 × 1024 vertices are 8 MiB of heights.
/// Max number of vertices of a height field.
const MAX_VERTICES: usize = 1 << 20;
/// Max number of height fields of a file.
const MAX_FIELDS: usize = 16;
/// Elevations closer together than this are level (MuJoCo's `mjEPS`).
const LEVEL: f32 = 1e-14;

impl HeightField {
    /// Distances of neighbouring vertices along x and y, m.
    pub fn steps(&self) -> [f64; 2] {
        // A single vertex has no neighbour; the divisor stays above 0.
        let step = |half: f64, vertices: usize| 2.0 * half / (vertices.max(2) - 1) as f64;
        [step(self.half_size[0], self.columns), step(self.half_size[1], self.rows)]
    }
}

/// The height fields of a file's assets.
#[derive(Debug, Default)]
pub(crate) struct Fields {
    /// The height fields that can be used.
    pub all: Vec<HeightField>,
    /// By name, as a place in `all` or why it cannot be used.
    pub names: HashMap<String, Result<usize, String>>,
}

/// Reads the height fields of an `<asset>` section.
pub(crate) fn read_fields(
    ctx: &Context,
    asset: &Element,
    compiler: &Compiler,
    fields: &mut Fields,
) -> Result<(), ModelError> {
    let Fields { all, names } = fields;
    for element in asset.children.iter().filter(|child| child.name == "hfield") {
        let file = element.get("file").unwrap_or("");
        let name = element.get("name").filter(|name| !name.is_empty()).unwrap_or_else(|| stem(file));
        if names.contains_key(name) {
            let message = format!("height field \"{}\" is there twice", shown(name));
            return Err(ctx.invalid(element.at, message, "names must differ"));
        }
        if names.len() >= MAX_FIELDS {
            return Err(ctx.too_many(element.at, "height fields", MAX_FIELDS));
        }
        let field = read_field(ctx, element, file, compiler)?.map(|field| {
            all.push(field);
            all.len() - 1
        });
        names.insert(name.to_string(), field);
    }
    Ok(())
}

/// The name that an asset gets from its file.
pub(crate) fn stem(file: &str) -> &str {
    let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// A height field, or why it cannot be used: a robot may do without its terrain, so that is said where a geom uses it.
fn read_field(
    ctx: &Context,
    element: &Element,
    file: &str,
    compiler: &Compiler,
) -> Result<Result<HeightField, String>, ModelError> {
    let mut a = Attributes::new(element);
    let Some(size) = a.array::<4>(ctx, "size")? else {
        let message = format!("{} without `size`", element.label());
        return Err(ctx.invalid(element.at, message, "add size=\"x y height base\""));
    };
    if size.iter().any(|length| *length <= 0.0) {
        let message = format!("`size` of {} is not above zero", element.label());
        return Err(ctx.invalid(a.at("size"), message, "give four lengths above zero"));
    }
    let (rows, columns, data) = if file.is_empty() {
        let (rows, columns) = (a.integer(ctx, "nrow")?, a.integer(ctx, "ncol")?);
        let count = |n: Option<i32>| n.and_then(|n| usize::try_from(n).ok()).unwrap_or(0);
        let (rows, columns) = (count(rows), count(columns));
        if rows.saturating_mul(columns) > MAX_VERTICES {
            return Err(ctx.too_many(element.at, "vertices of a height field", MAX_VERTICES));
        }
        let given = a.numbers(ctx, "elevation")?;
        let data = match given {
            // Without heights the field is level, as in MuJoCo.
            None => vec![0.0; rows * columns],
            Some(given) if given.len() == rows * columns => flipped(&given, columns),
            Some(given) => {
                let message = format!("`elevation` of {} has {} numbers", element.label(), given.len());
                return Err(ctx.invalid(
                    a.at("elevation"),
                    message,
                    "give nrow times ncol, from the highest y to the lowest",
                ));
            }
        };
        (rows, columns, data)
    } else {
        match read_file(ctx, file, compiler) {
            Ok(found) => found,
            Err(why) => return Ok(Err(why)),
        }
    };
    // The engine looks for the nearest point around an inner vertex, so there must be one.
    if rows < 3 || columns < 3 {
        return Ok(Err(format!("it has {rows} × {columns} vertices; give at least 3 × 3")));
    }
    // A number of the text may overflow single precision.
    if !data.iter().all(|height| height.is_finite()) {
        return Ok(Err("its heights are too large".to_string()));
    }
    let heights = scaled(&data, size[2]);
    Ok(Ok(HeightField { rows, columns, half_size: [size[0], size[1]], heights }))
}

/// Rows in the opposite order: a file's text begins with the highest y.
fn flipped(given: &[f64], columns: usize) -> Vec<f32> {
    given.chunks(columns.max(1)).rev().flatten().map(|&height| height as f32).collect()
}

/// Elevations brought to 0 ... 1 as MuJoCo does, in its precision, times the height.
fn scaled(data: &[f32], height: f64) -> Vec<f64> {
    // The lowest vertex comes to 0 and the highest one to `height`, unless the field is level.
    let low = data.iter().copied().fold(f32::INFINITY, f32::min);
    let range = data.iter().copied().fold(f32::NEG_INFINITY, f32::max) - low;
    // A level field would be divided by 0.
    let unit = |z: f32| if range > LEVEL { (z - low) / range } else { z - low };
    data.iter().map(|&z| f64::from(unit(z)) * height).collect()
}

/// MuJoCo's own format: rows and columns as 32-bit integers, then as many 32-bit floats, all little-endian.
fn read_file(ctx: &Context, file: &str, compiler: &Compiler) -> Result<(usize, usize, Vec<f32>), String> {
    let Some(folder) = &ctx.sources.folder else {
        return Err("a text has no folder for its file".to_string());
    };
    let path = folder.join(&compiler.mesh_folder).join(file);
    let shown = shown_path(&path);
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png")) {
        return picture::read(&path, MAX_VERTICES).map_err(|error| format!("{shown}: {error}"));
    }
    // Two counts, then a float for each vertex.
    let max = 8 + 4 * MAX_VERTICES as u64;
    let size = std::fs::metadata(&path).map_err(|error| format!("{shown}: {error}"))?;
    if !size.is_file() || size.len() > max {
        return Err(format!("{shown}: not a regular file of at most {max} bytes"));
    }
    let bytes = std::fs::read(&path).map_err(|error| format!("{shown}: {error}"))?;
    let words: Vec<[u8; 4]> =
        bytes.chunks_exact(4).map(|word| [word[0], word[1], word[2], word[3]]).collect();
    // A negative count becomes 0, and a field without vertices is refused later.
    let count = |word: &[u8; 4]| usize::try_from(i32::from_le_bytes(*word)).unwrap_or(0);
    let wrong = || format!("{shown}: not MuJoCo's format: rows, columns, then a float for each vertex");
    let [rows, columns, data @ ..] = &words[..] else { return Err(wrong()) };
    let (rows, columns) = (count(rows), count(columns));
    let data: Vec<f32> = data.iter().map(|word| f32::from_le_bytes(*word)).collect();
    if rows.checked_mul(columns) != Some(data.len()) {
        return Err(wrong());
    }
    Ok((rows, columns, data))
}
