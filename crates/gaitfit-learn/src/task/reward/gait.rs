//! A steady gait with lifted feet.

use crate::task::Moment;

/// Σ min(time in the air, T)/control step over feet that land in this step, while walking; T is the wanted swing
/// time.
pub fn air_time(m: &Moment<'_>) -> f32 {
    if !m.walking {
        return 0.0;
    }
    let wanted = m.scene.settings.swing_seconds as f32;
    let landed = m.feet.iter().filter(|foot| foot.landed);
    let sum: f32 = landed.map(|foot| foot.last_air.min(wanted)).sum();
    // A landing is an event, a step pays by its duration.
    sum / m.scene.interface.control_dt as f32
}

/// Share of pairs of feet in the gait that agree: feet of one group are both on the ground or both off it, feet
/// of different groups are not, and neither has been where it is for longer than twice the wanted swing time.
/// 1 in a trot; 0 in a robot that stands, on four legs or on two. Zero while standing is asked for.
pub fn alternation(m: &Moment<'_>) -> f32 {
    if !m.walking {
        return 0.0;
    }
    let longest = 2.0 * m.scene.settings.swing_seconds as f32;
    let (mut agree, mut pairs) = (0.0, 0.0);
    for (i, one) in m.feet.iter().enumerate() {
        for (j, other) in m.feet.iter().enumerate().take(i) {
            let (Some(a), Some(b)) = (m.scene.gait_group[i], m.scene.gait_group[j]) else { continue };
            pairs += 1.0;
            let stuck = [one, other].iter().any(|foot| foot.air.max(foot.contact) > longest);
            agree += if !stuck && (one.touching == other.touching) == (a == b) { 1.0 } else { 0.0 };
        }
    }
    if pairs > 0.0 { agree / pairs } else { 0.0 }
}

/// Deviation of moving feet from the swing height: Σ ((z − z*)/z*)² tanh(2 v), v the foot's horizontal speed.
pub fn swing_height(m: &Moment<'_>) -> f32 {
    if !m.walking {
        return 0.0;
    }
    let wanted = m.scene.settings.swing_height as f32;
    let swinging = m.feet.iter().filter(|foot| !foot.touching);
    swinging.map(|foot| ((foot.height - wanted) / wanted).powi(2) * (2.0 * foot.speed).tanh()).sum()
}

/// Σ v² of feet on the ground, m²/s².
pub fn foot_slip(m: &Moment<'_>) -> f32 {
    m.feet.iter().filter(|foot| foot.touching).map(|foot| foot.speed * foot.speed).sum()
}

/// Parts other than feet that touch the ground.
pub fn undesired_contact(m: &Moment<'_>) -> f32 {
    m.body_contacts as f32
}
