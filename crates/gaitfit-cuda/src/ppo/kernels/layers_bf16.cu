// One layer at a time, forth and back, for some samples in shared memory, in bf16.
//
// Products are done by the matrix units on numbers of 8 significant bits (bf16), their sums are f32. What a network gives
// at its end is f32 too; layers' outputs and derivatives are rounded.
//
// Rows in shared memory are 8 numbers further apart than they are long (a multiple of 16): then 8 rows one below the other
// meet no bank twice. The units' instruction loads squares of 8 x 8 numbers as they lie or transposed.

typedef unsigned short Number;

#ifndef GAITFIT_HOST
// Two numbers rounded, the first in the lower half; a NaN stays one.
DEVICE u32 pair_of(float low, float high) {
    u32 bits;
    asm("cvt.rn.bf16x2.f32 %0, %1, %2;" : "=r"(bits) : "f"(high), "f"(low));
    return bits;
}
// Two kept derivatives, once: caches need not hold them.
DEVICE u32 kept_at(const u32* at) {
    u32 pair;
    asm volatile("ld.global.cs.u32 %0, [%1];" : "=r"(pair) : "l"(__cvta_generic_to_global(at)) : "memory");
    return pair;
}
// sum += a b for a warp: 16 x 16 by 16 x 8, laid out as PTX's mma.m16n8k16 has it.
DEVICE void mma(float (&sum)[4], const u32 (&a)[4], const u32 (&b)[2]) {
    asm volatile(
        "mma.sync.aligned.m16n8k16.row.col.f32.bf16.bf16.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, {%0,%1,%2,%3};"
        : "+f"(sum[0]), "+f"(sum[1]), "+f"(sum[2]), "+f"(sum[3])
        : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b[0]), "r"(b[1]));
}
// Four squares of 8 x 8 numbers: thread 8 i + r of a warp says where row r of square i lies. Thread 4 g + t gets numbers
// 2 t and 2 t + 1 of row g of each; of column g if they are TURNED.
template <bool TURNED> DEVICE void load_squares(u32 (&to)[4], const Number* row) {
    u32 from = (u32)__cvta_generic_to_shared(row);
    if (TURNED)
        asm volatile("ldmatrix.sync.aligned.m8n8.x4.trans.shared.b16 {%0,%1,%2,%3}, [%4];"
                     : "=r"(to[0]), "=r"(to[1]), "=r"(to[2]), "=r"(to[3])
                     : "r"(from)
                     : "memory");
    else
        asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3}, [%4];"
                     : "=r"(to[0]), "=r"(to[1]), "=r"(to[2]), "=r"(to[3])
                     : "r"(from)
                     : "memory");
}
#endif

DEVICE float low_of(u32 pair) { return __uint_as_float(pair << 16); }
DEVICE float high_of(u32 pair) { return __uint_as_float(pair & 0xFFFF0000u); }
DEVICE Number rounded(float x) { return (Number)pair_of(x, 0.0f); }

// A warp's tile: I x 16 rows and J x 8 columns.
struct Tile {
    int i, j;
};
// The tile that makes up `rows` x `columns` at the least cost: rounds of `warps` warps, times a round's products and loads.
__device__ constexpr Tile tile_for(int rows, int columns, int warps) {
    Tile best = {1, 2};
    int least = 0;
    for (int i = 1; i <= 4; i++)
        for (int j = 2; j <= 4; j += 2) {
            // More sums than 12 x 4 a thread do not fit into its registers.
            if (rows % (16 * i) != 0 || columns % (8 * j) != 0 || i * j > 12) continue;
            int tiles = rows / (16 * i) * (columns / (8 * j));
            int cost = (tiles + warps - 1) / warps * (24 * i * j + 64 * i + 32 * j);
            if (least == 0 || cost < least) least = cost, best = {i, j};
        }
    return best;
}

// sum += a b for 16 I x 16 by 16 x 8 J.
template <int I, int J> DEVICE void multiply(float (&sum)[I][J][4], const u32 (&a)[I][4], const u32 (&b)[J][2]) {
#pragma unroll
    for (int i = 0; i < I; i++)
#pragma unroll
        for (int j = 0; j < J; j++) mma(sum[i][j], a[i], b[j]);
}

