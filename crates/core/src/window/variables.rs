//! Variables at their values.

use nalgebra::Matrix3;

use crate::error::{Error, Result, check_finite};
use crate::lie::{Pose, log_so3};

/// A variable's value.
#[derive(Debug, Clone, PartialEq)]
pub enum Variable {
    /// A rigid transform.
    Pose(Pose),
    /// A rotation.
    Rotation(Matrix3<f64>),
    /// Numbers.
    Vector(Vec<f64>),
}

/// Variables by their numbers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Variables(Vec<(u64, Variable)>);

impl Variable {
    /// How many numbers a step has.
    #[must_use]
    pub fn width(&self) -> usize {
        match self {
            Self::Pose(_) => 6,
            Self::Rotation(_) => 3,
            Self::Vector(values) => values.len(),
        }
    }

    /// The step from here to another value of the same kind; nothing is written if it is of another.
    pub(super) fn step_to(&self, other: &Self, out: &mut [f64]) {
        match (self, other) {
            (Self::Pose(from), Self::Pose(to)) => {
                let step = from.inverse().compose(to).log();
                out[..3].copy_from_slice(&step.as_slice()[3..]);
                out[3..].copy_from_slice(&step.as_slice()[..3]);
            }
            (Self::Rotation(from), Self::Rotation(to)) => {
                out.copy_from_slice(log_so3(&(from.transpose() * to)).as_slice());
            }
            (Self::Vector(from), Self::Vector(to)) => {
                out.iter_mut().zip(to.iter().zip(from)).for_each(|(step, (to, from))| *step = to - from);
            }
            _ => {}
        }
    }

    /// Whether a step from here to the other exists.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        std::mem::discriminant(self) == std::mem::discriminant(other) && self.width() == other.width()
    }

    fn numbers(&self) -> Vec<f64> {
        match self {
            Self::Pose(pose) => pose.rotation.iter().chain(pose.translation.iter()).copied().collect(),
            Self::Rotation(rotation) => rotation.iter().copied().collect(),
            Self::Vector(values) => values.clone(),
        }
    }
}

impl Variables {
    /// Take variables in any order.
    ///
    /// # Errors
    /// [`Error`] for a value that is not finite, or a number that two variables have.
    pub fn new(mut variables: Vec<(u64, Variable)>) -> Result<Self> {
        variables.sort_by_key(|(name, _)| *name);
        for (_, variable) in &variables {
            check_finite("a variable", &variable.numbers())?;
        }
        if let Some(pair) = variables.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let found = pair[0].0 as f64;
            return Err(Error::Range { what: "number of a variable", expected: "given once", found });
        }
        Ok(Self(variables))
    }

    /// The variable of a number.
    ///
    /// # Errors
    /// [`Error::Index`] if there is none.
    pub fn get(&self, name: u64) -> Result<&Variable> {
        match self.0.binary_search_by_key(&name, |(name, _)| *name) {
            Ok(at) => Ok(&self.0[at].1),
            Err(_) => Err(Error::Index { what: "variable", index: name as i64, count: self.0.len() }),
        }
    }
}
