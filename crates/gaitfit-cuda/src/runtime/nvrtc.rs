//! NVIDIA's run-time compiler: its library found, its functions called.

use std::ffi::{CStr, CString, c_char, c_int};
use std::path::PathBuf;
use std::ptr::{null, null_mut};
use std::sync::OnceLock;

use libloading::Library;

use super::driver::Handle;
use super::error::CudaError;
use super::search;
use super::table::functions;

functions! {
    /// Functions of the compiler that this crate uses (names and signatures of `nvrtc.h`).
    Functions {
        version = "nvrtcVersion"(*mut c_int, *mut c_int);
        architecture_count = "nvrtcGetNumSupportedArchs"(*mut c_int);
        architectures = "nvrtcGetSupportedArchs"(*mut c_int);
        create = "nvrtcCreateProgram"(
            *mut Handle, *const c_char, *const c_char, c_int, *const *const c_char, *const *const c_char,
        );
        destroy = "nvrtcDestroyProgram"(*mut Handle);
        compile = "nvrtcCompileProgram"(Handle, c_int, *const *const c_char);
        log_size = "nvrtcGetProgramLogSize"(Handle, *mut usize);
        log = "nvrtcGetProgramLog"(Handle, *mut c_char);
        cubin_size = "nvrtcGetCUBINSize"(Handle, *mut usize);
        cubin = "nvrtcGetCUBIN"(Handle, *mut c_char);
        ptx_size = "nvrtcGetPTXSize"(Handle, *mut usize);
        ptx = "nvrtcGetPTX"(Handle, *mut c_char);
    }
}

/// Lines of the compiler's words in an error.
const MAX_LINES: usize = 20;

/// The compiler's library.
pub struct Nvrtc {
    functions: Functions,
    /// Kept loaded as long as the compiler is.
    _builtins: Vec<Library>,
    /// Where it was found: a path, or the name that the loader knew.
    pub path: PathBuf,
    /// Version, for example (13, 0).
    pub version: (i32, i32),
    /// Compute capabilities that it compiles for, times ten: 90 is 9.0.
    pub architectures: Vec<i32>,
}

/// A compiled program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Machine code (cubin), or PTX where the compiler does not know the architecture.
    pub code: Vec<u8>,
    /// The compiler's words: warnings, and registers and spills if the options ask for them.
    pub log: String,
}

