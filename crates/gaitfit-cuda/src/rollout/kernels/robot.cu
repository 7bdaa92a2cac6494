// A robot's numbers where the physics keeps them, and what its sensors tell.

// A number of environment `e`, in its tile of `size` numbers.
template <class F> DEVICE F& at(F* numbers, int size, Spot spot, u32 e) {
    return numbers[(u64)(e / PER_TILE) * size + spot.base + (int)(e % PER_TILE) * spot.stride];
}

// Numbers of the state, in the order of `State::visit`.
#define POSITION 0
#define QUATERNION 3
#define LINEAR 7
#define ANGULAR 10
#define QPOS 13
#define QVEL (13 + JOINTS)
#define QACC (13 + 2 * JOINTS)
#define ACCELERATION (13 + 3 * JOINTS)
#define STATE_COUNT (19 + 3 * JOINTS)
#define STATE(k) at(state, STATE_SIZE, STATE_SPOTS[k], e)
#define BIAS(j) at(params, PARAMS_SIZE, BIAS_SPOTS[j], e)
#define TARGET(tap, j) at(targets, TARGETS_SIZE, TARGET_SPOTS[(tap) * JOINTS + (j)], e)
// Numbers of the report: torques, normal forces, centres.
#define TORQUE(j) at(report, REPORT_SIZE, REPORT_SPOTS[j], e)
#define FORCE(k) at(report, REPORT_SIZE, REPORT_SPOTS[JOINTS + (k)], e)
#define CENTRE(k, axis) at(report, REPORT_SIZE, REPORT_SPOTS[JOINTS + GEOMS + 3 * (k) + (axis)], e)

// The base as its sensors tell it. `position` is of the world; `linear` too, `angular` of the body.
struct Base {
    float position[3], quaternion[4], linear[3], angular[3];
};

#if HAS_LEAD
// What LEAD seconds of the last acceleration change in the velocities of a base with orientation `q`.
DEVICE void velocity_change(const float* state, u32 e, const float q[4], float angular[3], float linear[3]) {
    float a[3], once[3], twice[3];
    for (int k = 0; k < 3; k++) a[k] = STATE(ACCELERATION + k);
    float w = q[0], x = q[1], y = q[2], z = q[3];
    once[0] = y * a[2] - z * a[1], once[1] = z * a[0] - x * a[2], once[2] = x * a[1] - y * a[0];
    twice[0] = y * once[2] - z * once[1], twice[1] = z * once[0] - x * once[2], twice[2] = x * once[1] - y * once[0];
    for (int k = 0; k < 3; k++) {
        angular[k] = LEAD * (a[k] + 2.0f * (twice[k] - w * once[k]));
        linear[k] = LEAD * STATE(ACCELERATION + 3 + k);
    }
}
#endif

DEVICE Base base_of(const float* state, u32 e) {
    Base base;
    for (int k = 0; k < 3; k++) base.position[k] = STATE(POSITION + k);
    for (int k = 0; k < 4; k++) base.quaternion[k] = STATE(QUATERNION + k);
    for (int k = 0; k < 3; k++) base.linear[k] = STATE(LINEAR + k);
    for (int k = 0; k < 3; k++) base.angular[k] = STATE(ANGULAR + k);
#if HAS_LEAD
    float angular[3], linear[3];
    velocity_change(state, e, base.quaternion, angular, linear);
    for (int k = 0; k < 3; k++) {
        base.angular[k] = base.angular[k] + angular[k];
        base.linear[k] = base.linear[k] + linear[k];
    }
#endif
    return base;
}

DEVICE float joint_position(const float* state, const float* params, u32 e, int j) { return STATE(QPOS + j) + BIAS(j); }

DEVICE float joint_velocity(const float* state, u32 e, int j) {
#if HAS_LEAD
    return fmaf(LEAD, STATE(QACC + j), STATE(QVEL + j));
#else
    return STATE(QVEL + j);
#endif
}

// What networks remember.
#define REMEMBERED(k) at(memory, MEMORY_SIZE, MEMORY_SPOTS[k], e)

// The number `k` of it of a robot that has been as it is for long: angles and velocities in turn, or 0 for joint JOINTS.
DEVICE float settled(const float* state, const float* params, u32 e, int k) {
    int j = MEMORY_OF[k];
    if (j == JOINTS) return 0.0f;
    return k % 2 ? STATE(QVEL + j) : joint_position(state, params, e, j);
}

// Phase of the gait clock, 0 to 1.
DEVICE float clock_of(u32 steps) {
#if HAS_CLOCK
    double turns = (double)steps * CONTROL_DT * GAIT_FREQUENCY;
    return (float)(turns - trunc(turns));
#else
    return 0.0f;
#endif
}
