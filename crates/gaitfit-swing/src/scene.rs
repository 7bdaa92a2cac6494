//! Walks of one robot, with what their swings showed of its joints.

use crate::feet::Ground;
use crate::report::{SwingReport, SwingSettings};
use crate::torques::Drag;
use crate::walk::Walk;
use gaitfit_model::Model;

/// Walks of one robot, and what is known of its joints from its legs in the air.
pub(crate) struct Scene<'a> {
    pub model: &'a Model,
    pub walks: &'a [Walk],
    pub groups: Vec<(String, Vec<usize>)>,
    pub settings: SwingSettings,
    /// Delay of targets, s.
    pub delay: f64,
    /// Friction, damping and armature, one entry a joint.
    pub drag: Vec<Drag>,
    /// One entry a walk.
    pub grounds: Vec<Ground>,
}

impl<'a> Scene<'a> {
    /// `swings`: what [`crate::estimate_walks`] found in the same walks.
    pub fn new(model: &'a Model, walks: &'a [Walk], swings: &SwingReport, settings: &SwingSettings) -> Self {
        let groups = settings.groups_of(model);
        let settings = settings.of_walks(walks);
        let delay = swings.delay.value;
        let mut drag = vec![Drag::default(); model.joints.len()];
        for (name, joints) in &groups {
            if let Some(group) = swings.groups.iter().find(|group| group.group == *name) {
                joints.iter().for_each(|&joint| drag[joint] = group.drag());
            }
        }
        // The second look knows from the first how the base moves.
        let grounds = gaitfit_pool::map(walks.len(), settings.threads, |log| {
            let first = Ground::new(model, &walks[log], delay, &drag, None);
            Ground::new(model, &walks[log], delay, &drag, Some(&first))
        });
        Self { model, walks, groups, settings, delay, drag, grounds }
    }
}
