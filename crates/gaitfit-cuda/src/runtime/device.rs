//! A GPU and its context.

use std::ffi::{CStr, c_int};
use std::ptr::null_mut;
use std::sync::Arc;

use serde::Serialize;

use super::ahead::Ahead;
use super::cache::Cache;
use super::compile::{Program, compile};
use super::driver::{Driver, Handle};
use super::error::CudaError;
use super::module::Module;
use super::nvrtc::Nvrtc;

/// Properties of a GPU.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DeviceInfo {
    /// Its number, from 0, in the driver's order (`CUDA_VISIBLE_DEVICES` changes it).
    pub ordinal: usize,
    /// Its name, for example "NVIDIA H200".
    pub name: String,
    /// Memory in bytes.
    pub memory: u64,
    /// Compute capability, (9, 0) for an H200.
    pub capability: (i32, i32),
    /// Multiprocessors.
    pub processors: i32,
    /// Bytes of shared memory that a block may ask for.
    pub shared_memory: i32,
    /// Bytes of the second-level cache.
    pub cache: i32,
}

/// `CU_DEVICE_ATTRIBUTE_…` of `cuda.h`.
const PROCESSORS: c_int = 16;
const CACHE: c_int = 38;
const CAPABILITY_MAJOR: c_int = 75;
const CAPABILITY_MINOR: c_int = 76;
const SHARED_MEMORY: c_int = 97;
/// `CUDA_ERROR_PEER_ACCESS_ALREADY_ENABLED`.
const ALREADY_REACHED: c_int = 704;

/// Number of GPUs that the driver shows.
pub(super) fn count(driver: &Driver) -> Result<usize, CudaError> {
    let mut count = 0;
    // SAFETY: the driver stores one int.
    let code = unsafe { (driver.device_count)(&raw mut count) };
    driver.check(code, || "counting the GPUs".into())?;
    Ok(usize::try_from(count).unwrap_or(0))
}

/// Properties of the GPU of this number.
pub(super) fn describe(driver: &Driver, ordinal: usize) -> Result<DeviceInfo, CudaError> {
    let doing = || format!("asking about GPU {ordinal}");
    let mut device = 0;
    let number = c_int::try_from(ordinal).unwrap_or(c_int::MAX);
    // SAFETY: the driver stores one int.
    driver.check(unsafe { (driver.device_get)(&raw mut device, number) }, doing)?;
    let mut name = [0u8; 256];
    // SAFETY: the driver stores at most as many characters as it is told, with a 0 at the end.
    let code = unsafe { (driver.device_name)(name.as_mut_ptr().cast(), name.len() as c_int, device) };
    driver.check(code, doing)?;
    let mut memory = 0;
    // SAFETY: the driver stores one size.
    driver.check(unsafe { (driver.device_memory)(&raw mut memory, device) }, doing)?;
    let attribute = |which: c_int| {
        let mut value = 0;
        // SAFETY: the driver stores one int.
        let code = unsafe { (driver.device_attribute)(&raw mut value, which, device) };
        driver.check(code, doing).map(|()| value)
    };
    Ok(DeviceInfo {
        ordinal,
        name: CStr::from_bytes_until_nul(&name).unwrap_or_default().to_string_lossy().into_owned(),
        memory: memory as u64,
        capability: (attribute(CAPABILITY_MAJOR)?, attribute(CAPABILITY_MINOR)?),
        processors: attribute(PROCESSORS)?,
        shared_memory: attribute(SHARED_MEMORY)?,
        cache: attribute(CACHE)?,
    })
}

/// A GPU in use; clones share its context.
#[derive(Clone)]
pub struct Device {
    pub(super) context: Arc<Context>,
}

/// The primary context, kept as long as anything of this GPU is.
pub(super) struct Context {
    pub(super) driver: &'static Driver,
    pub(super) info: DeviceInfo,
    pub(super) handle: Handle,
}

// SAFETY: the driver's functions may be called from any thread; each call here first makes the context the thread's own.
unsafe impl Send for Context {}
// SAFETY: as above.
unsafe impl Sync for Context {}

impl Context {
    /// Makes this the calling thread's context; every call that needs one does it first.
    pub(super) fn enter(&self) -> Result<(), CudaError> {
        // SAFETY: the context was retained by `Device::open` and is released with `self`.
        let code = unsafe { (self.driver.context_set)(self.handle) };
        self.driver.check(code, || format!("using GPU {}", self.info.ordinal))
    }

    /// See [`Device::visit`].
    pub(super) fn visit(self: &Arc<Self>) -> Visit {
        let mut before = null_mut();
        // SAFETY: the driver stores one handle, or none.
        unsafe { (self.driver.context_get)(&raw mut before) };
        Visit { context: self.clone(), before }
    }
}

/// Keeps a thread's own context for the time of a [`Device::visit`], and makes it current again when dropped.
pub struct Visit {
    context: Arc<Context>,
    before: Handle,
}

