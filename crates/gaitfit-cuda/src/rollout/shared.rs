//! Arrays in a GPU's memory that others hold on to.

use std::sync::Arc;

use crate::ppo::{Kind, Storage};
use crate::runtime::{CudaError, Device, Event, Stream};

/// Memory and event, let go of without a change to the dropping thread's present GPU, which is another library's.
struct Held {
    parts: Option<(Arc<Storage>, Arc<Event>)>,
    device: Device,
}

impl Drop for Held {
    fn drop(&mut self) {
        let _visit = self.device.visit();
        self.parts = None;
    }
}

/// An array of one or two dimensions in a GPU's memory. Its memory lives as long as any clone of it does.
#[derive(Clone)]
pub struct Shared {
    device: Device,
    /// The memory, and the event after the last work that wrote it.
    held: Arc<Held>,
    first: usize,
    shape: Vec<usize>,
    strides: Vec<usize>,
}

impl Shared {
    /// The numbers from number `first` of `storage` on, row by row.
    pub(super) fn new(
        device: &Device,
        storage: &Arc<Storage>,
        ready: &Arc<Event>,
        first: usize,
        shape: &[usize],
    ) -> Self {
        let strides = (1..=shape.len()).map(|axis| shape[axis..].iter().product()).collect();
        let parts = Some((storage.clone(), ready.clone()));
        let held = Arc::new(Held { parts, device: device.clone() });
        Self { device: device.clone(), held, first, shape: shape.to_vec(), strides }
    }

    /// The same memory with its axes in the other order.
    #[must_use]
    pub(super) fn transposed(mut self) -> Self {
        self.shape.reverse();
        self.strides.reverse();
        self
    }

    fn storage(&self) -> Option<&Storage> {
        self.held.parts.as_ref().map(|(storage, _)| &**storage)
    }

    /// Number of its GPU.
    pub fn ordinal(&self) -> usize {
        self.device.info().ordinal
    }

    /// Numbers along each axis.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Numbers from one to the next along each axis.
    pub fn strides(&self) -> &[usize] {
        &self.strides
    }

    /// Type of its numbers; bytes are 0 or 1.
    pub fn kind(&self) -> Kind {
        self.storage().map_or(Kind::F32, Storage::kind)
    }

    /// Where its first number lies in the GPU's memory.
    pub fn address(&self) -> u64 {
        let base = self.storage().map_or(0, Storage::address);
        base + (self.first * self.kind().bytes()) as u64
    }

    /// The event after the last work that wrote it.
    pub fn ready(&self) -> Option<&Event> {
        self.held.parts.as_ref().map(|(_, ready)| &**ready)
    }

    /// Copies its numbers out, row by row, as 32-bit floats; bytes become 0 and 1.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn read(&self) -> Result<Vec<f32>, CudaError> {
        let _visit = self.device.visit();
        let stream = Stream::new(&self.device)?;
        let Some((storage, ready)) = &self.held.parts else { return Ok(Vec::new()) };
        stream.wait_for(ready)?;
        let numbers: Vec<f32> = match &**storage {
            Storage::U8(buffer) => buffer.read(&stream)?.into_iter().map(f32::from).collect(),
            storage => storage.read(&stream)?,
        };
        let number = |index: usize| {
            let mut rest = index;
            let mut at = self.first;
            for (length, stride) in self.shape.iter().zip(&self.strides).rev() {
                at += rest % length * stride;
                rest /= length;
            }
            numbers.get(at).copied().unwrap_or_default()
        };
        Ok((0..self.shape.iter().product()).map(number).collect())
    }
}
