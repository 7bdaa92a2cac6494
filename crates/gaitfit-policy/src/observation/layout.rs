//! Where each term of an observation lies in its row, and the one function that writes a row.

use std::ops::Range;

use super::Sensed;
use crate::{Interface, Quantity, Term};

/// Where one term lies in a row.
#[derive(Clone, Debug, PartialEq)]
pub struct Slot {
    /// What is observed.
    pub quantity: Quantity,
    /// Its numbers: all frames one after the other, the oldest first.
    pub range: Range<usize>,
    /// Frames: the present one and those of the control periods before it.
    pub frames: usize,
    /// Numbers of one frame.
    width: usize,
    /// Factors, as [`Term::scale`] has them.
    scale: Vec<f32>,
}

/// Where the terms of an observation lie in a row: term after term, and within a term frame after frame, the oldest
/// first (the order of Isaac Lab's flattened history). Interfaces have one frame a term.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    slots: Vec<Slot>,
    width: usize,
    /// Pose at action zero, rad, policy order.
    default_pose: Vec<f32>,
}

impl Layout {
    /// Of `terms` (for example [`Interface::observation`]) with one frame each.
    pub fn new(interface: &Interface, terms: &[Term]) -> Self {
        Self::with_frames(interface, terms, &[])
    }

    /// Of `terms` with `frames` frames each, in their order; a term without an entry, or with 0, has one.
    pub fn with_frames(interface: &Interface, terms: &[Term], frames: &[usize]) -> Self {
        let joints = interface.joints.len();
        let mut start = 0;
        let mut slots = Vec::with_capacity(terms.len());
        for (index, term) in terms.iter().enumerate() {
            let width = term.quantity.width(joints);
            let frames = frames.get(index).copied().unwrap_or(1).max(1);
            let range = start..start + frames * width;
            start = range.end;
            slots.push(Slot { quantity: term.quantity, range, frames, width, scale: term.scale.clone() });
        }
        let default_pose = interface.default_pose.iter().map(|&angle| angle as f32).collect();
        Self { slots, width: start, default_pose }
    }

    /// Numbers in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The terms in order.
    pub fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// Writes the row of a robot.
    ///
    /// `past`: the row of the control period before, whose frames move up by one; `None` at an episode's start, where
    /// all frames show the present. With one frame a term it is not looked at. `corrupt` may add sensor noise to the
    /// present frame of each term, before the term's scale; it is called in the terms' order.
    ///
    /// # Panics
    /// If `row` or `past` is shorter than [`Layout::width`], or `sensed` is of another number of joints: errors of the
    /// caller.
    #[inline]
    pub fn write(
        &self,
        sensed: &Sensed,
        past: Option<&[f32]>,
        mut corrupt: impl FnMut(Quantity, &mut [f32]),
        row: &mut [f32],
    ) {
        for slot in &self.slots {
            let Range { start, end } = slot.range;
            let present = end - slot.width;
            let out = &mut row[present..end];
            self.sense(slot.quantity, sensed, out);
            corrupt(slot.quantity, out);
            match slot.scale.as_slice() {
                [] => {}
                [scale] => out.iter_mut().for_each(|value| *value *= scale),
                scales => out.iter_mut().zip(scales).for_each(|(value, scale)| *value *= scale),
            }
            if slot.frames > 1 {
                match past {
                    Some(past) => row[start..present].copy_from_slice(&past[start + slot.width..end]),
                    None => {
                        let (older, present) = row[start..end].split_at_mut(present - start);
                        older.chunks_exact_mut(slot.width).for_each(|frame| frame.copy_from_slice(present));
                    }
                }
            }
        }
    }

    /// The present value of one term, before noise and scale.
    #[inline]
    fn sense(&self, quantity: Quantity, sensed: &Sensed, out: &mut [f32]) {
        match quantity {
            Quantity::BaseAngularVelocity => out.copy_from_slice(&sensed.base_angular_velocity),
            Quantity::ProjectedGravity => out.copy_from_slice(&sensed.projected_gravity),
            Quantity::BaseLinearVelocity => out.copy_from_slice(&sensed.base_linear_velocity),
            Quantity::Command => out.copy_from_slice(&sensed.command),
            Quantity::JointPosition => {
                out.copy_from_slice(&sensed.joint_position);
                out.iter_mut().zip(&self.default_pose).for_each(|(value, home)| *value -= home);
            }
            Quantity::JointVelocity => out.copy_from_slice(&sensed.joint_velocity),
            Quantity::LastAction => out.copy_from_slice(&sensed.last_action),
            Quantity::GaitPhase => {
                let (sin, cos) = (std::f32::consts::TAU * sensed.clock).sin_cos();
                out.copy_from_slice(&[sin, cos]);
            }
        }
    }
}
