// What the kernels of the update and of rollouts share. The text is also compiled as C++ for a test without a GPU, which
// defines GAITFIT_HOST and stands in for what CUDA has built in.

typedef unsigned int u32;
typedef unsigned long long u64;

#ifndef GAITFIT_HOST
#define KERNEL extern "C" __global__ void
#define DEVICE __device__ __forceinline__
#define METHOD __device__ __forceinline__
// Shared memory that the launch gives.
#define POOL(name) extern __shared__ __align__(16) float name[]
// Waits for `threads` threads of the block that wait at barrier `number`, 1 .. 15.
DEVICE void group_barrier(int number, int threads) {
    asm volatile("bar.sync %0, %1;" ::"r"(number), "r"(threads) : "memory");
}
#endif

// Philox 4x32 with ten rounds (Salmon et al. 2011), as gaitfit-random has it.
DEVICE void philox(u32 counter[4], u32 key0, u32 key1) {
    u32 c0 = counter[0], c1 = counter[1], c2 = counter[2], c3 = counter[3];
    for (int round = 0; round < 10; round++) {
        u64 product0 = (u64)0xD2511F53u * c0, product1 = (u64)0xCD9E8D57u * c2;
        u32 high0 = (u32)(product0 >> 32), high1 = (u32)(product1 >> 32);
        c0 = high1 ^ c1 ^ key0;
        c1 = (u32)product1;
        c2 = high0 ^ c3 ^ key1;
        c3 = (u32)product0;
        key0 += 0x9E3779B9u;
        key1 += 0xBB67AE85u;
    }
    counter[0] = c0, counter[1] = c1, counter[2] = c2, counter[3] = c3;
}

// Sum over a block of up to 1024 threads, in a fixed order; every thread gets it.
DEVICE double block_sum(double x) {
    __shared__ double sums[1024];
    __syncthreads();
    sums[threadIdx.x] = x;
    __syncthreads();
    for (u32 half = 512; half > 0; half /= 2) {
        if (threadIdx.x < half && threadIdx.x + half < blockDim.x) sums[threadIdx.x] += sums[threadIdx.x + half];
        __syncthreads();
    }
    return sums[0];
}

DEVICE bool is_finite(double x) { return x - x == 0.0; }
