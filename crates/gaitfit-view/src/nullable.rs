//! NaN and infinities to and from JSON's `null`, which `serde_json` writes but does not read back.

/// One number.
pub mod scalar {
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(x: &f64, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_f64(*x)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(from)?.unwrap_or(f64::NAN))
    }
}

/// A list of numbers.
#[cfg(feature = "pages")]
pub mod list {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(x: &[f64], to: S) -> Result<S::Ok, S::Error> {
        x.serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f64>, D::Error> {
        let list = Vec::<Option<f64>>::deserialize(from)?;
        Ok(list.into_iter().map(|x| x.unwrap_or(f64::NAN)).collect())
    }
}

/// A list of named numbers.
#[cfg(feature = "pages")]
pub mod named {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(x: &[(String, f64)], to: S) -> Result<S::Ok, S::Error> {
        x.serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<(String, f64)>, D::Error> {
        let list = Vec::<(String, Option<f64>)>::deserialize(from)?;
        Ok(list.into_iter().map(|(name, x)| (name, x.unwrap_or(f64::NAN))).collect())
    }
}

/// A fixed number of numbers.
pub mod array {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer, const N: usize>(x: &[f64; N], to: S) -> Result<S::Ok, S::Error> {
        x.as_slice().serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>, const N: usize>(from: D) -> Result<[f64; N], D::Error> {
        let list = Vec::<Option<f64>>::deserialize(from)?;
        let count = list.len();
        let numbers: Vec<f64> = list.into_iter().map(|x| x.unwrap_or(f64::NAN)).collect();
        numbers.try_into().map_err(|_| serde::de::Error::invalid_length(count, &"another count of numbers"))
    }
}