impl Drop for Visit {
    fn drop(&mut self) {
        // SAFETY: the context was the thread's own before the visit, or it had none.
        unsafe { (self.context.driver.context_set)(self.before) };
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        let number = c_int::try_from(self.info.ordinal).unwrap_or(c_int::MAX);
        // SAFETY: released once, after all that used it: they hold the context by `Arc`.
        unsafe { (self.driver.context_release)(number) };
    }
}

impl Device {
    /// Opens the GPU of this number.
    ///
    /// # Errors
    /// [`CudaError`] if there is no driver, no such GPU, or the driver refuses it.
    pub fn open(ordinal: usize) -> Result<Self, CudaError> {
        let driver = Driver::get()?;
        let count = count(driver)?;
        if ordinal >= count {
            return Err(CudaError::Ordinal { ordinal, count });
        }
        let info = describe(driver, ordinal)?;
        let mut handle = null_mut();
        // SAFETY: the driver stores one handle; the number was checked above.
        let code = unsafe { (driver.context_retain)(&raw mut handle, ordinal as c_int) };
        driver.check(code, || format!("opening GPU {ordinal} ({})", info.name))?;
        Ok(Self { context: Arc::new(Context { driver, info, handle }) })
    }

    /// Keeps the calling thread's context until the result is dropped: other libraries (PyTorch) take it for their present
    /// GPU, and calls of this crate change it.
    pub fn visit(&self) -> Visit {
        self.context.visit()
    }

    /// Lets this GPU read the other's memory directly, if both can; whether they can. Copies between GPUs that cannot go
    /// through the host's memory.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn reach(&self, other: &Self) -> Result<bool, CudaError> {
        let (near, far) = (&self.context, &other.context);
        if near.info.ordinal == far.info.ordinal {
            return Ok(true);
        }
        // The driver gives access to the context that is current on this thread.
        near.enter()?;
        let doing = || format!("asking whether GPU {} reaches GPU {}", near.info.ordinal, far.info.ordinal);
        let mut devices = [0; 2];
        for (device, context) in devices.iter_mut().zip([near, far]) {
            // SAFETY: the driver stores one int; the number is that of an opened GPU.
            let code = unsafe { (near.driver.device_get)(device, context.info.ordinal as c_int) };
            near.driver.check(code, doing)?;
        }
        let mut reached = 0;
        // SAFETY: the driver stores one int.
        let code = unsafe { (near.driver.can_reach)(&raw mut reached, devices[0], devices[1]) };
        near.driver.check(code, doing)?;
        if reached == 0 {
            return Ok(false);
        }
        // SAFETY: both contexts are retained; the only flags are 0.
        let code = unsafe { (near.driver.reach)(far.handle, 0) };
        if code == ALREADY_REACHED {
            return Ok(true);
        }
        let doing = || format!("letting GPU {} read from GPU {}", near.info.ordinal, far.info.ordinal);
        near.driver.check(code, doing).map(|()| true)
    }

    /// Waits until all work on it is done, that of other libraries of this process too.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn wait(&self) -> Result<(), CudaError> {
        self.context.enter()?;
        // SAFETY: the context is the thread's own.
        let code = unsafe { (self.context.driver.context_wait)() };
        self.context.driver.check(code, || format!("waiting for GPU {}", self.info().ordinal))
    }

    /// Its properties.
    pub fn info(&self) -> &DeviceInfo {
        &self.context.info
    }

    /// Bytes of memory free and in all.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn memory(&self) -> Result<(u64, u64), CudaError> {
        self.context.enter()?;
        let (mut free, mut total) = (0, 0);
        // SAFETY: the driver stores two sizes.
        let code = unsafe { (self.context.driver.memory_info)(&raw mut free, &raw mut total) };
        self.context.driver.check(code, || "asking for free memory".into())?;
        Ok((free as u64, total as u64))
    }

    /// Refuses a plan that does not fit into free memory: pairs of a name and its bytes. The message names the largest
    /// parts. To be called before anything of the plan is allocated.
    ///
    /// # Errors
    /// [`CudaError::Memory`].
    pub fn check_room(&self, parts: &[(&str, u64)]) -> Result<(), CudaError> {
        let (free, total) = self.memory()?;
        super::memory::check(parts, self.info().ordinal, free, total)
    }

    /// Begins to compile `programs` on threads of their own, for a later [`Device::load`].
    pub fn compile_ahead(&self, programs: impl IntoIterator<Item = Program>) -> Ahead {
        Ahead::new(programs, self.info().capability)
    }

    /// Compiles a program (or takes it from the user's cache) and loads it.
    ///
    /// # Errors
    /// [`CudaError`] if there is no compiler, or compiler or driver refuse the program.
    pub fn load(&self, program: &Program) -> Result<Module, CudaError> {
        let cache = Cache::of_user();
        let compiled = compile(Nvrtc::get()?, program, self.info().capability, cache.as_ref())?;
        let module = Module::load(self, &program.name, compiled)?;
        for (name, numbers) in &program.tables {
            module.fill(name, numbers)?;
        }
        Ok(module)
    }
}
