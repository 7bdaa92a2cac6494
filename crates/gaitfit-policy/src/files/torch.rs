//! PyTorch's own files, which are programs or pickles: refused, with the lines that convert them.

use crate::PolicyError;
use crate::error::invalid;
use std::path::Path;

/// Why `bytes` of the file at `path` are not read, and what to do.
pub(super) fn refuse(path: &Path, bytes: &[u8]) -> PolicyError {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let name = gaitfit_model::shown(&name);
    let stem = name.rsplit_once('.').map_or(name.as_str(), |(stem, _)| stem);
    // TorchScript keeps its program in a folder of the archive.
    let script = bytes.windows(6).any(|window| window == b"/code/");
    let (what, lines) = if script {
        (
            "TorchScript",
            format!(
                "    import torch; policy = torch.jit.load(\"{name}\", map_location=\"cpu\").eval()\n    \
                 torch.onnx.export(policy, torch.zeros(1, WIDTH), \"{stem}.onnx\", input_names=[\"obs\"], \
                 output_names=[\"actions\"])\n(WIDTH: numbers of an observation)"
            ),
        )
    } else {
        (
            "a PyTorch checkpoint",
            format!(
                "    import torch; from safetensors.torch import save_file; state = torch.load(\"{name}\", \
                 map_location=\"cpu\", weights_only=False)[\"model_state_dict\"]\n    \
                 save_file({{name: tensor.float().contiguous() for name, tensor in state.items()}}, \
                 \"{stem}.safetensors\")"
            ),
        )
    };
    invalid(format!(
        "{what}, which only PyTorch reads. Convert it in Python:\n{lines}\nand describe the result in a TOML file \
         (docs/policies.md)"
    ))
}
