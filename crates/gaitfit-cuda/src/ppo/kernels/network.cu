// Forward pass, losses and backward pass of both networks over one minibatch, in one launch.
//
// Some blocks work on the actor, the others on the critic. A block takes ROWS samples at a time: all layers' outputs stay
// in shared memory, and the derivatives take their place on the way back. Weights are read from a padded copy that
// stays in the first-level cache. Each block adds its weight gradients to its own part of `partial`; `reduce` adds the
// parts up in a fixed order, so the result has the same bits every time.
//
// Products are done by the matrix units on numbers of 11 significant bits (TF32). With SPLIT each factor is a sum of two
// such numbers and three products are added: the error is then about that of f32.
//
// Rows in shared memory are `padded` numbers apart (a multiple of 32), and column c of row r lies at
// c ^ swizzle(r): then neither a walk along rows nor one along columns meets a bank twice.

#define WARPS (THREADS / 32)
// Numbers that each block sums besides gradients.
enum { SURROGATE, VALUE, DIVERGENCE, RATIO_K1, RATIO_K3, CLIPPED, LOSSES };

DEVICE int swizzle(int row) { return ((row & 3) << 3) | (row & 4); }

#ifndef GAITFIT_HOST
// To 11 significant bits; a NaN stays one.
DEVICE float round_tf32(float x) {
    u32 bits;
    asm("cvt.rna.tf32.f32 %0, %1;" : "=r"(bits) : "f"(x));
    return __uint_as_float(bits);
}
DEVICE float truncate_tf32(float x) { return __uint_as_float(__float_as_uint(x) & 0xFFFFE000u); }
// sum += a b for a warp: 16 x 8 by 8 x 8, laid out as PTX's mma.m16n8k8 has it.
DEVICE void mma(float (&sum)[4], const float (&a)[4], const float (&b)[2]) {
    asm volatile(
        "mma.sync.aligned.m16n8k8.row.col.f32.tf32.tf32.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, {%0,%1,%2,%3};"
        : "+f"(sum[0]), "+f"(sum[1]), "+f"(sum[2]), "+f"(sum[3])
        : "r"(__float_as_uint(a[0])), "r"(__float_as_uint(a[1])), "r"(__float_as_uint(a[2])),
          "r"(__float_as_uint(a[3])), "r"(__float_as_uint(b[0])), "r"(__float_as_uint(b[1])));
}
#endif

// What a product takes: rounded already, or whole where it is split later.
DEVICE float rounded(float x) {
#if SPLIT
    return x;
#else
    return round_tf32(x);
#endif
}

// sum += a b for 32 x 8 by 8 x 32.
DEVICE void multiply(float (&sum)[2][4][4], const float (&a)[2][4], const float (&b)[4][2]) {
#if SPLIT
    float a_high[2][4], a_low[2][4], b_high[4][2], b_low[4][2];
#pragma unroll
    for (int i = 0; i < 2; i++)
#pragma unroll
        for (int e = 0; e < 4; e++) a_high[i][e] = truncate_tf32(a[i][e]), a_low[i][e] = a[i][e] - a_high[i][e];
#pragma unroll
    for (int j = 0; j < 4; j++)
#pragma unroll
        for (int e = 0; e < 2; e++) b_high[j][e] = truncate_tf32(b[j][e]), b_low[j][e] = b[j][e] - b_high[j][e];
#pragma unroll
    for (int i = 0; i < 2; i++)
#pragma unroll
        for (int j = 0; j < 4; j++) {
            mma(sum[i][j], a_low[i], b_high[j]);
            mma(sum[i][j], a_high[i], b_low[j]);
            mma(sum[i][j], a_high[i], b_high[j]);
        }
#else
#pragma unroll
    for (int i = 0; i < 2; i++)
#pragma unroll
        for (int j = 0; j < 4; j++) mma(sum[i][j], a[i], b[j]);
#endif
}

DEVICE float activate(float x) {
#if ACTIVATION == 0
    return x > 0.0f ? x : expf(x) - 1.0f;
#elif ACTIVATION == 1
    return x < 0.0f ? 0.0f : x;
#else
    return tanhf(x);
#endif
}

// Derivative by the activation's result.
DEVICE float slope(float h) {
#if ACTIVATION == 0
    return h > 0.0f ? 1.0f : h + 1.0f;
#elif ACTIVATION == 1
    return h > 0.0f ? 1.0f : 0.0f;
#else
    return 1.0f - h * h;
#endif
}

