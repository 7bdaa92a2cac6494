// A control step of robots that are given their logs' targets and put right by what the logs' sensors read, but for the
// physics. The same as `gaitfit_policy::predict`.

// Dimensions of the signals: joint positions, velocities.
#define DIMENSIONS (2 * ACTIONS)
// Numbers of a start, and of a sample's readings: those of the state up to the joint velocities.
#define LOGGED (13 + 2 * JOINTS)
// Numbers of a foot at a sample: its place, its velocity, and what a unit of each joint of its leg moves it by.
#define LEG_NUMBERS (6 + 3 * LEG_JOINTS)
#define FEET_OF_BLOCK (ROWS * (LEGS > 0 ? LEGS : 1))

DEVICE void rotate(const double q[4], const double v[3], double out[3]) {
    double t[3], w[3];
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        t[k] = 2.0 * (q[1 + a] * v[b] - q[1 + b] * v[a]);
    }
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        w[k] = q[1 + a] * t[b] - q[1 + b] * t[a];
    }
    for (int k = 0; k < 3; k++) out[k] = v[k] + q[0] * t[k] + w[k];
}

// A point's velocity: its own in the body's frame `moving`, and what the body's rates move it at place `at`.
DEVICE void point_velocity(const double moving[3], const double rates[3], const double at[3], double out[3]) {
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        out[k] = moving[k] + (rates[a] * at[b] - rates[b] * at[a]);
    }
}

// The load on a foot, N.
DEVICE double load_of(const float* report, u32 e, int foot) {
    double load = 0.0;
    for (int i = 0; i < LEG[foot].forces; i++) load += (double)FORCE(LEG_FORCE[LEG[foot].force + i]);
    return load;
}

// What foot `foot` asks of the base: velocity (m/s, world frame) and height (m), by its share of the load. Zeros if too
// little load rests on the feet. `read`: what the sensors read, `leg`: the feet there.
DEVICE void foot_correction(
    const float* state, const float* params, const float* memory, const float* report, const float* imu, const float* read,
    const float* leg, u32 e, int foot, double asks[4]
) {
    for (int k = 0; k < 4; k++) asks[k] = 0.0;
    double total = 0.0;
    for (int other = 0; other < LEGS; other++) total += load_of(report, e, other);
    if (!(total > LEAST_LOAD)) return;
    double share = load_of(report, e, foot) / total, at[3], velocity[3], there[3], moving[3];
    for (int k = 0; k < 3; k++) there[k] = at[k] = leg[k], moving[k] = velocity[k] = leg[3 + k];
    // Where and how fast the simulation has it, to first order in the joints' errors.
    for (int i = 0; i < LEG[foot].joints; i++) {
        int j = LEG_JOINT[LEG[foot].joint + i];
        double angle = (double)joint_position(state, params, e, j) - (double)read[QPOS + j];
        double rate = (double)read_velocity(state, memory, e, j) - (double)read[QVEL + j];
        for (int k = 0; k < 3; k++) {
            double column = leg[6 + 3 * i + k];
            there[k] = there[k] + angle * column;
            moving[k] = moving[k] + rate * column;
        }
    }
    Base base = base_of(state, e);
    double simulated[4], logged[4], rates[3], logged_rates[3], body[3], before[3], after[3];
    for (int k = 0; k < 4; k++) simulated[k] = base.quaternion[k], logged[k] = true_number(imu, 1, read, QUATERNION + k);
    for (int k = 0; k < 3; k++) rates[k] = base.angular[k], logged_rates[k] = true_number(imu, 1, read, ANGULAR + k);
    point_velocity(moving, rates, there, body);
    rotate(simulated, body, before);
    point_velocity(velocity, logged_rates, at, body);
    rotate(logged, body, after);
    for (int k = 0; k < 3; k++) asks[k] = share * (before[k] - after[k]);
    rotate(simulated, there, before);
    rotate(logged, at, after);
    asks[3] = share * (before[2] - after[2]);
}

