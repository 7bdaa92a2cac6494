// The motion that the policy follows, as `gaitfit_policy::Reference` has it, and a robot's place in it.
// REFERENCE_POSITION and REFERENCE_VELOCITY (samples x ACTIONS) and REFERENCE_ORIENTATIONS (samples x 4) are filled
// when the program is loaded.

// FOLLOWING adds parameters to functions and arguments to calls where the policy follows a motion.
#if !FOLLOWS
#define FOLLOWING(...)
#else
#define FOLLOWING(...) , __VA_ARGS__

// Time since the motion's beginning, s, and the angle about the vertical by which the motion is turned, rad.
struct MotionPlace {
    double time, heading;
};

// The samples about a time, the share of the second, and whether the motion moves then.
struct Between {
    int low, high;
    double share;
    bool moves;
};

DEVICE Between between(double time) {
    double last = REFERENCE_SAMPLES - 1, place = time * REFERENCE_RATE, near = round(place);
    // Without this, a time that is rounded up would be after the last sample, where the velocity is 0.
    if (fabs(place - near) < SAME_SAMPLE) place = near;
    bool moves = place >= 0.0 && place <= last;
    // In this form a place that is not a number becomes the first sample.
    place = place > 0.0 ? place < last ? place : last : 0.0;
    int low = (int)floor(place);
    return {low, low + 1 < REFERENCE_SAMPLES ? low + 1 : low, place - low, moves};
}

// Number `k` of `rows` of ACTIONS numbers.
DEVICE float reference_number(const float* rows, Between samples, int k) {
    double a = rows[samples.low * ACTIONS + k], b = rows[samples.high * ACTIONS + k];
    return (float)(a + samples.share * (b - a));
}

// Share of the motion that is over. A motion of one sample is over from the beginning.
DEVICE float reference_phase(double time) {
    if (REFERENCE_SAMPLES == 1) return 1.0f;
    double share = time * REFERENCE_RATE / (double)(REFERENCE_SAMPLES - 1);
    return (float)(share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share);
}

#if ACTOR_FOLLOWS
// Root-mean-square difference between the policy's joints and the motion, rad.
DEVICE float distance_from_motion(const float* state, const float* params, double time, u32 e) {
    Between samples = between(time);
    float squares = 0.0f;
    for (int k = 0; k < ACTIONS; k++) {
        float off = joint_position(state, params, e, JOINT_OF[k]) - reference_number(REFERENCE_POSITION, samples, k);
        squares = squares + off * off;
    }
    return sqrtf(squares / (float)ACTIONS);
}
#endif

#if REFERENCE_TURNS
DEVICE Quat scaled(Quat q, double norm) { return {q.w / norm, q.x / norm, q.y / norm, q.z / norm}; }

DEVICE Quat unit_quaternion(Quat q) {
    double norm = sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    if (norm < 1e-14 || !is_finite(norm)) return {1.0, 0.0, 0.0, 0.0};
    return scaled(q, norm);
}

// Orientation of the anchor in the motion, unturned.
DEVICE Quat reference_orientation(Between samples) {
    const float *low = REFERENCE_ORIENTATIONS + 4 * samples.low, *high = REFERENCE_ORIENTATIONS + 4 * samples.high;
    Quat a = unit_quaternion({low[0], low[1], low[2], low[3]});
    Quat b = unit_quaternion({high[0], high[1], high[2], high[3]});
    // q and -q are the same rotation: the sign chooses the nearer one.
    double sign = a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z < 0.0 ? -1.0 : 1.0, share = samples.share;
    Quat q = {
        a.w + share * (sign * b.w - a.w), a.x + share * (sign * b.x - a.x), a.y + share * (sign * b.y - a.y),
        a.z + share * (sign * b.z - a.z)};
    return scaled(q, sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z));
}

// Orientation of the robot's anchor for a base with this orientation. With `params` the joints are where the encoders
// report them.
DEVICE Quat anchor_of(const float base[4], const float* state, const float* params, u32 e) {
    Quat frame = unit_quaternion({base[0], base[1], base[2], base[3]});
    for (int i = 0; i < ANCHORS; i++) {
        Anchor next = ANCHOR[i];
        int j = JOINT_OF[next.joint];
        double half = 0.5 * (double)(params ? joint_position(state, params, e, j) : STATE(QPOS + j));
        double s = sin(half), c = cos(half);
        frame = product(frame, {c, s * next.axis[0], s * next.axis[1], s * next.axis[2]});
    }
    return frame;
}

// Direction in which a body with this orientation looks over the ground, rad from the world's x axis.
DEVICE double heading_of(Quat q) {
    return atan2(-(2.0 * (q.x * q.y - q.w * q.z)), 1.0 - 2.0 * (q.x * q.x + q.z * q.z));
}

// Rotation from the robot's anchor to the motion's, `time` s after the motion's beginning.
DEVICE Quat turn_to_motion(
    double heading, double time, const float* state, const float* params, const float* memory, const float* imu,
    u32 apart, u32 e
) {
    Base base = read_base(state, memory, e);
    float seen[4];
    for (int k = 0; k < 4; k++) seen[k] = attitude_number(imu, apart, base.quaternion, k);
    Quat anchor = anchor_of(seen, state, params, e), back = {anchor.w, -anchor.x, -anchor.y, -anchor.z};
    return product(back, product(turn(2, heading), reference_orientation(between(time))));
}

// Number `k` of the first two columns of a rotation's matrix, row by row.
DEVICE float column_number(Quat q, int k) {
    switch (k) {
        case 0: return (float)(q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z);
        case 1: return (float)(2.0 * (q.x * q.y - q.w * q.z));
        case 2: return (float)(2.0 * (q.x * q.y + q.w * q.z));
        case 3: return (float)(q.w * q.w - q.x * q.x + q.y * q.y - q.z * q.z);
        case 4: return (float)(2.0 * (q.x * q.z - q.w * q.y));
        default: return (float)(2.0 * (q.y * q.z + q.w * q.x));
    }
}
#endif

// Angle by which the motion is turned for a robot whose episode begins in this state, rad.
DEVICE float turn_of_episode(const float* state, u32 e) {
#if REFERENCE_TURNS && ACTOR_FOLLOWS
    float base[4];
    for (int k = 0; k < 4; k++) base[k] = STATE(QUATERNION + k);
    return (float)(heading_of(anchor_of(base, state, nullptr, e)) - heading_of(reference_orientation(between(0.0))));
#else
    return 0.0f;
#endif
}

// The place of a robot `steps` control periods after its episode's beginning.
DEVICE MotionPlace place_of(u32 steps, float turned) { return {(double)steps * CONTROL_DT, (double)turned}; }
#endif
