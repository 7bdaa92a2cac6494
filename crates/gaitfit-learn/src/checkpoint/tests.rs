//! Numbers that cannot be, under a right checksum.

use gaitfit_physics::Preset;
use safetensors::SafeTensors;

use super::{BEFORE, Origin, checksum};
use crate::task::{Task, TaskSettings};
use crate::{Training, TrainingSettings, ppo};

#[test]
fn numbers_that_cannot_be_are_refused() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    let model = gaitfit_model::read(path.as_ref(), &Default::default()).unwrap();
    let task = Task::new(&model, &TaskSettings::default(), Preset::Fast).unwrap();
    let learner = Training::fresh_learner(&task, &ppo::Settings::default(), 7).unwrap();
    let settings = TrainingSettings { environments: 270, steps: 6, iterations: 5 };
    let mut training = Training::new(&task, None, &settings, learner, 7).unwrap();
    let origin = Origin { robot: "go2".to_owned(), model: "m".to_owned(), settings: "s".to_owned(), seed: 7 };
    let bytes = training.save(&origin, 0.0).unwrap();
    let mut spoilt = |tensor: &str, number: [u8; 4]| {
        let mut bytes = bytes.clone();
        let data = SafeTensors::deserialize(&bytes).unwrap().tensor(tensor).unwrap().data().as_ptr();
        let place = data as usize - bytes.as_ptr() as usize;
        bytes[place..place + 4].copy_from_slice(&number);
        assert!(checksum::seal(&mut bytes, BEFORE));
        training.restore(&bytes, &origin).unwrap_err().to_string()
    };
    let longest = task.episode_steps();
    assert!(spoilt("tile.0.steps", (longest + 1).to_le_bytes()).contains("of another task"));
    assert!(spoilt("tile.1.returns", f32::INFINITY.to_le_bytes()).contains("tile.1.returns holds inf"));
    assert!(spoilt("learner.adam.second", (-1.0_f32).to_le_bytes()).contains("`adam.second` is -1"));
    assert!(spoilt("learner.actor", f32::NAN.to_le_bytes()).contains("`actor` is NaN"));
}
