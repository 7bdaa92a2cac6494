// One robot at the end of a control period, and what reward terms may name of it: a function `quantity_NAME` for each
// quantity of gaitfit-learn's expressions that is not the same for all robots and times.

struct Moment {
    float command[3], velocity[3], angular[3], gravity[3], yaw_rate, uprightness, height, clock;
    bool walking, fallen;
    int body_contacts;
    u32 e;
    const float *state, *params, *report;
    // The action of this period; the one before, with ENVIRONMENTS between its numbers.
    const float *action, *last_action;
    // Of each foot its numbers, and 1 if it landed.
    float feet[FEET > 0 ? FEET : 1][FOOT_SIZE + 1];
};

#define QUANTITY(name, value) \
    DEVICE float quantity_##name(const Moment& m, int k) { \
        const float *state = m.state, *report = m.report; \
        const u32 e = m.e; \
        (void)state, (void)report, (void)e, (void)k; \
        return value; \
    }

DEVICE float flag(bool on) { return on ? 1.0f : 0.0f; }

// The target that this period's action asks for.
DEVICE float wanted_target(const Moment& m, int j) {
    int k = ACTION_OF[j];
    return k < 0 ? DEFAULT_POSE[j] : target_of(k, m.action[k]);
}

QUANTITY(command, m.command[k])
QUANTITY(velocity, m.velocity[k])
QUANTITY(angular_velocity, m.angular[k])
QUANTITY(yaw_rate, m.yaw_rate)
QUANTITY(gravity, m.gravity[k])
QUANTITY(uprightness, m.uprightness)
QUANTITY(height, m.height)
QUANTITY(qpos, joint_position(state, m.params, e, k))
QUANTITY(qvel, joint_velocity(state, e, k))
QUANTITY(qacc, STATE(QACC + k))
QUANTITY(tau, TORQUE(k))
QUANTITY(target, wanted_target(m, k))
QUANTITY(action, m.action[k])
QUANTITY(last_action, m.last_action[k * ENVIRONMENTS + e])
QUANTITY(contact, m.feet[k][TOUCHING])
QUANTITY(landed, m.feet[k][FOOT_SIZE])
QUANTITY(foot_height, m.feet[k][PLACE_Z] - ground_under(m.feet[k] + PLACE_X))
QUANTITY(foot_speed, m.feet[k][SPEED])
QUANTITY(air_time, m.feet[k][AIR])
QUANTITY(contact_time, m.feet[k][CONTACT])
QUANTITY(last_air_time, m.feet[k][LAST_AIR])
QUANTITY(body_contacts, (float)m.body_contacts)
QUANTITY(walking, flag(m.walking))
QUANTITY(fallen, flag(m.fallen))
QUANTITY(clock, m.clock)

// What expressions are made of, besides C's operators and functions.
DEVICE float square(float x) { return x * x; }
// Unlike fminf and fmaxf, these give NaN if a or b is NaN.
DEVICE float smaller(float a, float b) { return a < b || a != a ? a : b; }
DEVICE float larger(float a, float b) { return a > b || a != a ? a : b; }

