// The words that a generated control period is written in.
typedef float R;
#define K(x) (x)
#define FMA(a, b, c) fmaf(a, b, c)
#define MIN(a, b) fminf(a, b)
#define MAX(a, b) fmaxf(a, b)
#define ABS(a) fabsf(a)
#define SELECT(a, b, x, y) ((a) < (b) ? (x) : (y))
#define ROUND(a) rintf(a)
// The outputs of a function that is called at many places.
struct Four {
  R n0, n1, n2, n3;
};
#define FUNCTION(name) __device__ __noinline__ Four name(R i0, R i1, R i2)
// An entry of a table; 0 beyond its end.
#define GATHER(table, at) gather(table, sizeof(table) / 4, (int)(at))
__device__ __forceinline__ float gather(const float* table, unsigned length, int at) {
  return (unsigned)at < length ? table[at] : 0.f;
}
__device__ __forceinline__ float RECIP(float x) {
  float y;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}
__device__ __forceinline__ float SQRT(float x) {
  float y;
  asm("sqrt.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}
#define DIV(a, b) ((a) * RECIP(b))
// Sine and cosine to 1e-7 for angles up to some hundred turns: reduced by multiples of pi/2 in three parts
// (Cody, Waite), then the minimax polynomials of the Cephes library (Moshier).
__device__ __forceinline__ void SINCOS(float x, float& sine, float& cosine) {
  float k = fmaf(x, 0.636619772f, 12582912.f);
  const int quarter = __float_as_int(k);
  k -= 12582912.f;
  float y = fmaf(-k, 1.5703125f, x);
  y = fmaf(-k, 4.837512969970703e-4f, y);
  y = fmaf(-k, 7.549789954891882e-8f, y);
  const float z = y * y;
  float s = fmaf(z, -1.9515295891e-4f, 8.3321608736e-3f);
  s = fmaf(z, s, -1.6666654611e-1f);
  s = fmaf(s * z, y, y);
  float c = fmaf(z, 2.443315711809948e-5f, -1.388731625493765e-3f);
  c = fmaf(z, c, 4.166664568298827e-2f);
  c = fmaf(c * z, z, fmaf(z, -0.5f, 1.f));
  const float a = (quarter & 1) ? c : s, b = (quarter & 1) ? s : c;
  sine = __int_as_float(__float_as_int(a) ^ ((quarter << 30) & 0x80000000));
  cosine = __int_as_float(__float_as_int(b) ^ (((quarter + 1) << 30) & 0x80000000));
}
// As the processor's lanes have it: Lambert's continued fraction of tanh(x/2), cut at x^7/x^6.
__device__ __forceinline__ float TANH(float v) {
  const float x = fminf(fmaxf(v, -9.f), 9.f) * 0.5f;
  const float s = x * x;
  const float n = fmaf(fmaf(s + 378.f, s, 17325.f), s, 135135.f) * x;
  const float d = fmaf(fmaf(fmaf(28.f, s, 3150.f), s, 62370.f), s, 135135.f);
  return (2.f * n * d) * RECIP(fmaf(n, n, d * d));
}
// Over the lanes of an environment.
__device__ __forceinline__ float LANE_SUM(float x) {
  if (LANES >= 2) x += __shfl_xor_sync(0xffffffffu, x, 1);
  if (LANES >= 4) x += __shfl_xor_sync(0xffffffffu, x, 2);
  return x;
}
__device__ __forceinline__ float LANE_MAX(float x) {
  if (LANES >= 2) x = fmaxf(x, __shfl_xor_sync(0xffffffffu, x, 1));
  if (LANES >= 4) x = fmaxf(x, __shfl_xor_sync(0xffffffffu, x, 2));
  return x;
}
__device__ __forceinline__ float LANE_MIN(float x) {
  if (LANES >= 2) x = fminf(x, __shfl_xor_sync(0xffffffffu, x, 1));
  if (LANES >= 4) x = fminf(x, __shfl_xor_sync(0xffffffffu, x, 2));
  return x;
}
// Whether some thread of the warp needs a guarded region.
#define UNLESS(a, b) (__any_sync(0xffffffffu, !((a) >= (b))) != 0)
// A number that the compiler is not to keep in a register from one turn of a loop to the next: what stays the same
// would be spilled.
#define FRESH(pointer) asm volatile("" : "+l"(pointer));
#define FRESH_TABLE asm volatile("" : "+r"(table_at));
__device__ __forceinline__ float from_shared(unsigned at) {
  float x;
  asm("ld.shared.f32 %0, [%1];" : "=f"(x) : "r"(at));
  return x;
}
// What one guarded region hands to another, in memory of the thread's own.
#define SCRATCH(count)                                                                             \
  float scratch_room[count];                                                                       \
  const size_t scratch_at = __cvta_generic_to_local(scratch_room);
template <int K> __device__ __forceinline__ float get(size_t at) {
  float x;
  asm volatile("ld.local.f32 %0, [%1+%2];" : "=f"(x) : "l"(at), "n"(4 * K));
  return x;
}
template <int K> __device__ __forceinline__ void put(size_t at, float x) {
  asm volatile("st.local.f32 [%0+%1], %2;" : : "l"(at), "n"(4 * K), "f"(x));
}
#define GET(k) get<k>(scratch_at)
#define PUT(k, x) put<k>(scratch_at, x);
#define ONCE _Pragma("unroll 1")
#define KERNEL(name)                                                                               \
  extern "C" __global__ void __launch_bounds__(BLOCK, 1) name(                                        \
      float* __restrict__ state, const float* __restrict__ params, float* __restrict__ targets,       \
      float* __restrict__ memory, const float* __restrict__ weights, float* __restrict__ report,      \
      const float* __restrict__ disturbance, int per_candidate)
#define BEGIN                                                                                      \
  const int thread = blockIdx.x * BLOCK + threadIdx.x;                                             \
  const int tile = thread / 32, in_tile = thread % 32, lane = in_tile % LANES, in_env = in_tile / LANES; \
  (void)lane; (void)in_env; (void)per_candidate;
#define PLACE(type, class, base, own, size)                                                        \
  type* class##_own = base + (size_t)tile * (size) + in_tile;                                      \
  type* class##_all = base + (size_t)tile * (size) + (own) * 32 + in_env;                          \
  (void)class##_own; (void)class##_all;
// The same place among the numbers of the next physics step.
#define NEXT(class, size)                                                                          \
  class##_own += (size_t)gridDim.x * (BLOCK / 32) * (size);                                        \
  class##_all += (size_t)gridDim.x * (BLOCK / 32) * (size);
#define PLACE_WEIGHTS(own, size)                                                                   \
  const float* w_own = weights + (size_t)((tile * (32 / LANES) + in_env) / per_candidate) * (size) + lane; \
  const float* w_all = w_own - lane + (own) * LANES;                                               \
  (void)w_own; (void)w_all;
#define PLACE_TABLE(rows)                                                                          \
  __shared__ float table_rows[(rows) * LANES];                                                     \
  for (int k = threadIdx.x; k < (rows) * LANES; k += BLOCK) table_rows[k] = table_values[k];       \
  __syncthreads();                                                                                 \
  unsigned table_at = (unsigned)__cvta_generic_to_shared(table_rows) + 4 * lane;
#define HELD_OWN(class, k) class##_own[(k) * 32]
#define HELD_ALL(class, k) class##_all[(k) * (32 / LANES)]
#define GIVEN_OWN(class, k) __ldg(class##_own + (k) * 32)
#define GIVEN_ALL(class, k) __ldg(class##_all + (k) * (32 / LANES))
#define WEIGHT_OWN(k) __ldg(w_own + (k) * LANES)
#define WEIGHT_ALL(k) __ldg(w_all + (k))
#define ROW(k) from_shared(table_at + (k) * LANES * 4)
#define KEEP_OWN(class, k, x) class##_own[(k) * 32] = x;
#define KEEP_ALL(class, k, x) if (lane == 0) class##_all[(k) * (32 / LANES)] = x;
