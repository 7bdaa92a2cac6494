// Recurrent layers before the networks: forth over the steps of some robots, back through them, and their parameters.
//
// A block works on TEAM robots; rows are numbered step x robots + robot. Gates lie in PyTorch's order (i, f, g, o of an
// LSTM, r, z, n of a GRU). The formulas are those of gaitfit-policy's `network/cell.rs`. Sums are in f32, in a fixed order.

#if MEMORY
#define TEAM 8
#define LSTM_GATES 4

DEVICE float sigmoid(float x) { return 1.0f / (1.0f + expf(-x)); }

// Whether an episode of environment `e` begins with `step` of the rollout.
DEVICE bool begins_at(const float* done, u32 step, u32 environments, u32 e) {
    return step > 0 && done[(u64)(step - 1) * environments + e] != 0.0f;
}

// One layer over `steps` steps of `robots` robots: robot r is environment `list[from + r]` if they are listed, else r.
// Its input is `input`, a row a local number if it is `inner`, else row first_row + step x environments + environment,
// times `scale` if it is `scaled`. It begins with row start_first + environment of `start`, `remembered` numbers each, from
// number `start_at` on, and leaves what it then remembers there if that is to be kept. All arrays but these have local rows.
KERNEL remember(
    u32 steps, u32 robots, u32 from, u32 listed, u32 environments, u32 first_row, u32 inner, u32 scaled, u32 start_first,
    u32 start_at, u32 remembered, u32 keep, u32 resets, u32 count, u32 inputs, u32 hidden, u32 place, const u32* list,
    const float* input, const float* scale, const float* done, float* start, const float* parameters, float* taken,
    float* gates, float* of_output, float* output_before, float* output, float* cell_before, float* cell
) {
    POOL(pool);
    float *xs = pool, *hs = pool + inputs * TEAM;
    u32 wide = count * hidden, first = blockIdx.x * TEAM;
    bool lstm = count == LSTM_GATES;
    const float* w = parameters + place;
    const float* u = w + inputs * wide;
    const float* b = u + hidden * wide;
    const float* c = b + wide;
    for (u32 step = 0; step < steps; step++) {
        u64 local = (u64)step * robots + first;
        for (u32 i = threadIdx.x; i < inputs * TEAM; i += blockDim.x) {
            u32 g = i / inputs, k = i % inputs;
            float x = 0.0f;
            if (first + g < robots) {
                u32 e = listed ? list[from + first + g] : first + g;
                u64 row = inner ? local + g : first_row + (u64)step * environments + e;
                x = input[row * inputs + k];
                if (scaled) x = x * scale[k] + scale[inputs + k];
                if (!inner) taken[(local + g) * inputs + k] = x;
            }
            xs[k * TEAM + g] = x;
        }
        for (u32 i = threadIdx.x; i < hidden * TEAM; i += blockDim.x) {
            u32 g = i / hidden, k = i % hidden;
            float h = 0.0f, m = 0.0f;
            if (first + g < robots) {
                u32 e = listed ? list[from + first + g] : first + g;
                if (step == 0) {
                    const float* row = start + (u64)(start_first + e) * remembered + start_at;
                    h = row[k];
                    if (lstm) m = row[hidden + k];
                } else if (!(resets && begins_at(done, step, environments, e))) {
                    u64 before = (local - robots + g) * hidden + k;
                    h = output[before];
                    if (lstm) m = cell[before];
                }
                output_before[(local + g) * hidden + k] = h;
                if (lstm) cell_before[(local + g) * hidden + k] = m;
            }
            hs[k * TEAM + g] = h;
        }
        __syncthreads();
        for (u32 j = threadIdx.x; j < wide; j += blockDim.x) {
            float of_x[TEAM] = {}, of_h[TEAM] = {};
            for (u32 k = 0; k < inputs; k++) {
                float weight = w[(u64)k * wide + j];
#pragma unroll
                for (u32 g = 0; g < TEAM; g++) of_x[g] += xs[k * TEAM + g] * weight;
            }
            for (u32 k = 0; k < hidden; k++) {
                float weight = u[(u64)k * wide + j];
#pragma unroll
                for (u32 g = 0; g < TEAM; g++) of_h[g] += hs[k * TEAM + g] * weight;
            }
#pragma unroll
            for (u32 g = 0; g < TEAM; g++)
                if (first + g < robots) {
                    gates[(local + g) * wide + j] = of_x[g] + b[j];
                    of_output[(local + g) * wide + j] = of_h[g] + c[j];
                }
        }
        __syncthreads();
        for (u32 i = threadIdx.x; i < hidden * TEAM; i += blockDim.x) {
            u32 g = i / hidden, k = i % hidden;
            if (first + g >= robots) continue;
            float* x = gates + (local + g) * wide + k;
            float* h = of_output + (local + g) * wide + k;
            u64 at = (local + g) * hidden + k;
            if (lstm) {
                float in = sigmoid(x[0] + h[0]), kept = sigmoid(x[hidden] + h[hidden]);
                float fresh = tanhf(x[2 * hidden] + h[2 * hidden]), out = sigmoid(x[3 * hidden] + h[3 * hidden]);
                float now = kept * cell_before[at] + in * fresh;
                x[0] = in, x[hidden] = kept, x[2 * hidden] = fresh, x[3 * hidden] = out;
                cell[at] = now;
                output[at] = out * tanhf(now);
            } else {
                float reset = sigmoid(x[0] + h[0]), old = sigmoid(x[hidden] + h[hidden]);
                float fresh = tanhf(x[2 * hidden] + reset * h[2 * hidden]);
                x[0] = reset, x[hidden] = old, x[2 * hidden] = fresh;
                output[at] = (1.0f - old) * fresh + old * output_before[at];
            }
            if (keep && step + 1 == steps) {
                u32 e = listed ? list[from + first + g] : first + g;
                float* row = start + (u64)(start_first + e) * remembered + start_at;
                row[k] = output[at];
                if (lstm) row[hidden + k] = cell[at];
            }
        }
        __syncthreads();
    }
}

