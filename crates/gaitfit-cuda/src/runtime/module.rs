//! Loaded programs and their kernels.

use std::ffi::{CString, c_int, c_void};
use std::ptr::null_mut;
use std::sync::{Arc, OnceLock};

use super::compile::Compiled;
use super::device::{Context, Device};
use super::driver::Handle;
use super::error::CudaError;
use super::memory::{Buffer, Number};
use super::stream::Stream;

/// `CU_FUNC_ATTRIBUTE_…` of `cuda.h`.
const LOCAL_BYTES: c_int = 3;
const REGISTERS: c_int = 4;
const MAX_DYNAMIC_SHARED: c_int = 8;
/// Bytes that any kernel may take as arguments.
const MAX_ARGUMENT_BYTES: usize = 4096;
/// Bytes of shared memory that a kernel may use without asking: CUDA's limit, the same on all GPUs.
const SHARED_WITHOUT_ASKING: u32 = 48 << 10;

/// A program in a GPU, unloaded when it and its kernels are gone.
#[derive(Clone)]
pub struct Module {
    loaded: Arc<Loaded>,
}

struct Loaded {
    context: Arc<Context>,
    handle: Handle,
    name: String,
    log: String,
    cached: bool,
}

// SAFETY: the driver's functions for modules may be called from any thread.
unsafe impl Send for Loaded {}
// SAFETY: as above.
unsafe impl Sync for Loaded {}

impl Drop for Loaded {
    fn drop(&mut self) {
        if self.context.enter().is_ok() {
            // SAFETY: unloaded once, after its kernels: they hold it by `Arc`.
            unsafe { (self.context.driver.module_unload)(self.handle) };
        }
    }
}

impl Module {
    /// Loads a compiled program.
    ///
    /// # Errors
    /// [`CudaError::Load`].
    pub fn load(device: &Device, name: &str, compiled: Compiled) -> Result<Self, CudaError> {
        let context = device.context.clone();
        context.enter()?;
        let mut code = compiled.image.code;
        // PTX must end with 0; machine code knows its length.
        code.push(0);
        let mut handle = null_mut();
        // SAFETY: the driver reads an image that NVRTC made, whole (the cache checks it), and stores one handle.
        let result = unsafe { (context.driver.module_load)(&raw mut handle, code.as_ptr().cast()) };
        if result != 0 {
            return Err(CudaError::Load { program: name.to_owned(), reason: context.driver.reason(result) });
        }
        let (name, log, cached) = (name.to_owned(), compiled.image.log, compiled.cached);
        Ok(Self { loaded: Arc::new(Loaded { context, handle, name, log, cached }) })
    }

    /// Copies `numbers` into the array `name` that the text declares.
    ///
    /// # Errors
    /// [`CudaError::NoTable`] if there is no such array of that length; [`CudaError::Call`].
    pub(super) fn fill(&self, name: &str, numbers: &[f32]) -> Result<(), CudaError> {
        let missing = || CudaError::NoTable { program: self.loaded.name.clone(), table: name.to_owned() };
        let text = CString::new(name).map_err(|_| missing())?;
        let context = &self.loaded.context;
        context.enter()?;
        let (mut address, mut bytes) = (0, 0);
        // SAFETY: the module is alive, the name ends with 0, the driver stores one address and one size.
        let code = unsafe {
            (context.driver.module_global)(
                &raw mut address,
                &raw mut bytes,
                self.loaded.handle,
                text.as_ptr(),
            )
        };
        if code != 0 || bytes != size_of_val(numbers) {
            return Err(missing());
        }
        // SAFETY: both arrays have that many bytes; the call returns when `numbers` has been read.
        let code = unsafe { (context.driver.copy_now)(address, numbers.as_ptr().cast(), bytes) };
        context.driver.check(code, || format!("copying into `{name}`"))
    }

    /// The compiler's words.
    pub fn log(&self) -> &str {
        &self.loaded.log
    }

    /// Whether the program came from the cache.
    pub fn cached(&self) -> bool {
        self.loaded.cached
    }

    /// Kernels by their names, with these.
    ///
    /// # Errors
    /// [`CudaError::NoKernel`].
    pub fn kernels(&self, names: Vec<&'static str>) -> Result<Vec<(&'static str, Kernel)>, CudaError> {
        names.into_iter().map(|name| Ok((name, self.kernel(name)?))).collect()
    }

