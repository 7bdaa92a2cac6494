//! Where each term of an observation lies in its row, and the one function that writes a row.

use std::ops::Range;

use super::Sensed;
use crate::reference::Follower;
use crate::{FrameOrder, HistoryStart, Interface, Quantity, Term};

/// Where one term lies in a row.
#[derive(Clone, Debug, PartialEq)]
pub struct Slot {
    /// What is observed.
    pub quantity: Quantity,
    /// Its present frame.
    pub present: Range<usize>,
    /// Where each of its frames begins, the oldest first; the last is the present.
    pub frames: Vec<usize>,
    /// Factors, as [`Term::scale`] has them.
    scale: Vec<f32>,
    /// Control periods by which the reference motion is read ahead.
    pub ahead: usize,
}

impl Slot {
    /// Numbers of one frame.
    fn width(&self) -> usize {
        self.present.len()
    }

    /// The factor of number `index` of a frame.
    fn factor(&self, index: usize) -> f32 {
        match self.scale[..] {
            [one] => one,
            _ => self.scale.get(index).copied().unwrap_or(1.0),
        }
    }
}

/// Where the terms of an observation lie in a row, past frames as [`Interface::history`] says.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    slots: Vec<Slot>,
    width: usize,
    start: HistoryStart,
    /// Where the present last action lies, and its factors, where the action before it is observed.
    last_action: Option<(usize, Vec<f32>)>,
    /// Pose at action zero, rad, policy order.
    default_pose: Vec<f32>,
    /// The motion that the policy follows; `None` if the observation has no quantity of a motion.
    follower: Option<Follower>,
}

impl Layout {
    /// The layout of `terms`, for example of [`Interface::observation`]. The interface has passed
    /// [`Interface::check`].
    pub fn new(interface: &Interface, terms: &[Term]) -> Self {
        let joints = interface.joints.len();
        // Numbers of one frame of all terms: whole frames lie this far apart.
        let frame: usize = terms.iter().map(|term| term.quantity.width(joints)).sum();
        let order = interface.history.order;
        let mut start = 0;
        let mut slots = Vec::with_capacity(terms.len());
        for term in terms {
            let (width, count) = (term.quantity.width(joints), term.history.max(1));
            let begin = |number: usize| match order {
                FrameOrder::Terms => start + number * width,
                FrameOrder::Frames => start + number * frame,
                // Frame 0 is the oldest in every order, so here it stands last.
                FrameOrder::NewestFirst => start + (count - 1 - number) * frame,
            };
            let frames: Vec<usize> = (0..count).map(begin).collect();
            let present = begin(count - 1)..begin(count - 1) + width;
            // In whole frames the next term stands beside this one; else it begins behind all frames of this
            // one.
            start += if order == FrameOrder::Terms { count * width } else { width };
            slots.push(Slot {
                quantity: term.quantity,
                present,
                frames,
                scale: term.scale.clone(),
                ahead: term.ahead,
            });
        }
        let default_pose = interface.default_pose.iter().map(|&angle| angle as f32).collect();
        let width = interface.width(terms);
        let find = |quantity: Quantity| slots.iter().find(|slot: &&Slot| slot.quantity == quantity);
        // The action before the last is read from the row before, where it is the last action.
        let last_action = find(Quantity::EarlierAction)
            .and(find(Quantity::LastAction))
            .map(|slot| (slot.present.start, (0..joints).map(|joint| slot.factor(joint)).collect()));
        let follows = terms.iter().any(|term| term.quantity.is_of_reference());
        let follower = if follows { Follower::new(interface) } else { None };
        Self { width, start: interface.history.start, last_action, default_pose, follower, slots }
    }

    /// Numbers in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The terms in order.
    pub fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// Max frames of a term, plus one if the action before the last is observed. A row contains readings of up to this many control
    /// periods, the present one included.
    pub fn frames(&self) -> usize {
        let frames = self.slots.iter().map(|slot| slot.frames.len()).max().unwrap_or(1);
        frames + usize::from(self.last_action.is_some())
    }

    /// Whether the observation has a quantity of the motion that the policy follows.
    pub fn follows(&self) -> bool {
        self.follower.is_some()
    }

    /// Angle by which the motion is turned to face as the robot does, for [`crate::MotionPlace::heading`], rad. `sensed` needs
    /// the base's orientation and the joints, and the time of the motion.
    pub fn motion_heading(&self, sensed: &Sensed) -> f64 {
        self.follower.as_ref().map_or(0.0, |follower| {
            follower.heading(sensed.motion.time, sensed.orientation, &sensed.joint_position)
        })
    }

