// One layer at a time, forth and back, for R samples in shared memory, in f32.
//
// Products are done by the matrix units on numbers of 11 significant bits (TF32). With SPLIT each factor is a sum of two
// such numbers and three products are added: the error is then about that of f32.
//
// Rows in shared memory are `padded` numbers apart (a multiple of 32), and column c of row r lies at
// c ^ swizzle(r): then neither a walk along rows nor one along columns meets a bank twice.

typedef float Number;

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
// Two kept derivatives, once: caches need not hold them.
DEVICE float2 kept_at(const float2* at) {
    float2 x;
    asm volatile("ld.global.cs.v2.f32 {%0, %1}, [%2];"
                 : "=f"(x.x), "=f"(x.y)
                 : "l"(__cvta_generic_to_global(at))
                 : "memory");
    return x;
}
// Factor a of `mma`: rows 0 .. 16 of `rows`, which are `apart` numbers apart, columns k0 .. k0 + 8. One instruction loads
// four squares of 8 rows x 16 bytes; each thread says where one row of one square lies.
DEVICE void load_rows(float (&a)[4], const float* rows, int apart, int k0) {
    int lane = threadIdx.x & 31, row = lane & 15, s = swizzle(lane & 7) ^ (lane >> 4 << 2);
    u32 from = (u32)__cvta_generic_to_shared(rows + row * apart + (k0 & ~31) + ((k0 & 31) ^ s)), bits[4];
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3}, [%4];"
                 : "=r"(bits[0]), "=r"(bits[1]), "=r"(bits[2]), "=r"(bits[3])
                 : "r"(from)
                 : "memory");
