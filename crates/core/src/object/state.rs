//! Where an object is and what it looks like.

use nalgebra::Vector3;

use crate::error::{Result, check_length};
use crate::lie::Pose;
use crate::template::Template;

/// An object: where it is and what it looks like.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectState {
    /// Its pose.
    pub world_from_object: Pose,
    /// Mode coefficients, in standard deviations.
    pub z: Vec<f64>,
    /// Free-form displacement, metres; one entry a degree of freedom of the symmetry basis.
    pub d: Vec<f64>,
    /// Its velocity in the world, m/s: `world_from_object` holds at time 0.
    pub velocity: Vector3<f64>,
}

impl ObjectState {
    /// The pose at another time.
    #[must_use]
    pub fn pose_at(&self, time_s: f64) -> Pose {
        let Pose { rotation, translation } = self.world_from_object;
        Pose { rotation, translation: translation + self.velocity * time_s }
    }

    /// Check that the shape is one of this template's.
    pub(super) fn check(&self, template: &Template) -> Result<()> {
        check_length("mode coefficients", self.z.len(), template.mode_count)?;
        check_length("free-form displacement", self.d.len(), template.symmetry.dimension())
    }
}
