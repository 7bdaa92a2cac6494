//! What walks show of joints, ground and sensors without a simulation.

use super::cause;
use gaitfit_log::{Estimate, Sensors};
use gaitfit_model::Model;
use gaitfit_swing::{Effect, Standing, SwingReport, SwingSettings, Walk, effects};
use serde::{Deserialize, Serialize};

/// Findings in the logs of one robot without a simulation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SwingFindings {
    /// Lags, biases and noise of sensors.
    pub sensors: Sensors,
    /// Findings about the inertial unit from standing feet.
    pub standing: Standing,
    /// The same, estimated together with the twist of joints; absent if no joints seem to twist. See [`Self::tilt`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beside_twist: Option<Standing>,
    /// Faults that were removed from the logs before legs in the air were examined, each in a sentence.
    pub taken_out: Vec<String>,
    /// Names of the robot's slides. Estimates from legs in the air leave them out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub slides: Vec<String>,
    /// Names of the hinges that follow others, lead others, or are held by a coupling. The estimates leave them out too.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub coupled: Vec<String>,
    /// Effects of joints and ground that the model lacks, each alone, see [`super::explain`].
    #[serde(default)]
    pub effects: Vec<Effect>,
    /// Estimates from legs in the air; absent if there are none.
    pub swings: Option<SwingReport>,
    /// Why there are none.
    pub why_not: Option<String>,
    /// The estimates from legs in the air, corrected by simulated walks; absent if they are not corrected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrected: Option<SwingReport>,
    /// Why they are not corrected, if a correction was tried; the end of a sentence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_corrected: Option<String>,
}

impl SwingFindings {
    /// The tilt of the IMU about the base's x and y axes, rad. If joints twist, the one that was estimated together with their
    /// twist.
    pub fn tilt(&self) -> Option<[Estimate; 2]> {
        // Joints that twist let the standing robot lean. Without the twist in the estimate this looks like a
        // tilted unit.
        let twists = self.twisting().is_some();
        self.beside_twist.filter(|_| twists).unwrap_or(self.standing).tilt
    }

    /// The effects beyond `model`; none if no legs swing.
    pub(crate) fn effects_of(&self, model: &Model, walks: &[Walk], settings: &SwingSettings) -> Vec<Effect> {
        self.swings.as_ref().map(|report| effects(model, walks, report, settings)).unwrap_or_default()
    }

    /// The joint group whose twist under load the logs show most surely, if they show any.
    pub fn twisting(&self) -> Option<String> {
        cause::twisting(&self.effects, self.swings.as_ref())
    }

    /// Springs and strengths of single joints among the causes.
    pub fn singles(&self) -> impl Iterator<Item = &Effect> {
        cause::singles(&self.effects, self.swings.as_ref())
    }

    /// The estimates from legs in the air: the corrected ones if there are such.
    pub fn best(&self) -> Option<&SwingReport> {
        self.corrected.as_ref().or(self.swings.as_ref())
    }
}
