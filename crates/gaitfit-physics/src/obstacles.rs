//! Static boxes and height fields of a model, compiled for the step.

use gaitfit_model::{Geom, HeightField, Model, ObstacleShape, Shape};

use crate::terrain::{Block, Ceiling, Field};
use crate::tree::Touched;
use crate::vec3::*;
use crate::{PhysicsError, Real};

/// Most vertices of a field: their numbers are exact in single precision.
const MAX_VERTICES: usize = 1 << 24;

/// The obstacles of a model.
pub(crate) struct Obstacles<K> {
    pub blocks: Vec<Block<K>>,
    pub fields: Vec<Field<K>>,
    /// Where each obstacle of the model is.
    places: Vec<Touched>,
}

impl<K> Obstacles<K> {
    /// No obstacles.
    pub fn none() -> Self {
        Self { blocks: Vec::new(), fields: Vec::new(), places: Vec::new() }
    }

    /// Compiles the obstacles of `model`.
    ///
    /// # Errors
    /// A height field that is no grid.
    pub fn compile<T: Real<K = K>>(model: &Model) -> Result<Self, PhysicsError> {
        let k3 = |v: V3<f64>| v.map(T::constant);
        let mut all = Self::none();
        for obstacle in &model.obstacles {
            let (rotation, position) = (quat_matrix(&obstacle.quat).map(k3), k3(obstacle.pos));
            match &obstacle.shape {
                ObstacleShape::Box { half_size } => {
                    all.places.push(Touched::Block(all.blocks.len()));
                    all.blocks.push(Block { rotation, position, half: k3(*half_size) });
                }
                ObstacleShape::Field(field) => {
                    check(field, &obstacle.name)?;
                    let steps = field.steps();
                    let top = field.heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                    all.places.push(Touched::Field(all.fields.len()));
                    all.fields.push(Field {
                        rotation,
                        position,
                        // The origin of a field is in the middle of its grid.
                        corner: field.half_size.map(|half| T::constant(-half)),
                        step: steps.map(T::constant),
                        per_step: steps.map(|step| T::constant(1.0 / step)),
                        // The last inner vertex: the four cells about it must exist.
                        last: [field.columns, field.rows].map(|count| T::constant((count - 2) as f64)),
                        columns: T::constant(field.columns as f64),
                        top: T::constant(top),
                        heights: field.heights.iter().map(|&height| T::constant(height)).collect(),
                        ceiling: ceiling::<T>(field),
                    });
                }
            }
        }
        Ok(all)
    }

    /// Where an obstacle is that `geom` may touch.
    ///
    /// # Errors
    /// A shape that is neither a sphere nor a capsule, or a ball too large for the field's cells.
    pub fn touched(&self, model: &Model, geom: &Geom, obstacle: usize) -> Result<Touched, PhysicsError> {
        let name = || (geom.name.clone(), model.obstacles[obstacle].name.clone());
        let radius = match geom.shape {
            Shape::Sphere { radius } | Shape::Capsule { radius, .. } => radius,
            other => {
                let (geom, obstacle) = name();
                return Err(PhysicsError::ObstacleShape { geom, shape: other.name(), obstacle });
            }
        };
        if let ObstacleShape::Field(field) = &model.obstacles[obstacle].shape {
            let [x, y] = field.steps();
            // The nearest of a field's points is sought among the cells about one vertex.
            if radius > 0.5 * x.min(y) {
                let (geom, obstacle) = name();
                return Err(PhysicsError::FieldCells { geom, radius, obstacle, cell: x.min(y) });
            }
        }
        Ok(self.places[obstacle])
    }
}

/// How far a ceiling looks, m, and over how many cells at most: the parts of a walking robot reach no further.
const LOOK: f64 = 0.2;
const MAX_CELLS: usize = 64;

/// The greatest heights about each block of cells.
fn ceiling<T: Real>(field: &HeightField) -> Ceiling<T::K> {
    let steps = field.steps();
    // At least one cell, also where cells are longer than the look.
    let cells = ((LOOK / steps[0].min(steps[1])).ceil() as usize).clamp(1, MAX_CELLS);
    let blocks = [field.columns, field.rows].map(|vertices| (vertices - 1).div_ceil(cells));
    // Vertices of a block, and of those on either side.
    let range = |block: usize, vertices: usize| {
        block.saturating_sub(1) * cells..((block + 2) * cells + 1).min(vertices)
    };
    let mut heights = Vec::with_capacity(blocks[0] * blocks[1]);
    for row in 0..blocks[1] {
        // First down the columns, then along the row.
        let mut high = vec![f64::NEG_INFINITY; field.columns];
        for line in range(row, field.rows) {
            let line = &field.heights[line * field.columns..(line + 1) * field.columns];
            high.iter_mut().zip(line).for_each(|(high, &height)| *high = high.max(height));
        }
        for column in 0..blocks[0] {
            let part = &high[range(column, field.columns)];
            heights.push(T::constant(part.iter().copied().fold(f64::NEG_INFINITY, f64::max)));
        }
    }
    let edges = steps.map(|step| step * cells as f64);
    Ceiling {
        per_edge: edges.map(|edge| T::constant(1.0 / edge)),
        edge: T::constant(edges[0].min(edges[1])),
        last: blocks.map(|count| T::constant((count - 1) as f64)),
        columns: T::constant(blocks[0] as f64),
        heights,
    }
}

fn check(field: &HeightField, name: &str) -> Result<(), PhysicsError> {
    let wrong = |quantity, value, must| {
        let object = format!("height field `{name}`");
        Err(PhysicsError::Value { object, quantity, value, must })
    };
    let (rows, columns) = (field.rows, field.columns);
    // The nearest point is sought in the four cells about an inner vertex, so there must be one.
    if rows < 3 || columns < 3 {
        return wrong("the number of rows or columns", rows.min(columns) as f64, "at least 3");
    }
    if rows.checked_mul(columns) != Some(field.heights.len()) || field.heights.len() > MAX_VERTICES {
        return wrong(
            "the number of heights",
            field.heights.len() as f64,
            "rows times columns, at most 2^24",
        );
    }
    if let Some(half) = field.half_size.into_iter().find(|half| !(*half > 0.0 && half.is_finite())) {
        return wrong("a half size", half, "positive and finite");
    }
    if let Some(height) = field.heights.iter().find(|height| !height.is_finite()) {
        return wrong("a height", *height, "finite");
    }
    Ok(())
}
