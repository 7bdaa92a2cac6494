// What costs are made of: Wasserstein distances of pooled samples, and sums of squared differences.
//
// The host defines ITEMS before this text. If it is above 0, a block sorts its keys in shared memory, ITEMS (an odd number) a thread.
// If it is 0, a block sorts them in global memory.
// `signals` is candidates x recordings x samples x dimensions. Of each recording the samples from `skip` to its entry of
// `ends` (candidates x recordings) count. The text is also compiled as C++ for a test without a GPU.

typedef unsigned int u32;
typedef unsigned long long u64;
// Threads of a block of `wasserstein`, at most.
#define THREADS 512
#ifndef GAITFIT_HOST
#define KERNEL extern "C" __global__ void
#define BOUNDED_KERNEL extern "C" __global__ void __launch_bounds__(THREADS, 1)
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

// A stable radix sort, four bits a pass: the 16 counts of every thread fit into shared memory.
#define RADIX 16
#if ITEMS > 0
typedef unsigned short Count;
#else
typedef u32 Count;
#endif

// Where a count is. The padding spreads threads that read RADIX neighbours each over the banks.
DEVICE u32 padded(u32 count) { return count + count / RADIX; }

// Where the keys of this thread with the same digit as `key` are counted.
DEVICE u32 own_count(u32 key, u32 shift) { return padded((key >> shift) % RADIX * blockDim.x + threadIdx.x); }

// Turns counts, of every thread for every digit, digit after digit, into the places where their keys begin.
DEVICE void prefix_sums(Count* counts) {
    __shared__ u32 totals[THREADS];
    u32 first = threadIdx.x * RADIX, total = 0;
    for (u32 k = 0; k < RADIX; k++) total += counts[padded(first + k)];
    totals[threadIdx.x] = total;
    __syncthreads();
    for (u32 apart = 1; apart < blockDim.x; apart *= 2) {
        u32 before = threadIdx.x >= apart ? totals[threadIdx.x - apart] : 0;
        __syncthreads();
        totals[threadIdx.x] += before;
        __syncthreads();
    }
    u32 from = totals[threadIdx.x] - total;
    for (u32 k = 0; k < RADIX; k++) {
        u32 count = counts[padded(first + k)];
        counts[padded(first + k)] = (Count)from;
        from += count;
    }
    __syncthreads();
}

// Sorts keys with all threads of the block, digit by digit from the lowest: keys of the same digit stay in their order. Each thread
// handles a contiguous run of keys. `counts`: room for 17 counts a thread (16 digits, one of padding).
#if ITEMS > 0
// `keys`: ITEMS a thread, in shared memory. A thread reads all of its own before any is moved.
DEVICE void sort(u32* keys, u32, Count* counts) {
    u32 own[ITEMS];
    for (u32 shift = 0; shift < 32; shift += 4) {
        for (u32 digit = 0; digit < RADIX; digit++) counts[padded(digit * blockDim.x + threadIdx.x)] = 0;
#pragma unroll
        for (u32 k = 0; k < ITEMS; k++) {
            own[k] = keys[threadIdx.x * ITEMS + k];
            counts[own_count(own[k], shift)]++;
        }
        __syncthreads();
        prefix_sums(counts);
#pragma unroll
        for (u32 k = 0; k < ITEMS; k++) keys[counts[own_count(own[k], shift)]++] = own[k];
        __syncthreads();
    }
}
#else
// `keys`: twice `size`; they move from one half to the other and back.
DEVICE void sort(u32* keys, u32 size, Count* counts) {
    u32 each = (size + blockDim.x - 1) / blockDim.x;
    u32 first = threadIdx.x * each < size ? threadIdx.x * each : size;
    u32 last = first + each < size ? first + each : size;
    for (u32 shift = 0; shift < 32; shift += 4) {
        const u32* __restrict__ from = keys + (shift % 8 ? size : 0);
        u32* __restrict__ to = keys + (shift % 8 ? 0 : size);
        for (u32 digit = 0; digit < RADIX; digit++) counts[padded(digit * blockDim.x + threadIdx.x)] = 0;
#pragma unroll 8
        for (u32 i = first; i < last; i++) counts[own_count(from[i], shift)]++;
        __syncthreads();
        prefix_sums(counts);
#pragma unroll 8
        for (u32 i = first; i < last; i++) {
            u32 key = from[i];
            to[counts[own_count(key, shift)]++] = key;
        }
        __syncthreads();
    }
}
#endif

// Sum over the block's threads, a power of two of them, in a fixed order.
DEVICE double block_sum(double x) {
    __shared__ double sums[THREADS];
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
// `reference`: each dimension's samples ascending, `of_reference` numbers each. `scratch`: blocks x 2 x keys where the keys,
// one for each sample, do not fit into shared memory.
// `distance`: candidates x dimensions; NaN if a sample is not finite, or if there are no samples.
BOUNDED_KERNEL wasserstein(
    u32 recordings, u32 samples, u32 dimensions, u32 skip, const float* signals, const u32* ends, const double* reference,
    u32 of_reference, u32* scratch, double* distance
) {
    POOL(pool);
    __shared__ u32 faulty;
    u32 candidate = blockIdx.x, dimension = blockIdx.y, size = recordings * samples;
    Count* counts = (Count*)pool;
#if ITEMS > 0
    u32 room = ITEMS * blockDim.x;
    u32* keys = (u32*)(counts + padded(RADIX * blockDim.x));
#else
    u32 room = size;
    u32* keys = scratch + ((u64)candidate * gridDim.y + dimension) * 2 * size;
#endif
    if (threadIdx.x == 0) faulty = 0;
    __syncthreads();
    signals += (u64)candidate * recordings * samples * dimensions + dimension;
    u64 count = 0;
    for (u32 r = 0; r < recordings; r++) {
        u32 end = ends[candidate * recordings + r];
        end = end < samples ? end : samples;
        count += end > skip ? end - skip : 0;
    }
    for (u32 i = threadIdx.x; i < room; i += blockDim.x) {
        u32 key = 0xFFFFFFFFu, r = i / samples, s = i % samples;
        if (i < size && s >= skip && s < ends[candidate * recordings + r]) {
            float x = signals[(u64)i * dimensions];
            if (!(x - x == 0.0f)) atomicExch(&faulty, 1u);
            key = key_of(x);
        }
        keys[i] = key;
    }
    __syncthreads();
    sort(keys, size, counts);
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
