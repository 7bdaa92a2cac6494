//! Reward terms as plain loops, which they were before they were expressions: what these must give, to the bit.

use gaitfit_learn::task::Moment;

/// The value of a built-in term; `None` for later ones.
pub fn value(name: &str, m: &Moment<'_>) -> Option<f32> {
    Some(match name {
        "track_linear_velocity" => linear_velocity(m),
        "track_yaw_rate" => yaw_rate(m),
        "vertical_velocity" => vertical_velocity(m),
        "roll_pitch_rate" => roll_pitch_rate(m),
        "posture" => posture(m),
        "height" => height(m),
        "torque" => squares(m.torque),
        "joint_acceleration" => squares(m.joint_acceleration),
        "action_rate" => squared_distance(m.action, m.last_action),
        "air_time" => air_time(m),
        "gait" => alternation(m),
        "swing_height" => swing_height(m),
        "foot_slip" => foot_slip(m),
        "stand_still" if m.walking => 0.0,
        "stand_still" | "joint_deviation" => squared_distance(m.joint_position, &m.task.walker.default_pose),
        "undesired_contact" => m.body_contacts as f32,
        "upright" => upright(m),
        "front_feet_height" => front_feet_height(m),
        "front_contact" => front_contact(m),
        "step_clock" => step_clock(m),
        "fall" => fall(m),
        _ => return None,
    })
}

fn squares(values: &[f32]) -> f32 {
    values.iter().map(|x| x * x).sum()
}

fn squared_distance(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

fn linear_velocity(m: &Moment<'_>) -> f32 {
    let error = [m.velocity[0] - m.command[0], m.velocity[1] - m.command[1]];
    let width = m.task.settings.tracking_width as f32;
    (-(error[0] * error[0] + error[1] * error[1]) / (width * width)).exp()
}

fn yaw_rate(m: &Moment<'_>) -> f32 {
    let error = m.yaw_rate - m.command[2];
    let width = m.task.settings.yaw_tracking_width as f32;
    (-error * error / (width * width)).exp()
}

fn vertical_velocity(m: &Moment<'_>) -> f32 {
    m.velocity[2] * m.velocity[2]
}

fn roll_pitch_rate(m: &Moment<'_>) -> f32 {
    let w = m.angular_velocity;
    w.iter().map(|x| x * x).sum::<f32>() - m.yaw_rate * m.yaw_rate
}

fn posture(m: &Moment<'_>) -> f32 {
    (1.0 - m.uprightness * m.uprightness).max(0.0)
}

fn height(m: &Moment<'_>) -> f32 {
    let error = (m.height - m.task.settings.height as f32) / 0.1;
    (-error * error).exp()
}

fn fall(m: &Moment<'_>) -> f32 {
    // A step pays by its duration, a fall is one event.
    if m.fallen { 1.0 / m.task.walker.interface.control_dt as f32 } else { 0.0 }
}

fn air_time(m: &Moment<'_>) -> f32 {
    if !m.walking {
        return 0.0;
    }
    let wanted = m.task.settings.swing_seconds as f32;
    let landed = m.feet.iter().filter(|foot| foot.landed);
    let sum: f32 = landed.map(|foot| (foot.last_air / wanted).min(1.0).powi(2)).sum();
    // A landing is an event, a step pays by its duration.
    sum / m.task.walker.interface.control_dt as f32
}

fn alternation(m: &Moment<'_>) -> f32 {
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

fn swing_height(m: &Moment<'_>) -> f32 {
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

fn foot_slip(m: &Moment<'_>) -> f32 {
    m.feet.iter().filter(|foot| foot.touching).map(|foot| foot.speed * foot.speed).sum()
}

fn upright(m: &Moment<'_>) -> f32 {
    let half = 0.5 * (1.0 + m.uprightness);
    half * half
}

fn front_feet_height(m: &Moment<'_>) -> f32 {
    let idle = m.feet.iter().zip(&m.task.gait_group).filter(|(_, group)| group.is_none());
    idle.map(|(foot, _)| foot.height.clamp(0.0, 0.25)).sum()
}

fn front_contact(m: &Moment<'_>) -> f32 {
    let idle = m.feet.iter().zip(&m.task.gait_group).filter(|(_, group)| group.is_none());
    idle.filter(|(foot, _)| foot.touching).count() as f32
}

fn step_clock(m: &Moment<'_>) -> f32 {
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
