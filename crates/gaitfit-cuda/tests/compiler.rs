//! The compiler, on machines that have it (no GPU is needed).
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_cuda::runtime::{Cache, CudaError, Nvrtc, Program, compile};

const TEXT: &str = "extern \"C\" __global__ void twice(float* x, unsigned n) {\n\
                    unsigned i = blockIdx.x * blockDim.x + threadIdx.x;\n\
                    if (i < n) x[i] *= 2.0f;\n}";

#[test]
#[ignore = "needs NVRTC: tools/setup_nvrtc.sh"]
fn nvrtc_compiles_once_and_says_registers() {
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::new(folder.path().join("cache"));
    let nvrtc = Nvrtc::get().unwrap();
    let program = Program::new("twice", TEXT).option("--ptxas-options=-v");
    let first = compile(nvrtc, &program, (9, 0), Some(&cache)).unwrap();
    assert!(!first.cached && first.image.code.starts_with(b"\x7fELF"));
    assert!(
        first.image.log.contains("registers") && first.image.log.contains("spill"),
        "{}",
        first.image.log
    );
    let second = compile(nvrtc, &program, (9, 0), Some(&cache)).unwrap();
    assert!(second.cached && second.image == first.image);
    let other = compile(nvrtc, &program.clone().option("--use_fast_math"), (9, 0), Some(&cache)).unwrap();
    assert!(!other.cached, "other options are another program");
    // A GPU newer than the compiler gets PTX, which its driver compiles on.
    let newer = compile(nvrtc, &program, (99, 0), Some(&cache)).unwrap();
    assert!(newer.image.code.windows(7).any(|text| text == b".target"));
}

#[test]
#[ignore = "needs NVRTC: tools/setup_nvrtc.sh"]
fn nvrtc_names_program_and_line_of_an_error() {
    let program = Program::new("broken", "extern \"C\" __global__ void f() {\n  missing();\n}");
    let error = compile(Nvrtc::get().unwrap(), &program, (9, 0), None).unwrap_err();
    let CudaError::Compile { program, architecture, log } = &error else { panic!("{error}") };
    assert_eq!((program.as_str(), architecture.as_str()), ("broken", "sm_90"));
    assert!(log.contains("broken.cu(2)") && log.contains("missing"), "{log}");
    let old = compile(Nvrtc::get().unwrap(), &Program::new("twice", TEXT), (2, 0), None).unwrap_err();
    assert!(old.to_string().contains("knows no GPU that old"), "{old}");
}