    /// Joint angles of the motion at a time since its beginning (s), rad, policy order; `None` if the observation has no
    /// quantity of a motion.
    pub fn motion_position(&self, time: f64) -> Option<Vec<f32>> {
        let follower = self.follower.as_ref()?;
        let mut angles = vec![0.0; self.default_pose.len()];
        follower.position(time, &mut angles);
        Some(angles)
    }

    /// The factor of each number of a row. Factors of neither one number nor the term's width, which
    /// [`Interface::check`] refuses, count as 1.
    pub fn scales(&self) -> Vec<f32> {
        let mut scales = vec![1.0; self.width];
        for slot in &self.slots {
            for &start in &slot.frames {
                let part = &mut scales[start..start + slot.width()];
                match slot.scale[..] {
                    [one] => part.fill(one),
                    _ if slot.scale.len() == part.len() => part.copy_from_slice(&slot.scale),
                    _ => {}
                }
            }
        }
        scales
    }

    /// The `past` from which [`Layout::write`] wrote `row`: its frames moved back by one. Of the oldest frames, which `row` no
    /// longer holds and no later row needs, it has copies of the next ones. If the row has no older frame of the last
    /// action, the `past` has it from the action before, rounded.
    ///
    /// # Panics
    /// If `row` is shorter than [`Layout::width`]: an error of the caller.
    #[must_use]
    pub fn before(&self, row: &[f32]) -> Vec<f32> {
        let mut past = row.to_vec();
        for slot in &self.slots {
            for pair in slot.frames.windows(2) {
                past[pair[1]..pair[1] + slot.width()].copy_from_slice(&row[pair[0]..pair[0] + slot.width()]);
            }
        }
        self.restore_last_action(row, &mut past);
        past
    }

    /// Puts into `past` the last action that `row` has as the action before the last.
    fn restore_last_action(&self, row: &[f32], past: &mut [f32]) {
        let Some((place, factors)) = &self.last_action else { return };
        let has_older = |slot: &Slot| slot.quantity == Quantity::LastAction && slot.frames.len() > 1;
        // Its older frame has already moved to the present one.
        if self.slots.iter().any(has_older) {
            return;
        }
        let earlier = || self.slots.iter().filter(|slot| slot.quantity == Quantity::EarlierAction);
        for (joint, factor) in factors.iter().enumerate() {
            // A term with the factor 0 does not show the action.
            if let Some(slot) = earlier().find(|slot| slot.factor(joint) != 0.0) {
                past[place + joint] = row[slot.present.start + joint] / slot.factor(joint) * factor;
            }
        }
    }

    /// Writes the row of a robot.
    ///
    /// `past`: the row of the control period before, whose frames move up by one; `None` at an episode's start, where
    /// [`Interface::history`] says what older frames hold. With one frame a term it is not looked at. `corrupt` may add
    /// sensor noise to the present frame of each term, before the term's scale; it is called in the terms' order.
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
            // First the present frame. Noise comes before the factor, because it is given in the quantity's unit.
            let out = &mut row[slot.present.clone()];
            slot.quantity.write(sensed, &self.default_pose, out);
            if let Some(follower) = &self.follower {
                follower.write(slot.quantity, slot.ahead, sensed, out);
            }
            // What the row before has as its last action.
            if let (Quantity::EarlierAction, Some((place, factors)), Some(past)) =
                (slot.quantity, &self.last_action, past)
            {
                // The row holds it scaled.
                let before = past[*place..].iter().zip(factors);
                out.iter_mut().zip(before).for_each(|(out, (value, factor))| *out = value / factor);
            }
            corrupt(slot.quantity, out);
            match slot.scale.as_slice() {
                [] => {}
                [scale] => out.iter_mut().for_each(|value| *value *= scale),
                scales => out.iter_mut().zip(scales).for_each(|(value, scale)| *value *= scale),
            }
            // An older frame is what stood one frame newer in the row before.
            for pair in slot.frames.windows(2) {
                let to = pair[0]..pair[0] + slot.width();
                match past {
                    Some(past) => row[to].copy_from_slice(&past[pair[1]..pair[1] + slot.width()]),
                    None if self.start == HistoryStart::Zeros => row[to].fill(0.0),
                    None => row.copy_within(slot.present.clone(), to.start),
                }
            }
        }
    }
}
