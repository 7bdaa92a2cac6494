//! A program's text to machine code, from the cache if it was compiled before.

use std::sync::Arc;

use super::ahead;
use super::cache::Cache;
use super::error::CudaError;
use super::nvrtc::{Image, Nvrtc};

/// A program in CUDA C++ whose kernels are `extern "C"`. It includes no headers: none are needed where it runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    /// Name in messages; letters, digits, `_` and `-`.
    pub name: String,
    /// The text.
    pub text: String,
    /// Options of NVRTC besides the architecture, for example `--use_fast_math` or `--maxrregcount=128`.
    pub options: Vec<String>,
    /// Numbers of arrays that the text declares (`__device__ float name[length]`), by name. They are copied in when the
    /// program is loaded, so programs that differ only in these numbers are compiled once.
    pub tables: Vec<(String, Arc<[f32]>)>,
}

impl Program {
    /// A program of this name and text, without options and tables.
    pub fn new(name: impl Into<String>, text: impl Into<String>) -> Self {
        Self { name: name.into(), text: text.into(), options: Vec::new(), tables: Vec::new() }
    }

    /// Adds one option.
    #[must_use]
    pub fn option(mut self, option: impl Into<String>) -> Self {
        self.options.push(option.into());
        self
    }

    /// Adds the numbers of one array.
    #[must_use]
    pub fn table(mut self, name: impl Into<String>, numbers: impl Into<Arc<[f32]>>) -> Self {
        self.tables.push((name.into(), numbers.into()));
        self
    }
}

/// A compiled program and where it came from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Compiled {
    /// Code and the compiler's words.
    pub image: Image,
    /// Whether the cache had it.
    pub cached: bool,
}

/// Name of the program in the cache: a hash of the text, the options, the architecture and the compiler's version. With it
/// the architecture.
///
/// # Errors
/// [`CudaError::Compile`] if the compiler is older than the GPU and knows no PTX for it.
pub(super) fn identity(
    nvrtc: &Nvrtc,
    program: &Program,
    capability: (i32, i32),
) -> Result<(String, String), CudaError> {
    let (major, minor) = nvrtc.version;
    let Some(architecture) = nvrtc.architecture(capability) else {
        return Err(CudaError::Compile {
            program: program.name.clone(),
            architecture: format!("compute capability {}.{}", capability.0, capability.1),
            log: format!("NVRTC {major}.{minor} knows no GPU that old"),
        });
    };
    let options = program.options.join("\n");
    // Another compiler makes other code of the same text.
    let version = format!("{major}.{minor}");
    Ok((Cache::key(&[&program.name, &program.text, &options, &architecture, &version]), architecture))
}

/// Compiles `program` for a GPU of this compute capability, or takes it from `cache`, or waits for a thread that is compiling
/// it. A cache that cannot be written is no error: the program is compiled at the next start again.
///
/// # Errors
/// [`CudaError::Compile`], also if the compiler is older than the GPU and knows no PTX for it.
pub fn compile(
    nvrtc: &Nvrtc,
    program: &Program,
    capability: (i32, i32),
    cache: Option<&Cache>,
) -> Result<Compiled, CudaError> {
    let (key, architecture) = identity(nvrtc, program, capability)?;
    ahead::once(&key, || make(nvrtc, program, (&key, &architecture), cache))
}

/// As [`compile`], on the calling thread. `key` and `architecture`: of [`identity`].
pub(super) fn make(
    nvrtc: &Nvrtc,
    program: &Program,
    (key, architecture): (&str, &str),
    cache: Option<&Cache>,
) -> Result<Compiled, CudaError> {
    if let Some(image) = cache.and_then(|cache| cache.read(key)) {
        return Ok(Compiled { image, cached: true });
    }
    let image = nvrtc.compile(&program.name, &program.text, architecture, &program.options)?;
    if let Some(cache) = cache {
        let _ = cache.write(key, &image);
    }
    Ok(Compiled { image, cached: false })
}
