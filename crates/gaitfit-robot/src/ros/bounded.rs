//! Sequences and names of messages that anyone may send: bounded before they are kept.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

/// Max elements of a sequence. The longest one needed is a `Float64MultiArray` of 35 motors with 5 numbers each: 175.
pub const MAX_ITEMS: usize = 256;
/// Max length of a name, bytes.
pub const MAX_NAME: usize = 64;

/// At most [`MAX_ITEMS`] elements.
pub(super) fn items<'de, T: Deserialize<'de>, D: Deserializer<'de>>(from: D) -> Result<Vec<T>, D::Error> {
    struct Items<T>(PhantomData<T>);

    impl<'de, T: Deserialize<'de>> Visitor<'de> for Items<T> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "at most {MAX_ITEMS} elements")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut from: A) -> Result<Vec<T>, A::Error> {
            // Grows as elements come: the length that a message states is not trusted.
            let mut all = Vec::new();
            while let Some(item) = from.next_element()? {
                if all.len() == MAX_ITEMS {
                    return Err(A::Error::custom(format!("a sequence has more than {MAX_ITEMS} elements")));
                }
                all.push(item);
            }
            Ok(all)
        }
    }

    from.deserialize_seq(Items(PhantomData))
}

/// A name of at most [`MAX_NAME`] bytes.
struct Name(String);

impl<'de> Deserialize<'de> for Name {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        name(from).map(Self)
    }
}

/// A name of at most [`MAX_NAME`] bytes.
pub(super) fn name<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    struct Text;

    impl Visitor<'_> for Text {
        type Value = String;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "a name of at most {MAX_NAME} bytes")
        }

        fn visit_str<E: Error>(self, text: &str) -> Result<String, E> {
            match text.len() <= MAX_NAME {
                true => Ok(text.to_owned()),
                false => Err(E::custom(format!("a name has {} bytes; at most {MAX_NAME}", text.len()))),
            }
        }
    }

    from.deserialize_str(Text)
}

/// At most [`MAX_ITEMS`] names.
pub(super) fn names<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<String>, D::Error> {
    Ok(items::<Name, D>(from)?.into_iter().map(|Name(text)| text).collect())
}
