//! Fixed multi-layer perceptrons.
