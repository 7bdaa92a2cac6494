// How high uneven ground is, as `gaitfit_model::Surface` has it. GROUND_HEIGHTS are filled when the program is loaded.

// A plane: its height at the origin and its slopes along x and y.
struct GroundPlane {
    double height, slopes[2];
};
// A box: its middle, its axes in the world, half its edges.
struct GroundBlock {
    double position[3], axes[9], half[3];
};
// A height field: its middle, cosine and sine of its turn, half sizes, distances of vertices, vertices along its y and x,
// and the first of its heights.
struct GroundField {
    double position[3], turn[2], half[2], step[2];
    int rows, columns, first;
};
#if UNEVEN
GROUND_TABLES

// Where the vertical line at x, y leaves a box; LOWEST if it misses it.
DEVICE double block_top(const GroundBlock& block, double x, double y) {
    double low = -1e300, high = 1e300, dx = x - block.position[0], dy = y - block.position[1];
    for (int k = 0; k < 3; k++) {
        const double* axis = block.axes + 3 * k;
        double along = axis[0] * dx + axis[1] * dy;
        if (fabs(axis[2]) <= 1e-9) {
            if (fabs(along) > block.half[k]) return GROUND_LOWEST;
            continue;
        }
        double a = (-block.half[k] - along) / axis[2], b = (block.half[k] - along) / axis[2];
        low = fmax(low, fmin(a, b));
        high = fmin(high, fmax(a, b));
    }
    return low <= high && high < 1e300 ? block.position[2] + high : GROUND_LOWEST;
}

// The height of a field at x, y; GROUND_LOWEST beside it.
DEVICE double field_height(const GroundField& field, double x, double y) {
    double dx = x - field.position[0], dy = y - field.position[1];
    double along = field.turn[0] * dx + field.turn[1] * dy, across = field.turn[0] * dy - field.turn[1] * dx;
    if (!(fabs(along) <= field.half[0] && fabs(across) <= field.half[1])) return GROUND_LOWEST;
    double u = (along + field.half[0]) / field.step[0], v = (across + field.half[1]) / field.step[1];
    int column = (int)u < field.columns - 2 ? (int)u : field.columns - 2;
    int row = (int)v < field.rows - 2 ? (int)v : field.rows - 2;
    u -= column, v -= row;
    const float* corner = GROUND_HEIGHTS + field.first + row * field.columns + column;
    double a = corner[0], b = corner[1], c = corner[field.columns], d = corner[field.columns + 1];
    return field.position[2] + (u >= v ? a + u * (b - a) + v * (d - b) : a + v * (c - a) + u * (d - c));
}

// The highest ground at x, y; where there is none, the lowest of all.
DEVICE double ground_height(double x, double y) {
    double highest = GROUND_LOWEST;
    for (int k = 0; k < GROUND_PLANES; k++)
        highest = fmax(highest, GROUND_PLANE[k].height + GROUND_PLANE[k].slopes[0] * x + GROUND_PLANE[k].slopes[1] * y);
    for (int k = 0; k < GROUND_BLOCKS; k++) highest = fmax(highest, block_top(GROUND_BLOCK[k], x, y));
    for (int k = 0; k < GROUND_FIELDS; k++) highest = fmax(highest, field_height(GROUND_FIELD[k], x, y));
    return highest;
}

// The highest ground at nine points of a square about x, y.
DEVICE double highest_about(double x, double y, double radius) {
    double highest = GROUND_LOWEST;
    for (int i = -1; i <= 1; i++)
        for (int j = -1; j <= 1; j++) highest = fmax(highest, ground_height(x + i * radius, y + j * radius));
    return highest;
}
#endif

// Height of the ground under a point, from which heights count; 0 on flat ground, wherever its plane lies.
DEVICE float ground_under(const float place[3]) {
#if UNEVEN
    return (float)ground_height((double)place[0], (double)place[1]);
#else
    return 0.0f;
#endif
}