    /// A kernel by its name, `extern "C" __global__` in the text.
    ///
    /// # Errors
    /// [`CudaError::NoKernel`].
    pub fn kernel(&self, name: &str) -> Result<Kernel, CudaError> {
        let missing = || CudaError::NoKernel { program: self.loaded.name.clone(), kernel: name.to_owned() };
        let text = CString::new(name).map_err(|_| missing())?;
        let context = &self.loaded.context;
        context.enter()?;
        let mut handle = null_mut();
        // SAFETY: the module is alive, the name ends with 0, the driver stores one handle.
        let code =
            unsafe { (context.driver.module_function)(&raw mut handle, self.loaded.handle, text.as_ptr()) };
        if code != 0 {
            return Err(missing());
        }
        Ok(Kernel { module: self.loaded.clone(), handle, name: name.into() })
    }
}

/// A function that runs on the GPU.
#[derive(Clone)]
pub struct Kernel {
    module: Arc<Loaded>,
    handle: Handle,
    name: Arc<str>,
}

// SAFETY: the driver's functions for kernels may be called from any thread.
unsafe impl Send for Kernel {}
// SAFETY: as above.
unsafe impl Sync for Kernel {}

/// Number of threads that run a kernel, and their blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Blocks in x, y and z.
    pub grid: [u32; 3],
    /// Threads of a block in x, y and z.
    pub block: [u32; 3],
    /// Bytes of shared memory that the launch gives each block, besides what the text declares.
    pub shared: u32,
}

impl Shape {
    /// `blocks` blocks of `threads` threads.
    pub fn new(blocks: u32, threads: u32) -> Self {
        Self { grid: [blocks, 1, 1], block: [threads, 1, 1], shared: 0 }
    }

    /// At least `count` threads in blocks of `threads`.
    pub fn cover(count: usize, threads: u32) -> Self {
        Self::new(u32::try_from(count.div_ceil(threads.max(1) as usize)).unwrap_or(u32::MAX), threads)
    }
}

/// One argument of a kernel: its bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Argument {
    bytes: [u8; 8],
    size: usize,
}

impl Argument {
    fn from_bytes(bytes: &[u8]) -> Self {
        let mut argument = Self { bytes: [0; 8], size: bytes.len() };
        argument.bytes[..bytes.len()].copy_from_slice(bytes);
        argument
    }
}

macro_rules! arguments {
    ($($type:ty),*) => {
        $(impl From<$type> for Argument {
            fn from(value: $type) -> Self {
                Self::from_bytes(&value.to_ne_bytes())
            }
        })*
    };
}
arguments!(u32, i32, u64, i64, f32, f64);

/// A pointer to the buffer's first number.
impl<T: Number> From<&Buffer<T>> for Argument {
    fn from(buffer: &Buffer<T>) -> Self {
        Self::from_bytes(&buffer.address.to_ne_bytes())
    }
}

/// A pointer to the buffer's first number, which the kernel changes.
impl<T: Number> From<&mut Buffer<T>> for Argument {
    fn from(buffer: &mut Buffer<T>) -> Self {
        Self::from_bytes(&buffer.address.to_ne_bytes())
    }
}

impl Kernel {
    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    fn attribute(&self, which: c_int) -> Result<i32, CudaError> {
        let context = &self.module.context;
        context.enter()?;
        let mut value = 0;
        // SAFETY: the kernel is alive; the driver stores one int.
        let code = unsafe { (context.driver.function_attribute)(&raw mut value, which, self.handle) };
        context.driver.check(code, || format!("asking about kernel `{}`", self.name))?;
        Ok(value)
    }

    /// Registers of a thread.
    ///
    /// # Errors
    /// [`CudaError::Call`], as for the next ones.
    pub fn registers(&self) -> Result<i32, CudaError> {
        self.attribute(REGISTERS)
    }

    /// Bytes of local memory of a thread: spilled registers and arrays.
    ///
    /// # Errors
    /// As [`Kernel::registers`].
    pub fn local_bytes(&self) -> Result<i32, CudaError> {
        self.attribute(LOCAL_BYTES)
    }

    /// Blocks of this many threads and bytes of launched shared memory that one multiprocessor runs at once.
    ///
    /// # Errors
    /// As [`Kernel::registers`].
    pub fn blocks_per_processor(&self, threads: u32, shared: u32) -> Result<i32, CudaError> {
        self.allow_shared(shared)?;
        let context = &self.module.context;
        let mut blocks = 0;
        let threads = c_int::try_from(threads).unwrap_or(c_int::MAX);
        // SAFETY: the kernel is alive; the driver stores one int.
        let code = unsafe {
            (context.driver.blocks_per_processor)(&raw mut blocks, self.handle, threads, shared as usize)
        };
        context.driver.check(code, || format!("asking about kernel `{}`", self.name))?;
        Ok(blocks)
    }