// The next weights of a product, as the matrix units take them: 8 J of COLUMNS columns.
#define AHEAD 2
template <int J, int STEPS, int COLUMNS> struct Weights {
    const uint4* fragments;
    uint4 next[AHEAD][J / 2];
    // From this thread's first part on.
    METHOD void begin(const float* __restrict__ weight, int column) {
        fragments = (const uint4*)weight + column * 2 + (threadIdx.x & 31);
#pragma unroll
        for (int step = 0; step < AHEAD; step++) load(step, step < STEPS ? step : 0);
    }
    METHOD void load(int place, int step) {
#pragma unroll
        for (int part = 0; part < J / 2; part++) next[place][part] = fragments[step * 2 * COLUMNS + part * 32];
    }
    METHOD void take(u32 (&b)[J][2], int step) {
#pragma unroll
        for (int part = 0; part < J / 2; part++) {
            uint4 x = next[0][part];
            b[2 * part][0] = x.x, b[2 * part][1] = x.y, b[2 * part + 1][0] = x.z, b[2 * part + 1][1] = x.w;
        }
#pragma unroll
        for (int k = 0; k + 1 < AHEAD; k++)
#pragma unroll
            for (int part = 0; part < J / 2; part++) next[k][part] = next[k + 1][part];
        if (step + AHEAD < STEPS) load(AHEAD - 1, step + AHEAD);
    }
};

// sum += rows W for 16 I rows, which are `apart` numbers apart, and 8 J columns.
template <int I, int J, int STEPS, int COLUMNS>
DEVICE void product(float (&sum)[I][J][4], Weights<J, STEPS, COLUMNS>& weights, const Number* rows, int apart) {
    const Number* from = rows + (threadIdx.x & 15) * apart + (threadIdx.x >> 4 & 1) * 8;
#pragma unroll(STEPS <= 16 ? STEPS : 4)
    for (int step = 0; step < STEPS; step++) {
        u32 a[I][4], b[J][2];
        weights.take(b, step);
#pragma unroll
        for (int i = 0; i < I; i++) load_squares<false>(a[i], from + 16 * i * apart + 16 * step);
        multiply<I, J>(sum, a, b);
    }
}

// Waits for the group, then out = f(h W + b); of the last layer h W + b goes to `floats`, and zeros to `out`.
// `slopes`: where f' goes, if it is KEPT.
template <int R, int K, int IN, int OUT, int F, bool KEPT>
DEVICE void forward(
    const Number* h, Number* out, float* floats, const float* __restrict__ weight, const float* __restrict__ bias,
    bool last, Number* slopes
) {
    using G = Group<R>;
    constexpr Tile TILE_OF = tile_for(G::ROWS_OF, OUT, G::WARPS_OF);
    constexpr int I = TILE_OF.i, J = TILE_OF.j, COUNT = OUT / (8 * J), APART = OUT + 8;
    constexpr int TILES = G::ROWS_OF / (16 * I) * COUNT;
    int lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3;
    for (int first = 0; first < TILES; first += G::WARPS_OF) {
        int tile = first + (G::thread() >> 5);
        int m0 = G::first_row() + tile / COUNT * 16 * I, n0 = tile % COUNT * 8 * J;
        float sum[I][J][4];
        Weights<J, K / 16, OUT> weights;
        // Before the wait, which is then not for these too.
        if (tile < TILES) {
            weights.begin(weight, n0);
#pragma unroll
            for (int j = 0; j < J; j++) {
                float2 shift = *(const float2*)(bias + n0 + 8 * j + 2 * t);
#pragma unroll
                for (int i = 0; i < I; i++)
                    sum[i][j][0] = sum[i][j][2] = shift.x, sum[i][j][1] = sum[i][j][3] = shift.y;
            }
        }
        if (first == 0) G::sync();
        if (tile >= TILES) continue;
        product(sum, weights, h + m0 * (IN + 8), IN + 8);
        int at = (m0 + g) * APART + n0 + 2 * t;
        if (last) {
#pragma unroll
            for (int i = 0; i < 2 * I; i++)
#pragma unroll
                for (int j = 0; j < J; j++) {
                    float2 x = {sum[i / 2][j][i % 2 * 2], sum[i / 2][j][i % 2 * 2 + 1]};
                    *(float2*)(floats + at + 8 * i * APART + 8 * j) = x;
                    *(u32*)(out + at + 8 * i * APART + 8 * j) = 0;
                }
            continue;
        }
#pragma unroll
        for (int i = 0; i < 2 * I; i++)
#pragma unroll
            for (int j = 0; j < J; j++) {
                float x = sum[i / 2][j][i % 2 * 2], y = sum[i / 2][j][i % 2 * 2 + 1];
                if (KEPT) {
                    float of_x, of_y;
                    x = activate<F>(x, of_x), y = activate<F>(y, of_y);
                    int place = kept_pair<2 * I * J>(G::number() * TILES + tile, i * J + j);
                    ((u32*)slopes)[place] = pair_of(of_x, of_y);
                } else {
                    x = activate<F>(x), y = activate<F>(y);
                }
                *(u32*)(out + at + 8 * i * APART + 8 * j) = pair_of(x, y);
            }
    }
}

