//! Processes that a function of the user forks while a stage waits for it.

use pyo3::exceptions::PySystemExit;
use pyo3::prelude::*;

/// Where a stage began. A process that is forked from there has its calling thread, and none of its others: it cannot go
/// on with the stage, nor wait for its end.
#[derive(Clone, Copy)]
pub struct Home(u32);

impl Home {
    pub fn here() -> Self {
        Self(std::process::id())
    }

    /// Ends this process if it is not the one where the stage began: as the function asked by `SystemExit`, or with 1 and
    /// what is wrong on standard error.
    pub fn or_end(self, py: Python<'_>, called: PyResult<()>) -> PyResult<()> {
        if std::process::id() == self.0 {
            return called;
        }
        let code = code(py, called);
        for stream in ["stdout", "stderr"] {
            // A stream that is closed has nothing to lose.
            let _ = py.import("sys").and_then(|sys| sys.getattr(stream)?.call_method0("flush"));
        }
        py.import("os")?.call_method1("_exit", (code,))?;
        Ok(())
    }
}

/// The exit status, after what there is to say was said.
fn code(py: Python<'_>, called: PyResult<()>) -> i32 {
    let error = match called {
        Ok(()) => {
            eprintln!(
                "gaitfit: a process that was forked inside a function cannot go on with the stage that called the function: \
                 end it there with os._exit(), or begin it with multiprocessing"
            );
            return 1;
        }
        Err(error) => error,
    };
    if !error.is_instance_of::<PySystemExit>(py) {
        error.print(py);
        return 1;
    }
    match error.value(py).getattr("code") {
        Ok(code) if code.is_none() => 0,
        Ok(code) => code.extract().unwrap_or_else(|_| {
            eprintln!("{code}");
            1
        }),
        Err(_) => 1,
    }
}
