//! Where the compiler's library may lie.
//!
//! In this order: the file or folder that `GAITFIT_NVRTC` names (and then nowhere else), what the system's loader
//! knows, `CUDA_HOME` and `CUDA_PATH`, `/usr/local/cuda`, and the wheels (`nvidia-cuda-nvrtc`) of the Python
//! environments that `VIRTUAL_ENV` and `CONDA_PREFIX` name, that stands as `.venv` in the present folder, or whose
//! `bin` folder is on `PATH`.

use std::path::{Path, PathBuf};

/// The variables and folders that are looked at.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// `GAITFIT_NVRTC`.
    pub given: Option<PathBuf>,
    /// Toolkits: `CUDA_HOME`, `CUDA_PATH`, `/usr/local/cuda`.
    pub toolkits: Vec<PathBuf>,
    /// Python environments: folders with `lib/python3.x/site-packages`.
    pub environments: Vec<PathBuf>,
}

impl Places {
    /// Places for this process: from its environment variables, and the usual folders.
    pub fn of_process() -> Self {
        let variable =
            |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        let mut toolkits: Vec<PathBuf> =
            ["CUDA_HOME", "CUDA_PATH"].into_iter().filter_map(variable).collect();
        toolkits.push("/usr/local/cuda".into());
        let mut environments: Vec<PathBuf> =
            ["VIRTUAL_ENV", "CONDA_PREFIX"].into_iter().filter_map(variable).collect();
        environments.push(".venv".into());
        let path = std::env::var_os("PATH").unwrap_or_default();
        environments.extend(
            std::env::split_paths(&path)
                .filter(|folder| folder.ends_with("bin") && folder.join("python3").exists())
                .filter_map(|folder| folder.parent().map(Path::to_path_buf)),
        );
        Self { given: variable("GAITFIT_NVRTC"), toolkits, environments }
    }
}

/// Versions of the library that are tried, newest first. Those from 11.3 to 11.8 keep the name of 11.2.
const VERSIONS: [&str; 3] = ["13", "12", "11.2"];

/// Files and loader names to try, in order.
pub fn candidates(places: &Places) -> Vec<PathBuf> {
    if let Some(given) = &places.given {
        if given.is_dir() {
            let libraries = in_folder(given);
            // A name that will not load, so that the message shows where it was looked for.
            return if libraries.is_empty() { vec![given.join("libnvrtc.so")] } else { libraries };
        }
        return vec![given.clone()];
    }
    let mut names: Vec<PathBuf> = if cfg!(windows) {
        ["nvrtc64_130_0.dll", "nvrtc64_120_0.dll"].into_iter().map(PathBuf::from).collect()
    } else {
        let mut names: Vec<PathBuf> =
            VERSIONS.iter().map(|version| PathBuf::from(format!("libnvrtc.so.{version}"))).collect();
        names.push("libnvrtc.so".into());
        names
    };
    // After the loader's own names, so that the system's choice counts first.
    for toolkit in &places.toolkits {
        for folder in ["lib64", "lib", "bin"] {
            names.extend(in_folder(&toolkit.join(folder)));
        }
    }
    for environment in &places.environments {
        for python in folders(&environment.join("lib"), "python3").chain([environment.join("Lib")]) {
            let nvidia = python.join("site-packages").join("nvidia");
            for wheel in ["cu13", "cuda_nvrtc"] {
                for folder in ["lib", "bin"] {
                    names.extend(in_folder(&nvidia.join(wheel).join(folder)));
                }
            }
        }
    }
    names
}

/// Folders in `folder` whose names begin with `start`, in order of their names.
fn folders(folder: &Path, start: &str) -> impl Iterator<Item = PathBuf> + use<> {
    let mut folders: Vec<PathBuf> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(start))
        .map(|entry| entry.path())
        .collect();
    folders.sort();
    folders.into_iter()
}

/// Libraries of built-in functions beside the compiler's library at `path`; none for a bare name.
pub fn builtins(path: &Path) -> Vec<PathBuf> {
    let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) else {
        return Vec::new();
    };
    let is_library = |path: &PathBuf| !path.to_string_lossy().contains(".alt.");
    ["libnvrtc-builtins.so", "nvrtc-builtins64_"]
        .into_iter()
        .flat_map(|start| folders(folder, start))
        .filter(is_library)
        .collect()
}

/// The compiler's libraries in a folder, newest first.
fn in_folder(folder: &Path) -> Vec<PathBuf> {
    let is_library = |name: &str| {
        let unix = name.starts_with("libnvrtc.so") && !name.contains("alt");
        unix || (name.starts_with("nvrtc64_") && name.ends_with(".dll") && !name.contains("alt"))
    };
    let mut libraries: Vec<PathBuf> = folders(folder, "")
        .filter(|path| path.file_name().is_some_and(|name| is_library(&name.to_string_lossy())))
        .collect();
    libraries.reverse();
    libraries
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

    use super::*;

    #[test]
    fn wheels_and_toolkits_are_found_and_a_given_place_is_the_only_one() {
        let folder = tempfile::tempdir().unwrap();
        let make = |path: &str| {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "").unwrap();
            path
        };
        let toolkit = make("cuda/lib64/libnvrtc.so.12");
        let old = make("venv/lib/python3.11/site-packages/nvidia/cuda_nvrtc/lib/libnvrtc.so.12");
        let new = make("venv/lib/python3.11/site-packages/nvidia/cu13/lib/libnvrtc.so.13");
        let second = make("venv/lib/python3.11/site-packages/nvidia/cu13/lib/libnvrtc-builtins.so.13.0");
        make("venv/lib/python3.11/site-packages/nvidia/cu13/lib/libnvrtc-builtins.alt.so.13.0");
        make("venv/lib/python3.11/site-packages/nvidia/cu13/lib/libnvrtc.alt.so.13");
        let mut places = Places {
            given: None,
            toolkits: vec![folder.path().join("cuda"), folder.path().join("missing")],
            environments: vec![folder.path().join("venv")],
        };
        let libraries = candidates(&places);
        let files: Vec<_> =
            libraries.iter().filter(|path| path.starts_with(folder.path())).cloned().collect();
        assert_eq!(files, [toolkit, new.clone(), old]);
        assert!(
            libraries[0].parent().is_some_and(|parent| parent.as_os_str().is_empty()),
            "the loader comes first"
        );
        assert_eq!((builtins(&new), builtins(&libraries[0])), (vec![second], vec![]));
        places.given = new.parent().map(Path::to_path_buf);
        assert_eq!(candidates(&places), std::slice::from_ref(&new));
        places.given = Some(new.clone());
        assert_eq!(candidates(&places), [new]);
    }
}
