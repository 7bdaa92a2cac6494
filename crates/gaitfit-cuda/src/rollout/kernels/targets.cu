// Actions as the targets of joints.

// The target that the action `wanted` asks of the policy's joint `k`.
DEVICE float target_of(int k, float wanted) {
    int j = JOINT_OF[k];
    float target;
    clipped_target(DEFAULT_POSE[j], ACTION_SCALE[j], ACTION_CLIP[k], wanted, &target);
    return target;
}

// Sends joint `j` of environment `e` its next target. The `first` target also counts as all earlier ones.
DEVICE void send_target(float* targets, u32 e, int j, float target, bool first) {
    for (int tap = TAPS - 1; tap > 0; tap--) TARGET(tap, j) = first ? target : TARGET(tap - 1, j);
    TARGET(0, j) = target;
}