#pragma unroll
    for (int e = 0; e < 4; e++) a[e] = __uint_as_float(bits[e]);
}
#else
DEVICE void load_rows(float (&a)[4], const float* rows, int apart, int k0) {
    int lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3, c = (k0 + t) ^ swizzle(g);
    const float* row = rows + g * apart;
    a[0] = row[c], a[1] = row[8 * apart + c], a[2] = row[c ^ 4], a[3] = row[8 * apart + (c ^ 4)];
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

// sum += a b for 16 I x 8 by 8 x 8 J.
template <int I, int J>
DEVICE void multiply(float (&sum)[I][J][4], const float (&a)[I][4], const float (&b)[J][2]) {
#if SPLIT
    float a_high[I][4], a_low[I][4], b_high[J][2], b_low[J][2];
#pragma unroll
    for (int i = 0; i < I; i++)
#pragma unroll
        for (int e = 0; e < 4; e++) a_high[i][e] = truncate_tf32(a[i][e]), a_low[i][e] = a[i][e] - a_high[i][e];
#pragma unroll
    for (int j = 0; j < J; j++)
#pragma unroll
        for (int e = 0; e < 2; e++) b_high[j][e] = truncate_tf32(b[j][e]), b_low[j][e] = b[j][e] - b_high[j][e];
#pragma unroll
    for (int i = 0; i < I; i++)
#pragma unroll
        for (int j = 0; j < J; j++) {
            mma(sum[i][j], a_low[i], b_high[j]);
            mma(sum[i][j], a_high[i], b_low[j]);
            mma(sum[i][j], a_high[i], b_high[j]);
        }
#else
#pragma unroll
    for (int i = 0; i < I; i++)
#pragma unroll
        for (int j = 0; j < J; j++) mma(sum[i][j], a[i], b[j]);
#endif
}

// Columns of a warp's tile of 32 rows in blocks of 8: 4 where there are enough tiles for all warps.
#define BLOCKS_OF(rows, columns) ((rows) / 32 * ((columns) / 32) >= WARPS ? 4 : 2)

// Weights of STEPS blocks of 8 rows, from `fragments` on.
template <int STEPS, int PARTS, int COLUMNS>
DEVICE void load_weights(float4 (&to)[STEPS][PARTS], const float4* __restrict__ fragments) {
#pragma unroll
    for (int step = 0; step < STEPS; step++)
#pragma unroll
        for (int part = 0; part < PARTS; part++) to[step][part] = fragments[step * 2 * COLUMNS + part * 32];
}

// sum += rows W for 32 rows and 8 J columns of W: K numbers of each row, rows APART numbers apart. `fragments`: W as the
// matrix units take it, of COLUMNS columns, from this thread's first part on. The next weights are loaded while the
// present ones are used.
template <int J, int K, int APART, int COLUMNS>
DEVICE void product(float (&sum)[2][J][4], const float* rows, const float4* __restrict__ fragments) {
    constexpr int STEPS = K % 32 == 0 ? 4 : 2, PARTS = J / 2;
    float4 now[STEPS][PARTS], next[STEPS][PARTS];
    load_weights<STEPS, PARTS, COLUMNS>(now, fragments);
#pragma unroll 2
    for (int k0 = 0; k0 < K; k0 += 8 * STEPS) {
        int ahead = k0 + 8 * STEPS < K ? k0 + 8 * STEPS : k0;
        load_weights<STEPS, PARTS, COLUMNS>(next, fragments + ahead / 8 * 2 * COLUMNS);
#pragma unroll
        for (int step = 0; step < STEPS; step++) {
            float a[2][4], b[J][2];
#pragma unroll
            for (int part = 0; part < PARTS; part++) {
                float4 x = now[step][part];
                b[2 * part][0] = x.x, b[2 * part][1] = x.y, b[2 * part + 1][0] = x.z, b[2 * part + 1][1] = x.w;
            }
            load_rows(a[0], rows, APART, k0 + 8 * step);
            load_rows(a[1], rows + 16 * APART, APART, k0 + 8 * step);
            multiply<2, J>(sum, a, b);
        }
#pragma unroll
        for (int step = 0; step < STEPS; step++)
#pragma unroll
            for (int part = 0; part < PARTS; part++) now[step][part] = next[step][part];
    }
}

// Waits, then out = f(h W + b): K of IN columns of h are used. `slopes`: where f' goes, if it is KEPT.
template <int R, int K, int IN, int OUT, int F, bool KEPT>
DEVICE void forward(
    const float* h, float* out, float*, const float* __restrict__ weight, const float* __restrict__ bias, bool last,
    float* slopes
) {
    __syncthreads();
    constexpr int J = BLOCKS_OF(R, OUT), COUNT = OUT / (8 * J);
    int lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3, s = swizzle(g);
    for (int tile = threadIdx.x >> 5; tile < R / 32 * COUNT; tile += WARPS) {
        int m0 = tile / COUNT * 32, n0 = tile % COUNT * 8 * J;
        float sum[2][J][4] = {};
        product<J, K, IN, OUT>(sum, h + m0 * IN, (const float4*)weight + n0 * 2 + lane);
        float* to = out + (m0 + g) * OUT + (n0 & ~31);
#pragma unroll
        for (int j = 0; j < J; j++) {
            int n = (n0 & 31) + 8 * j + 2 * t;
            float2 shift = *(const float2*)(bias + (n0 & ~31) + n);
#pragma unroll
            for (int i = 0; i < 4; i++) {
                float2 x = {sum[i / 2][j][i % 2 * 2] + shift.x, sum[i / 2][j][i % 2 * 2 + 1] + shift.y};
                if (!last && KEPT) {
                    float2 kept;
                    x.x = rounded(activate<F>(x.x, kept.x)), x.y = rounded(activate<F>(x.y, kept.y));
                    ((float2*)slopes)[kept_pair<4 * J>(tile, i * J + j)] = kept;
                } else if (!last) {
                    x.x = rounded(activate<F>(x.x)), x.y = rounded(activate<F>(x.y));
                }
                *(float2*)(to + 8 * i * OUT + (n ^ s)) = x;
            }
        }
    }
}

// Waits, then h = (d W^T) f'(h), or without f' where h is no function's result: K of OUT columns of d are used.
// `slopes`: f' where it was kept.
template <int R, int K, int IN, int OUT, int F>
DEVICE void backward(float* h, const float* d, const float* __restrict__ weight, const float* slopes) {
    __syncthreads();
    constexpr int J = BLOCKS_OF(R, IN), COUNT = IN / (8 * J);
    int lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3, s = swizzle(g);
    for (int tile = threadIdx.x >> 5; tile < R / 32 * COUNT; tile += WARPS) {
        int m0 = tile / COUNT * 32, n0 = tile % COUNT * 8 * J;
        float sum[2][J][4] = {};
        product<J, K, OUT, IN>(sum, d + m0 * OUT, (const float4*)weight + n0 * 2 + lane);
        float* to = h + (m0 + g) * IN + (n0 & ~31);
#pragma unroll
        for (int j = 0; j < J; j++)
#pragma unroll
            for (int i = 0; i < 4; i++) {
                float2* at = (float2*)(to + 8 * i * IN + (((n0 & 31) + 8 * j + 2 * t) ^ s));
                float2 x = keeps<F>() ? kept_at((const float2*)slopes + kept_pair<4 * J>(tile, i * J + j)) : *at;
                float2 d_x = {sum[i / 2][j][i % 2 * 2], sum[i / 2][j][i % 2 * 2 + 1]};
                x.x = F == NO_FUNCTION ? d_x.x : rounded(d_x.x * (keeps<F>() ? x.x : slope<F>(x.x)));
                x.y = F == NO_FUNCTION ? d_x.y : rounded(d_x.y * (keeps<F>() ? x.y : slope<F>(x.y)));
                *at = x;
            }
    }
}

// Adds h^T d and the column sums of d to this block's gradient, or stores them if it is the first. A warp's tile is
// 16 I x 32.
template <int R, int I, int IN, int OUT>
DEVICE void gather_tiles(const float* h, const float* d, float* of_weight, float* of_bias, bool first) {
    int lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3, s = t << 3;
    for (int tile = threadIdx.x >> 5; tile < IN / (16 * I) * (OUT / 32); tile += WARPS) {
        int strip = tile / (OUT / 32) * I, column = tile % (OUT / 32);
        float4* to = (float4*)of_weight + (strip * (OUT / 32) + column) * 128 + lane;
        float sum[I][4][4] = {}, sum_of_rows[4] = {};
        if (!first)
#pragma unroll
            for (int i = 0; i < I; i++)
#pragma unroll
                for (int j = 0; j < 4; j++) {
                    float4 old = to[i * (OUT / 32) * 128 + j * 32];
                    sum[i][j][0] = old.x, sum[i][j][1] = old.y, sum[i][j][2] = old.z, sum[i][j][3] = old.w;
                }
        const float* h_row = h + t * IN + (strip * 16 & ~31);
        const float* d_row = d + t * OUT + column * 32;
#pragma unroll 2
        for (int r0 = 0; r0 < R; r0 += 8) {
            float a[I][4], b[4][2];
#pragma unroll
            for (int i = 0; i < I; i++) {
                // Strips begin at a multiple of 32: I is even.
                int m = 16 * i + g, at = r0 * IN + (m & ~31);
                a[i][0] = h_row[at + ((m & 31) ^ s)], a[i][1] = h_row[at + ((m & 31) + 8 ^ s)];
                a[i][2] = h_row[at + 4 * IN + ((m & 31) ^ s ^ 4)], a[i][3] = h_row[at + 4 * IN + ((m & 31) + 8 ^ s ^ 4)];
            }
#pragma unroll
            for (int j = 0; j < 4; j++) {
                int n = 8 * j + g ^ s;
                b[j][0] = d_row[r0 * OUT + n], b[j][1] = d_row[(r0 + 4) * OUT + (n ^ 4)];
                sum_of_rows[j] += b[j][0] + b[j][1];
            }
            multiply<I, 4>(sum, a, b);
        }
#pragma unroll
        for (int i = 0; i < I; i++)
#pragma unroll
            for (int j = 0; j < 4; j++) {
                float4 now = {sum[i][j][0], sum[i][j][1], sum[i][j][2], sum[i][j][3]};
                to[i * (OUT / 32) * 128 + j * 32] = now;
            }
        if (strip == 0)
#pragma unroll
            for (int j = 0; j < 4; j++) {
                float x = sum_of_four(sum_of_rows[j]);
                float* at = of_bias + column * 32 + 8 * j + g;
                if (t == 0) *at = first ? x : *at + x;
            }
    }
}

// Wide tiles where there are enough of them for all warps.
template <int R, int IN, int OUT>
DEVICE void gather_gradient(const float* h, const float* d, float* of_weight, float* of_bias, bool first) {
    constexpr int I = IN % 64 == 0 && IN / 64 * (OUT / 32) >= WARPS ? 4 : 2;
    gather_tiles<R, I, IN, OUT>(h, d, of_weight, of_bias, first);
}

// Number c of row r, which begins at `row`.
DEVICE float get(const Number* row, int r, int c) { return row[c ^ swizzle(r)]; }
// Numbers c and c + 1, of which c is even.
DEVICE void set_pair(Number* row, int r, int c, float x, float y) {
    float2 pair = {rounded(x), rounded(y)};
    *(float2*)(row + (c ^ swizzle(r))) = pair;
}

// What a network gives, and the floats behind the layers' rows.
template <int R> DEVICE float* outputs_begin(const Net& net, Number* pool) { return pool + R * net.place[net.layers]; }
template <int R> DEVICE float* behind(const Net& net, Number* pool) { return pool + R * net.end; }

// A row of what a network gives, and of the derivatives by it, which take its place.
struct Outputs {
    float* row;
    int s;
    METHOD float get(int c) const { return row[c ^ s]; }
    METHOD void set(int c, float x) const { row[c ^ s] = rounded(x); }
};
template <int R> DEVICE Outputs outputs_of(const Net& net, Number* pool, int r) {
    return {outputs_begin<R>(net, pool) + r * net.apart[net.layers], swizzle(r)};
}
