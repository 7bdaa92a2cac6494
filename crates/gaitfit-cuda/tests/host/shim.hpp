// Stands in for what CUDA has built in, so that kernels run on the CPU as plain C++: one block after the other, its
// threads as fibers that take turns at barriers.
#pragma once
#include <math.h>
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <ucontext.h>

#include <functional>
#include <vector>

#define GAITFIT_HOST 1
#define KERNEL extern "C" void
#define BOUNDED_KERNEL KERNEL
#define DEVICE static inline
#define METHOD inline
#define POOL(name) float* name = host_pool
#define __shared__ static
#define __device__
#define __global__
#define __launch_bounds__(...)

struct Dim {
    unsigned x, y, z;
};
static Dim threadIdx, blockIdx, blockDim, gridDim;
static float* host_pool;

// A barrier of `alive` threads.
struct Barrier {
    unsigned alive, arrived, generation;
    void leave() {
        alive--;
        if (alive > 0 && arrived == alive) arrived = 0, generation++;
    }
};

// A context starts a fiber; later switches are jumps, which need no system calls.
struct Fiber {
    ucontext_t context;
    jmp_buf place;
    std::vector<char> stack;
    bool started, done;
};
static std::vector<Fiber> fibers;
static jmp_buf scheduler;
static unsigned current;
static Barrier of_block, of_group[16];
static std::vector<Barrier> of_warp;
static std::function<void()> body;

static void yield() {
    if (!_setjmp(fibers[current].place)) _longjmp(scheduler, 1);
}
static void resume() {
    Fiber& fiber = fibers[current];
    if (_setjmp(scheduler)) return;
    if (fiber.started) _longjmp(fiber.place, 1);
    fiber.started = true;
    setcontext(&fiber.context);
}

static void wait_at(Barrier& barrier) {
    unsigned generation = barrier.generation;
    if (++barrier.arrived == barrier.alive) {
        barrier.arrived = 0;
        barrier.generation++;
        return;
    }
    while (barrier.generation == generation) yield();
}

static void __syncthreads() { wait_at(of_block); }
static void group_barrier(int number, unsigned threads) {
    of_group[number].alive = threads;
    wait_at(of_group[number]);
}
static void warp_barrier() { wait_at(of_warp[current / 32]); }

static void enter() {
    body();
    fibers[current].done = true;
    of_block.leave();
    of_warp[current / 32].leave();
    yield();
}

static void run_block(unsigned threads) {
    if (fibers.size() < threads) fibers.resize(threads);
    of_block = {threads, 0, 0};
    of_warp.assign((threads + 31) / 32, Barrier{32, 0, 0});
    if (threads % 32) of_warp.back().alive = threads % 32;
    for (unsigned i = 0; i < threads; i++) {
        Fiber& fiber = fibers[i];
        fiber.stack.resize(1 << 16);
        fiber.started = fiber.done = false;
        getcontext(&fiber.context);
        fiber.context.uc_stack.ss_sp = fiber.stack.data();
        fiber.context.uc_stack.ss_size = fiber.stack.size();
        fiber.context.uc_link = nullptr;
        makecontext(&fiber.context, enter, 0);
    }
    for (bool left = true; left;) {
        left = false;
        for (current = 0; current < threads; current++) {
            if (fibers[current].done) continue;
            left = true;
            threadIdx = {current % blockDim.x, current / blockDim.x % blockDim.y, current / blockDim.x / blockDim.y};
            resume();
        }
    }
}

// Starts a kernel: `call` is what each thread does.
static void run(Dim grid, Dim block, size_t shared, std::function<void()> call) {
    gridDim = grid, blockDim = block, body = call;
    std::vector<float> pool(shared / sizeof(float) + 1);
    host_pool = pool.data();
    for (unsigned z = 0; z < grid.z; z++)
        for (unsigned y = 0; y < grid.y; y++)
            for (unsigned x = 0; x < grid.x; x++) {
                blockIdx = {x, y, z};
                // What a block leaves in shared memory says nothing to the next.
                memset(host_pool, 0xFF, pool.size() * sizeof(float));
                run_block(block.x * block.y * block.z);
            }
}

// A pointer to any type.
struct Any {
    void* pointer;
    template <class T> operator T*() const { return (T*)pointer; }
};

template <class T> static T atomicExch(T* at, T value) {
    T old = *at;
    *at = value;
    return old;
}
template <class T> static T atomicAdd(T* at, T value) {
    T old = *at;
    *at = old + value;
    return old;
}
static void __threadfence() {}
template <class T> static T atomicMin(T* at, T value) {
    T old = *at;
    if (value < old) *at = value;
    return old;
}

struct float2 {
    float x, y;
};
struct float4 {
    float x, y, z, w;
};
struct uint4 {
    unsigned x, y, z, w;
};
#define __expf expf
template <class T> static T kept_at(const T* at) { return *at; }
static inline float __shfl_xor_sync(unsigned, float x, unsigned mask) {
    static float all[32][32];
    unsigned warp = current / 32, lane = current % 32;
    all[warp][lane] = x;
    warp_barrier();
    float y = all[warp][lane ^ mask];
    warp_barrier();
    return y;
}

