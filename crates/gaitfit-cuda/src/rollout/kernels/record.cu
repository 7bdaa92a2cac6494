// What is recorded of a walk.

// Numbers of a robot's row, as `gaitfit_learn::collect::Recorder::sense` takes it: joint positions and velocities in the
// policy's order, the command, the base's position, orientation (as the inertial unit reads it), velocity and rates (as the
// gyro reads them).
#define RECORDED (2 * ACTIONS + 16)

// The rows of step `step`, before its action; a thread a number. `records`: steps x environments x RECORDED.
KERNEL record(u32 step, const float* state, const float* params, const float* memory, const float* imu, const float* command, float* records) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x, e = i / RECORDED;
    int k = (int)(i % RECORDED);
    if (e >= ENVIRONMENTS) return;
    float value;
    if (k < ACTIONS)
        value = joint_position(state, params, e, JOINT_OF[k]);
    else if (k < 2 * ACTIONS)
        value = read_velocity(state, memory, e, JOINT_OF[k - ACTIONS]);
    else if (k < 2 * ACTIONS + 3)
        value = command[(k - 2 * ACTIONS) * ENVIRONMENTS + e];
    else {
        int number = k - 2 * ACTIONS - 3;
        Base base = read_base(state, memory, e);
        read_rates(imu + e, ENVIRONMENTS, base.angular);
        value = number < 3    ? base.position[number]
                : number < 7  ? attitude_number(imu + e, ENVIRONMENTS, base.quaternion, number - 3)
                : number < 10 ? base.linear[number - 7]
                              : base.angular[number - 10];
    }
    records[((u64)step * ENVIRONMENTS + e) * RECORDED + k] = value;
}
