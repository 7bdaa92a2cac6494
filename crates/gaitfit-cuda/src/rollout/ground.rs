//! Ground that is not one level plane at height 0, as the kernels' tables.

use gaitfit_learn::task::Task;
use gaitfit_policy::walker::Walker;

use crate::words::{Words, braces, double};

/// Name of the array of all fields' heights, which is filled when the program is loaded.
pub(crate) const GROUND_HEIGHTS: &str = "GROUND_HEIGHTS";

impl Words {
    /// The ground of a robot. Returns the heights of its fields, m: single precision, as the physics has them.
    pub(crate) fn ground(&mut self, walker: &Walker) -> Vec<f32> {
        let Some(ground) = walker.ground() else {
            self.define("UNEVEN", 0);
            return Vec::new();
        };
        let doubles = |numbers: &[f64]| braces(numbers, |&x| double(x));
        let planes = ground.planes.iter().map(|[height, along_x, along_y]| {
            format!("{{{}, {}}}", double(*height), doubles(&[*along_x, *along_y]))
        });
        let blocks = ground.blocks.iter().map(|block| {
            let axes = doubles(block.axes.as_flattened());
            format!("{{{}, {axes}, {}}}", doubles(&block.position), doubles(&block.half))
        });
        let mut heights = Vec::new();
        let mut fields = Vec::new();
        for field in &ground.fields {
            let (position, turn) = (doubles(&field.position), doubles(&field.turn));
            let (half, step) = (doubles(&field.half_size), doubles(&field.step));
            let (rows, columns, first) = (field.rows, field.columns, heights.len());
            fields.push(format!("{{{position}, {turn}, {half}, {step}, {rows}, {columns}, {first}}}"));
            heights.extend(field.heights.iter().map(|&height| height as f32));
        }
        self.define("UNEVEN", 1);
        self.define("GROUND_LOWEST", format!("({})", double(ground.lowest)));
        // The tables' types are declared after this.
        let mut tables = Words { text: String::new() };
        for (kind, name, rows) in [
            ("GroundPlane", "GROUND_PLANE", planes.collect::<Vec<_>>()),
            ("GroundBlock", "GROUND_BLOCK", blocks.collect()),
            ("GroundField", "GROUND_FIELD", fields),
        ] {
            self.define(&format!("{name}S"), rows.len());
            tables.table(kind, name, rows);
        }
        tables.text.push_str(&format!("__device__ float {GROUND_HEIGHTS}[{}];", heights.len().max(1)));
        self.define("GROUND_TABLES", tables.text.replace('\n', " "));
        heights
    }

    /// The cells of generated ground.
    pub(super) fn course(&mut self, task: &Task) {
        let Some(course) = &task.course else { return self.define("COURSE", 0) };
        let settings = course.settings();
        let [x, y] = course.inside();
        self.define("COURSE", 1);
        for (name, value) in [
            ("LEVELS", settings.levels),
            ("COLUMNS", settings.columns),
            ("DRAWN_LEVELS", course.drawn_levels()),
            ("CURRICULUM", usize::from(settings.curriculum)),
        ] {
            self.define(name, value);
        }
        let numbers =
            [("CELL_SIZE", course.size()), ("ROOM", course.room()), ("INSIDE_X", x), ("INSIDE_Y", y)];
        for (name, value) in numbers {
            self.define(name, double(value));
        }
    }
}
