// Generated ground: the cell in which an episode of a robot takes place, as in `gaitfit_learn::task::Course`.

// Numbers of a way: the level of its cell, distance walked along the commands and distance commanded, m.
enum { WAY_LEVEL, WAY_WALKED, WAY_COMMANDED };
#define WAY(number) ways[(number) * ENVIRONMENTS + e]

#if COURSE
DEVICE void cell_middle(int level, int column, double middle[2]) {
    middle[0] = CELL_SIZE * ((double)level + 0.5 - 0.5 * (double)LEVELS);
    middle[1] = CELL_SIZE * ((double)column + 0.5 - 0.5 * (double)COLUMNS);
}

DEVICE int cell_column(const u32* control, u32 e) { return (int)((control[FIRST_ENVIRONMENT] + e) % COLUMNS); }

// A level of the first `levels`, all alike.
DEVICE int any_level(const u32* control, u32 e, u32 step, int levels) {
    int level = (int)(uniform(draws_of(control, PLACE_DRAWS, e, step), 0) * (double)levels);
    return level < levels ? level : levels - 1;
}

DEVICE bool is_outside(const float place[3]) {
    return fabs((double)place[0]) > INSIDE_X || fabs((double)place[1]) > INSIDE_Y;
}

// Takes up a control period under `command` at `velocity`, heading frame.
DEVICE void advance_way(float* ways, u32 e, const float command[3], const float velocity[3]) {
    float speed = sqrtf(command[0] * command[0] + command[1] * command[1]), dt = (float)CONTROL_DT;
    if (!(speed > 0.0f)) return;
    WAY(WAY_WALKED) += dt * (velocity[0] * command[0] + velocity[1] * command[1]) / speed;
    WAY(WAY_COMMANDED) += dt * speed;
}

// The way of the episode that begins at `step`, after one that ended at `place`, by a fall or otherwise.
DEVICE void next_way(const u32* control, float* ways, u32 e, u32 step, const float place[3], bool fell) {
    int level = (int)WAY(WAY_LEVEL);
    if (CURRICULUM) {
        double middle[2];
        cell_middle(level, cell_column(control, e), middle);
        double dx = (double)place[0] - middle[0], dy = (double)place[1] - middle[1];
        if (sqrt(dx * dx + dy * dy) > 0.5 * CELL_SIZE)
            level = level + 1 < LEVELS ? level + 1 : any_level(control, e, step, LEVELS);
        else if (fell || WAY(WAY_WALKED) < 0.5f * WAY(WAY_COMMANDED))
            level = level > 0 ? level - 1 : 0;
    } else {
        level = any_level(control, e, step, DRAWN_LEVELS);
    }
    WAY(WAY_LEVEL) = (float)level;
    WAY(WAY_WALKED) = WAY(WAY_COMMANDED) = 0.0f;
}
#endif

// Where an episode that begins at `step` starts: x and y.
DEVICE void start_place(const u32* control, const float* ways, u32 e, u32 step, double place[2]) {
#if COURSE
    Draws draws = draws_of(control, PLACE_DRAWS, e, step);
    cell_middle((int)WAY(WAY_LEVEL), cell_column(control, e), place);
    for (int k = 0; k < 2; k++) place[k] += ROOM * (2.0 * uniform(draws, 1 + k) - 1.0);
#else
    place[0] = place[1] = 0.0;
#endif
}
