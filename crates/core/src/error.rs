//! What can be wrong with an input.

use thiserror::Error;

/// An input that cannot be used; the message says which, where, and what was expected.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Error {
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {index}, but the mesh has {vertices} vertices")]
    FaceIndex {
        /// Row of the face.
        face: usize,
        /// The index that it holds.
        index: i64,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A value is NaN or infinite.
    #[error("{what} must be finite, but entry {index} is {value}")]
    NotFinite {
        /// The argument's name.
        what: &'static str,
        /// Flat index of the first bad entry.
        index: usize,
        /// The bad value.
        value: f64,
    },
    /// An index is out of range.
    #[error("{what} {index} is out of range: there are {count}")]
    Index {
        /// What is indexed.
        what: &'static str,
        /// The index.
        index: i64,
        /// How many there are.
        count: usize,
    },
    /// Two arguments do not fit each other.
    #[error("{what} has {found} entries, expected {expected}")]
    Length {
        /// The argument's name.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it must have.
        expected: usize,
    },
    /// A value is outside the range in which it means something.
    #[error("{what} must be {expected}, found {found}")]
    Range {
        /// The argument's name.
        what: &'static str,
        /// What is allowed.
        expected: &'static str,
        /// The value found.
        found: f64,
    },
    /// The normal matrix has no Cholesky factor.
    #[error("the normal matrix is not positive definite at row {row}: nothing holds this parameter")]
    NotPositiveDefinite {
        /// The first row that failed.
        row: usize,
    },
}

/// Result of the core.
pub type Result<T> = std::result::Result<T, Error>;

/// Check that every entry of a slice is finite.
///
/// # Errors
/// [`Error::NotFinite`] with the first entry that is not.
pub fn check_finite(what: &'static str, values: &[f64]) -> Result<()> {
    match values.iter().position(|x| !x.is_finite()) {
        Some(index) => Err(Error::NotFinite { what, index, value: values[index] }),
        None => Ok(()),
    }
}

/// Check that an argument has the length that the others ask for.
///
/// # Errors
/// [`Error::Length`] if it has not.
pub fn check_length(what: &'static str, found: usize, expected: usize) -> Result<()> {
    if found == expected { Ok(()) } else { Err(Error::Length { what, found, expected }) }
}
