//! Walking on the hind legs.

use crate::task::Moment;

/// How far the robot is in the wanted posture: ((1 + cos)/2)², 1 in it, 0 upside down.
pub fn upright(m: &Moment<'_>) -> f32 {
    let half = 0.5 * (1.0 + m.uprightness);
    half * half
}

/// Height of the feet that are not in the gait, up to 0.25 m each, m.
pub fn front_feet_height(m: &Moment<'_>) -> f32 {
    let idle = m.feet.iter().zip(&m.task.gait_group).filter(|(_, group)| group.is_none());
    idle.map(|(foot, _)| foot.height.clamp(0.0, 0.25)).sum()
}

/// Feet outside the gait that touch the ground.
pub fn front_contact(m: &Moment<'_>) -> f32 {
    let idle = m.feet.iter().zip(&m.task.gait_group).filter(|(_, group)| group.is_none());
    idle.filter(|(foot, _)| foot.touching).count() as f32
}

/// Share of the gait's feet that are on the ground in their half of the clock and off it in the other.
pub fn step_clock(m: &Moment<'_>) -> f32 {
    let (mut kept, mut feet) = (0.0, 0.0);
    for (foot, group) in m.feet.iter().zip(&m.task.gait_group) {
        if let Some(group) = group {
            let stance = (m.clock < 0.5) == (group % 2 == 0);
            feet += 1.0;
            kept += if foot.touching == stance { 1.0 } else { 0.0 };
        }
    }
    if feet > 0.0 { kept / feet } else { 0.0 }
}
