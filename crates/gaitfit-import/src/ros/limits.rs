//! Bounds of messages and their definitions: what is larger is refused before it takes memory.

/// Largest definition, bytes.
pub(super) const MAX_BYTES: usize = 1 << 20;
/// Max number of types in a definition.
pub(super) const MAX_TYPES: usize = 2000;
/// Max number of fields in a definition.
pub(super) const MAX_FIELDS: usize = 20_000;
/// Longest name of a type or a field, bytes. A package's name is repeated in those of all its types.
pub(super) const MAX_NAME: usize = 256;
/// Deepest type in types.
pub(super) const DEEPEST: usize = 32;
/// Max number of topics of a bag.
pub(super) const MAX_TOPICS: usize = 10_000;
/// Largest message in JSON, bytes: decoded it takes some thirty times as much.
pub(super) const MAX_JSON: usize = 8 << 20;