impl Nvrtc {
    /// The compiler of this machine; looked for once, see [`search`] for the places.
    ///
    /// # Errors
    /// [`CudaError::NoNvrtc`] with the places looked at, or [`CudaError::OldNvrtc`].
    pub fn get() -> Result<&'static Self, CudaError> {
        static NVRTC: OnceLock<Result<Nvrtc, CudaError>> = OnceLock::new();
        NVRTC
            .get_or_init(|| Self::first_of(&search::candidates(&search::Places::of_process())))
            .as_ref()
            .map_err(Clone::clone)
    }

    /// The first of these libraries that loads.
    ///
    /// # Errors
    /// As [`Nvrtc::get`].
    pub fn first_of(candidates: &[PathBuf]) -> Result<Self, CudaError> {
        let mut fault = None;
        for path in candidates {
            // The compiler loads a second library by its bare name, which the system's loader does not find beside
            // it in a wheel. Loaded before, it is found.
            let builtins: Vec<Library> = search::builtins(path)
                .iter()
                // SAFETY: as below.
                .filter_map(|path| unsafe { Library::new(path) }.ok())
                .collect();
            // SAFETY: loading NVIDIA's compiler runs its own initialisers only.
            let Ok(library) = (unsafe { Library::new(path) }) else { continue };
            match Functions::load(library) {
                Ok(functions) => return Self::with(functions, builtins, path.clone()),
                Err(function) => {
                    let path = path.display().to_string();
                    // Too old, but a later candidate may do; the fault is told only if none does.
                    fault.get_or_insert(CudaError::OldNvrtc { path, function });
                }
            }
        }
        let names: Vec<String> = candidates.iter().map(|path| path.display().to_string()).collect();
        Err(fault.unwrap_or(CudaError::NoNvrtc { searched: names.join(", ") }))
    }

    fn with(functions: Functions, builtins: Vec<Library>, path: PathBuf) -> Result<Self, CudaError> {
        let (mut major, mut minor, mut count) = (0, 0, 0);
        // SAFETY: both take pointers to ints that live through the call.
        let codes = unsafe {
            [
                (functions.version)(&raw mut major, &raw mut minor),
                (functions.architecture_count)(&raw mut count),
            ]
        };
        let mut architectures = vec![0; usize::try_from(count).unwrap_or(0)];
        // SAFETY: the array has as many ints as the library said it would store.
        let code = unsafe { (functions.architectures)(architectures.as_mut_ptr()) };
        if codes != [0, 0] || code != 0 {
            let doing = format!("asking {} for its version", path.display());
            return Err(CudaError::Call { doing, reason: format!("NVRTC error {codes:?} {code}") });
        }
        Ok(Self { functions, _builtins: builtins, path, version: (major, minor), architectures })
    }

    /// The option that names the architecture for a GPU of this compute capability: machine code of exactly it, or of
    /// an older PTX that the driver compiles on. None if the compiler knows neither.
    pub fn architecture(&self, (major, minor): (i32, i32)) -> Option<String> {
        let version = major * 10 + minor;
        if self.architectures.contains(&version) {
            return Some(format!("sm_{version}"));
        }
        self.architectures
            .iter()
            .filter(|&&known| known < version)
            .max()
            .map(|known| format!("compute_{known}"))
    }

    /// Compiles `text` for `architecture`, `sm_90` or `compute_90`.
    ///
    /// # Errors
    /// [`CudaError::Compile`] with the compiler's words.
    pub fn compile(
        &self,
        program: &str,
        text: &str,
        architecture: &str,
        options: &[String],
    ) -> Result<Image, CudaError> {
        let refuse = |log: String| CudaError::Compile {
            program: program.to_owned(),
            architecture: architecture.to_owned(),
            log,
        };
        let with_zero = |text: String| {
            CString::new(text).map_err(|_| refuse("its text or an option holds a 0 character".into()))
        };
        let source = with_zero(text.to_owned())?;
        let name = with_zero(format!("{program}.cu"))?;
        let mut strings = vec![with_zero(format!("--gpu-architecture={architecture}"))?];
        for option in options {
            strings.push(with_zero(option.clone())?);
        }
        let pointers: Vec<*const c_char> = strings.iter().map(|option| option.as_ptr()).collect();
        let mut running = Running { functions: &self.functions, handle: null_mut() };
        // SAFETY: both strings end with 0 and outlive the program; there are no headers.
        let code = unsafe {
            (self.functions.create)(
                &raw mut running.handle,
                source.as_ptr(),
                name.as_ptr(),
                0,
                null(),
                null(),
            )
        };
        if code != 0 {
            return Err(refuse(format!("NVRTC error {code}")));
        }
        // SAFETY: the program was made above; there are as many options as pointers.
        let code =
            unsafe { (self.functions.compile)(running.handle, pointers.len() as c_int, pointers.as_ptr()) };
        // Read in any case: it holds the errors, or the warnings of a program that compiles.
        let log = running.read(self.functions.log_size, self.functions.log).map_err(&refuse)?;
        let log = CStr::from_bytes_until_nul(&log).unwrap_or_default().to_string_lossy().trim().to_owned();
        if code != 0 {
            // One fault may bring hundreds of lines.
            let lines: Vec<&str> = log.lines().take(MAX_LINES).collect();
            return Err(refuse(if log.is_empty() {
                format!("NVRTC error {code}")
            } else {
                lines.join("\n")
            }));
        }
        // `sm_` asks for machine code of one GPU, `compute_` for PTX, which the driver compiles.
        let (size, read) = if architecture.starts_with("sm_") {
            (self.functions.cubin_size, self.functions.cubin)
        } else {
            (self.functions.ptx_size, self.functions.ptx)
        };
        let code = running.read(size, read).map_err(&refuse)?;
        if code.is_empty() {
            return Err(refuse("the compiler gave no code".into()));
        }
        Ok(Image { code, log })
    }
}

/// A program of the compiler, destroyed with this.
struct Running<'a> {
    functions: &'a Functions,
    handle: Handle,
}

impl Running<'_> {
    /// Reads what the compiler offers by a size and a copy.
    fn read(
        &self,
        size_of: unsafe extern "system" fn(Handle, *mut usize) -> c_int,
        copy: unsafe extern "system" fn(Handle, *mut c_char) -> c_int,
    ) -> Result<Vec<u8>, String> {
        let mut size = 0;
        // SAFETY: the program is alive, the size a local number.
        let code = unsafe { size_of(self.handle, &raw mut size) };
        let mut bytes = vec![0u8; size];
        // SAFETY: there is room for as many bytes as the compiler said.
        let code = if code == 0 { unsafe { copy(self.handle, bytes.as_mut_ptr().cast()) } } else { code };
        if code == 0 { Ok(bytes) } else { Err(format!("NVRTC error {code}")) }
    }
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        if !self.handle.is_null() {
            // SAFETY: made by this library and destroyed once; a failure here leaves nothing to do.
            unsafe { (self.functions.destroy)(&raw mut self.handle) };
        }
    }
}
