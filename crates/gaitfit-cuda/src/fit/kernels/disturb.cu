// Random torques of all physics steps of a control period, a block row each. `seeds`: of each candidate, two words;
// `deviation`: of each, N m; `tiles`: those of the physics.
KERNEL disturb(
    u32 sample, u32 count, u32 places, u32 recordings, u32 tiles, const u32* seeds, const double* deviation,
    float* disturbance
) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= places) return;
    u32 own = source_of(e, count), candidate = own / recordings, substep = blockIdx.y;
    Draws draws = {
        seeds[2 * candidate], seeds[2 * candidate + 1], TORQUE_DRAWS, own % recordings, sample * SUBSTEPS + substep};
    float* there = disturbance + (u64)substep * tiles * DISTURBANCE_SIZE;
    double pair[2];
    for (int j = 0; j < DISTURBED; j++) {
        if (j % 2 == 0) normal_pair(draws, j / 2, pair);
        at(there, DISTURBANCE_SIZE, DISTURBANCE_SPOTS[j], e) = (float)(deviation[candidate] * pair[j % 2]);
    }
}