// Rows of a network without a memory, in the order of `remember`'s rows: row `local` of `taken` is the observation of a robot at
// a step, with its factors and offsets.
KERNEL pass_on(
    u32 steps, u32 robots, u32 from, u32 listed, u32 environments, u32 first_row, u32 inputs, const u32* list, const float* input,
    const float* scale, float* taken
) {
    u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= (u64)steps * robots * inputs) return;
    u32 local = (u32)(i / inputs), k = (u32)(i % inputs), step = local / robots, r = local % robots;
    u32 e = listed ? list[from + r] : r;
    u64 row = first_row + (u64)step * environments + e;
    taken[i] = input[row * inputs + k] * scale[k] + scale[inputs + k];
}

// The way back through one layer: `gates` and, of a GRU, `of_output` become derivatives by the products. `turned`: the
// parameters with each matrix transposed, in the same places; that of the output's product begins at `place`.
KERNEL recall(
    u32 steps, u32 robots, u32 from, u32 environments, u32 count, u32 hidden, u32 place, const u32* list, const float* done,
    const float* turned, const float* derivative, float* gates, float* of_output, const float* output_before,
    const float* cell_before, const float* cell
) {
    POOL(pool);
    u32 wide = count * hidden, first = blockIdx.x * TEAM;
    bool lstm = count == LSTM_GATES;
    float *carry = pool, *of_cell = carry + hidden * TEAM, *products = of_cell + hidden * TEAM;
    for (u32 i = threadIdx.x; i < 2 * hidden * TEAM; i += blockDim.x) carry[i] = 0.0f;
    __syncthreads();
    for (u32 step = steps; step-- > 0;) {
        u64 local = (u64)step * robots + first;
        for (u32 i = threadIdx.x; i < hidden * TEAM; i += blockDim.x) {
            u32 g = i / hidden, k = i % hidden, own = k * TEAM + g;
            float* d = products + own;
            if (first + g >= robots) {
                for (u32 gate = 0; gate < count; gate++) d[gate * hidden * TEAM] = 0.0f;
                continue;
            }
            float* x = gates + (local + g) * wide + k;
            float* h = of_output + (local + g) * wide + k;
            u64 at = (local + g) * hidden + k;
            float pull = derivative[at] + carry[own];
            if (lstm) {
                float in = x[0], kept = x[hidden], fresh = x[2 * hidden], out = x[3 * hidden], t = tanhf(cell[at]);
                float inner = of_cell[own] + pull * out * (1.0f - t * t);
                x[3 * hidden] = pull * t * out * (1.0f - out);
                x[0] = inner * fresh * in * (1.0f - in);
                x[hidden] = inner * cell_before[at] * kept * (1.0f - kept);
                x[2 * hidden] = inner * in * (1.0f - fresh * fresh);
                of_cell[own] = inner * kept;
                carry[own] = 0.0f;
                for (u32 gate = 0; gate < LSTM_GATES; gate++) d[gate * hidden * TEAM] = x[gate * hidden];
            } else {
                float reset = x[0], old = x[hidden], fresh = x[2 * hidden];
                float now = pull * (1.0f - old) * (1.0f - fresh * fresh);
                x[0] = now * h[2 * hidden] * reset * (1.0f - reset);
                x[hidden] = pull * (output_before[at] - fresh) * old * (1.0f - old);
                x[2 * hidden] = now;
                h[0] = x[0], h[hidden] = x[hidden], h[2 * hidden] = now * reset;
                carry[own] = pull * old;
                for (u32 gate = 0; gate < 3; gate++) d[gate * hidden * TEAM] = h[gate * hidden];
            }
        }
        __syncthreads();
        for (u32 i = threadIdx.x; i < hidden * (TEAM / 2); i += blockDim.x) {
            u32 k = i % hidden, g = i / hidden * 2;
            float a = 0.0f, b = 0.0f;
            for (u32 j = 0; j < wide; j++) {
                float weight = turned[place + (u64)j * hidden + k];
                a += products[j * TEAM + g] * weight;
                b += products[j * TEAM + g + 1] * weight;
            }
            for (u32 side = 0; side < 2; side++) {
                u32 robot = first + g + side, own = k * TEAM + g + side;
                bool begins = robot < robots && begins_at(done, step, environments, list[from + robot]);
                carry[own] = begins ? 0.0f : carry[own] + (side ? b : a);
                if (begins) of_cell[own] = 0.0f;
            }
        }
        __syncthreads();
    }
}