// h = (d W^T) f'(h), or without f' where h is no function's result. Waits for the block before h changes.
// `slopes`: f' where it was kept.
template <int R, int K, int IN, int OUT, int F>
DEVICE void backward(Number* h, const Number* d, const float* __restrict__ weight, const Number* slopes) {
    using G = Group<R>;
    constexpr Tile TILE_OF = tile_for(G::ROWS_OF, IN, G::WARPS_OF);
    constexpr int I = TILE_OF.i, J = TILE_OF.j, COUNT = IN / (8 * J), APART = IN + 8;
    constexpr int TILES = G::ROWS_OF / (16 * I) * COUNT;
    int lane = threadIdx.x & 31, g = lane >> 2, t = lane & 3;
    for (int first = 0; first < TILES; first += G::WARPS_OF) {
        int tile = first + (G::thread() >> 5);
        int m0 = G::first_row() + tile / COUNT * 16 * I, n0 = tile % COUNT * 8 * J;
        float sum[I][J][4] = {};
        if (tile < TILES) {
            Weights<J, K / 16, IN> weights;
            weights.begin(weight, n0);
            product(sum, weights, d + m0 * (OUT + 8), OUT + 8);
        }
        if (first == 0) __syncthreads();
        if (tile >= TILES) continue;
        Number* to = h + (m0 + g) * APART + n0 + 2 * t;
#pragma unroll
        for (int i = 0; i < 2 * I; i++)
#pragma unroll
            for (int j = 0; j < J; j++) {
                u32* at = (u32*)(to + 8 * i * APART + 8 * j);
                float2 d_x = {sum[i / 2][j][i % 2 * 2], sum[i / 2][j][i % 2 * 2 + 1]};
                if (keeps<F>()) {
                    int place = kept_pair<2 * I * J>(G::number() * TILES + tile, i * J + j);
                    u32 kept = kept_at((const u32*)slopes + place);
                    d_x.x *= low_of(kept), d_x.y *= high_of(kept);
                } else if (F != NO_FUNCTION) {
                    d_x.x *= slope<F>(low_of(*at)), d_x.y *= slope<F>(high_of(*at));
                }
                *at = pair_of(d_x.x, d_x.y);
            }
    }
}

