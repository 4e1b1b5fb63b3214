//! Wheels stand on the road.

use nalgebra::Vector3;

use super::{Rows, Term};
use crate::kernel::Kernel;
use crate::lie::Pose;

/// The road near an object, as a plane in the world: `normal · x = offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// Unit normal, up.
    pub normal: Vector3<f64>,
    /// Height of the plane along the normal, metres.
    pub offset_m: f64,
    /// How well that height is known, metres.
    pub height_sigma_m: f64,
    /// How well its slope is known, radians.
    pub tilt_sigma_rad: f64,
}

/// A combination of vertices whose height over the road should be `0`: the mean of all wheels, or front minus rear,
/// or left minus right.
#[derive(Debug, Clone, PartialEq)]
pub struct Contact {
    /// (vertex, weight).
    pub weights: Vec<(u32, f64)>,
    /// Distance between the groups that are subtracted, metres; 0 for the mean.
    pub lever_m: f64,
}

/// Contacts of a mesh whose wheels touch the ground at `wheels`: their mean height, pitch and roll.
#[must_use]
pub fn contacts(vertices: &[Vector3<f64>], wheels: &[u32]) -> Vec<Contact> {
    if wheels.is_empty() {
        return Vec::new();
    }
    let share = 1.0 / wheels.len() as f64;
    let mut out = vec![Contact { weights: wheels.iter().map(|&v| (v, share)).collect(), lever_m: 0.0 }];
    for axis in [0, 1] {
        let middle = wheels.iter().map(|&v| vertices[v as usize][axis]).sum::<f64>() * share;
        let (far, near): (Vec<u32>, Vec<u32>) = wheels.iter().partition(|&&v| vertices[v as usize][axis] > middle);
        if far.is_empty() || near.is_empty() {
            continue;
        }
        let mean = |group: &[u32]| group.iter().map(|&v| vertices[v as usize][axis]).sum::<f64>() / group.len() as f64;
        let weigh =
            |group: &[u32], sign: f64| group.iter().map(|&v| (v, sign / group.len() as f64)).collect::<Vec<_>>();
        let lever_m = mean(&far) - mean(&near);
        if lever_m > 0.1 {
            out.push(Contact { weights: [weigh(&far, 1.0), weigh(&near, -1.0)].concat(), lever_m });
        }
    }
    out
}

/// A row for each contact.
pub fn ground_rows(
    world_from_object: &Pose,
    vertices: &[Vector3<f64>],
    contacts: &[Contact],
    ground: &Ground,
    kernel: Kernel,
    rows: &mut Rows,
) {
    let up_in_object = world_from_object.rotation.transpose() * ground.normal;
    for contact in contacts {
        let is_mean = contact.lever_m == 0.0;
        let sigma_m = if is_mean { ground.height_sigma_m } else { ground.tilt_sigma_rad * contact.lever_m };
        let height: f64 = contact
            .weights
            .iter()
            .map(|&(v, w)| w * ground.normal.dot(&world_from_object.transform(&vertices[v as usize])))
            .sum();
        let target = if is_mean { ground.offset_m } else { 0.0 };
        let terms = contact.weights.iter().map(|&(vertex, w)| Term { vertex, gradient: up_in_object * (w / sigma_m) });
        rows.push((height - target) / sigma_m, 1.0, kernel, terms);
    }
}
