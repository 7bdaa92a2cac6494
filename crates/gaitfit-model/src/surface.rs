//! How high the ground is under a point.

use crate::model::{Model, Plane};
use crate::rotation::{Vec3, rotate};
use crate::shown::shown;
use crate::terrain::ObstacleShape;

/// Planes whose normal rises by no more than this (walls), and fields whose normal leans by more than this sine, have no heights.
const UPRIGHT: f64 = 1e-9;

/// The highest ground above each point of the horizontal plane: of planes, boxes and height fields.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Height at the origin (m) and slopes along x and y of each plane.
    pub planes: Vec<[f64; 3]>,
    /// Boxes.
    pub blocks: Vec<SurfaceBlock>,
    /// Height fields.
    pub fields: Vec<SurfaceField>,
    /// The lowest of all, m: the height where there is nothing.
    pub lowest: f64,
}

/// Ground whose heights are not known.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "height field `{name}` leans, so heights above it are not known; turn it about the vertical only, or use a box or a plane"
)]
pub struct LeaningField {
    /// The field.
    pub name: String,
}

/// A box of the ground.
#[derive(Clone, Debug)]
pub struct SurfaceBlock {
    /// Its middle, m, world frame.
    pub position: Vec3,
    /// Its axes in the world.
    pub axes: [Vec3; 3],
    /// Half its edges, m.
    pub half: Vec3,
}

/// An upright height field of the ground.
#[derive(Clone, Debug)]
pub struct SurfaceField {
    /// Its middle, m, world frame.
    pub position: Vec3,
    /// Cosine and sine of its turn about the vertical.
    pub turn: [f64; 2],
    /// Half sizes along its x and y, m.
    pub half_size: [f64; 2],
    /// Distances of neighbouring vertices along its x and y, m.
    pub step: [f64; 2],
    /// Vertices along its y.
    pub rows: usize,
    /// Vertices along its x.
    pub columns: usize,
    /// Heights, m, row by row from the lowest y, each from the lowest x.
    pub heights: Vec<f64>,
}

impl Surface {
    /// The ground of `model`; `None` if it is level and at height 0, with neither boxes nor height fields.
    ///
    /// # Errors
    /// A height field that is not upright.
    pub fn new(model: &Model) -> Result<Option<Self>, LeaningField> {
        let normal = |plane: &Plane| rotate(plane.quat, [0.0, 0.0, 1.0]);
        // Walls have no height.
        let plain = |plane: &Plane| {
            let up = normal(plane)[2];
            // A plane that faces down has no height either, and level ground at 0 needs no surface.
            up <= UPRIGHT || (up == 1.0 && plane.pos[2] == 0.0)
        };
        if model.obstacles.is_empty() && model.planes.iter().all(plain) {
            return Ok(None);
        }
        let mut surface =
            Self { planes: Vec::new(), blocks: Vec::new(), fields: Vec::new(), lowest: f64::INFINITY };
        for plane in &model.planes {
            let normal = normal(plane);
            if normal[2] > UPRIGHT {
                // The plane n·(p − p₀) = 0, solved for the height.
                let slopes = [-normal[0] / normal[2], -normal[1] / normal[2]];
                let [x, y, z] = plane.pos;
                surface.planes.push([z - slopes[0] * x - slopes[1] * y, slopes[0], slopes[1]]);
                surface.lowest = surface.lowest.min(z);
            }
        }
        for obstacle in &model.obstacles {
            let axis = |k: usize| rotate(obstacle.quat, std::array::from_fn(|i| f64::from(u8::from(i == k))));
            let axes = [axis(0), axis(1), axis(2)];
            match &obstacle.shape {
                ObstacleShape::Box { half_size } => {
                    // How far a box that is turned reaches below its middle.
                    let reach: f64 = (0..3).map(|k| half_size[k] * axes[k][2].abs()).sum();
                    surface.lowest = surface.lowest.min(obstacle.pos[2] - reach);
                    surface.blocks.push(SurfaceBlock { position: obstacle.pos, axes, half: *half_size });
                }
                ObstacleShape::Field(field) => {
                    if axes[2][0].hypot(axes[2][1]) > UPRIGHT || axes[2][2] < 0.0 {
                        return Err(LeaningField { name: shown(&obstacle.name) });
                    }
                    if field.rows < 2 || field.columns < 2 || field.heights.len() < field.rows * field.columns
                    {
                        // Such a field is refused where it is compiled.
                        continue;
                    }
                    let low = field.heights.iter().copied().fold(f64::INFINITY, f64::min);
                    surface.lowest = surface.lowest.min(obstacle.pos[2] + low);
                    surface.fields.push(SurfaceField {
                        position: obstacle.pos,
                        turn: [axes[0][0], axes[0][1]],
                        half_size: field.half_size,
                        step: field.steps(),
                        rows: field.rows,
                        columns: field.columns,
                        heights: field.heights.clone(),
                    });
                }
            }
        }
        Ok(Some(surface))
    }