// Four numbers of rows g, g + 8, g + 16, g + 24 from `rows` on, at column `c` and the fourth after it.
DEVICE void rows_of(float (&a)[2][4], const float* rows, int apart, int c) {
#pragma unroll
    for (int i = 0; i < 2; i++) {
        const float* row = rows + 16 * i * apart;
        a[i][0] = row[c], a[i][1] = row[8 * apart + c], a[i][2] = row[c ^ 4], a[i][3] = row[8 * apart + (c ^ 4)];
    }
}

// h' = f(h W + b), from layer `layer` to the next.
DEVICE void forward(const Net& net, int layer, float* pool, const float* __restrict__ packed) {
    int lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3, s = swizzle(g);
    int inputs = (net.width[layer] + 7) & ~7, apart = net.padded[layer], columns = net.padded[layer + 1];
    bool last = layer + 1 == net.layers;
    for (int tile = threadIdx.x >> 5; tile < ROWS / 32 * (columns / 32); tile += WARPS) {
        int m0 = tile / (columns / 32) * 32, n0 = tile % (columns / 32) * 32;
        const float* rows = pool + net.place[layer] + (m0 + g) * apart;
        const float* weight = packed + net.weight[layer] + t * columns + n0 + g;
        float sum[2][4][4] = {};
#pragma unroll 2
        for (int k0 = 0; k0 < inputs; k0 += 8) {
            float a[2][4], b[4][2];
            rows_of(a, rows, apart, (k0 + t) ^ s);
#pragma unroll
            for (int j = 0; j < 4; j++)
                b[j][0] = weight[k0 * columns + 8 * j], b[j][1] = weight[(k0 + 4) * columns + 8 * j];
            multiply(sum, a, b);
        }
        const float* bias = packed + net.bias[layer];
        float* out = pool + net.place[layer + 1] + (m0 + g) * columns;
#pragma unroll
        for (int i = 0; i < 2; i++)
#pragma unroll
            for (int j = 0; j < 4; j++)
#pragma unroll
                for (int e = 0; e < 4; e++) {
                    int n = n0 + 8 * j + 2 * t + (e & 1);
                    float x = sum[i][j][e] + bias[n];
                    out[(16 * i + 8 * (e >> 1)) * columns + (n ^ s)] = last ? x : rounded(activate(x));
                }
    }
}

// d = (d' W^T) f'(h) in place of h, from layer `layer` + 1 to `layer`.
DEVICE void backward(const Net& net, int layer, float* pool, const float* __restrict__ packed) {
    int lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3, s = swizzle(g);
    int outputs = (net.width[layer + 1] + 7) & ~7, apart = net.padded[layer + 1], columns = net.padded[layer];
    for (int tile = threadIdx.x >> 5; tile < ROWS / 32 * (columns / 32); tile += WARPS) {
        int m0 = tile / (columns / 32) * 32, n0 = tile % (columns / 32) * 32;
        const float* rows = pool + net.place[layer + 1] + (m0 + g) * apart;
        const float* weight = packed + net.weight[layer] + (n0 + g) * apart + t;
        float sum[2][4][4] = {};
#pragma unroll 2
        for (int k0 = 0; k0 < outputs; k0 += 8) {
            float a[2][4], b[4][2];
            rows_of(a, rows, apart, (k0 + t) ^ s);
#pragma unroll
            for (int j = 0; j < 4; j++) b[j][0] = weight[8 * j * apart + k0], b[j][1] = weight[8 * j * apart + k0 + 4];
            multiply(sum, a, b);
        }
        float* out = pool + net.place[layer] + (m0 + g) * columns;
#pragma unroll
        for (int i = 0; i < 2; i++)
#pragma unroll
            for (int j = 0; j < 4; j++)
#pragma unroll
                for (int e = 0; e < 4; e++) {
                    int n = n0 + 8 * j + 2 * t + (e & 1);
                    float* h = out + (16 * i + 8 * (e >> 1)) * columns + (n ^ s);
                    *h = rounded(sum[i][j][e] * slope(*h));
                }
    }
}

