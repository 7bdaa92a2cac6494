//! The driver's functions, found when the program runs.

use std::error::Error as _;
use std::ffi::{CStr, c_char, c_int, c_uint, c_ulonglong, c_void};
use std::sync::OnceLock;

use libloading::Library;

use super::error::CudaError;
use super::table::functions;

/// A context, module, function, stream, event or graph of the driver.
pub(super) type Handle = *mut c_void;
/// An address in the GPU's memory.
pub(super) type Address = u64;

functions! {
    /// Functions of the driver that this crate uses (names and signatures of NVIDIA's `cuda.h`, which maps plain
    /// names to the `_v2` ones).
    Driver {
        init = "cuInit"(c_uint);
        error_name = "cuGetErrorName"(c_int, *mut *const c_char);
        error_text = "cuGetErrorString"(c_int, *mut *const c_char);
        driver_version = "cuDriverGetVersion"(*mut c_int);
        device_count = "cuDeviceGetCount"(*mut c_int);
        device_get = "cuDeviceGet"(*mut c_int, c_int);
        device_name = "cuDeviceGetName"(*mut c_char, c_int, c_int);
        device_memory = "cuDeviceTotalMem_v2"(*mut usize, c_int);
        device_attribute = "cuDeviceGetAttribute"(*mut c_int, c_int, c_int);
        context_retain = "cuDevicePrimaryCtxRetain"(*mut Handle, c_int);
        context_release = "cuDevicePrimaryCtxRelease_v2"(c_int);
        context_set = "cuCtxSetCurrent"(Handle);
        context_get = "cuCtxGetCurrent"(*mut Handle);
        context_wait = "cuCtxSynchronize"();
        memory_info = "cuMemGetInfo_v2"(*mut usize, *mut usize);
        allocate = "cuMemAlloc_v2"(*mut Address, usize);
        free = "cuMemFree_v2"(Address);
        allocate_host = "cuMemAllocHost_v2"(*mut *mut c_void, usize);
        free_host = "cuMemFreeHost"(*mut c_void);
        copy_in = "cuMemcpyHtoDAsync_v2"(Address, *const c_void, usize, Handle);
        copy_out = "cuMemcpyDtoHAsync_v2"(*mut c_void, Address, usize, Handle);
        copy_across = "cuMemcpyPeerAsync"(Address, Handle, Address, Handle, usize, Handle);
        can_reach = "cuDeviceCanAccessPeer"(*mut c_int, c_int, c_int);
        reach = "cuCtxEnablePeerAccess"(Handle, c_uint);
        copy_within = "cuMemcpyDtoDAsync_v2"(Address, Address, usize, Handle);
        fill_bytes = "cuMemsetD8Async"(Address, u8, usize, Handle);
        module_load = "cuModuleLoadData"(*mut Handle, *const c_void);
        module_unload = "cuModuleUnload"(Handle);
        module_function = "cuModuleGetFunction"(*mut Handle, Handle, *const c_char);
        module_global = "cuModuleGetGlobal_v2"(*mut Address, *mut usize, Handle, *const c_char);
        copy_now = "cuMemcpyHtoD_v2"(Address, *const c_void, usize);
        function_attribute = "cuFuncGetAttribute"(*mut c_int, c_int, Handle);
        set_function_attribute = "cuFuncSetAttribute"(Handle, c_int, c_int);
        blocks_per_processor = "cuOccupancyMaxActiveBlocksPerMultiprocessor"(*mut c_int, Handle, c_int, usize);
        launch = "cuLaunchKernel"(
            Handle, c_uint, c_uint, c_uint, c_uint, c_uint, c_uint, c_uint, Handle, *mut *mut c_void, *mut *mut c_void,
        );
        stream_create = "cuStreamCreate"(*mut Handle, c_uint);
        stream_destroy = "cuStreamDestroy_v2"(Handle);
        stream_wait = "cuStreamSynchronize"(Handle);
        stream_wait_event = "cuStreamWaitEvent"(Handle, Handle, c_uint);
        event_create = "cuEventCreate"(*mut Handle, c_uint);
        event_destroy = "cuEventDestroy_v2"(Handle);
        event_record = "cuEventRecord"(Handle, Handle);
        event_wait = "cuEventSynchronize"(Handle);
        event_elapsed = "cuEventElapsedTime"(*mut f32, Handle, Handle);
        capture_begin = "cuStreamBeginCapture_v2"(Handle, c_int);
        capture_end = "cuStreamEndCapture"(Handle, *mut Handle);
        graph_make = "cuGraphInstantiateWithFlags"(*mut Handle, Handle, c_ulonglong);
        graph_launch = "cuGraphLaunch"(Handle, Handle);
        graph_destroy = "cuGraphDestroy"(Handle);
        graph_exec_destroy = "cuGraphExecDestroy"(Handle);
    }
}

impl Driver {
    /// The driver of this machine, started; looked for once.
    pub(super) fn get() -> Result<&'static Self, CudaError> {
        static DRIVER: OnceLock<Result<Driver, CudaError>> = OnceLock::new();
        DRIVER.get_or_init(Self::start).as_ref().map_err(Clone::clone)
    }

    fn start() -> Result<Self, CudaError> {
        let names = if cfg!(windows) { &["nvcuda.dll"][..] } else { &["libcuda.so.1", "libcuda.so"] };
        let mut reason = String::new();
        for name in names {
            // SAFETY: loading NVIDIA's driver runs its own initialisers only.
            match unsafe { Library::new(*name) } {
                Ok(library) => {
                    let driver = Self::load(library).map_err(CudaError::OldDriver)?;
                    // SAFETY: the only flag that cuInit takes is 0.
                    let code = unsafe { (driver.init)(0) };
                    return match code {
                        0 => Ok(driver),
                        code => Err(CudaError::DriverStart(driver.reason(code))),
                    };
                }
                // The first name is the usual one; its reason tells more than the fallback's.
                Err(error) if reason.is_empty() => {
                    reason = error.source().map_or_else(|| error.to_string(), ToString::to_string);
                }
                Err(_) => {}
            }
        }
        Err(CudaError::NoDriver(reason))
    }

    /// The driver's words for a result code.
    pub(super) fn reason(&self, code: c_int) -> String {
        let text = |function: unsafe extern "system" fn(c_int, *mut *const c_char) -> c_int| {
            let mut pointer: *const c_char = std::ptr::null();
            // SAFETY: the driver stores a pointer to a constant string, or null for a code it does not know.
            unsafe { function(code, &raw mut pointer) };
            // SAFETY: as above; the string ends with 0 and lives as long as the library.
            (!pointer.is_null()).then(|| unsafe { CStr::from_ptr(pointer) }.to_string_lossy().into_owned())
        };
        match (text(self.error_text), text(self.error_name)) {
            (Some(words), Some(name)) => format!("{words} ({name})"),
            _ => format!("error {code}"),
        }
    }

    /// An error if `code` is one.
    pub(super) fn check(&self, code: c_int, doing: impl FnOnce() -> String) -> Result<(), CudaError> {
        if code == 0 {
            return Ok(());
        }
        Err(CudaError::Call { doing: doing(), reason: self.reason(code) })
    }
}
