// Errors of a robot's sensors.

// The velocity of joint `j` as a slow sensor reads it: the physics remembers what it reads beyond the true one. Who observes
// without errors has no `memory`.
DEVICE float read_velocity(const float* state, const float* memory, u32 e, int j) {
    float velocity = joint_velocity(state, e, j);
#if HAS_FILTER
    if (memory) velocity = velocity + REMEMBERED(FILTER_AT + j);
#endif
    return velocity;
}

// The base as its inertial unit reads it, before errors of the unit itself: orientation and rates are late, of which the
// physics remembers what they are beyond the true ones. Who observes without errors has no `memory`.
DEVICE Base read_base(const float* state, const float* memory, u32 e) {
    Base base = base_of(state, e);
#if HAS_LATE_IMU
    if (memory) {
        float square = 0.0f;
        for (int k = 0; k < 4; k++) {
            base.quaternion[k] = base.quaternion[k] + REMEMBERED(LATE_IMU_AT + k);
            square = square + base.quaternion[k] * base.quaternion[k];
        }
        float length = sqrtf(square);
        for (int k = 0; k < 4; k++) base.quaternion[k] = base.quaternion[k] / length;
        for (int k = 0; k < 3; k++) base.angular[k] = base.angular[k] + REMEMBERED(LATE_IMU_AT + 4 + k);
    }
#endif
    return base;
}

// A robot that is put somewhere: its sensors read the state it has there. `thread` of `threads`.
DEVICE void begin_sensors(float* memory, u32 e, int thread, int threads) {
    for (int k = SENSORS_AT + thread; k < MEMORY; k += threads) REMEMBERED(k) = 0.0f;
}

// The inertial unit, as `gaitfit_sim::Imu` has it.

// Numbers of a robot, `apart` from each other: whether there are errors, the unit's orientation in the base, its three axes
// there, and what its gyro reads at rest.
enum { IMU_TURN = 1, IMU_AXES = 5, IMU_BIAS = 14, IMU_NUMBERS = 17 };
#define IMU(k) imu[(u64)(k) * apart]

// Who observes without errors has no `imu`.
DEVICE bool has_errors(const float* imu, u32 apart) { return imu && IMU(0) != 0.0f; }

// A vector of the base's frame in the unit's.
DEVICE void to_unit(const float* imu, u32 apart, float v[3]) {
    float x = v[0], y = v[1], z = v[2];
    for (int k = 0; k < 3; k++) v[k] = IMU(IMU_AXES + 3 * k) * x + IMU(IMU_AXES + 3 * k + 1) * y + IMU(IMU_AXES + 3 * k + 2) * z;
}

// What the gyro reads of the base's rates.
DEVICE void read_rates(const float* imu, u32 apart, float v[3]) {
    if (!has_errors(imu, apart)) return;
    to_unit(imu, apart, v);
    for (int k = 0; k < 3; k++) v[k] = v[k] + IMU(IMU_BIAS + k);
}

// The directions of the base's frame that the unit sees.
DEVICE void read_direction(const float* imu, u32 apart, float v[3]) {
    if (has_errors(imu, apart)) to_unit(imu, apart, v);
}

// The number `k` of the quaternion product a b.
DEVICE float product_number(const float a[4], const float b[4], int k) {
    switch (k) {
        case 0: return a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
        case 1: return a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
        case 2: return a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
        default: return a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
    }
}

// The number `k` of the orientation that the unit reads of the base's.
DEVICE float attitude_number(const float* imu, u32 apart, const float q[4], int k) {
    if (!has_errors(imu, apart)) return q[k];
    float turn[4] = {IMU(IMU_TURN), IMU(IMU_TURN + 1), IMU(IMU_TURN + 2), IMU(IMU_TURN + 3)};
    return product_number(q, turn, k);
}

// The number `k` of the state of a robot whose sensors read `read`: without the errors of the unit.
DEVICE float true_number(const float* imu, u32 apart, const float* read, int k) {
    bool turned = k >= QUATERNION && k < LINEAR, moved = k >= ANGULAR && k < QPOS;
    if (!(turned || moved) || !has_errors(imu, apart)) return read[k];
    if (turned) {
        float back[4] = {IMU(IMU_TURN), -IMU(IMU_TURN + 1), -IMU(IMU_TURN + 2), -IMU(IMU_TURN + 3)};
        return product_number(read + QUATERNION, back, k - QUATERNION);
    }
    float own[3];
    for (int i = 0; i < 3; i++) own[i] = read[ANGULAR + i] - IMU(IMU_BIAS + i);
    int axis = k - ANGULAR;
    return IMU(IMU_AXES + axis) * own[0] + IMU(IMU_AXES + 3 + axis) * own[1] + IMU(IMU_AXES + 6 + axis) * own[2];
}