// Step `sample` of ROWS environments a block. `lengths`: samples of each recording, `samples` at most. `every`: for each
// candidate, the samples between corrections. `logged`: targets of the logs, recordings x samples x JOINTS. `readings`: what
// their sensors read, recordings x samples x LOGGED. `legs`: where the feet are, recordings x samples x LEGS x LEG_NUMBERS.
// `trust`: for each candidate, the share of what standing feet ask for that is done. `starts`: the first state of each
// environment. `factors`: for each candidate 3 JOINTS, of which the last are encoder biases. `imus`: for each candidate, errors
// of its inertial unit. `ends`: for each environment, the end of its recording.
KERNEL predict(
    u32 sample, u32 count, u32 places, u32 recordings, u32 samples, const u32* lengths, const u32* every, const float* logged,
    const float* readings, const float* legs, const double* trust, const float* starts, const double* factors,
    const float* imus, const float* params, const float* report, float* state, float* targets, float* memory,
    float* signals, u32* ends
) {
    __shared__ u32 candidate[ROWS], length[ROWS];
    __shared__ u64 row[ROWS];
    __shared__ bool corrects[ROWS];
    __shared__ double asks[FEET_OF_BLOCK][4];
    // New position of the base, its new linear velocity, and what is subtracted from the gyro's angular velocity.
    __shared__ float place[ROWS][3], linear[ROWS][3], angular_change[ROWS][3];
    u32 from = blockIdx.x * ROWS;
    int rows = places - from < ROWS ? (int)(places - from) : ROWS;
    int thread = (int)threadIdx.x, threads = (int)blockDim.x;
    if (thread < rows) {
        u32 own = source_of(from + thread, count), of = own % recordings;
        candidate[thread] = own / recordings;
        length[thread] = lengths[of];
        u32 now = sample < lengths[of] ? sample : lengths[of] - 1;
        row[thread] = (u64)of * samples + now;
        corrects[thread] = sample > 0 && sample < lengths[of] && sample % every[own / recordings] == 0;
        if (sample == 0 && from + thread < count) ends[from + thread] = lengths[of];
    }
    __syncthreads();
    if (sample == 0) {
        for (int i = thread; i < ROWS * STATE_COUNT; i += threads) {
            int r = i % ROWS, k = i / ROWS;
            u32 e = from + r;
            if (r >= rows) continue;
            STATE(k) = k < LOGGED ? starts[(u64)source_of(e, count) * LOGGED + k] : 0.0f;
        }
        for (int r = 0; r < rows; r++) begin_sensors(memory, from + r, thread, threads);
        __syncthreads();
    }
    // Neighbouring threads have the same number of neighbouring robots.
    for (int i = thread; i < ROWS * DIMENSIONS; i += threads) {
        int r = i % ROWS, k = i / ROWS;
        u32 e = from + r;
        if (r >= rows || e >= count || sample >= length[r]) continue;
        signals[((u64)e * samples + sample) * DIMENSIONS + k] =
            k < ACTIONS ? joint_position(state, params, e, JOINT_OF[k]) : read_velocity(state, memory, e, JOINT_OF[k - ACTIONS]);
    }
    for (int i = thread; i < ROWS * LEGS; i += threads) {
        int r = i % ROWS, foot = i / ROWS;
        if (r >= rows || !corrects[r]) continue;
        const float* imu = imus + (u64)candidate[r] * IMU_NUMBERS;
        foot_correction(
            state, params, memory, report, imu, readings + row[r] * LOGGED,
            legs + (row[r] * LEGS + foot) * LEG_NUMBERS, from + r, foot, asks[i]);
    }
    __syncthreads();
    if (thread < rows && corrects[thread]) {
        u32 e = from + thread;
        Base base = base_of(state, e);
        double sums[4] = {0.0, 0.0, 0.0, 0.0}, share = trust[candidate[thread]];
        for (int foot = 0; foot < LEGS; foot++)
            for (int k = 0; k < 4; k++) sums[k] += asks[foot * ROWS + thread][k];
        bool whole = true;
        float changes[2][3] = {};
#if HAS_LEAD
        velocity_change(state, e, base.quaternion, changes[0], changes[1]);
#endif
        base.position[2] = base.position[2] + (float)(share * sums[3]);
        for (int k = 0; k < 3; k++) {
            base.linear[k] = base.linear[k] + (float)(share * sums[k]);
            whole = whole && is_finite(base.position[k]) && is_finite(base.linear[k]);
            place[thread][k] = base.position[k];
            linear[thread][k] = base.linear[k] - changes[1][k];
            angular_change[thread][k] = changes[0][k];
        }
        // A robot that has diverged stays as it is.
        corrects[thread] = whole;
    }
    __syncthreads();
    for (int i = thread; i < ROWS * LOGGED; i += threads) {
        int r = i % ROWS, k = i / ROWS;
        u32 e = from + r;
        if (r >= rows || !corrects[r]) continue;
        float number = true_number(imus + (u64)candidate[r] * IMU_NUMBERS, 1, readings + row[r] * LOGGED, k);
        if (k < QUATERNION) number = place[r][k];
        else if (k >= LINEAR && k < ANGULAR) number = linear[r][k - LINEAR];
        else if (k >= ANGULAR && k < QPOS) number = number - angular_change[r][k - ANGULAR];
        else if (k >= QPOS && k < QVEL)
            number = (float)((double)number - factors[(u64)candidate[r] * 3 * JOINTS + 2 * JOINTS + k - QPOS]);
        else if (k >= QVEL) {
            int j = k - QVEL;
#if HAS_FILTER
            // The filter keeps its difference from the true velocity, so that its reading is the log's.
            number = number - (read_velocity(state, memory, e, j) - joint_velocity(state, e, j));
#endif
            number = number - LEAD * STATE(QACC + j);
        }
        STATE(k) = number;
    }
    for (int i = thread; i < ROWS * JOINTS; i += threads) {
        int r = i % ROWS, j = i / ROWS;
        if (r >= rows) continue;
        send_target(targets, from + r, j, logged[row[r] * JOINTS + j], sample == 0);
    }
    if (sample > 0) return;
    // What networks remember of a robot that has been as it is for long.
    for (int i = thread; i < ROWS * MEMORY; i += threads) {
        int r = i % ROWS, k = i / ROWS;
        u32 e = from + r;
        if (r >= rows) continue;
        REMEMBERED(k) = settled(state, params, e, k);
    }
}
