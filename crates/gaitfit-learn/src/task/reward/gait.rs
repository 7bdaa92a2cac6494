//! A steady gait with lifted feet.

use crate::task::Moment;

/// Largest difference of times that counts, s, and the width of the kernel (Isaac Lab, Spot task, `GaitReward`).
const MAX_DIFFERENCE: f32 = 0.2;
const WIDTH: f32 = 0.1;

/// Sum over feet that land in this step of (time in the air − 0.5 s), while walking.
pub fn air_time(m: &Moment<'_>) -> f32 {
    if !m.walking {
        return 0.0;
    }
    m.feet.iter().filter(|foot| foot.landed).map(|foot| foot.last_air - 0.5).sum()
}

/// Feet of a group move together, groups alternate: with a, c the times since a foot left or met the ground,
/// exp(−Σ d/width) over pairs, where d = min((aᵢ − aⱼ)², …²) + min((cᵢ − cⱼ)², …²) inside a group and
/// min((aᵢ − cⱼ)², …²) + min((cᵢ − aⱼ)², …²) between groups. Zero while standing.
pub fn alternation(m: &Moment<'_>) -> f32 {
    if !m.walking {
        return 0.0;
    }
    let clip = |difference: f32| (difference * difference).min(MAX_DIFFERENCE * MAX_DIFFERENCE);
    let mut sum = 0.0;
    for (i, one) in m.feet.iter().enumerate() {
        for (j, other) in m.feet.iter().enumerate().take(i) {
            let (Some(a), Some(b)) = (m.scene.gait_group[i], m.scene.gait_group[j]) else { continue };
            sum += if a == b {
                clip(one.air - other.air) + clip(one.contact - other.contact)
            } else {
                clip(one.air - other.contact) + clip(one.contact - other.air)
            };
        }
    }
    (-sum / WIDTH).exp()
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
