//! What the targets share: readers that take files of a folder.

use gaitfit_import::{Mapping, Options, import};
use gaitfit_log::{ReadOptions, read_csv};
use std::cell::RefCell;
use std::path::PathBuf;
use tempfile::TempDir;

/// A folder of this process, and the file in it that readers are given.
struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Self {
        Place { folder: tempfile::tempdir().expect("a folder for the files to read") }
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.folder.path().join(name);
        std::fs::write(&path, bytes).expect("space for the file to read");
        path
    }
}

thread_local! {
    static PLACE: RefCell<Option<Place>> = const { RefCell::new(None) };
}

/// Calls `work` with the folder of this process.
fn with_place<T>(work: impl FnOnce(&Place) -> T) -> T {
    PLACE.with(|place| work(place.borrow_mut().get_or_insert_with(Place::new)))
}

/// Imports a file that begins as files of its kind do; others are not looked at, because another target has them.
pub fn read_log(begins: &[u8], bytes: &[u8]) {
    if !bytes.starts_with(begins) {
        return;
    }
    let joints: Vec<String> = (0..12).map(|i| format!("'joint_{i}'")).collect();
    let mapping =
        Mapping::parse(&format!("joints = [{}]", joints.join(", "))).expect("a mapping that is read");
    // The limits bound the memory, as those that a caller gives do.
    let options = Options { mapping, max_bytes: 1 << 20, max_values: 1_000_000 };
    with_place(|place| {
        let path = place.write("log", bytes);
        if let Ok(imported) = import(&[&path], &options) {
            imported.trajectory.validate().expect("what is imported is well formed");
        }
    });
}

/// Reads a file as a log of gaitfit's own.
pub fn read_own_log(bytes: &[u8]) {
    let options = ReadOptions { max_bytes: 1 << 20, max_columns: 64, ..ReadOptions::default() };
    with_place(|place| {
        if let Ok(log) = read_csv(&place.write("log.csv", bytes), &options) {
            log.validate().expect("what is read is well formed");
        }
    });
}

/// Reads a policy of a kind of file, by itself and through a description.
pub fn read_policy(ending: &str, bytes: &[u8]) {
    with_place(|place| {
        let name = format!("policy.{ending}");
        let path = place.write(&name, bytes);
        let joints: Vec<String> = (0..12).map(|i| format!("'joint_{i}'")).collect();
        let description = format!(
            "file = '{name}'\njoints = [{}]\ndefault_pose = 0.0\naction_scale = 0.25\nkp = 20.0\nkd = 0.5\ncontrol_dt = 0.02\n\
             activation = 'elu'\nobservation = [{{ quantity = 'base_angular_velocity' }}, {{ quantity = 'projected_gravity' }}, \
             {{ quantity = 'command' }}, {{ quantity = 'joint_position' }}, {{ quantity = 'joint_velocity' }}, \
             {{ quantity = 'last_action' }}]\n",
            joints.join(", ")
        );
        let described = place.write("policy.toml", description.as_bytes());
        for path in [path, described] {
            if let Ok(policy) = gaitfit_policy_files::read(&path) {
                policy.check().expect("what is read is well formed");
            }
        }
    });
}
