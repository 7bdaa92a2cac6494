// Running mean and variance of observations. `statistics`: mean of each element, then variance of each, then the count.

// Factor and offset of each element: 1/sqrt(variance + 0.01) and -mean times it; or 1 and 0 without statistics.
KERNEL scale_of(u32 width, u32 present, const double* statistics, float* scale) {
    u32 c = blockIdx.x * blockDim.x + threadIdx.x;
    if (c >= width) return;
    double factor = present ? 1.0 / sqrt(statistics[width + c] + 1e-2) : 1.0;
    scale[c] = (float)factor;
    scale[width + c] = present ? (float)(-statistics[c] * factor) : 0.0f;
}

// Mean and sum of squared differences of each element over `chunk` rows a block; `parts` is blocks x 2 x width.
KERNEL statistics_of(u32 rows, u32 width, u32 chunk, const float* observation, double* parts) {
    u32 from = blockIdx.x * chunk, to = from + chunk < rows ? from + chunk : rows;
    double* own = parts + (u64)blockIdx.x * 2 * width;
    for (u32 c = threadIdx.x; c < width; c += blockDim.x) {
        double sum = 0.0, squares = 0.0;
        for (u32 r = from; r < to; r++) sum += observation[(u64)r * width + c];
        double mean = sum / (to - from);
        for (u32 r = from; r < to; r++) {
            double difference = observation[(u64)r * width + c] - mean;
            squares += difference * difference;
        }
        own[c] = mean;
        own[width + c] = squares;
    }
}

// Joins the statistics of column `c` of parts of `chunk` rows, in order.
DEVICE void join_parts(
    u32 rows, u32 width, u32 chunk, u32 blocks, const double* parts, u32 c, double& mean, double& squares, double& count
) {
    mean = 0.0, squares = 0.0, count = 0.0;
    for (u32 b = 0; b < blocks; b++) {
        double other = b + 1 < blocks ? chunk : rows - (blocks - 1) * chunk, total = count + other;
        double delta = parts[(u64)b * 2 * width + c] - mean;
        mean += delta * (other / total);
        squares += parts[((u64)b * 2 + 1) * width + c] + delta * delta * count * (other / total);
        count = total;
    }
}

// The same of all columns, for the other GPUs: `share` is 2 x width. One block.
KERNEL statistics_share(u32 rows, u32 width, u32 chunk, u32 blocks, const double* parts, double* share) {
    double count;
    for (u32 c = threadIdx.x; c < width; c += blockDim.x)
        join_parts(rows, width, chunk, blocks, parts, c, share[c], share[width + c], count);
}

// Joins the blocks' statistics in order, then joins them to the running ones (Chan, Golub, LeVeque 1979). One block.
KERNEL statistics_join(
    u32 rows, u32 width, u32 chunk, u32 blocks, const double* parts, const double* state, double* statistics
) {
    double old_count = statistics[2 * width];
    // All have read the count before it changes.
    __syncthreads();
    if (state[FAULT] != 0.0) return;
    for (u32 c = threadIdx.x; c < width; c += blockDim.x) {
        double mean, squares, count;
        join_parts(rows, width, chunk, blocks, parts, c, mean, squares, count);
        double total = old_count + count, share = old_count / total, other_share = count / total;
        double delta = mean - statistics[c];
        statistics[c] += delta * other_share;
        statistics[width + c] = statistics[width + c] * share + squares / count * other_share
            + delta * delta * share * other_share;
    }
    if (threadIdx.x == 0) statistics[2 * width] = old_count + rows;
}

// Both networks' factors and offsets one after the other.
KERNEL join_scales(u32 size, u32 critic_size, const float* actor, const float* critic, float* scale) {
    u32 i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < size) scale[i] = actor[i];
    else if (i < size + critic_size) scale[i] = critic[i - size];
}
