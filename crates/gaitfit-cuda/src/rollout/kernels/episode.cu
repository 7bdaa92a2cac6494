// How an episode starts: the command, and the robot at rest in a pose plus uniform deviations, on the ground.

// An end of the commands' ranges: low and high of forward, left, yaw rate.
DEVICE double command_end(const u32* control, int end) {
    const u32* words = control + COMMAND_RANGES + 2 * end;
    return double_of_bits(((u64)words[1] << 32) | words[0]);
}

DEVICE void draw_command(const u32* control, u32 e, u32 step, float* command) {
    Draws draws = draws_of(control, COMMAND_DRAWS, e, step);
    bool standing = uniform(draws, 3) < COMMAND_STANDING;
    for (int k = 0; k < 3; k++)
        command[k * ENVIRONMENTS + e] =
            standing ? 0.0f : (float)within(draws, k, command_end(control, 2 * k), command_end(control, 2 * k + 1));
}

struct Vec {
    double x, y, z;
};
DEVICE Vec cross(Vec a, Vec b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
DEVICE Vec rotated(Quat q, Vec v) {
    Vec u = {q.x, q.y, q.z}, t = cross(u, v);
    t = {2.0 * t.x, 2.0 * t.y, 2.0 * t.z};
    Vec w = cross(u, t);
    return {v.x + q.w * t.x + w.x, v.y + q.w * t.y + w.y, v.z + q.w * t.z + w.z};
}
DEVICE Vec sum(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
DEVICE Vec difference(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }

// How high the base's origin must be over x, y of `place` for shape `k` to touch the ground: on flat ground over its
// plane. `moves` holds cos and sin of half of each hinge's angle from its reference; of a slide zero and how far it is from
// its own.
DEVICE double needed_height(int k, Quat base, const double place[2], const double* moves) {
    Shape shape = SHAPE[k];
    Vec p = {UNEVEN ? place[0] : 0.0, UNEVEN ? place[1] : 0.0, 0.0};
    Quat q = base;
    for (int i = 0; i < shape.links; i++) {
        Link link = WAY_TO[shape.first + i];
        if (link.framed) {
            p = sum(p, rotated(q, {link.position[0], link.position[1], link.position[2]}));
            q = product(q, {link.quaternion[0], link.quaternion[1], link.quaternion[2], link.quaternion[3]});
        }
        if (link.joint < 0) continue;
        double c = moves[2 * link.joint], s = moves[2 * link.joint + 1];
        if (link.slides) {
            p = sum(p, rotated(q, {s * link.axis[0], s * link.axis[1], s * link.axis[2]}));
            continue;
        }
        // A turn about the anchor: the anchor stays where it is.
        Vec own = {link.anchor[0], link.anchor[1], link.anchor[2]};
        Vec anchor = sum(p, rotated(q, own));
        q = product(q, {c, s * link.axis[0], s * link.axis[1], s * link.axis[2]});
        p = difference(anchor, rotated(q, own));
    }
    Vec centre = sum(p, rotated(q, {shape.position[0], shape.position[1], shape.position[2]}));
    double edges[3];
    for (int i = 0; i < 3; i++)
        edges[i] = fabs(rotated(q, {shape.edges[3 * i], shape.edges[3 * i + 1], shape.edges[3 * i + 2]}).z);
    double slope = rotated(q, {shape.axis[0], shape.axis[1], shape.axis[2]}).z;
    double flat = 1.0 - slope * slope;
    flat = flat > 0.0 ? flat : 0.0;
    double drop = edges[0] + edges[1] + edges[2] + shape.rim * sqrt(flat) + shape.radius;
#if UNEVEN
    // Both ends of a capsule touch; the reach of boxes and cylinders is as wide as it is high.
    if (!shape.round) return highest_about(centre.x, centre.y, drop) + drop - centre.z;
    Vec end = rotated(q, {shape.edges[0], shape.edges[1], shape.edges[2]});
    double one = highest_about(centre.x + end.x, centre.y + end.y, shape.radius) + shape.radius - (centre.z + end.z);
    double other = highest_about(centre.x - end.x, centre.y - end.y, shape.radius) + shape.radius - (centre.z - end.z);
    return one > other ? one : other;
#else
    return GROUND - (centre.z - drop);
#endif
}

#if UNEVEN
#define HEIGHT_WITHOUT_SHAPES ground_height(place[0], place[1])
#else
#define HEIGHT_WITHOUT_SHAPES GROUND
#endif

// What a block's threads hand to each other while they place a robot.
struct Placing {
    double angles[JOINTS], moves[2 * JOINTS], heights[SHAPES > 0 ? SHAPES : 1];
};

// A new episode of environment `e` that begins at `step`: all threads of the block share the work.
DEVICE void start_episode(
    const u32* control, u32 e, u32 step, Placing& placing, float* state, float* report, float* memory, float* command,
    const float* ways FOLLOWING(float* turned)
) {
    Draws draws = draws_of(control, RESET_DRAWS, e, step);
    double place[2];
    start_place(control, ways, e, step, place);
#define EITHER(draw, half) within(draws, draw, -(half), half)
    int thread = (int)threadIdx.x, threads = (int)blockDim.x;
    for (int j = thread; j < JOINTS; j += threads) {
        double drawn = (double)START_POSE[j] + EITHER(8 + j, START_JOINT_POSITION);
        if (JOINT[j].limited) {
            drawn = drawn < JOINT[j].range[0] ? JOINT[j].range[0] : drawn;
            drawn = drawn > JOINT[j].range[1] ? JOINT[j].range[1] : drawn;
        }
        placing.angles[j] = drawn;
    }
#if COUPLINGS > 0
    __syncthreads();
    // A leader may follow another joint, whose coupling may come later.
    for (int turn = 0; thread == 0 && turn < COUPLINGS; turn++) {
        for (int k = 0; k < COUPLINGS; k++) {
            Coupling coupling = COUPLING[k];
            int leader = coupling.leader;
            double x = leader < 0 ? 0.0 : placing.angles[leader] - JOINT[leader].reference, follow = 0.0;
            for (int power = 4; power >= 0; power--) follow = follow * x + coupling.polynomial[power];
            placing.angles[coupling.follower] = JOINT[coupling.follower].reference + follow;
        }
    }
    __syncthreads();
#endif
    for (int j = thread; j < JOINTS; j += threads) {
        double by = placing.angles[j] - JOINT[j].reference, half = 0.5 * by;
        placing.moves[2 * j] = JOINT[j].slides ? 0.0 : cos(half);
        placing.moves[2 * j + 1] = JOINT[j].slides ? by : sin(half);
    }
    double yaw = EITHER(0, START_YAW);
    Quat posture = product(turn(1, START_PITCH + EITHER(1, START_TILT)), turn(0, EITHER(2, START_TILT)));
    Quat q = product(turn(2, yaw), posture);
    __syncthreads();
    for (int k = thread; k < SHAPES; k += threads) placing.heights[k] = needed_height(k, q, place, placing.moves);
    for (int k = thread; k < STATE_COUNT; k += threads) {
        if (k >= QPOS && k < QACC) continue;
        if (k >= LINEAR && k < LINEAR + 2) STATE(k) = (float)EITHER(3 + k - LINEAR, START_LINEAR_VELOCITY);
        else if (k >= ANGULAR && k < QPOS) STATE(k) = (float)EITHER(5 + k - ANGULAR, START_ANGULAR_VELOCITY);
        else STATE(k) = 0.0f;
    }
    for (int j = thread; j < JOINTS; j += threads) {
        STATE(QPOS + j) = (float)placing.angles[j];
        STATE(QVEL + j) = (float)EITHER(8 + JOINTS + j, START_JOINT_VELOCITY);
        TORQUE(j) = 0.0f;
    }
    begin_sensors(memory, e, thread, threads);
    for (int k = thread; k < GEOMS; k += threads) FORCE(k) = 0.0f;
    for (int k = thread; k < FEET; k += threads)
        for (int axis = 0; axis < 3; axis++) CENTRE(k, axis) = 0.0f;
    __syncthreads();
    if (thread != 0) return;
#if COUPLINGS > 0
    // Joints that follow others move as their leaders do there.
    double rates[JOINTS];
    for (int j = 0; j < JOINTS; j++) rates[j] = EITHER(8 + JOINTS + j, START_JOINT_VELOCITY);
    for (int turn = 0; turn < COUPLINGS; turn++) {
        for (int k = 0; k < COUPLINGS; k++) {
            Coupling coupling = COUPLING[k];
            int leader = coupling.leader;
            double x = leader < 0 ? 0.0 : placing.angles[leader] - JOINT[leader].reference, slope = 0.0;
            for (int power = 4; power >= 1; power--) slope = slope * x + power * coupling.polynomial[power];
            rates[coupling.follower] = leader < 0 ? 0.0 : slope * rates[leader];
        }
    }
    for (int k = 0; k < COUPLINGS; k++) STATE(QVEL + COUPLING[k].follower) = (float)rates[COUPLING[k].follower];
#endif
    double height = SHAPES > 0 ? placing.heights[0] : HEIGHT_WITHOUT_SHAPES;
    for (int k = 1; k < SHAPES; k++) height = placing.heights[k] > height ? placing.heights[k] : height;
    for (int k = 0; k < 2; k++) STATE(POSITION + k) = (float)place[k];
    STATE(POSITION + 2) = (float)(height + GAP);
    STATE(QUATERNION) = (float)q.w;
    STATE(QUATERNION + 1) = (float)q.x;
    STATE(QUATERNION + 2) = (float)q.y;
    STATE(QUATERNION + 3) = (float)q.z;
    draw_command(control, e, step, command);
#if FOLLOWS
    turned[e] = turn_of_episode(state, e);
#endif
}
