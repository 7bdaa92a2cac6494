//! Networks of joints as ONNX and as NumPy's arrays, with rest angle and scales inside.

use gaitfit_adapt::{NETWORK_LAYERS as LAYERS, SavedNetwork, ThetaFile};
use gaitfit_policy::network::{Activation, Network, Shape};
use gaitfit_policy_files::onnx;
use gaitfit_settings::Error;
use std::io::{Cursor, Write};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// Loads networks.npz.
const LOADER: &str = include_str!("networks.py");

/// The files of the networks: one ONNX model each, all in one npz archive, and its loader. None without networks.
pub(super) fn files(file: &ThetaFile) -> Result<Vec<(String, Vec<u8>)>, Error> {
    if file.network.is_empty() {
        return Ok(Vec::new());
    }
    let failed = |error: &dyn std::fmt::Display| Error::failed(format!("cannot write networks: {error}"));
    let names = names(&file.network);
    let mut out = Vec::new();
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, network) in names.iter().zip(&file.network) {
        let parts = Parts::new(network)?;
        out.push((format!("{name}.onnx"), parts.onnx(name)?));
        for (part, shape, values) in parts.arrays() {
            // Files of an archive carry no time: the same fit gives the same bytes.
            let plain = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
            archive.start_file(format!("{name}/{part}.npy"), plain).map_err(|error| failed(&error))?;
            let bytes = npy(&shape, values).map_err(|error| failed(&error))?;
            archive.write_all(&bytes).map_err(|error| failed(&error))?;
        }
    }
    let archive = archive.finish().map_err(|error| failed(&error))?.into_inner();
    out.push(("networks.npz".to_owned(), archive));
    out.push(("networks.py".to_owned(), LOADER.as_bytes().to_vec()));
    Ok(out)
}

/// Names that files may have, one a network.
fn names(networks: &[SavedNetwork]) -> Vec<String> {
    let mut names: Vec<String> = Vec::with_capacity(networks.len());
    for (number, network) in networks.iter().enumerate() {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' || c == '-' { c } else { '_' };
        // Most file systems take names of 255 bytes at most.
        let mut name: String = network.name.chars().take(100).map(plain).collect();
        // An empty name, or one that is taken, gets the network's number. Some file systems take `a` and `A` for one.
        while name.is_empty() || names.iter().any(|taken| taken.eq_ignore_ascii_case(&name)) {
            name = format!("{name}_{number}");
        }
        names.push(name);
    }
    names
}

/// A network as other programs evaluate it: inputs times factors plus offsets, then its layers.
struct Parts {
    factor: Vec<f64>,
    offset: Vec<f64>,
    /// Weights and biases of each layer; the output's unit is folded into the last.
    layers: Vec<(Vec<f64>, Vec<f64>)>,
}

impl Parts {
    fn new(network: &SavedNetwork) -> Result<Parts, Error> {
        let mut rest = network.weights.as_slice();
        let mut layers = Vec::new();
        // Weights lie layer by layer, a layer's matrix before its biases.
        for (inputs, outputs) in LAYERS {
            let wrong =
                || Error::failed(format!("network `{}` has {} weights", network.name, network.weights.len()));
            let (weights, after) = rest.split_at_checked(inputs * outputs).ok_or_else(wrong)?;
            let (biases, after) = after.split_at_checked(outputs).ok_or_else(wrong)?;
            layers.push((weights.to_vec(), biases.to_vec()));
            rest = after;
        }
        // The last layer is linear, so the output's unit can be part of its weights.
        if let Some((weights, biases)) = layers.last_mut() {
            weights.iter_mut().chain(biases).for_each(|weight| *weight *= network.output_scale);
        }
        // The inputs are position and velocity, three times over.
        let factor = [network.position_scale, network.velocity_scale].repeat(3);
        let offset = [-network.rest * network.position_scale, 0.0].repeat(3);
        Ok(Parts { factor, offset, layers })
    }

    fn onnx(&self, name: &str) -> Result<Vec<u8>, Error> {
        let all = self.layers.iter().flat_map(|(weights, biases)| weights.iter().chain(biases));
        // The ONNX model is of single precision; the archive keeps double precision.
        let parameters: Vec<f32> = all.map(|weight| *weight as f32).collect();
        let (inputs, outputs) = (LAYERS[0].0, LAYERS[2].1);
        let hidden = vec![LAYERS[0].1, LAYERS[1].1];
        let shape = Shape { inputs, hidden, outputs, activation: Activation::Tanh };
        let network = Network::new(shape, &parameters)
            .map_err(|error| Error::failed(format!("network `{name}`: {error}")))?;
        let scale: Vec<(f32, f32)> = self
            .factor
            .iter()
            .zip(&self.offset)
            .map(|(factor, offset)| (*factor as f32, *offset as f32))
            .collect();
        Ok(onnx::write_network(name, &network, &scale)?)
    }

    /// Names, shapes and values.
    fn arrays(&self) -> Vec<(String, Vec<u64>, &[f64])> {
        let mut out: Vec<(String, Vec<u64>, &[f64])> = vec![
            ("factor".to_owned(), vec![self.factor.len() as u64], &self.factor),
            ("offset".to_owned(), vec![self.offset.len() as u64], &self.offset),
        ];
        for (number, ((inputs, outputs), (weights, biases))) in LAYERS.iter().zip(&self.layers).enumerate() {
            out.push((format!("w{number}"), vec![*inputs as u64, *outputs as u64], weights));
            out.push((format!("b{number}"), vec![*outputs as u64], biases));
        }
        out
    }
}

/// A file of NumPy's format with numbers in row-major order.
fn npy(shape: &[u64], values: &[f64]) -> std::io::Result<Vec<u8>> {
    use npyz::WriterBuilder;
    let mut out = Vec::new();
    let mut writer =
        npyz::WriteOptions::<f64>::new().default_dtype().shape(shape).writer(&mut out).begin_nd()?;
    writer.extend(values.iter().copied())?;
    writer.finish()?;
    Ok(out)
}
