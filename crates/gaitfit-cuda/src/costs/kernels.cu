// What costs are made of: Wasserstein distances of pooled samples, and sums of squared differences.
//
// `signals` is candidates x recordings x samples x dimensions. Of each recording the samples from `skip` to its entry of
// `ends` (candidates x recordings) count. The text is also compiled as C++ for a test without a GPU.

typedef unsigned int u32;
typedef unsigned long long u64;
#ifndef GAITFIT_HOST
#define KERNEL extern "C" __global__ void
#define DEVICE __device__ __forceinline__
#define POOL(name) extern __shared__ float name[]
DEVICE u32 bits_of(float x) { return __float_as_uint(x); }
DEVICE float float_of(u32 bits) { return __uint_as_float(bits); }
#endif

// Integers in the order of the numbers: the sign bit is set for positive ones, all bits are flipped for negative ones.
DEVICE u32 key_of(float x) {
    u32 bits = bits_of(x);
    return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
}
DEVICE float value_of(u32 key) { return float_of(key & 0x80000000u ? key & 0x7FFFFFFFu : ~key); }

// Sorts `size` keys, a power of two, with all threads of the block (Batcher 1968, bitonic).
DEVICE void sort(u32* keys, u32 size) {
    for (u32 run = 2; run <= size; run *= 2)
        // All are powers of two: `low` is pair / apart * 2 * apart + pair % apart.
        for (u32 apart = run / 2; apart > 0; apart /= 2) {
            __syncthreads();
            for (u32 pair = threadIdx.x; pair < size / 2; pair += blockDim.x) {
                u32 low = pair + (pair & ~(apart - 1)), high = low + apart;
                u32 a = keys[low], b = keys[high];
                bool up = (low & run) == 0;
                if ((a > b) == up) keys[low] = b, keys[high] = a;
            }
        }
    __syncthreads();
}

// Sum over the block's threads, a power of two of them, in a fixed order.
DEVICE double block_sum(double x) {
    __shared__ double sums[1024];
    __syncthreads();
    sums[threadIdx.x] = x;
    __syncthreads();
    for (u32 half = blockDim.x / 2; half > 0; half /= 2) {
        if (threadIdx.x < half) sums[threadIdx.x] += sums[threadIdx.x + half];
        __syncthreads();
    }
    return sums[0];
}

// One block a candidate (x) and dimension (y): the Wasserstein-1 distance of its samples from the robot's.
// `reference`: each dimension's samples ascending, `of_reference` numbers each. `size`: a power of two, at least the
// samples of a candidate. `scratch`: blocks x size where the keys do not fit into shared memory, as `outside` says.
// `distance`: candidates x dimensions; not a number if a sample is none, or if there are no samples.
KERNEL wasserstein(
    u32 recordings, u32 samples, u32 dimensions, u32 skip, const float* signals, const u32* ends, const double* reference,
    u32 of_reference, u32 size, u32 outside, u32* scratch, double* distance
) {
    POOL(pool);
    __shared__ u32 faulty;
    u32 candidate = blockIdx.x, dimension = blockIdx.y;
    u32* keys = outside ? scratch + ((u64)candidate * gridDim.y + dimension) * size : (u32*)pool;
    if (threadIdx.x == 0) faulty = 0;
    __syncthreads();
    signals += (u64)candidate * recordings * samples * dimensions + dimension;
    u64 count = 0;
    for (u32 r = 0; r < recordings; r++) {
        u32 end = ends[candidate * recordings + r];
        end = end < samples ? end : samples;
        count += end > skip ? end - skip : 0;
    }
    for (u32 i = threadIdx.x; i < size; i += blockDim.x) {
        u32 key = 0xFFFFFFFFu, r = i / samples, s = i % samples;
        if (r < recordings && s >= skip && s < ends[candidate * recordings + r]) {
            float x = signals[(u64)i * dimensions];
            if (!(x - x == 0.0f)) atomicExch(&faulty, 1u);
            key = key_of(x);
        }
        keys[i] = key;
    }
    sort(keys, size);
    // Both inverse distribution functions over t in 0 .. count x of_reference: step i of the candidate's ends at
    // (i + 1) of_reference, step j of the robot's at (j + 1) count.
    const double* b = reference + (u64)dimension * of_reference;
    u64 n = count, m = of_reference;
    double sum = 0.0;
    for (u64 i = threadIdx.x; i < n; i += blockDim.x) {
        double a = value_of(keys[i]);
        u64 from = i * m, to = from + m;
        for (u64 j = from / n; j * n < to; j++) {
            u64 begin = j * n < from ? from : j * n, end = (j + 1) * n < to ? (j + 1) * n : to;
            sum += (double)(end - begin) * fabs(a - b[j]);
        }
    }
    sum = block_sum(sum);
    if (threadIdx.x == 0) {
        double none = 0.0;
        distance[candidate * dimensions + dimension] = faulty ? none / none : sum / ((double)n * (double)m);
    }
}

// A thread a candidate, recording and dimension: the sum of squared differences from the robot's samples, in their order.
// `measured` is recordings x samples x dimensions, `squares` candidates x recordings x dimensions.
KERNEL squared_differences(
    u32 candidates, u32 recordings, u32 samples, u32 dimensions, u32 skip, const float* signals, const u32* ends,
    const double* measured, double* squares
) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= candidates * recordings * dimensions) return;
    u32 dimension = i % dimensions, run = i / dimensions, end = ends[run];
    end = end < samples ? end : samples;
    const float* x = signals + (u64)run * samples * dimensions + dimension;
    const double* y = measured + (u64)(run % recordings) * samples * dimensions + dimension;
    double sum = 0.0;
#pragma unroll 8
    for (u32 s = skip; s < end; s++) {
        double difference = (double)x[(u64)s * dimensions] - y[(u64)s * dimensions];
        sum += difference * difference;
    }
    squares[i] = sum;
}

// A thread a candidate and dimension: the sums of all recordings together, in their order. `squares` as above, `sums`
// candidates x dimensions.
KERNEL sum_recordings(u32 candidates, u32 recordings, u32 dimensions, const double* squares, double* sums) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= candidates * dimensions) return;
    const double* own = squares + (u64)(i / dimensions) * recordings * dimensions + i % dimensions;
    double sum = 0.0;
    for (u32 r = 0; r < recordings; r++) sum += own[(u64)r * dimensions];
    sums[i] = sum;
}