static unsigned bits_of(float x) {
    unsigned bits;
    memcpy(&bits, &x, 4);
    return bits;
}
static float float_of(unsigned bits) {
    float x;
    memcpy(&x, &bits, 4);
    return x;
}
static inline float truncate_tf32(float x) { return float_of(bits_of(x) & 0xFFFFE000u); }
static inline float round_tf32(float x) { return x - x == 0.0f ? float_of((bits_of(x) + 0x1000u) & 0xFFFFE000u) : x; }

// PTX's mma.m16n8k8 of TF32: the units ignore the last 13 bits of a factor.
static inline void mma(float (&sum)[4], const float (&a)[4], const float (&b)[2]) {
    static float all_a[32][32][4], all_b[32][32][2];
    unsigned warp = current / 32, lane = current % 32, g = lane / 4, t = lane % 4;
    for (int e = 0; e < 4; e++) all_a[warp][lane][e] = truncate_tf32(a[e]);
    for (int e = 0; e < 2; e++) all_b[warp][lane][e] = truncate_tf32(b[e]);
    warp_barrier();
    for (unsigned e = 0; e < 4; e++) {
        unsigned row = g + 8 * (e / 2), column = 2 * t + e % 2;
        double total = sum[e];
        for (unsigned k = 0; k < 8; k++)
            total += (double)all_a[warp][row % 8 * 4 + k % 4][row / 8 + 2 * (k / 4)] *
                     all_b[warp][column * 4 + k % 4][k / 4];
        sum[e] = (float)total;
    }
    warp_barrier();
}

// To 8 significant bits, ties to even; the first number in the lower half.
static inline float __uint_as_float(unsigned bits) { return float_of(bits); }
static inline unsigned round_bf16(float x) {
    unsigned bits = bits_of(x);
    return x == x ? (bits + 0x7FFFu + (bits >> 16 & 1u)) >> 16 : 0x7FFFu;
}
static inline unsigned pair_of(float low, float high) { return round_bf16(low) | round_bf16(high) << 16; }

// PTX's mma.m16n8k16 of bf16.
static inline void mma(float (&sum)[4], const unsigned (&a)[4], const unsigned (&b)[2]) {
    static unsigned all_a[32][32][4], all_b[32][32][2];
    unsigned warp = current / 32, lane = current % 32, g = lane / 4, t = lane % 4;
    memcpy(all_a[warp][lane], a, sizeof a);
    memcpy(all_b[warp][lane], b, sizeof b);
    warp_barrier();
    for (unsigned e = 0; e < 4; e++) {
        unsigned row = g + 8 * (e / 2), column = 2 * t + e % 2;
        double total = sum[e];
        for (unsigned k = 0; k < 16; k++) {
            unsigned of_a = all_a[warp][row % 8 * 4 + k % 8 / 2][row / 8 + 2 * (k / 8)];
            unsigned of_b = all_b[warp][column * 4 + k % 8 / 2][k / 8];
            unsigned shift = k % 2 * 16;
            total += (double)float_of(of_a >> shift << 16) * float_of(of_b >> shift << 16);
        }
        sum[e] = (float)total;
    }
    warp_barrier();
}

// PTX's ldmatrix.x4.
template <bool TURNED> static void load_squares(unsigned (&to)[4], const unsigned short* row) {
    static const unsigned short* all[32][32];
    unsigned warp = current / 32, lane = current % 32, g = lane / 4, t = lane % 4;
    all[warp][lane] = row;
    warp_barrier();
    for (unsigned i = 0; i < 4; i++) {
        unsigned pair[2];
        for (unsigned e = 0; e < 2; e++)
            pair[e] = TURNED ? all[warp][8 * i + 2 * t + e][g] : all[warp][8 * i + g][2 * t + e];
        to[i] = pair[0] | pair[1] << 16;
    }
    warp_barrier();
}

// Reads a file into an array, if it is there.
static void load(const char* path, std::vector<char>& bytes) {
    FILE* file = fopen(path, "rb");
    if (!file) return;
    size_t count = fread(bytes.data(), 1, bytes.size(), file);
    if (count != bytes.size() || fgetc(file) != EOF) {
        fprintf(stderr, "%s is of another size\n", path);
        exit(1);
    }
    fclose(file);
}
// Fills a table that the text declares.
static void fill(const char* path, float* table, size_t size) {
    std::vector<char> bytes(size);
    load(path, bytes);
    memcpy(table, bytes.data(), size);
}
static void store(const char* path, const std::vector<char>& bytes) {
    FILE* file = fopen(path, "wb");
    if (!file || fwrite(bytes.data(), 1, bytes.size(), file) != bytes.size() || fclose(file)) exit(1);
}
