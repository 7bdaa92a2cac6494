// A control step of clamped robots that are given their logs' targets, but for the physics: as the replay of gaitfit-sim.

// Dimensions of the signals: joint positions, velocities.
#define DIMENSIONS (2 * JOINTS)

// Step `sample`, a thread an environment and joint. `logged`: targets of the logs, recordings x samples x JOINTS; `velocities`: the
// first of each recording; `rest`: a state at rest. `gains` and `factors` as for `spread`.
KERNEL replay(
    u32 sample, u32 count, u32 places, u32 recordings, u32 samples, const u32* lengths, const float* logged,
    const float* velocities, const float* rest, const double* factors, const double* gains, const float* params,
    float* state, float* targets, float* memory, float* signals, u32* ends
) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x, e = i / JOINTS;
    int j = (int)(i % JOINTS);
    if (e >= places) return;
    u32 own = source_of(e, count), recording = own % recordings, candidate = own / recordings;
    u32 length = lengths[recording];
    if (sample == 0) {
        double bias = factors[(u64)candidate * 3 * JOINTS + 2 * JOINTS + j];
        float angle = (float)(gains[(u64)recording * 3 * JOINTS + 2 * JOINTS + j] - bias);
        for (int k = j; k < STATE_COUNT; k += JOINTS)
            if (k < QPOS || k >= QACC) STATE(k) = rest[k];
        STATE(QPOS + j) = angle;
        STATE(QVEL + j) = velocities[recording * JOINTS + j];
        STATE(QACC + j) = 0.0f;
        // Gears at rest in the middle of their play, sensors that read the velocity; nothing else remembers anything here. Both
        // remember as many numbers of every joint, so a thread reads what it wrote.
        for (int k = j; k < MEMORY; k += JOINTS) REMEMBERED(k) = 0.0f;
        if (j == 0 && e < count) ends[e] = length;
    }
    if (e < count && sample < length) {
        float* row = signals + ((u64)e * samples + sample) * DIMENSIONS;
        row[j] = joint_position(state, params, e, j);
        // The integrator's velocity belongs to half a step before the position.
        row[JOINTS + j] = STATE(QVEL + j) + HALF_STEP * STATE(QACC + j);
#if HAS_FILTER
        // A slow sensor.
        row[JOINTS + j] = row[JOINTS + j] + REMEMBERED(FILTER_AT + j);
#endif
    }
    u32 now = sample < length ? sample : length - 1;
    float target = logged[((u64)recording * samples + now) * JOINTS + j];
    for (int tap = TAPS - 1; tap > 0; tap--) TARGET(tap, j) = sample == 0 ? target : TARGET(tap - 1, j);
    TARGET(0, j) = target;
}