// Derivatives by a layer's input: `rows` rows of `gates` times the transposed matrix at `place`.
KERNEL pass_down(u32 rows, u32 inputs, u32 wide, u32 place, const float* turned, const float* gates, float* of_input) {
    POOL(pool);
    u32 first = blockIdx.x * TEAM;
    for (u32 i = threadIdx.x; i < wide * TEAM; i += blockDim.x) {
        u32 g = i / wide, j = i % wide;
        pool[j * TEAM + g] = first + g < rows ? gates[(u64)(first + g) * wide + j] : 0.0f;
    }
    __syncthreads();
    for (u32 i = threadIdx.x; i < inputs * (TEAM / 2); i += blockDim.x) {
        u32 k = i % inputs, g = i / inputs * 2;
        float a = 0.0f, b = 0.0f;
        for (u32 j = 0; j < wide; j++) {
            float weight = turned[place + (u64)j * inputs + k];
            a += pool[j * TEAM + g] * weight;
            b += pool[j * TEAM + g + 1] * weight;
        }
        if (first + g < rows) of_input[(u64)(first + g) * inputs + k] = a;
        if (first + g + 1 < rows) of_input[(u64)(first + g + 1) * inputs + k] = b;
    }
}

#define TILE 32

// Derivatives by a matrix and its bias: left^T right and the column sums of right, over `chunk` rows a block column.
// `left` is rows x `inputs`, `right` rows x `wide`. Each block column has `size` numbers of `partial`.
KERNEL outer(
    u32 rows, u32 chunk, u32 inputs, u32 wide, u32 weight_place, u32 bias_place, u32 size, const float* left,
    const float* right, float* partial
) {
    __shared__ float a[TILE][TILE + 1], d[TILE][TILE + 1];
    u32 columns = (wide + TILE - 1) / TILE, tx = threadIdx.x % TILE, ty = threadIdx.x / TILE, lines = blockDim.x / TILE;
    u32 k0 = blockIdx.y / columns * TILE, j = blockIdx.y % columns * TILE + tx;
    u32 begin = blockIdx.x * chunk, end = begin + chunk < rows ? begin + chunk : rows;
    float sum[4] = {};
    for (u32 r0 = begin; r0 < end; r0 += TILE) {
        for (u32 i = ty; i < TILE; i += lines) {
            u32 r = r0 + i, k = k0 + tx;
            // The bias has an input of 1.
            a[i][tx] = r >= end || k > inputs ? 0.0f : k < inputs ? left[(u64)r * inputs + k] : 1.0f;
            d[i][tx] = r < end && j < wide ? right[(u64)r * wide + j] : 0.0f;
        }
        __syncthreads();
        for (u32 i = 0; i < TILE; i++) {
            float x = d[i][tx];
#pragma unroll
            for (u32 n = 0; n < 4; n++) sum[n] += a[i][ty * 4 + n] * x;
        }
        __syncthreads();
    }
    float* to = partial + (u64)blockIdx.x * size;
    for (u32 n = 0; n < 4; n++) {
        u32 k = k0 + ty * 4 + n;
        if (k <= inputs && j < wide) to[k < inputs ? weight_place + k * wide + j : bias_place + j] = sum[n];
    }
}

