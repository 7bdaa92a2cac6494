//! Numbers of tensors in a file beside the graph's, as PyTorch's exporter writes them by default.

use super::decoded::decode_message;
use super::proto::{Entry, Tensor};
use crate::file::bytes;
use gaitfit_model::shown;
use gaitfit_policy::PolicyError;
use gaitfit_policy::invalid;
use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

/// Max number of entries that say where a tensor lies, and of files that tensors lie in.
const MAX_PARTS: usize = 16;
/// Max number of bytes of all tensors that lie in other files: as many as one policy file may have.
const MAX_BYTES: usize = 32 << 20;

/// Where a tensor's bytes lie.
pub(super) struct Place {
    /// The file, relative to the graph's folder.
    pub file: PathBuf,
    offset: usize,
    /// Bytes; to the file's end where the graph does not say.
    length: Option<usize>,
}

/// Where `tensor` lies; `None` if the graph's own file holds it.
///
/// # Errors
/// Entries that are damaged, and files outside the graph's folder.
pub(super) fn place(tensor: &Tensor) -> Result<Option<Place>, PolicyError> {
    if tensor.data_location == 0 {
        return Ok(None);
    }
    let name = shown(&tensor.name);
    if tensor.external_data.len() > MAX_PARTS {
        return Err(invalid(format!("tensor {name} has more than {MAX_PARTS} entries of external data")));
    }
    let mut place = Place { file: PathBuf::new(), offset: 0, length: None };
    for entry in &tensor.external_data {
        let entry: Entry = decode_message(entry, "external data")?;
        let number = || {
            entry.value.parse::<usize>().map_err(|_| {
                let (key, value) = (shown(&entry.key), shown(&entry.value));
                invalid(format!(
                    "tensor {name}: `{key}` of its external data is `{value}`, not a number of bytes"
                ))
            })
        };
        match entry.key.as_str() {
            "location" => place.file = PathBuf::from(&entry.value),
            "offset" => place.offset = number()?,
            "length" => place.length = Some(number()?),
            // ONNX also has a `checksum` here, which is not needed.
            _ => {}
        }
    }
    // A policy's file must not make this program read any other file of the machine.
    let mut parts = place.file.components().filter(|part| *part != Component::CurDir).peekable();
    if parts.peek().is_none() || !parts.all(|part| matches!(part, Component::Normal(_))) {
        return Err(invalid(format!(
            "the numbers of tensor {name} lie in `{}`, which is not a file in the folder of the ONNX file: such files are \
             not read. Export the model again",
            shown(&place.file.display().to_string())
        )));
    }
    Ok(Some(place))
}

/// The files beside a graph, each read once.
pub(super) struct Beside<'a> {
    folder: Option<&'a Path>,
    files: HashMap<PathBuf, Vec<u8>>,
    /// Bytes that tensors took so far.
    taken: usize,
}

impl<'a> Beside<'a> {
    /// Files in `folder`; without one there are no other files.
    pub fn new(folder: Option<&'a Path>) -> Self {
        Self { folder, files: HashMap::new(), taken: 0 }
    }

    /// Gives a tensor that lies in another file its bytes.
    ///
    /// # Errors
    /// A file that is missing, too large or cut short.
    pub fn fill(&mut self, tensor: &mut Tensor) -> Result<(), PolicyError> {
        if tensor.data_location == 0 {
            return Ok(());
        }
        let name = shown(&tensor.name);
        let Some(folder) = self.folder else {
            return Err(invalid(format!(
                "the numbers of tensor {name} lie in another file; give the policy by its path, or export the model as one \
                 file (external_data=False)"
            )));
        };
        let Some(Place { file, offset, length }) = place(tensor)? else { return Ok(()) };
        let shown_file = shown(&file.display().to_string());
        // All tensors usually lie in one file, at different offsets.
        if !self.files.contains_key(&file) {
            // Each file stays in memory until the whole graph is read.
            if self.files.len() == MAX_PARTS {
                return Err(invalid(format!("its tensors lie in more than {MAX_PARTS} files")));
            }
            let content = bytes(&folder.join(&file)).map_err(|error| {
                invalid(format!(
                    "the numbers of tensor {name} lie in another file: {error}. Keep that file beside the ONNX file under \
                     this name, or export the model as one file (external_data=False)"
                ))
            })?;
            self.files.insert(file.clone(), content);
        }
        let all = self.files.get(&file).map_or(&[][..], Vec::as_slice);
        // Without a length the tensor takes the file to its end.
        let end = length.map_or(Some(all.len()), |length| offset.checked_add(length));
        let Some(found) = end.and_then(|end| all.get(offset..end)) else {
            return Err(invalid(format!(
                "the numbers of tensor {name} lie beyond the end of {shown_file}, which has {} bytes: it is cut short, or \
                 another export's. Export the model again",
                all.len()
            )));
        };
        self.taken += found.len();
        if self.taken > MAX_BYTES {
            return Err(invalid(format!(
                "its tensors have more than {} MiB, no policy of a legged robot",
                MAX_BYTES >> 20
            )));
        }
        // From here on the tensor is like one that the graph's own file holds.
        tensor.raw_data = found.to_vec();
        tensor.data_location = 0;
        Ok(())
    }
}
