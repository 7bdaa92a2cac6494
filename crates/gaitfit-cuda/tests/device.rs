//! The runtime on a GPU.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_cuda::runtime::{Buffer, CudaError, Device, Event, Program, Shape, Stream, find};

const TEXT: &str = r#"
extern "C" __global__ void twice(float* x, unsigned n) {
    unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < n) x[i] *= 2.0f;
}
extern "C" __global__ void wild(float* x) {
    x[1ull << 40] = 1.0f;
}
extern "C" __global__ void roomy(float* out) {
    extern __shared__ float room[];
    room[threadIdx.x * 200] = threadIdx.x;
    __syncthreads();
    out[threadIdx.x] = room[(blockDim.x - 1 - threadIdx.x) * 200];
}
"#;

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_runs_kernels_graphs_and_says_what_failed() {
    let report = find();
    assert!(report.problems.is_empty() && !report.gpus.is_empty(), "{report:?}");
    let device = Device::open(0).unwrap();
    assert_eq!(report.gpus[0], *device.info());
    let module = device.load(&Program::new("test", TEXT)).unwrap();
    let stream = Stream::new(&device).unwrap();
    let twice = module.kernel("twice").unwrap();
    let numbers: Vec<f32> = (0..1000).map(|i| i as f32).collect();
    let mut x = Buffer::from_slice(&device, "x", &numbers).unwrap();
    twice.launch(&stream, Shape::cover(x.len(), 256), &[(&mut x).into(), 1000u32.into()]).unwrap();
    assert_eq!(x.read(&stream).unwrap()[999], 1998.0);
    let (start, end) = (Event::new(&device).unwrap(), Event::new(&device).unwrap());
    let work = |stream: &Stream| {
        for _ in 0..3 {
            twice.launch(stream, Shape::cover(1000, 256), &[(&x).into(), 1000u32.into()])?;
        }
        Ok(())
    };
    let mut graph = stream.record(work).unwrap();
    assert_eq!(x.read(&stream).unwrap()[1], 2.0, "recorded, not run");
    start.record(&stream).unwrap();
    graph.launch(&stream).unwrap();
    graph.launch(&stream).unwrap();
    end.record(&stream).unwrap();
    assert_eq!(x.read(&stream).unwrap()[1], 128.0);
    assert!(start.seconds_until(&end).unwrap() > 0.0);
    assert!(twice.registers().unwrap() > 0 && twice.local_bytes().unwrap() == 0);

    let roomy = module.kernel("roomy").unwrap();
    let shape = Shape { shared: 128 * 800, ..Shape::new(1, 128) };
    roomy.launch(&stream, shape, &[(&mut x).into()]).unwrap();
    assert_eq!(x.read(&stream).unwrap()[0], 127.0);
    let huge = Shape { shared: 10 << 20, ..shape };
    let error = roomy.launch(&stream, huge, &[(&mut x).into()]).unwrap_err();
    assert!(
        error.to_string().starts_with("kernel `roomy` could not be started: it needs 10485760 bytes"),
        "{error}"
    );

    assert!(matches!(module.kernel("none"), Err(CudaError::NoKernel { .. })));
    let error = Buffer::<f32>::new(&device, "too much", 1 << 42).map(|_| ()).unwrap_err();
    assert!(error.to_string().starts_with("`too much` needs 16.0 TiB of GPU 0's memory"), "{error}");
    assert!(matches!(Device::open(99).map(|_| ()), Err(CudaError::Ordinal { ordinal: 99, .. })));
}

/// Names the process that loses its context.
const WILD: &str = "GAITFIT_TEST_LOSES_ITS_CONTEXT";

/// A kernel that writes where nothing is. After it the process has lost its context, and all later tests would fail, so
/// another process runs it.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_names_the_kernel_that_lost_the_context() {
    if std::env::var_os(WILD).is_none() {
        let test = "device::gpu_names_the_kernel_that_lost_the_context";
        let mut other = std::process::Command::new(std::env::current_exe().unwrap());
        other.args(["--exact", test, "--include-ignored"]).env(WILD, "1");
        let output = other.output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && text.contains("1 passed"), "{text}");
        return;
    }
    let device = Device::open(0).unwrap();
    let module = device.load(&Program::new("test", TEXT)).unwrap();
    let stream = Stream::new(&device).unwrap();
    let mut x = Buffer::from_slice(&device, "x", &[0.0f32; 8]).unwrap();
    module.kernel("wild").unwrap().launch(&stream, Shape::new(1, 1), &[(&mut x).into()]).unwrap();
    let error = stream.wait().unwrap_err();
    assert!(error.to_string().contains("while running `wild`"), "{error}");
}
