//! Arrays in a GPU's memory, given to other libraries and taken from them by DLPack.
#![allow(unsafe_code, reason = "DLPack hands addresses and streams from library to library")]

use crate::errors::{failed, value};
use dlpark::ffi::{DLDataType, DLDevice, DLDeviceType, DLManagedTensor, DLManagedTensorVersioned};
use dlpark::metadata::Dynamic;
use dlpark::python::{
    CudaStreamRequest, DlpackExporter, ExportRequest, ImportedDlpack, dlpack_device, export_dlpack,
    from_dlpack,
};
use dlpark::{DlpackFlags, Managed, ManagedTensorBase};
use gaitfit_cuda::ppo::Kind;
use gaitfit_cuda::rollout::Shared;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

/// The driver's own stream, and the calling thread's, as their handles.
const DEFAULT_STREAM: usize = 1;
const THREAD_STREAM: usize = 2;

/// An array of robots in a GPU's memory. Libraries take it without a copy by DLPack, for example
/// ``torch.from_dlpack(array)``; its memory lives as long as any of them has it.
///
/// >>> robots = gaitfit.Robots(num_envs=4096, device="cuda")      # doctest: +SKIP
/// >>> torch.from_dlpack(robots.observation).shape      # doctest: +SKIP
/// torch.Size([4096, 45])
#[pyclass(module = "gaitfit", frozen)]
pub struct DeviceArray {
    array: Shared,
}

impl DeviceArray {
    pub fn new(array: Shared) -> Self {
        Self { array }
    }

    fn is_flag(&self) -> bool {
        self.array.kind() == Kind::U8
    }

    fn exported<M: ManagedTensorBase>(&self) -> PyResult<Managed<M>> {
        let metadata = Dynamic::new(self.array.shape().to_vec(), self.array.strides().to_vec());
        let mut tensor = metadata.initialize_as::<M>(Box::new(self.array.clone())).map_err(failed)?;
        let address = usize::try_from(self.array.address()).map_err(failed)?;
        tensor
            .set_data(std::ptr::without_provenance_mut(address))
            .set_device(self.device())
            .set_dtype(if self.is_flag() { DLDataType::BOOL } else { DLDataType::F32 });
        // SAFETY: address, type, shape and strides are those of the array, whose memory the tensor holds.
        Ok(unsafe { tensor.finish() })
    }
}

impl DlpackExporter for DeviceArray {
    fn device(&self) -> DLDevice {
        DLDevice::cuda(i32::try_from(self.array.ordinal()).unwrap_or(i32::MAX))
    }

    fn flags(&self) -> DlpackFlags {
        DlpackFlags::empty()
    }

    fn prepare_export(&self, _: Python<'_>, request: &ExportRequest<'_>) -> PyResult<()> {
        let stream = match request.cuda_stream()? {
            CudaStreamRequest::NoSync => return Ok(()),
            CudaStreamRequest::Omitted | CudaStreamRequest::LegacyDefault => DEFAULT_STREAM,
            CudaStreamRequest::PerThreadDefault => THREAD_STREAM,
            CudaStreamRequest::Pointer(stream) => stream,
        };
        let Some(ready) = self.array.ready() else { return Ok(()) };
        // SAFETY: by the protocol, the stream is the consumer's and alive.
        unsafe { ready.hold(stream) }.map_err(failed)
    }

    fn export_legacy(&self, _: Python<'_>) -> PyResult<Managed<DLManagedTensor>> {
        self.exported()
    }

    fn export_versioned(&self, _: Python<'_>) -> PyResult<Managed<DLManagedTensorVersioned>> {
        self.exported()
    }
}

