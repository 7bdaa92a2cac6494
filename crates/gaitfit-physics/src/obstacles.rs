//! Static boxes and height fields of a model, compiled for the step.

use gaitfit_model::{Geom, HeightField, Model, ObstacleShape, Shape};

use crate::terrain::{Block, Field};
use crate::tree::Touched;
use crate::vec3::*;
use crate::{PhysicsError, Real};

/// Most vertices of a field: their numbers are exact in single precision.
const MOST_VERTICES: usize = 1 << 24;

/// The obstacles of a model.
pub(crate) struct Obstacles<K> {
    pub blocks: Vec<Block<K>>,
    pub fields: Vec<Field<K>>,
    /// Where each obstacle of the model is.
    places: Vec<Touched>,
}

impl<K> Obstacles<K> {
    /// Compiles the obstacles of `model`.
    ///
    /// # Errors
    /// A height field that is no grid.
    pub fn compile<T: Real<K = K>>(model: &Model) -> Result<Self, PhysicsError> {
        let k3 = |v: V3<f64>| v.map(T::constant);
        let mut all = Self { blocks: Vec::new(), fields: Vec::new(), places: Vec::new() };
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
                        corner: field.half_size.map(|half| T::constant(-half)),
                        step: steps.map(T::constant),
                        per_step: steps.map(|step| T::constant(1.0 / step)),
                        last: [field.columns, field.rows].map(|count| T::constant((count - 2) as f64)),
                        columns: T::constant(field.columns as f64),
                        top: T::constant(top),
                        heights: field.heights.iter().map(|&height| T::constant(height)).collect(),
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

fn check(field: &HeightField, name: &str) -> Result<(), PhysicsError> {
    let wrong = |quantity, value, must| {
        let object = format!("height field `{name}`");
        Err(PhysicsError::Value { object, quantity, value, must })
    };
    let (rows, columns) = (field.rows, field.columns);
    if rows < 3 || columns < 3 {
        return wrong("the number of rows or columns", rows.min(columns) as f64, "at least 3");
    }
    if rows.checked_mul(columns) != Some(field.heights.len()) || field.heights.len() > MOST_VERTICES {
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