    /// Raises the kernel's limit of shared memory where a launch asks for more than every kernel has.
    fn allow_shared(&self, bytes: u32) -> Result<(), CudaError> {
        let context = &self.module.context;
        context.enter()?;
        if bytes <= SHARED_WITHOUT_ASKING {
            return Ok(());
        }
        let max = context.info.shared_memory;
        let asked = c_int::try_from(bytes).unwrap_or(c_int::MAX);
        if asked > max {
            let reason = format!("it needs {bytes} bytes of shared memory a block, this GPU has {max}");
            return Err(CudaError::Launch { kernel: self.name.to_string(), reason });
        }
        // SAFETY: the kernel is alive.
        let code = unsafe { (context.driver.set_function_attribute)(self.handle, MAX_DYNAMIC_SHARED, asked) };
        context.driver.check(code, || format!("giving kernel `{}` shared memory", self.name))
    }

    /// Starts the kernel on a stream. The arguments are those of the text, in order and of the same sizes: the driver
    /// does not check it. Wrong ones spoil arrays of the GPU or end in an error of the GPU; the host's memory is safe.
    ///
    /// With `GAITFIT_CUDA_SYNC=1` it waits, so that an error names this kernel (not while a graph is recorded).
    ///
    /// # Errors
    /// [`CudaError::Launch`], naming the kernel.
    pub fn launch(&self, stream: &Stream, shape: Shape, arguments: &[Argument]) -> Result<(), CudaError> {
        // The driver refuses a grid without blocks, and there is nothing to compute.
        if shape.grid.contains(&0) {
            return Ok(());
        }
        self.allow_shared(shape.shared)?;
        let context = &self.module.context;
        let mut packed = Packed::new(arguments);
        let ([gx, gy, gz], [bx, by, bz]) = (shape.grid, shape.block);
        // SAFETY: the kernel and the stream are alive. The driver reads as many arguments as the kernel has from
        // pointers that `packed` holds for as many as any kernel may have, each to more bytes than any kernel takes.
        let code = unsafe {
            (context.driver.launch)(
                self.handle,
                gx,
                gy,
                gz,
                bx,
                by,
                bz,
                shape.shared,
                stream.handle(),
                packed.pointers.as_mut_ptr(),
                null_mut(),
            )
        };
        if code != 0 {
            let reason = format!(
                "{} (grid {:?}, block {:?}, {} bytes of shared memory)",
                context.driver.reason(code),
                shape.grid,
                shape.block,
                shape.shared
            );
            return Err(CudaError::Launch { kernel: self.name.to_string(), reason });
        }
        stream.started(&self.name);
        if wait_after_each() { stream.wait() } else { Ok(()) }
    }
}

/// Whether `GAITFIT_CUDA_SYNC` asks for a wait after every kernel.
fn wait_after_each() -> bool {
    static WAIT: OnceLock<bool> = OnceLock::new();
    *WAIT.get_or_init(|| std::env::var_os("GAITFIT_CUDA_SYNC").is_some_and(|value| value == "1"))
}

/// Arguments as the driver wants them: pointers to values. Both are longer than any kernel needs, so that a call with
/// too few or too small arguments reads zeros and not foreign memory.
struct Packed {
    pointers: Vec<*mut c_void>,
    /// The values that the pointers point to.
    _values: Vec<[u8; 8]>,
}

impl Packed {
    fn new(arguments: &[Argument]) -> Self {
        let spare = MAX_ARGUMENT_BYTES / 8 + 1;
        let mut values: Vec<[u8; 8]> = arguments.iter().map(|argument| argument.bytes).collect();
        values.resize(arguments.len() + spare, [0; 8]);
        let base = values.as_mut_ptr();
        let pointers = (0..arguments.len().max(MAX_ARGUMENT_BYTES))
            // SAFETY: each index is inside `values`.
            .map(|index| unsafe { base.add(index.min(arguments.len())) }.cast())
            .collect();
        Self { pointers, _values: values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_packed_in_order_with_room_behind() {
        let packed = Packed::new(&[7u32.into(), 2.5f32.into(), u64::MAX.into()]);
        let read = |index: usize| {
            // SAFETY: the pointers point into `packed`, which is alive.
            unsafe { *packed.pointers[index].cast::<[u8; 8]>() }
        };
        assert_eq!(read(0)[..4], 7u32.to_ne_bytes());
        assert_eq!(read(1)[..4], 2.5f32.to_ne_bytes());
        assert_eq!(read(2), [255; 8]);
        assert!((3..MAX_ARGUMENT_BYTES).all(|index| read(index) == [0; 8]));
        assert_eq!(packed._values.len(), 3 + MAX_ARGUMENT_BYTES / 8 + 1);
    }

    #[test]
    fn shapes_cover_the_count() {
        assert_eq!(Shape::cover(1000, 256).grid, [4, 1, 1]);
        assert_eq!(Shape::cover(0, 256).grid, [0, 1, 1]);
    }
}
