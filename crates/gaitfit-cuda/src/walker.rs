//! A policy on a robot as kernels' text: joints, targets, falls and observations.

use gaitfit_policy::observation::{Layout, Slot};
use gaitfit_policy::walker::{TOUCH, Walker};
use gaitfit_policy::{HistoryStart, Quantity, frames, target};

use crate::emit::Class;
use crate::physics::Period;
use crate::ppo::{Array, Kind};
use crate::traced::function;
use crate::words::{Words, double, single};

/// Where the terms of a row lie, and the half range of the noise on each.
pub(crate) type Observed<'a> = (&'a Layout, &'a dyn Fn(Quantity) -> f32);

/// Numbers of a row that are kept from step to step: none without past frames.
pub(crate) fn kept(layout: &Layout) -> usize {
    if layout.frames() > 1 { layout.width() } else { 0 }
}

/// Whether a row contains the action before the last.
fn observes_earlier(layout: &Layout) -> bool {
    layout.slots().iter().any(|slot| slot.quantity == Quantity::EarlierAction)
}

/// Number that the kernels need of a term besides its `Term`: for the earlier action, the place of the present last
/// action in the row; for quantities of a motion, the control periods by which it is read ahead; else 0.
fn extra(layout: &Layout, slot: &Slot) -> usize {
    let last = || layout.slots().iter().find(|other| other.quantity == Quantity::LastAction);
    match slot.quantity {
        Quantity::EarlierAction => last().map_or(0, |last| last.present.start),
        quantity if quantity.is_of_reference() => slot.ahead,
        _ => 0,
    }
}

/// The physics' arrays for `tiles` tiles, and the class of numbers that each holds.
pub(crate) fn physics_arrays(period: &Period, tiles: usize) -> [(Class, Array); 6] {
    [
        ("robot_state", Class::State),
        ("robot_params", Class::Params),
        ("robot_targets", Class::Targets),
        ("robot_memory", Class::Memory),
        ("robot_report", Class::Report),
        ("robot_disturbance", Class::Disturbance),
    ]
    .map(|(name, class)| {
        let times = if class == Class::Disturbance { period.substeps() } else { 1 };
        (class, Array { name, kind: Kind::F32, length: times * tiles * period.layout().size(class) })
    })
}

impl Words {
    /// Joints and their targets, the clock, and when a robot has fallen.
    pub fn walker(&mut self, walker: &Walker) {
        let interface = &walker.interface;
        let (min_uprightness, min_height, posture) = walker.fall_limits();
        self.lead(walker.batch.settings().lead() as f32);
        for (name, value) in [
            ("ACTIONS", walker.joints.len()),
            ("GEOMS", walker.batch.contact_geoms().len()),
            ("FALL_GEOMS", walker.fall_geoms().len()),
            ("HAS_CLOCK", usize::from(interface.gait_frequency.is_some())),
            ("OTHER_JOINTS", walker.other_joints.len()),
        ] {
            self.define(name, value);
        }
        for (name, value) in
            [("MIN_UPRIGHTNESS", min_uprightness), ("MIN_HEIGHT", min_height), ("TOUCH", TOUCH)]
        {
            self.define(name, single(value));
        }
        self.define("CONTROL_DT", double(interface.control_dt));
        self.define("GAIT_FREQUENCY", double(interface.gait_frequency.unwrap_or(0.0)));
        self.singles("POSTURE", &posture);
        self.integers("FALL_GEOM", walker.fall_geoms());
        self.integers("JOINT_OF", &walker.joints);
        self.singles("DEFAULT_POSE", &walker.default_pose);
        self.singles("ACTION_SCALE", &walker.action_scale);
        self.singles("ACTION_CLIP", &walker.action_clip);
        self.integers("OTHER_JOINT", &walker.other_joints);
        let home: Vec<f32> = interface.default_pose.iter().map(|&angle| angle as f32).collect();
        self.singles("HOME", &home);
        self.frames();
        let parameters = [("pose", 1), ("scale", 1), ("clip", 1), ("action", 1)];
        self.text.push_str(&function("clipped_target", &parameters, |[pose, scale, clip, action]| {
            vec![target(pose, scale, clip, action)]
        }));
    }

    /// Functions of [`frames`].
    fn frames(&mut self) {
        let (q, v) = (("q", 4), ("v", 3));
        let texts = [
            function("up_of", &[q], |[w, x, y, z]| frames::up([w, x, y, z]).to_vec()),
            function("to_body", &[q, v], |[w, x, y, z, a, b, c]| {
                frames::to_body([w, x, y, z], [a, b, c]).to_vec()
            }),
            function("uprightness_of", &[("up", 3), ("posture", 3)], |[x, y, z, a, b, c]| {
                vec![frames::uprightness([x, y, z], [a, b, c])]
            }),
        ];
        self.text.extend(texts);
    }

    /// How much later read velocities are than the simulation's, s; 0 if they are not.
    pub fn lead(&mut self, lead: f32) {
        self.define("LEAD", single(lead));
        self.define("HAS_LEAD", u32::from(lead != 0.0));
    }

    /// The numbers that quantities have in terms, by their names in capitals; the terms of each row, one row after the
    /// other; their scales; and the [`extra`] number of each. Returns each row as the text of a `Row`.
    pub fn observed(&mut self, walker: &Walker, rows: &[Observed<'_>]) -> Vec<String> {
        let names: Vec<String> =
            Quantity::ALL.iter().map(|quantity| quantity.name().to_uppercase()).collect();
        self.text.push_str(&format!("enum {{ {} }};\n", names.join(", ")));
        let zeros = walker.interface.history.start == HistoryStart::Zeros;
        self.define("ZEROS_BEFORE", u32::from(zeros));
        let (mut terms, mut scales, mut all) = (Vec::new(), Vec::new(), Vec::new());
        let mut extras = Vec::new();
        for (layout, noise) in rows {
            let (first, scale, mut draw) = (terms.len(), scales.len(), 0);
            for slot in layout.slots() {
                extras.push(extra(layout, slot));
                let (quantity, width) = (slot.quantity as usize, slot.present.len());
                let (place, half) = (slot.present.start, single(noise(slot.quantity)));
                let (oldest, frames) = (slot.frames[0], slot.frames.len());
                let apart = slot.frames.get(1).map_or(0, |&second| second as i64 - oldest as i64);
                terms.push(format!(
                    "{{{quantity}, {place}, {width}, {draw}, {half}, {oldest}, {apart}, {frames}}}"
                ));
                draw += width;
            }
            scales.extend(layout.scales());
            let (count, width) = (layout.slots().len(), layout.width());
            all.push(format!("{{{first}, {count}, {scale}, {width}, {}}}", layout.frames()));
        }
        self.table("Term", "TERMS", terms);
        self.singles("SCALES", &scales);
        let layouts: Vec<&Layout> = rows.iter().map(|(layout, _)| *layout).collect();
        let has_earlier = layouts.iter().any(|layout| observes_earlier(layout));
        self.define("HAS_EARLIER", u32::from(has_earlier));
        // The kernels of other policies do not have the table.
        if has_earlier || layouts.iter().any(|layout| layout.follows()) {
            self.integers("EXTRA", &extras);
        }
        all
    }
}
