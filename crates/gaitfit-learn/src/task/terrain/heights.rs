//! The heights of generated ground.

use gaitfit_model::HeightField;
use gaitfit_random::{Purpose, Stream};

use super::{Cell, Course, TerrainKind, TerrainSettings};

/// Share of a step by which a vertex on its edge may miss it.
const ROUNDING: f64 = 1e-6;

/// The value at `fraction` of the way from the first level to the last.
pub(super) fn at_level([first, last]: [f64; 2], fraction: f64) -> f64 {
    first + (last - first) * fraction
}

/// All cells and the border as one height field about the world's origin: levels along x, columns along y.
pub(super) fn field(settings: &TerrainSettings, course: &Course) -> HeightField {
    let (across, rim) = (settings.across(), settings.rim());
    let vertices = |cells: usize| cells * across + 2 * rim + 1;
    let (columns, rows) = (vertices(settings.levels), vertices(settings.columns));
    let mut heights = vec![0.0; rows * columns];
    for level in 0..settings.levels {
        for column in 0..settings.columns {
            // The border keeps the array's 0, the height at which slopes and stairs end.
            let shape = Shape::new(settings, course, Cell { level, column });
            // A cell's last vertices are the first of the next one.
            for j in 0..across {
                let line = (rim + column * across + j) * columns + rim + level * across;
                for (i, height) in heights[line..line + across].iter_mut().enumerate() {
                    *height = shape.height(i, j);
                }
            }
        }
    }
    // n vertices span n − 1 distances.
    let half = |vertices: usize| 0.5 * (vertices - 1) as f64 * settings.cell;
    HeightField { rows, columns, half_size: [half(columns), half(rows)], heights }
}

/// Shape of the ground on one cell.
struct Shape<'a> {
    settings: &'a TerrainSettings,
    kind: TerrainKind,
    /// −1 for a pit, 1 for a pyramid.
    sign: f64,
    /// Share of the way from the first level to the last, 0 to 1.
    fraction: f64,
    /// Draws of its noise.
    noise: Stream,
}

impl<'a> Shape<'a> {
    fn new(settings: &'a TerrainSettings, course: &Course, cell: Cell) -> Self {
        // Its number keeps the draws of a cell apart from those of the others.
        let number = cell.level * settings.columns + cell.column;
        Self {
            settings,
            kind: course.kind(cell),
            sign: if course.is_pit(cell) { -1.0 } else { 1.0 },
            fraction: course.fraction(cell),
            noise: Stream::new(settings.seed, Purpose::TERRAIN).environment(number as u32),
        }
    }

    /// Height of its vertex `i` along x and `j` along y, m.
    fn height(&self, i: usize, j: usize) -> f64 {
        let TerrainSettings { platform, cell, .. } = *self.settings;
        // The edge in whole vertices, because `size` need not be a multiple of `cell`.
        let size = self.settings.across() as f64 * cell;
        let off = |k: usize| (k as f64 * cell - 0.5 * size).abs();
        // Distance from the middle to the square through the vertex, and from there to the edge.
        let out = off(i).max(off(j));
        let (inner, half) = (0.5 * platform, 0.5 * size);
        match self.kind {
            TerrainKind::Flat => 0.0,
            TerrainKind::Slopes => {
                self.sign * at_level(self.settings.slope, self.fraction) * (half - out.clamp(inner, half))
            }
            TerrainKind::Stairs => {
                // Whole steps between platform and edge; a remainder that fits no step stays level at the
                // edge. A vertex is as many steps from the edge as it has not taken yet from the platform.
                let depth = at_level(self.settings.step_depth, self.fraction);
                let steps = ((half - inner) / depth + ROUNDING).floor();
                let taken = if out < inner - ROUNDING {
                    0.0
                } else {
                    ((out - inner) / depth + ROUNDING).floor() + 1.0
                };
                self.sign * at_level(self.settings.step_height, self.fraction) * (steps - taken).max(0.0)
            }
            TerrainKind::Rough => {
                let amplitude = at_level(self.settings.roughness, self.fraction);
                // Value noise: heights are drawn on a coarser grid and interpolated bilinearly between its
                // corners.
                let spacing = self.settings.rough_distance;
                let (x, y) = (i as f64 * cell / spacing, j as f64 * cell / spacing);
                let (a, b) = (x.floor(), y.floor());
                // Corners of a cell's own grid, counted from its first vertex: neighbouring cells do not join
                // smoothly.
                let drawn = |a: f64, b: f64| 2.0 * self.noise.step(a as u32).uniform(b as u32) - 1.0;
                let along = |b: f64| {
                    let (low, high) = (drawn(a, b), drawn(a + 1.0, b));
                    low + (x - a) * (high - low)
                };
                let (low, high) = (along(b), along(b + 1.0));
                amplitude * (low + (y - b) * (high - low))
            }
        }
    }
}