// Adds h^T d' and the column sums of d' to this block's gradient, or stores them if it is the first.
DEVICE void gather_gradient(const Net& net, int layer, const float* pool, float* gradient, bool first) {
    int lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3;
    int apart = net.padded[layer], columns = net.padded[layer + 1];
    const float* h = pool + net.place[layer];
    const float* d = pool + net.place[layer + 1];
    for (int tile = threadIdx.x >> 5; tile < apart / 32 * (columns / 32); tile += WARPS) {
        int m0 = tile / (columns / 32) * 32, n0 = tile % (columns / 32) * 32;
        float* out = gradient + net.weight[layer] + (m0 + g) * columns + n0 + 2 * t;
        float sum[2][4][4] = {};
        if (!first)
#pragma unroll
            for (int i = 0; i < 2; i++)
#pragma unroll
                for (int j = 0; j < 4; j++)
#pragma unroll
                    for (int e = 0; e < 4; e++)
                        sum[i][j][e] = out[(16 * i + 8 * (e >> 1)) * columns + 8 * j + (e & 1)];
#pragma unroll 2
        for (int r0 = 0; r0 < ROWS; r0 += 8) {
            const float* h_row = h + (r0 + t) * apart;
            const float* d_row = d + (r0 + t) * columns;
            float a[2][4], b[4][2];
#pragma unroll
            for (int i = 0; i < 2; i++) {
                int m = (m0 + 16 * i + g) ^ (t << 3), m8 = (m0 + 16 * i + 8 + g) ^ (t << 3);
                a[i][0] = h_row[m], a[i][1] = h_row[m8];
                a[i][2] = h_row[4 * apart + (m ^ 4)], a[i][3] = h_row[4 * apart + (m8 ^ 4)];
            }
#pragma unroll
            for (int j = 0; j < 4; j++) {
                int n = (n0 + 8 * j + g) ^ (t << 3);
                b[j][0] = d_row[n], b[j][1] = d_row[4 * columns + (n ^ 4)];
            }
            multiply(sum, a, b);
        }
#pragma unroll
        for (int i = 0; i < 2; i++)
#pragma unroll
            for (int j = 0; j < 4; j++)
#pragma unroll
                for (int e = 0; e < 4; e++)
                    out[(16 * i + 8 * (e >> 1)) * columns + 8 * j + (e & 1)] = sum[i][j][e];
    }
    for (int n = threadIdx.x; n < columns; n += THREADS) {
        float* out = gradient + net.bias[layer] + n;
        float sum = first ? 0.0f : *out;
#pragma unroll 8
        for (int r = 0; r < ROWS; r++) sum += d[r * columns + (n ^ swizzle(r))];
        *out = sum;
    }
}

// Policy loss of one row, as gaitfit-learn has it: the derivative takes the place of the mean.
DEVICE void policy_loss(
    float* out, int s, const float* action, const float* old_mean, float old_log_probability, float advantage,
    const float* constants, float weight, float* losses, float* pull
) {
    float squares = 0.0f, shift = 0.0f;
    for (int c = 0; c < ACTIONS; c++) {
        float mean = out[c ^ s], z = (action[c] - mean) * constants[c], moved = (old_mean[c] - mean) * constants[c];
        squares += z * z;
        shift += moved * moved;
        pull[c] = z;
    }
    float log_ratio = -0.5f * squares - constants[ACTIONS] - old_log_probability, ratio = expf(log_ratio);
    float low = 1.0f - CLIP, high = 1.0f + CLIP;
    float clipped = ratio < low ? low : ratio;
    clipped = clipped > high ? high : clipped;
    float plain = -advantage * ratio, bounded = -advantage * clipped;
    // Written so that a NaN takes the plain branch and shows in the loss.
    bool held = bounded > plain;
    float pull_of_row = held ? 0.0f : plain * weight;
    for (int c = 0; c < ACTIONS; c++) {
        float z = pull[c];
        out[c ^ s] = rounded(pull_of_row * z * constants[c]);
        pull[c] = pull_of_row * (z * z - 1.0f);
    }
    losses[SURROGATE * ROWS] = held ? bounded : plain;
    losses[DIVERGENCE * ROWS] = 0.5f * shift + constants[ACTIONS + 1];
    losses[RATIO_K1 * ROWS] = -log_ratio;
    losses[RATIO_K3 * ROWS] = ratio - 1.0f - log_ratio;
    losses[CLIPPED * ROWS] = ratio < low || ratio > high ? 1.0f : 0.0f;
}

// Value loss of one row, likewise.
DEVICE void value_loss(float* out, float old, float target, bool clip, float weight, float* losses) {
    float value = *out, moved = value - old;
    float bounded = moved < -CLIP ? -CLIP : moved;
    bounded = bounded > CLIP ? CLIP : bounded;
    float plain_error = value - target, bounded_error = old + bounded - target;
    float plain = plain_error * plain_error, clipped = bounded_error * bounded_error;
    bool held = clip && clipped > plain;
    float pull = held ? (bounded == moved ? bounded_error : 0.0f) : plain_error;
    losses[VALUE * ROWS] = held ? clipped : plain;
    *out = rounded(2.0f * VALUE_COEFFICIENT * weight * pull);
}

