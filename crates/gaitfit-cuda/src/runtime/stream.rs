//! Order of work: streams, events and recorded graphs.

use std::ptr::null_mut;
use std::sync::{Arc, Mutex, PoisonError};

use super::device::{Context, Device};
use super::driver::Handle;
use super::error::CudaError;

/// Max number of kernels that a message names: the last ones.
const MAX_NAMES: usize = 8;

/// `CU_STREAM_NON_BLOCKING`: not ordered with the driver's own stream.
const NON_BLOCKING: u32 = 1;
/// `CU_EVENT_DISABLE_TIMING`.
const NO_TIMES: u32 = 2;
/// `CU_STREAM_CAPTURE_MODE_THREAD_LOCAL`: other threads may allocate meanwhile.
const THIS_THREAD: i32 = 1;

/// A queue of work for a GPU; its work runs in order.
pub struct Stream {
    pub(super) context: Arc<Context>,
    handle: Handle,
    /// Kernels started since the last wait, the last few.
    names: Mutex<Vec<Arc<str>>>,
}

// SAFETY: the driver's functions for streams may be called from any thread.
unsafe impl Send for Stream {}
// SAFETY: as above.
unsafe impl Sync for Stream {}

impl Stream {
    /// An empty one.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn new(device: &Device) -> Result<Self, CudaError> {
        let context = device.context.clone();
        context.enter()?;
        let mut handle = null_mut();
        // SAFETY: the driver stores one handle.
        let code = unsafe { (context.driver.stream_create)(&raw mut handle, NON_BLOCKING) };
        context.driver.check(code, || "making a stream".into())?;
        Ok(Self { context, handle, names: Mutex::new(Vec::new()) })
    }

    pub(super) fn handle(&self) -> Handle {
        self.handle
    }

    /// Its handle as a number, as other libraries take it (`cudaStream_t`).
    pub fn address(&self) -> u64 {
        self.handle as u64
    }

    /// Remembers that a kernel was started.
    pub(super) fn started(&self, name: &Arc<str>) {
        let mut names = self.names.lock().unwrap_or_else(PoisonError::into_inner);
        if names.last() != Some(name) {
            if names.len() == MAX_NAMES {
                names.remove(0);
            }
            names.push(name.clone());
        }
    }

    /// Waits until all its work is done.
    ///
    /// # Errors
    /// [`CudaError::Run`], naming the kernels started since the last wait, if one of them failed.
    pub fn wait(&self) -> Result<(), CudaError> {
        self.context.enter()?;
        // SAFETY: the stream is alive.
        let code = unsafe { (self.context.driver.stream_wait)(self.handle) };
        let mut names = self.names.lock().unwrap_or_else(PoisonError::into_inner);
        if code == 0 {
            names.clear();
            return Ok(());
        }
        let kernels: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
        let kernels = if kernels.is_empty() { "a copy".to_owned() } else { kernels.join(", ") };
        let reason = self.context.driver.reason(code);
        Err(CudaError::Run { ordinal: self.context.info.ordinal, kernels, reason })
    }

    /// Makes later work of this stream wait for an event.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn wait_for(&self, event: &Event) -> Result<(), CudaError> {
        self.context.enter()?;
        // SAFETY: both are alive.
        let code = unsafe { (self.context.driver.stream_wait_event)(self.handle, event.handle, 0) };
        self.context.driver.check(code, || "waiting for an event".into())
    }

    /// Records what `work` starts on this stream instead of running it. Buffers that the graph uses must outlive its
    /// runs: it holds their addresses only. `work` must not wait, allocate or copy from and to the host.
    ///
    /// # Errors
    /// `work`'s error, or the driver's.
    pub fn record(&self, work: impl FnOnce(&Self) -> Result<(), CudaError>) -> Result<Graph, CudaError> {
        let driver = self.context.driver;
        self.context.enter()?;
        // SAFETY: the stream is alive and not being recorded: recording ends below in every case.
        let code = unsafe { (driver.capture_begin)(self.handle, THIS_THREAD) };
        driver.check(code, || "recording a graph".into())?;
        let outcome = work(self);
        let mut graph = null_mut();
        // SAFETY: the driver stores one handle.
        let code = unsafe { (driver.capture_end)(self.handle, &raw mut graph) };
        // Only now: recording must end in every case, or the stream stays unusable.
        outcome?;
        driver.check(code, || "recording a graph".into())?;
        let mut handle = null_mut();
        // SAFETY: the graph was recorded above; the driver stores one handle.
        let code = unsafe { (driver.graph_make)(&raw mut handle, graph, 0) };
        // SAFETY: the recorded form is not needed any more.
        unsafe { (driver.graph_destroy)(graph) };
        driver.check(code, || "making a graph ready".into())?;
        let names = std::mem::take(&mut *self.names.lock().unwrap_or_else(PoisonError::into_inner));
        Ok(Graph { context: self.context.clone(), handle, names })
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        if self.context.enter().is_ok() {
            // SAFETY: destroyed once; the driver lets its work end first.
            unsafe { (self.context.driver.stream_destroy)(self.handle) };
        }
    }
}