// Adds up the parts of the memories' derivatives, as `reduce` does those of the networks.
KERNEL memory_reduce(
    u32 chunks, u32 size, u32 actor_size, const u32* control, const float* partial, float* gradient, double* squares
) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    bool actor = i < actor_size;
    float sum = 0.0f;
    if (i < size) {
        if (!(actor && control[CRITIC_ALONE]))
            for (u32 chunk = 0; chunk < chunks; chunk++) sum += partial[(u64)chunk * size + i];
        gradient[i] = sum;
    }
    double square = (double)sum * sum;
    double of_actor = block_sum(actor ? square : 0.0), of_critic = block_sum(actor ? 0.0 : square);
    if (threadIdx.x == 0) squares[blockIdx.x] = of_actor, squares[gridDim.x + blockIdx.x] = of_critic;
}

// Steps the memories' parameters and renews the transposed copy, as `adam` does. `turn`: where a parameter lies in it.
KERNEL memory_adam(
    u32 alone, u32 size, u32 actor_size, const u32* control, const double* state, const u32* turn, const float* gradient,
    float* moments, float* parameters, float* turned
) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= size) return;
    if (!alone) {
        if (state[FAULT] != 0.0 || (i < actor_size && control[CRITIC_ALONE])) return;
        parameters[i] = adam_step(parameters[i], gradient[i], &moments[i], &moments[size + i], state);
    }
    turned[turn[i]] = parameters[i];
}

// Rows of the samples in the order of the minibatches: of each, step by step, all its robots. `robots` has the robots in
// the order of the minibatches. Epochs are the grid's second dimension.
KERNEL memory_places(u32 steps, u32 environments, u32 minibatches, const u32* robots, u32* places) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= steps * environments) return;
    u32 m = (u32)(((u64)(i / steps) + 1) * minibatches - 1) / environments;
    u32 begin = (u32)((u64)m * environments / minibatches), end = (u32)(((u64)m + 1) * environments / minibatches);
    u32 local = i - begin * steps, step = local / (end - begin), r = local % (end - begin);
    places[(u64)blockIdx.y * steps * environments + i] = step * environments + robots[blockIdx.y * environments + begin + r];
}

// Before an update: moments begin at 0 again if the host says so.
KERNEL memory_begin(u32 size, const u32* control, float* moments) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < 2 * size && control[RESET_MOMENTS]) moments[i] = 0.0f;
}

// Before a rollout: what is remembered then.
KERNEL memory_copy(u32 count, const float* from, float* to) {
    for (u32 i = blockIdx.x * blockDim.x + threadIdx.x; i < count; i += gridDim.x * blockDim.x) to[i] = from[i];
}

// After a step: episodes that ended are forgotten. What the critic remembered of those that were cut off is kept for the
// value of the state reached.
KERNEL forget(
    u32 step, u32 environments, u32 cuts, u32 actor_width, u32 critic_width, const float* done, float* actor, float* critic,
    const u32* cut, float* tail
) {
    u32 e = blockIdx.x * blockDim.x + threadIdx.x;
    if (e >= environments || done[(u64)step * environments + e] == 0.0f) return;
    float* own = critic + (u64)e * critic_width;
    for (u32 slot = 0; slot < cuts; slot++) {
        if (cut[slot * environments + e] != step + 1) continue;
        float* to = tail + ((u64)slot * environments + e) * critic_width;
        for (u32 k = 0; k < critic_width; k++) to[k] = own[k];
    }
    for (u32 k = 0; k < critic_width; k++) own[k] = 0.0f;
    for (u32 k = 0; k < actor_width; k++) actor[(u64)e * actor_width + k] = 0.0f;
}
#endif
