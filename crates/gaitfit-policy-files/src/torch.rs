//! PyTorch's own files, which are programs or pickles: refused, with the lines that convert them.

use gaitfit_policy::PolicyError;
use gaitfit_policy::invalid;
use std::path::Path;

/// Endings of PyTorch's files.
pub(super) const ENDINGS: [&str; 4] = ["pt", "pth", "jit", "ptl"];

/// Why `bytes` of the file at `path` are not read, and what to do. `width`: numbers of an observation, where they are known.
pub(super) fn refuse(path: &Path, bytes: &[u8], width: Option<usize>) -> PolicyError {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let name = gaitfit_model::shown(&name);
    let stem = name.rsplit_once('.').map_or(name.as_str(), |(stem, _)| stem);
    let holds = |word: &[u8]| bytes.windows(word.len()).any(|window| window == word);
    // TorchScript keeps its program in a folder of the archive. Names of what it holds stand in its pickle.
    let (what, lines, converted) = if holds(b"/code/") {
        let (width, meaning) = match width {
            Some(width) => (width.to_string(), ""),
            None => ("WIDTH".to_owned(), "\n(WIDTH: numbers of an observation)"),
        };
        let remembers = match holds(b"hidden_state") || holds(b"cell_state") {
            true => {
                "\nIt seems to be recurrent and to keep its state to itself, which a graph cannot: export it as ONNX by the \
                 program that trained it, with the states as inputs (h_in, c_in)."
            }
            false => "",
        };
        (
            "TorchScript",
            format!(
                "    import torch; policy = torch.jit.load(\"{name}\", map_location=\"cpu\").eval()\n    \
                 torch.onnx.export(policy, (torch.zeros(1, {width}),), \"{stem}.onnx\", input_names=[\"obs\"], \
                 output_names=[\"actions\"], dynamo=False){meaning}\n(PyTorch before 2.5 does not know dynamo: leave it \
                 out there){remembers}"
            ),
            format!("{stem}.onnx"),
        )
    } else {
        // What trainers call the networks' tensors in their checkpoints.
        let key = [&b"model_state_dict"[..], b"actor_state_dict"].into_iter().find(|key| holds(key));
        let key = key.map_or_else(String::new, |key| format!("[\"{}\"]", String::from_utf8_lossy(key)));
        (
            "a PyTorch checkpoint",
            format!(
                "    import torch; from safetensors.torch import save_file\n    state = torch.load(\"{name}\", \
                 map_location=\"cpu\", weights_only=False){key}\n    save_file({{name: tensor.float().contiguous() for \
                 name, tensor in state.items()}}, \"{stem}.safetensors\")"
            ),
            format!("{stem}.safetensors"),
        )
    };
    let describe = match width {
        Some(_) => format!("and name {converted} as `file`"),
        None => format!("and describe {converted} in a TOML file (docs/policies.md)"),
    };
    invalid(format!("{what}, which only PyTorch reads. Convert it in Python:\n{lines}\n{describe}"))
}
