//! What can go wrong on a GPU.

/// Why something could not be done on a GPU.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CudaError {
    /// The driver's library is not on this machine.
    #[error("there is no NVIDIA driver on this machine ({0}): install it, or use the CPU")]
    NoDriver(String),
    /// The driver's library lacks a function.
    #[error("the NVIDIA driver is too old, it has no `{0}`: install version 525 or later")]
    OldDriver(&'static str),
    /// The driver would not start.
    #[error("the NVIDIA driver does not start: {0}")]
    DriverStart(String),
    /// A number of no GPU.
    #[error("there is no GPU {ordinal}: the driver shows {count}; `gaitfit doctor` lists them")]
    Ordinal {
        /// The number asked for.
        ordinal: usize,
        /// GPUs that the driver shows.
        count: usize,
    },
    /// The compiler's library was not found.
    #[error(
        "NVIDIA's compiler library NVRTC was not found; looked for {searched}. Install the CUDA toolkit or the Python \
         package nvidia-cuda-nvrtc, or set GAITFIT_NVRTC to the library or its folder"
    )]
    NoNvrtc {
        /// Files that were tried.
        searched: String,
    },
    /// The compiler's library lacks a function.
    #[error("the NVRTC library {path} has no `{function}`: use NVRTC 11.8 or later")]
    OldNvrtc {
        /// The library.
        path: String,
        /// The function that it lacks.
        function: &'static str,
    },
    /// The compiler refused a program.
    #[error("NVRTC cannot compile the program `{program}` for {architecture}: {log}")]
    Compile {
        /// Name of the program.
        program: String,
        /// For example `sm_90`.
        architecture: String,
        /// The compiler's words.
        log: String,
    },
    /// The driver refused a compiled program.
    #[error(
        "the driver cannot load the program `{program}`: {reason}. A driver older than NVRTC may be the cause: \
         update the driver, or use an NVRTC of the driver's version"
    )]
    Load {
        /// Name of the program.
        program: String,
        /// The driver's words.
        reason: String,
    },
    /// A program without this kernel.
    #[error("the program `{program}` has no kernel `{kernel}`")]
    NoKernel {
        /// Name of the program.
        program: String,
        /// Name of the kernel.
        kernel: String,
    },
    /// A program without this array, or with one of another length.
    #[error("the program `{program}` has no array `{table}` with as many entries as there are numbers")]
    NoTable {
        /// Name of the program.
        program: String,
        /// Name of the array.
        table: String,
    },
    /// More memory than is free.
    #[error(
        "`{what}` needs {} of GPU {ordinal}'s memory, {} of {} are free: use fewer environments or candidates, or \
         stop other programs on this GPU", bytes(*.needed), bytes(*.free), bytes(*.total)
    )]
    Memory {
        /// Name of the buffer, or of the largest parts.
        what: String,
        /// Number of the GPU.
        ordinal: usize,
        /// Bytes needed.
        needed: u64,
        /// Bytes free.
        free: u64,
        /// Bytes in all.
        total: u64,
    },
    /// A kernel was given other arguments than it takes, or could not be started.
    #[error("kernel `{kernel}` could not be started: {reason}")]
    Launch {
        /// Name of the kernel.
        kernel: String,
        /// What is wrong.
        reason: String,
    },
    /// A kernel failed while it ran.
    #[error(
        "GPU {ordinal} failed while running {kernels}: {reason}. What this process had on the GPU is lost; files are \
         not touched. With GAITFIT_CUDA_SYNC=1 the message names the one kernel"
    )]
    Run {
        /// Number of the GPU.
        ordinal: usize,
        /// The kernels that were under way.
        kernels: String,
        /// The driver's words.
        reason: String,
    },
    /// A copy between arrays of different lengths.
    #[error("buffer `{buffer}` holds {expected} numbers, {found} were given")]
    Length {
        /// Name of the buffer.
        buffer: String,
        /// Its length.
        expected: usize,
        /// The other's.
        found: usize,
    },
    /// Any other call of the driver.
    #[error("{doing} failed: {reason}")]
    Call {
        /// The work that failed.
        doing: String,
        /// The driver's words.
        reason: String,
    },
}

impl CudaError {
    /// Whether the GPU's memory was too small: for a plan, or for an allocation, if another thread was faster.
    pub(crate) fn is_memory(&self) -> bool {
        match self {
            Self::Memory { .. } => true,
            // The driver's words for `CUDA_ERROR_OUT_OF_MEMORY`.
            Self::Call { reason, .. } => reason.contains("out of memory"),
            _ => false,
        }
    }
}

/// A size in words: "3.2 GiB".
pub fn bytes(count: u64) -> String {
    let units = ["KiB", "MiB", "GiB", "TiB"];
    let mut size = count as f64;
    let mut unit = "bytes";
    for name in units {
        if size < 1024.0 {
            break;
        }
        size /= 1024.0;
        unit = name;
    }
    if unit == "bytes" { format!("{count} bytes") } else { format!("{size:.1} {unit}") }
}

impl CudaError {
    /// Whether a driver, a GPU or the compiler is not there, or too old, rather than something failed.
    pub fn is_missing(&self) -> bool {
        use CudaError::{DriverStart, NoDriver, NoNvrtc, OldDriver, OldNvrtc, Ordinal};
        matches!(
            self,
            NoDriver(_) | OldDriver(_) | DriverStart(_) | Ordinal { .. } | NoNvrtc { .. } | OldNvrtc { .. }
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_messages_say_what_fits() {
        let error = CudaError::Memory {
            what: "samples".into(),
            ordinal: 1,
            needed: 3 << 30,
            free: 512 << 20,
            total: 80 << 30,
        };
        let text = error.to_string();
        assert!(
            text.starts_with("`samples` needs 3.0 GiB of GPU 1's memory, 512.0 MiB of 80.0 GiB are free"),
            "{text}"
        );
        assert_eq!(bytes(1000), "1000 bytes");
    }
}