/// Recorded work that starts with one call.
pub struct Graph {
    context: Arc<Context>,
    handle: Handle,
    names: Vec<Arc<str>>,
}

// SAFETY: the driver wants one call at a time for a graph; `launch` takes it mutably.
unsafe impl Send for Graph {}
// SAFETY: a shared graph does nothing.
unsafe impl Sync for Graph {}

impl Graph {
    /// Starts the recorded work on a stream.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn launch(&mut self, stream: &Stream) -> Result<(), CudaError> {
        self.context.enter()?;
        // SAFETY: both are alive.
        let code = unsafe { (self.context.driver.graph_launch)(self.handle, stream.handle) };
        self.context.driver.check(code, || "starting a graph".into())?;
        self.names.iter().for_each(|name| stream.started(name));
        Ok(())
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        if self.context.enter().is_ok() {
            // SAFETY: destroyed once.
            unsafe { (self.context.driver.graph_exec_destroy)(self.handle) };
        }
    }
}

/// A mark in a stream, for order between streams and for times.
pub struct Event {
    context: Arc<Context>,
    handle: Handle,
}

// SAFETY: the driver's functions for events may be called from any thread.
unsafe impl Send for Event {}
// SAFETY: as above.
unsafe impl Sync for Event {}

impl Event {
    /// One that is not in a stream yet.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn new(device: &Device) -> Result<Self, CudaError> {
        Self::with(device, 0)
    }

    /// One for order alone, which takes less time and knows none.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn mark(device: &Device) -> Result<Self, CudaError> {
        Self::with(device, NO_TIMES)
    }

    fn with(device: &Device, flags: u32) -> Result<Self, CudaError> {
        let context = device.context.clone();
        context.enter()?;
        let mut handle = null_mut();
        // SAFETY: the driver stores one handle.
        let code = unsafe { (context.driver.event_create)(&raw mut handle, flags) };
        context.driver.check(code, || "making an event".into())?;
        Ok(Self { context, handle })
    }

    /// Puts it after the stream's present work.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn record(&self, stream: &Stream) -> Result<(), CudaError> {
        self.context.enter()?;
        // SAFETY: both are alive.
        let code = unsafe { (self.context.driver.event_record)(self.handle, stream.handle) };
        self.context.driver.check(code, || "recording an event".into())
    }

    /// Makes later work of another library's stream wait for this event. `stream` is its handle; 1 is the driver's own stream,
    /// 2 the calling thread's.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    ///
    /// # Safety
    /// `stream` must be the handle of a stream that is alive, of this process, or 1 or 2.
    pub unsafe fn hold(&self, stream: usize) -> Result<(), CudaError> {
        let _visit = self.context.visit();
        self.context.enter()?;
        let stream = std::ptr::without_provenance_mut(stream);
        // SAFETY: the event is alive, and the caller answers for the stream.
        let code = unsafe { (self.context.driver.stream_wait_event)(stream, self.handle, 0) };
        self.context.driver.check(code, || "making a stream wait for an event".into())
    }

    /// Seconds of the GPU from this event to `later`; waits for it.
    ///
    /// # Errors
    /// [`CudaError::Call`] if one was not recorded, or work before it failed.
    pub fn seconds_until(&self, later: &Self) -> Result<f64, CudaError> {
        self.context.enter()?;
        // SAFETY: the event is alive.
        let code = unsafe { (self.context.driver.event_wait)(later.handle) };
        self.context.driver.check(code, || "waiting for an event".into())?;
        let mut milliseconds = 0.0;
        // SAFETY: both are alive; the driver stores one number.
        let code =
            unsafe { (self.context.driver.event_elapsed)(&raw mut milliseconds, self.handle, later.handle) };
        self.context.driver.check(code, || "reading the time between events".into())?;
        Ok(f64::from(milliseconds) * 1e-3)
    }
}

impl Drop for Event {
    fn drop(&mut self) {
        if self.context.enter().is_ok() {
            // SAFETY: destroyed once.
            unsafe { (self.context.driver.event_destroy)(self.handle) };
        }
    }
}