    /// Height of the highest ground at x, y (m), m; where there is none, that of the lowest ground anywhere.
    pub fn height(&self, x: f64, y: f64) -> f64 {
        let planes = self.planes.iter().map(|[z, along_x, along_y]| z + along_x * x + along_y * y);
        let blocks = self.blocks.iter().filter_map(|block| block.top(x, y));
        let fields = self.fields.iter().filter_map(|field| field.height(x, y));
        let highest = planes.chain(blocks).chain(fields).fold(f64::NEG_INFINITY, f64::max);
        if highest > f64::NEG_INFINITY { highest } else { self.lowest }
    }

    /// The highest ground of a square about x, y that reaches `radius` to each side, as far as nine points of it say, m.
    pub fn highest_about(&self, x: f64, y: f64, radius: f64) -> f64 {
        let offsets = [-radius, 0.0, radius];
        let all = offsets.into_iter().flat_map(|dx| offsets.map(|dy| self.height(x + dx, y + dy)));
        all.fold(f64::NEG_INFINITY, f64::max)
    }
}

impl SurfaceBlock {
    /// Where the vertical line at x, y leaves it, if it meets it.
    fn top(&self, x: f64, y: f64) -> Option<f64> {
        // A box is what three pairs of parallel planes have in common (slab method, Kay and Kajiya 1986): the line is
        // inside from the last entry to the first exit.
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        let d = [x - self.position[0], y - self.position[1]];
        for (axis, half) in self.axes.iter().zip(self.half) {
            let along = axis[0] * d[0] + axis[1] * d[1];
            // The line runs along these two planes: between them all the way, or never.
            if axis[2].abs() <= UPRIGHT {
                if along.abs() > half {
                    return None;
                }
                continue;
            }
            let ends = [(-half - along) / axis[2], (half - along) / axis[2]];
            low = low.max(ends[0].min(ends[1]));
            high = high.min(ends[0].max(ends[1]));
        }
        (low <= high && high < f64::INFINITY).then_some(self.position[2] + high)
    }
}