#[pymethods]
impl DeviceArray {
    /// Numbers along each axis.
    #[getter]
    fn shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.array.shape())
    }

    /// ``"float32"`` or ``"bool"``.
    #[getter]
    fn dtype(&self) -> &'static str {
        if self.is_flag() { "bool" } else { "float32" }
    }

    /// Where it lies, for example ``"cuda:0"``.
    #[getter(device)]
    fn place(&self) -> String {
        format!("cuda:{}", self.array.ordinal())
    }

    /// A copy in the processor's memory: a NumPy array of the same shape.
    fn numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let numbers = py.detach(|| self.array.read()).map_err(failed)?;
        let shape = self.array.shape();
        if self.is_flag() {
            let flags = PyArray1::from_iter(py, numbers.into_iter().map(|number| number != 0.0));
            return Ok(flags.reshape(shape)?.into_any());
        }
        Ok(PyArray1::from_vec(py, numbers).reshape(shape)?.into_any())
    }

    /// DLPack's kind of device (2: CUDA) and the number of the GPU.
    fn __dlpack_device__(&self) -> (u32, i32) {
        self.device().into()
    }

    /// A capsule of the array for another library. ``stream``, the library's, waits for what was last written.
    #[pyo3(signature = (*, stream=None, max_version=None, dl_device=None, copy=None))]
    fn __dlpack__<'py>(
        &self,
        py: Python<'py>,
        stream: Option<Bound<'py, PyAny>>,
        max_version: Option<(u32, u32)>,
        dl_device: Option<(u32, i32)>,
        copy: Option<bool>,
    ) -> PyResult<Py<PyAny>> {
        export_dlpack(self, py, ExportRequest::parse(stream.as_ref(), max_version, dl_device, copy)?)
    }

    /// Copies to the processor are asked for by name.
    #[pyo3(signature = (*_arguments, **_named))]
    fn __array__(
        &self,
        _arguments: &Bound<'_, PyTuple>,
        _named: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Py<PyAny>> {
        let place = self.place();
        Err(PyTypeError::new_err(format!(
            "the array lies on {place}; its method numpy() copies it from there"
        )))
    }

    fn __repr__(&self) -> String {
        format!(
            "DeviceArray(shape={:?}, dtype={}, device={})",
            self.array.shape(),
            self.dtype(),
            self.place()
        )
    }
}

/// Numbers of another library in a GPU's memory, checked: 32-bit floats of one shape, row by row. The memory is held as
/// long as this is there.
#[pyclass(module = "gaitfit._gaitfit", frozen)]
pub struct DeviceInput {
    _tensor: ImportedDlpack,
    /// Rows and columns.
    pub shape: (usize, usize),
    /// Number of the GPU.
    pub device: usize,
    /// Where the first number lies.
    #[pyo3(get)]
    pub address: u64,
}

#[pymethods]
impl DeviceInput {
    /// ``array``, named ``what``, on the GPU ``device``. What its library still writes is done before later work of ``stream``.
    #[new]
    fn new(
        what: &str,
        array: &Bound<'_, PyAny>,
        shape: (usize, usize),
        device: usize,
        stream: u64,
    ) -> PyResult<Self> {
        let needed = format!("{what} must be 32-bit floats on cuda:{device}");
        let wrong = |found: String| PyTypeError::new_err(format!("{needed}; {found}"));
        if !array.hasattr("__dlpack_device__")? {
            let kind = array.get_type().name()?;
            return Err(wrong(format!("they are a {kind}, which has no __dlpack__ (a tensor of torch has)")));
        }
        let found = dlpack_device(array.as_borrowed())?;
        if found.device_type != DLDeviceType::CUDA {
            let place = match found.device_type {
                DLDeviceType::CPU => "the processor".to_owned(),
                other => format!("a device of another kind ({})", other.0),
            };
            return Err(wrong(format!(
                "they lie on {place}: move them, for example actions.to(\"cuda:{device}\")"
            )));
        }
        if usize::try_from(found.device_id).ok() != Some(device) {
            return Err(value(format!("{needed}; they lie on cuda:{}", found.device_id)));
        }
        let named = PyDict::new(array.py());
        named.set_item("stream", stream)?;
        let capsule = array.call_method("__dlpack__", (), Some(&named))?;
        let tensor = from_dlpack(capsule.as_borrowed(), None, None)?;
        let view = tensor.validate().map_err(value)?;
        if view.device() != found {
            return Err(value(format!("{needed}; their __dlpack__ gives another device than they say")));
        }
        if !view.dtype().is::<f32>() {
            let dtype = view.dtype();
            return Err(wrong(format!("they are of {} bits, kind {} of DLPack", dtype.bits, dtype.code.0)));
        }
        let (rows, columns) = shape;
        if view.shape() != [rows as i64, columns as i64] {
            let found = view.shape().iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
            return Err(value(format!("{what} have the shape ({found}); needed: {shape:?}")));
        }
        if !view.is_compact().map_err(value)? {
            return Err(value(format!(
                "{what} must be one block of memory, row by row, for example {what}.contiguous()"
            )));
        }
        let address = view.data_ptr() as u64 + view.byte_offset();
        Ok(Self { _tensor: tensor, shape, device, address })
    }
}
