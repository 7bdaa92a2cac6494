//! What a fit's result depends on.

use super::setup::Setup;
use crate::Error;
use crate::run::inputs::Inputs;
use crate::settings::AdaptConfig;
use std::path::Path;

/// Hashes the robot, the logs with the files beside them, and the settings.
pub fn inputs(config: &AdaptConfig, setup: &Setup) -> Result<Inputs, Error> {
    let mut files: Vec<&Path> = vec![&setup.robot_path];
    for log in setup.fit.logs.iter().chain(setup.validate.iter().flat_map(|set| &set.logs)) {
        files.push(&log.path);
        files.extend(log.sidecars.iter().map(|path| path.as_ref() as &Path));
    }
    // Where results go, how often they are saved and on how many threads they are found changes nothing.
    let mut settings = config.clone();
    settings.name = None;
    settings.runs = String::new();
    settings.checkpoint_seconds = 0.0;
    settings.simulation.threads = 0;
    settings.optimizer.max_seconds = 0.0;
    Inputs::new(files, &setup.model, &settings)
}