// Blocks 0 .. actor_blocks are the actor's. `places`: rows of the samples, from `from` on `rows` of this minibatch.
// `scale`: of the actor's observations, then of the critic's. `sums`: blocks x (LOSSES + ACTIONS), the latter the
// derivative by ln sigma.
extern "C" __global__ void __launch_bounds__(THREADS, 1) network(
    u32 from, u32 rows, u32 actor_blocks, const u32* control, const u32* places, const float* observation,
    const float* critic_observation, const float* action, const float* mean, const float* log_probability,
    const float* advantage, const float* value, const float* returns, const float* scale, const float* __restrict__ packed,
    const float* constants, float* partial, double* sums
) {
    POOL(pool);
    bool actor = blockIdx.x < actor_blocks;
    const Net& net = NETS[actor ? 0 : 1];
    u32 block = actor ? blockIdx.x : blockIdx.x - actor_blocks, blocks = actor ? actor_blocks : gridDim.x - actor_blocks;
    const float* weights = packed + (actor ? 0 : ACTOR_PACKED);
    float* gradient = partial + (u64)(actor ? 0 : actor_blocks) * ACTOR_PACKED + (u64)block * net.packed;
    const float* input = actor ? observation : critic_observation;
    const float* input_scale = actor ? scale : scale + 2 * OBSERVATION;
    float* losses = pool + net.end;
    float* pulls = losses + LOSSES * ROWS;
    float weight = (float)(1.0 / (double)rows);
    bool clip_value = CLIPPED_VALUE_LOSS && !control[CRITIC_ALONE];
    int inputs = net.width[0], input_apart = net.padded[0], outputs_apart = net.padded[net.layers];
    // Which sum this thread keeps, if any.
    int quantity = THREADS - 1 - (int)threadIdx.x;
    double total = 0.0;
    bool first = true;
    for (u32 tile = block; tile * ROWS < rows; tile += blocks) {
        for (u32 i = threadIdx.x; i < LOSSES * ROWS + ROWS * ACTIONS; i += THREADS) losses[i] = 0.0f;
#pragma unroll 4
        for (int r = threadIdx.x >> 5; r < ROWS; r += WARPS) {
            u32 number = tile * ROWS + r;
            bool inside = number < rows;
            const float* row = input + (u64)(inside ? places[from + number] : 0) * inputs;
            for (int c = threadIdx.x & 31; c < input_apart; c += 32) {
                float x = inside && c < inputs ? row[c] * input_scale[c] + input_scale[inputs + c] : 0.0f;
                pool[net.place[0] + r * input_apart + (c ^ swizzle(r))] = rounded(x);
            }
        }
        __syncthreads();
        for (int layer = 0; layer < net.layers; layer++) {
            forward(net, layer, pool, weights);
            __syncthreads();
        }
        if (threadIdx.x < ROWS) {
            int r = threadIdx.x, s = swizzle(r);
            u32 number = tile * ROWS + r;
            float* out = pool + net.place[net.layers] + r * outputs_apart;
            if (number >= rows) {
                for (int c = 0; c < net.width[net.layers]; c++) out[c ^ s] = 0.0f;
            } else if (actor) {
                u64 i = places[from + number];
                policy_loss(
                    out, s, action + i * ACTIONS, mean + i * ACTIONS, log_probability[i], advantage[i], constants, weight,
                    losses + r, pulls + r * ACTIONS);
            } else {
                u64 i = places[from + number];
                value_loss(out + s, value[i], returns[i], clip_value, weight, losses + r);
            }
        }
        __syncthreads();
        // The last warps add up losses while the others begin with the gradients.
        if (quantity < LOSSES + ACTIONS) {
            bool loss = quantity < LOSSES;
            const float* from_row = loss ? losses + quantity * ROWS : pulls + quantity - LOSSES;
            for (int r = 0; r < ROWS; r++) total += from_row[r * (loss ? 1 : ACTIONS)];
        }
        for (int layer = net.layers; layer-- > 0;) {
            gather_gradient(net, layer, pool, gradient, first);
            __syncthreads();
            if (layer > 0) {
                backward(net, layer, pool, weights);
                __syncthreads();
            }
        }
        first = false;
    }
    if (quantity < LOSSES + ACTIONS) sums[blockIdx.x * (LOSSES + ACTIONS) + quantity] = total;
}
