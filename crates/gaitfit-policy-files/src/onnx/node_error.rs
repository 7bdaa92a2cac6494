//! Why a node of a graph is not read.

use std::borrow::Cow;

/// Why a node is not read: a sentence part that follows the node's name.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum NodeError {
    /// The node's attributes are no whole messages.
    #[error("its attributes are damaged ({0})")]
    Damaged(#[from] prost::DecodeError),
    /// A part that must be known before the graph runs is computed by it.
    #[error("{0}")]
    NotConstant(&'static str),
    /// Numbers, shapes or names that do not go together, or more of them than a limit allows.
    #[error("{0}")]
    Misfit(Cow<'static, str>),
    /// An operator, attribute or arrangement that is not read.
    #[error("{0}")]
    Unread(Cow<'static, str>),
}

/// A [`NodeError::Misfit`].
pub(super) fn misfit(why: impl Into<Cow<'static, str>>) -> NodeError {
    NodeError::Misfit(why.into())
}

/// A [`NodeError::Unread`].
pub(super) fn unread(why: impl Into<Cow<'static, str>>) -> NodeError {
    NodeError::Unread(why.into())
}