impl SurfaceField {
    /// Its height at x, y, on the triangles that the physics touches: a cell's diagonal runs from its lower row and
    /// column to its higher ones.
    fn height(&self, x: f64, y: f64) -> Option<f64> {
        let [cos, sin] = self.turn;
        let (dx, dy) = (x - self.position[0], y - self.position[1]);
        let local = [cos * dx + sin * dy, cos * dy - sin * dx];
        if local[0].abs() > self.half_size[0] || local[1].abs() > self.half_size[1] {
            return None;
        }
        let u = (local[0] + self.half_size[0]) / self.step[0];
        let v = (local[1] + self.half_size[1]) / self.step[1];
        // NaN becomes 0 as an index.
        let (column, row) =
            ((u.max(0.0) as usize).min(self.columns - 2), (v.max(0.0) as usize).min(self.rows - 2));
        let (u, v) = (u - column as f64, v - row as f64);
        let at = |a: usize, b: usize| self.heights[(row + b) * self.columns + column + a];
        let height = if u >= v {
            at(0, 0) + u * (at(1, 0) - at(0, 0)) + v * (at(1, 1) - at(1, 0))
        } else {
            at(0, 0) + v * (at(0, 1) - at(0, 0)) + u * (at(1, 1) - at(0, 1))
        };
        Some(self.position[2] + height)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::{ReadOptions, read_mjcf_str};

    fn surface(ground: &str) -> Result<Option<Surface>, LeaningField> {
        let text = format!(
            r#"<mujoco><compiler angle="degree"/><asset>
            <hfield name="f" nrow="3" ncol="3" size="1 2 0.9 1" elevation="6 7 8  3 4 5  0 1 2"/></asset>
            <worldbody>{ground}<body pos="0 0 5"><freejoint/><geom name="ball" size="0.1"/></body></worldbody></mujoco>"#
        );
        Surface::new(&read_mjcf_str(&text, &ReadOptions::default()).unwrap())
    }

    #[test]
    fn flat_ground_at_height_0_has_no_surface() {
        assert!(surface(r#"<geom type="plane" size="1 1 1"/>"#).unwrap().is_none());
        assert!(surface("").unwrap().is_none());
    }

    #[test]
    fn a_raised_or_tilted_plane_has_a_surface() {
        let raised = surface(r#"<geom type="plane" size="1 1 1" pos="3 0 0.5"/>"#).unwrap().unwrap();
        assert_eq!(raised.height(-7.0, 2.0), 0.5);
        let tilted = surface(r#"<geom type="plane" size="1 1 1" euler="0 -10 0"/>"#).unwrap().unwrap();
        assert!((tilted.height(2.0, 1.0) - 2.0 * 10f64.to_radians().tan()).abs() < 1e-12);
    }

    #[test]
    fn heights_are_those_of_the_grid_and_of_its_triangles() {
        let field = surface(r#"<geom type="hfield" hfield="f" pos="10 20 0.5"/>"#).unwrap().unwrap();
        // Elevations 0 ... 8 become 0 ... 0.9: columns along x, rows along y, the last row of the text first.
        let unit = 0.9 / 8.0;
        for row in 0..3 {
            for column in 0..3 {
                let (x, y) = (9.0 + column as f64, 18.0 + 2.0 * row as f64);
                let wanted = 0.5 + unit * (3 * row + column) as f64;
                let found = field.height(x, y);
                assert!((found - wanted).abs() < 1e-6, "{row} {column}: {found}, not {wanted}");
            }
        }
        // The field is the plane unit · (x + 3 y / 2) from its corner.
        let found = field.height(9.3, 18.9);
        assert!((found - (0.5 + unit * (0.3 + 3.0 * 0.9 / 2.0))).abs() < 1e-6, "{found}");
        assert_eq!(field.height(0.0, 0.0), 0.5, "nothing there: the lowest");
        assert_eq!(field.height(f64::NAN, 19.0), 0.5, "no number: the lowest, and no panic");
        // A quarter turn: its x is the world's y.
        let turned = surface(r#"<geom type="hfield" hfield="f" euler="0 0 90"/>"#).unwrap().unwrap();
        assert!((turned.height(1.8, 0.9) - unit * (1.9 + 3.0 * 0.2 / 2.0)).abs() < 1e-6);
        let error = surface(r#"<geom name="g" type="hfield" hfield="f" euler="10 0 0"/>"#).unwrap_err();
        assert!(error.to_string().contains("`g` leans"), "{error}");
    }

    #[test]
    fn the_highest_of_planes_and_boxes_counts() {
        let ground = surface(
            r#"<geom type="plane" size="0 0 1" pos="0 0 0.1"/><geom type="box" size="1 1 0.2" pos="0 0 0.1"/>
            <geom type="box" size="1 1 0.2" pos="5 0 0" euler="0 -30 0"/>"#,
        );
        let ground = ground.unwrap().unwrap();
        assert!((ground.height(3.0, 0.0) - 0.1).abs() < 1e-12);
        assert!((ground.height(0.9, -0.9) - 0.3).abs() < 1e-12);
        // The top of the leaning box rises with x: 0.2 / cos 30° over its middle.
        let top = |x: f64| 0.2 / 0.75f64.sqrt() + x * 30f64.to_radians().tan();
        assert!((ground.height(5.0, 0.5) - top(0.0)).abs() < 1e-12);
        assert!((ground.height(5.3, 0.5) - top(0.3)).abs() < 1e-12);
        assert!((ground.highest_about(0.0, 1.05, 0.1) - 0.3).abs() < 1e-12);
    }
}