// Adds h^T d and the column sums of d to this block's gradient, or stores them if it is the first, for R rows.
template <int R, int IN, int OUT>
DEVICE void gather_gradient(const Number* h, const Number* d, float* of_weight, float* of_bias, bool first) {
    constexpr Tile TILE_OF = tile_for(IN, OUT, WARPS);
    constexpr int I = TILE_OF.i, J = TILE_OF.j, STRIPS = IN / (16 * I), COUNT = OUT / (8 * J);
    const u32 ones[4] = {0x3F803F80u, 0x3F803F80u, 0x3F803F80u, 0x3F803F80u};
    int lane = threadIdx.x & 31, t = lane & 3;
    for (int tile = threadIdx.x >> 5; tile < STRIPS * COUNT; tile += WARPS) {
        int strip = tile / COUNT, n0 = tile % COUNT * 8 * J;
        // Squares of 16 x 8, of which the upper and the lower half are 64 numbers each.
        float2* to = (float2*)of_weight + (strip * I * (OUT / 8) + n0 / 8) * 64 + lane;
        float sum[I][J][4] = {}, sum_of_rows[J][4] = {};
        if (!first)
#pragma unroll
            for (int i = 0; i < I; i++)
#pragma unroll
                for (int j = 0; j < J; j++) {
                    const float2* old = to + (i * (OUT / 8) + j) * 64;
                    float2 upper = old[0], lower = old[32];
                    sum[i][j][0] = upper.x, sum[i][j][1] = upper.y, sum[i][j][2] = lower.x, sum[i][j][3] = lower.y;
                }
        const Number* h_row = h + ((lane & 7) + (lane >> 4) * 8) * (IN + 8) + strip * 16 * I + (lane >> 3 & 1) * 8;
        const Number* d_row = d + (lane & 15) * (OUT + 8) + n0 + (lane >> 4) * 8;
#pragma unroll 2
        for (int r0 = 0; r0 < R; r0 += 16) {
            u32 a[I][4], b[J][2];
#pragma unroll
            for (int i = 0; i < I; i++) load_squares<true>(a[i], h_row + r0 * (IN + 8) + 16 * i);
#pragma unroll
            for (int j = 0; j < J; j += 2) {
                u32 both[4];
                load_squares<true>(both, d_row + r0 * (OUT + 8) + 8 * j);
                b[j][0] = both[0], b[j][1] = both[1], b[j + 1][0] = both[2], b[j + 1][1] = both[3];
            }
            multiply<I, J>(sum, a, b);
            // Each strip's warps sum up some of the columns.
#pragma unroll
            for (int j = 0; j < J; j++)
                if (j % STRIPS == strip) mma(sum_of_rows[j], ones, b[j]);
        }
#pragma unroll
        for (int i = 0; i < I; i++)
#pragma unroll
            for (int j = 0; j < J; j++) {
                float2 *now = to + (i * (OUT / 8) + j) * 64, upper = {sum[i][j][0], sum[i][j][1]};
                float2 lower = {sum[i][j][2], sum[i][j][3]};
                now[0] = upper, now[32] = lower;
            }
#pragma unroll
        for (int j = 0; j < J; j++)
            if (j % STRIPS == strip && lane < 4) {
                float2 *at = (float2*)(of_bias + n0 + 8 * j + 2 * t), x = {sum_of_rows[j][0], sum_of_rows[j][1]};
                if (!first) x.x += at->x, x.y += at->y;
                *at = x;
            }
    }
}

// Number c of row r, which begins at `row`.
DEVICE float get(const Number* row, int r, int c) { return low_of(row[c]); }
// Numbers c and c + 1, of which c is even.
DEVICE void set_pair(Number* row, int r, int c, float x, float y) { *(u32*)(row + c) = pair_of(x, y); }

// What a network gives, and the floats behind it.
template <int R> DEVICE float* outputs_begin(const Net& net, Number* pool) { return (float*)(pool + R * net.end); }
template <int R> DEVICE float* behind(const Net& net, Number* pool) {
    return outputs_begin<R>(net, pool) + R * net.apart[net.layers];
}

// A row of what a network gives, and of the derivatives by it.
struct Outputs {
    const float* row;
    Number* derivatives;
    METHOD float get(int c) const { return row[c]; }
    METHOD void set(int c, float x) const { derivatives[c] = rounded(x); }
};
template <int R> DEVICE Outputs outputs_of(const Net& net, Number* pool, int r) {
    int place = r * net.apart[net.layers];
    return {outputs_begin<R>(net, pool) + place, pool + R * net.place[net.layers] + place};
}
