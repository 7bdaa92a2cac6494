//! Helpers of the physics tests: robots, arrays of numbers from MuJoCo, and a ledger of worst errors.
#![allow(dead_code, reason = "every test file uses its own part")]
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

pub mod batch;
pub mod compare;
pub mod kinematics;
pub mod random;

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use gaitfit_log::npy::Npy;
use gaitfit_model::{Cone, Integrator, Model, ReadOptions, Root, SelfContact, read};
use gaitfit_physics::{Preset, Settings};

/// A path below this crate.
pub fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// A robot of the fixtures folder.
pub fn robot(name: &str) -> Model {
    read(&here(&format!("tests/fixtures/{name}.xml")), &ReadOptions::default()).unwrap()
}

/// A robot of the fixtures folder whose own parts touch as its file says.
pub fn touching(name: &str) -> Model {
    let (model, left_out) = robot(name).touching_itself(&SelfContact::File).unwrap();
    assert!(left_out.is_empty(), "{left_out:?}");
    model
}

/// A robot of the fixtures folder, clamped.
pub fn clamped(name: &str) -> Model {
    let options = ReadOptions { root: Some(Root::Fixed), ..ReadOptions::default() };
    read(&here(&format!("tests/fixtures/{name}.xml")), &options).unwrap()
}

/// Enough work to reach rounding: the reference numbers are converged far below the tolerances.
pub fn converged(model: &Model) -> Settings {
    Settings::new(&model.options, Preset::Converged)
}

/// The arrays of one `.npz` file.
pub struct Arrays {
    numbers: BTreeMap<String, (Vec<usize>, Vec<f64>)>,
}

impl Arrays {
    pub fn open(path: &Path) -> Self {
        let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
        let mut numbers = BTreeMap::new();
        for index in 0..archive.len() {
            let mut entry = archive.by_index(index).unwrap();
            let name = entry.name().unwrap().trim_end_matches(".npy").to_owned();
            let mut bytes = Vec::new();
            entry.read_to_end(&mut bytes).unwrap();
            let array = Npy::parse(&bytes).unwrap();
            let values = array.numbers().unwrap();
            numbers.insert(name, (array.shape, values));
        }
        Self { numbers }
    }

    pub fn has(&self, name: &str) -> bool {
        self.numbers.contains_key(name)
    }

    pub fn all(&self, name: &str) -> &[f64] {
        &self.numbers.get(name).unwrap_or_else(|| panic!("no array `{name}`")).1
    }

    pub fn scalar(&self, name: &str) -> f64 {
        self.all(name)[0]
    }

    /// Number of rows of the first axis.
    pub fn len(&self, name: &str) -> usize {
        self.numbers[name].0[0]
    }

    /// Row `index` of the first axis.
    pub fn row(&self, name: &str, index: usize) -> &[f64] {
        let (shape, values) = &self.numbers.get(name).unwrap_or_else(|| panic!("no array `{name}`"));
        let stride: usize = shape[1..].iter().product();
        &values[index * stride..(index + 1) * stride]
    }
}

/// The model as a fixture's variant changes it.
pub fn variant(model: &Model, data: &Arrays) -> Model {
    let mut model = model.clone();
    model.options.timestep = data.scalar("timestep");
    model.options.cone = if data.scalar("cone") == 1.0 { Cone::Elliptic } else { Cone::Pyramidal };
    model.options.impratio = data.scalar("impratio");
    model.options.integrator =
        if data.scalar("integrator") == 1.0 { Integrator::ImplicitFast } else { Integrator::Euler };
    model.options.eulerdamp = data.scalar("eulerdamp") == 1.0;
    let first = model.nv() - model.joints.len();
    for (joint, loss) in model.joints.iter_mut().zip(&data.all("frictionloss")[first..]) {
        joint.frictionloss = *loss;
    }
    if let Some(free) = &mut model.free_joint {
        free.frictionloss = data.all("frictionloss")[0];
    }
    for plane in &mut model.planes {
        plane.pos.copy_from_slice(data.all("plane_pos"));
        plane.quat.copy_from_slice(data.all("plane_quat"));
    }
    model
}

/// Largest absolute entry.
pub fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |most, v| f64::max(most, v.abs()))
}

/// Largest difference; NaN anywhere gives infinity.
pub fn difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).fold(0.0, |most, (x, y)| {
        let d = (x - y).abs();
        if d.is_nan() { f64::INFINITY } else { f64::max(most, d) }
    })
}

/// Largest difference relative to the largest entry of the reference.
pub fn relative(got: &[f64], want: &[f64]) -> f64 {
    difference(got, want) / largest(want).max(f64::MIN_POSITIVE)
}

/// Largest difference relative to the largest entry of the reference, or to 1 where all are smaller.
pub fn relative_1(got: &[f64], want: &[f64]) -> f64 {
    difference(got, want) / largest(want).max(1.0)
}

/// Worst errors by quantity, each with its limit; `check` prints the table and fails past a limit.
#[derive(Default)]
pub struct Ledger {
    entries: BTreeMap<String, (f64, f64, String)>,
}

impl Ledger {
    pub fn note(&mut self, quantity: &str, error: f64, limit: f64, place: impl FnOnce() -> String) {
        let entry = self.entries.entry(quantity.to_owned()).or_insert((-1.0, limit, String::new()));
        if error > entry.0 || error.is_nan() {
            *entry = (error, limit, place());
        }
    }

    pub fn check(&self, title: &str) {
        println!("{title}");
        for (quantity, (error, limit, place)) in &self.entries {
            println!("  {quantity:<34} {error:9.2e} of {limit:7.0e}  {place}");
        }
        for (quantity, (error, limit, place)) in &self.entries {
            assert!(
                error <= limit,
                "{title}: {quantity} is off by {error:e}, more than {limit:e}, at {place}"
            );
        }
        assert!(!self.entries.is_empty(), "{title}: nothing was compared");
    }
}
