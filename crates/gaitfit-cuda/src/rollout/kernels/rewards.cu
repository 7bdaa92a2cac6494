// Reward terms: small functions of one robot's moment, as gaitfit-learn has them.

// Numbers of a foot between steps.
enum { TOUCHING, AIR, CONTACT, LAST_AIR, PLACE_X, PLACE_Y, PLACE_Z, SPEED, FOOT_SIZE };

struct Foot {
    bool touching, landed;
    float air, contact, last_air, height, speed;
};

struct Moment {
    float command[3], velocity[3], angular[3], gravity[3], yaw_rate, uprightness, height, clock;
    bool walking, fallen;
    int body_contacts;
    u32 e;
    const float *state, *params, *report;
    // The action of this period; the one before, with ENVIRONMENTS between its numbers.
    const float *action, *last_action;
    Foot feet[FEET > 0 ? FEET : 1];
};

DEVICE float limited(float x, float low, float high) { return x < low ? low : x > high ? high : x; }

DEVICE float reward_track_linear_velocity(const Moment& m) {
    float x = m.velocity[0] - m.command[0], y = m.velocity[1] - m.command[1];
    return expf(-(x * x + y * y) / (TRACKING_WIDTH * TRACKING_WIDTH));
}
DEVICE float reward_track_yaw_rate(const Moment& m) {
    float error = m.yaw_rate - m.command[2];
    return expf(-error * error / (YAW_TRACKING_WIDTH * YAW_TRACKING_WIDTH));
}
DEVICE float reward_vertical_velocity(const Moment& m) { return m.velocity[2] * m.velocity[2]; }
DEVICE float reward_roll_pitch_rate(const Moment& m) {
    const float* w = m.angular;
    return w[0] * w[0] + w[1] * w[1] + w[2] * w[2] - m.yaw_rate * m.yaw_rate;
}
DEVICE float reward_posture(const Moment& m) { return fmaxf(1.0f - m.uprightness * m.uprightness, 0.0f); }
DEVICE float reward_height(const Moment& m) {
    float error = (m.height - WANTED_HEIGHT) / 0.1f;
    return expf(-error * error);
}
DEVICE float reward_torque(const Moment& m) {
    const float* report = m.report;
    u32 e = m.e;
    float sum = 0.0f;
    for (int j = 0; j < JOINTS; j++) sum += TORQUE(j) * TORQUE(j);
    return sum;
}
DEVICE float reward_joint_acceleration(const Moment& m) {
    const float* state = m.state;
    u32 e = m.e;
    float sum = 0.0f;
    for (int j = 0; j < JOINTS; j++) sum += STATE(QACC + j) * STATE(QACC + j);
    return sum;
}
DEVICE float reward_action_rate(const Moment& m) {
    float sum = 0.0f;
    for (int k = 0; k < ACTIONS; k++) {
        float change = m.action[k] - m.last_action[k * ENVIRONMENTS + m.e];
        sum += change * change;
    }
    return sum;
}
DEVICE float reward_joint_deviation(const Moment& m) {
    float sum = 0.0f;
    for (int j = 0; j < JOINTS; j++) {
        float away = joint_position(m.state, m.params, m.e, j) - DEFAULT_POSE[j];
        sum += away * away;
    }
    return sum;
}
DEVICE float reward_stand_still(const Moment& m) { return m.walking ? 0.0f : reward_joint_deviation(m); }
DEVICE float reward_air_time(const Moment& m) {
    float sum = 0.0f;
    for (int k = 0; k < FEET && m.walking; k++) {
        if (!m.feet[k].landed) continue;
        float share = fminf(m.feet[k].last_air / SWING_SECONDS, 1.0f);
        sum += share * share;
    }
    // A landing is an event, a step pays by its duration.
    return sum / (float)CONTROL_DT;
}
DEVICE bool stuck(const Foot& foot) { return fmaxf(foot.air, foot.contact) > 2.0f * SWING_SECONDS; }
DEVICE float reward_gait(const Moment& m) {
    float agree = 0.0f, pairs = 0.0f;
    for (int i = 0; i < FEET && m.walking; i++)
        for (int j = 0; j < i; j++) {
            if (GAIT_GROUP[i] < 0 || GAIT_GROUP[j] < 0) continue;
            pairs += 1.0f;
            bool kept = (m.feet[i].touching == m.feet[j].touching) == (GAIT_GROUP[i] == GAIT_GROUP[j]);
            agree += kept && !stuck(m.feet[i]) && !stuck(m.feet[j]) ? 1.0f : 0.0f;
        }
    return pairs > 0.0f ? agree / pairs : 0.0f;
}
DEVICE float reward_swing_height(const Moment& m) {
    float sum = 0.0f, feet = 0.0f;
    for (int k = 0; k < FEET && m.walking; k++) {
        if (GAIT_GROUP[k] < 0) continue;
        feet += 1.0f;
        if (!m.feet[k].touching && m.feet[k].air <= 2.0f * SWING_SECONDS)
            sum += limited(m.feet[k].height / SWING_HEIGHT, 0.0f, 1.0f);
    }
    return feet > 0.0f ? sum / feet : 0.0f;
}
DEVICE float reward_foot_slip(const Moment& m) {
    float sum = 0.0f;
    for (int k = 0; k < FEET; k++) sum += m.feet[k].touching ? m.feet[k].speed * m.feet[k].speed : 0.0f;
    return sum;
}
DEVICE float reward_undesired_contact(const Moment& m) { return (float)m.body_contacts; }
DEVICE float reward_upright(const Moment& m) {
    float half = 0.5f * (1.0f + m.uprightness);
    return half * half;
}
DEVICE float reward_front_feet_height(const Moment& m) {
    float sum = 0.0f;
    for (int k = 0; k < FEET; k++) sum += GAIT_GROUP[k] < 0 ? limited(m.feet[k].height, 0.0f, 0.25f) : 0.0f;
    return sum;
}
DEVICE float reward_front_contact(const Moment& m) {
    int count = 0;
    for (int k = 0; k < FEET; k++) count += GAIT_GROUP[k] < 0 && m.feet[k].touching ? 1 : 0;
    return (float)count;
}
DEVICE float reward_step_clock(const Moment& m) {
    float kept = 0.0f, feet = 0.0f;
    for (int k = 0; k < FEET; k++) {
        if (GAIT_GROUP[k] < 0) continue;
        bool stance = (m.clock < 0.5f) == (GAIT_GROUP[k] % 2 == 0);
        feet += 1.0f;
        kept += m.feet[k].touching == stance ? 1.0f : 0.0f;
    }
    return feet > 0.0f ? kept / feet : 0.0f;
}
// A step pays by its duration, a fall is one event.
DEVICE float reward_fall(const Moment& m) { return m.fallen ? 1.0f / (float)CONTROL_DT : 0.0f; }
