//! A steady gait with lifted feet.

use crate::task::Moment;

/// Σ (min(t, T)/T)²/control step over feet that land in this step after the time t in the air, while walking; T is
/// the wanted swing time. Square, so that a few long steps are worth more than many short ones.
pub fn air_time(m: &Moment<'_>) -> f32 {
    if !m.walking {
        return 0.0;
    }
    let wanted = m.task.settings.swing_seconds as f32;
    let landed = m.feet.iter().filter(|foot| foot.landed);
    let sum: f32 = landed.map(|foot| (foot.last_air / wanted).min(1.0).powi(2)).sum();
    // A landing is an event, a step pays by its duration.
    sum / m.task.walker.interface.control_dt as f32
}

/// Share of pairs of feet in the gait that agree: feet of one group are both on the ground or both off it, feet
/// of different groups are not, and neither has been where it is for longer than twice the wanted swing time.
/// 1 in a trot; 0 in a robot that stands, on four legs or on two. Zero while standing is asked for.
pub fn alternation(m: &Moment<'_>) -> f32 {
    if !m.walking {
        return 0.0;
    }
    let longest = 2.0 * m.task.settings.swing_seconds as f32;
    let (mut agree, mut pairs) = (0.0, 0.0);
    for (i, one) in m.feet.iter().enumerate() {
        for (j, other) in m.feet.iter().enumerate().take(i) {
            let (Some(a), Some(b)) = (m.task.gait_group[i], m.task.gait_group[j]) else { continue };
            pairs += 1.0;
            let stuck = [one, other].iter().any(|foot| foot.air.max(foot.contact) > longest);
            agree += if !stuck && (one.touching == other.touching) == (a == b) { 1.0 } else { 0.0 };
        }
    }
    if pairs > 0.0 { agree / pairs } else { 0.0 }
}

/// Mean over the gait's feet of min(z/z*, 1) in the air, z the height of a foot's centre and z* the wanted one, while
/// walking; feet that stay up longer than twice the wanted swing time earn nothing.
pub fn swing_height(m: &Moment<'_>) -> f32 {
    if !m.walking {
        return 0.0;
    }
    let wanted = m.task.settings.swing_height as f32;
    let longest = 2.0 * m.task.settings.swing_seconds as f32;
    let (mut sum, mut feet) = (0.0, 0.0);
    for (foot, _) in m.feet.iter().zip(&m.task.gait_group).filter(|(_, group)| group.is_some()) {
        feet += 1.0;
        if !foot.touching && foot.air <= longest {
            sum += (foot.height / wanted).clamp(0.0, 1.0);
        }
    }
    if feet > 0.0 { sum / feet } else { 0.0 }
}

/// Σ v² of feet on the ground, m²/s².
pub fn foot_slip(m: &Moment<'_>) -> f32 {
    m.feet.iter().filter(|foot| foot.touching).map(|foot| foot.speed * foot.speed).sum()
}

/// Parts other than feet that touch the ground.
pub fn undesired_contact(m: &Moment<'_>) -> f32 {
    m.body_contacts as f32
}
