//! Attributes of a node.

use super::constant::Constant;
use super::node_error::{NodeError, misfit, unread};
use super::proto::{Attribute, Node};
use gaitfit_policy::network::SELU;
use prost::Message;

/// A node's attributes.
pub(super) struct Attributes(Vec<Attribute>);

impl Attributes {
    pub(super) fn decode(node: &Node) -> Result<Self, NodeError> {
        let all = node.attribute.iter().map(|bytes| Attribute::decode(bytes.as_slice()));
        Ok(Self(all.collect::<Result<_, _>>()?))
    }

    fn find(&self, name: &str) -> Option<&Attribute> {
        self.0.iter().find(|attribute| attribute.name == name)
    }

    pub(super) fn text(&self, name: &str) -> &[u8] {
        self.find(name).map_or(b"", |attribute| &attribute.s)
    }

    /// A list of whole numbers.
    pub(super) fn list(&self, name: &str) -> Option<&[i64]> {
        self.find(name).map(|attribute| &attribute.ints[..])
    }

    /// Whether there is an attribute of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.find(name).is_some()
    }

    /// The one number of a list.
    pub(super) fn one_of(&self, name: &str) -> Option<i64> {
        match self.find(name)?.ints[..] {
            [one] => Some(one),
            _ => None,
        }
    }

    pub(super) fn integer(&self, name: &str, default: i64) -> i64 {
        self.find(name).map_or(default, |attribute| attribute.i)
    }

    pub(super) fn number(&self, name: &str, default: f32) -> f32 {
        self.find(name).map_or(default, |attribute| attribute.f)
    }

    /// Alpha and gamma of a `Selu` node if they are not those of SELU.
    pub(super) fn other_selu(&self) -> Option<[f32; 2]> {
        let [alpha, gamma] = SELU.map(|value| value as f32);
        // ONNX's attributes are in single precision, so they are compared in single precision.
        Some([self.number("alpha", alpha), self.number("gamma", gamma)]).filter(|all| *all != [alpha, gamma])
    }

    /// A tensor of numbers; `None` where there is none, or none that is read.
    pub(super) fn tensor(&self, name: &str) -> Option<Constant> {
        Constant::read(self.find(name)?.t.clone()?).ok()
    }

    /// The value of a `Constant` node.
    pub(super) fn constant(&self) -> Result<Constant, NodeError> {
        let attribute =
            self.0.first().filter(|_| self.0.len() == 1).ok_or(unread("it has no single value"))?;
        match (attribute.name.as_str(), &attribute.t) {
            ("value", Some(tensor)) => {
                Constant::read(tensor.clone()).map_err(|error| misfit(error.to_string()))
            }
            ("value_float", _) => Ok(Constant::scalar(f64::from(attribute.f))),
            ("value_int", _) => Ok(Constant { whole: true, ..Constant::scalar(attribute.i as f64) }),
            // `wholes` gives the shape of a list; the flag is set back, because these are divided as real numbers.
            ("value_floats", _) => {
                let values = attribute.floats.iter().map(|&x| f64::from(x)).collect();
                Ok(Constant { whole: false, ..Constant::wholes(values) })
            }
            ("value_ints", _) => Ok(Constant::wholes(attribute.ints.iter().map(|&x| x as f64).collect())),
            _ => Err(unread("its value is not a tensor of numbers")),
        }
    }
}
