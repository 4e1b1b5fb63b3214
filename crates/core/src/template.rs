//! A category's mesh with its shape space: V = mean + B z + S d.

use nalgebra::Vector3;

use crate::error::{Error, Result, check_finite, check_length};
use crate::mesh::{Symmetry, Topology, cotangent_weights};
use crate::residuals::ground::{Contact, contacts};
use crate::residuals::normal::MOST_COLUMNS;
use crate::simd::wide;

/// Modes that fit beside a pose and a velocity.
const MOST_MODES: usize = MOST_COLUMNS - 9;

/// A category's mean mesh, its modes, its symmetry and its key points.
#[derive(Debug, Clone, PartialEq)]
pub struct Template {
    /// Faces and edges.
    pub topology: Topology,
    /// Mean vertices in the object's frame.
    pub mean: Vec<Vector3<f64>>,
    /// Displacement of each vertex by each mode at one standard deviation, vertex-major.
    pub modes: Vec<Vector3<f64>>,
    /// How many modes there are.
    pub mode_count: usize,
    /// The same displacements mode by mode: coordinates of all vertices.
    displacements: Vec<[f64; 3]>,
    /// The free-form basis S.
    pub symmetry: Symmetry,
    /// Columns of the key point association A: (vertex, weight) of each key point.
    pub keypoints: Vec<Vec<(u32, f64)>>,
    /// Where the mesh touches the ground.
    pub contacts: Vec<Contact>,
    /// Rows of the normalized cotangent Laplacian at each free vertex: the vertex's neighbours and their shares.
    pub laplacian: Vec<Vec<(u32, f64)>>,
    /// Surface that each free vertex stands for, relative to the mean.
    pub relative_area: Vec<f64>,
}

impl Template {
    /// Put a template together and check it.
    ///
    /// # Errors
    /// [`Error`] with the argument that does not fit.
    pub fn new(
        mean: Vec<Vector3<f64>>,
        faces: &[[i64; 3]],
        modes: Vec<Vector3<f64>>,
        mirror: Option<&[i64]>,
        keypoints: Vec<Vec<(u32, f64)>>,
        wheels: &[i64],
    ) -> Result<Self> {
        let count = mean.len();
        if count == 0 {
            return Err(Error::Range { what: "vertex count", expected: "positive", found: 0.0 });
        }
        check_finite("vertices", mean.iter().flat_map(|v| v.iter().copied()).collect::<Vec<_>>().as_slice())?;
        check_finite("modes", modes.iter().flat_map(|v| v.iter().copied()).collect::<Vec<_>>().as_slice())?;
        check_length("modes", modes.len() % count, 0)?;
        let mode_count = modes.len() / count;
        if mode_count > MOST_MODES {
            return Err(Error::Range { what: "mode count", expected: "at most 55", found: mode_count as f64 });
        }
        let displacements =
            (0..mode_count).flat_map(|k| modes[k..].iter().step_by(mode_count).map(|v| [v.x, v.y, v.z])).collect();
        let topology = Topology::new(count, faces)?;
        let symmetry = Symmetry::new(count, mirror)?;
        for &(vertex, weight) in keypoints.iter().flatten() {
            check_finite("key point weights", &[weight])?;
            if vertex as usize >= count {
                return Err(Error::Index { what: "key point vertex", index: i64::from(vertex), count });
            }
        }
        if let Some(&index) = wheels.iter().find(|&&v| v < 0 || v as usize >= count) {
            return Err(Error::Index { what: "wheel vertex", index, count });
        }
        let wheels: Vec<u32> = wheels.iter().map(|&v| v as u32).collect();
        let weights = cotangent_weights(&topology, &mean);
        let laplacian = laplacian_rows(&topology, &weights, &symmetry);
        let relative_area = relative_areas(&topology, &mean, &symmetry);
        let contacts = contacts(&mean, &wheels);
        Ok(Self {
            mode_count,
            displacements,
            topology,
            mean,
            modes,
            symmetry,
            keypoints,
            contacts,
            laplacian,
            relative_area,
        })
    }

    /// Modes of one vertex.
    #[must_use]
    pub fn modes_of(&self, vertex: usize) -> &[Vector3<f64>] {
        &self.modes[vertex * self.mode_count..(vertex + 1) * self.mode_count]
    }

    /// Vertices of the shape with mode coefficients `z` and free-form displacement `d` (which may be empty).
    #[must_use]
    pub fn vertices(&self, z: &[f64], d: &[f64]) -> Vec<Vector3<f64>> {
        let mut moved: Vec<[f64; 3]> = self.mean.iter().map(|v| [v.x, v.y, v.z]).collect();
        let flat = moved.as_flattened_mut();
        wide(
            #[inline(always)]
            || {
                for (mode, coefficient) in self.displacements.chunks_exact(self.mean.len()).zip(z) {
                    flat.iter_mut().zip(mode.as_flattened()).for_each(|(x, by)| *x = by.mul_add(*coefficient, *x));
                }
            },
        );
        if d.iter().all(|x| *x == 0.0) {
            return moved.into_iter().map(Vector3::from).collect();
        }
        moved.into_iter().enumerate().map(|(i, v)| Vector3::from(v) + self.symmetry.displacement(i, d)).collect()
    }
}

fn laplacian_rows(topology: &Topology, weights: &[f64], symmetry: &Symmetry) -> Vec<Vec<(u32, f64)>> {
    let mut around = vec![Vec::new(); topology.vertex_count];
    for (edge, &w) in topology.edges.iter().zip(weights) {
        let [a, b] = edge.vertices;
        around[a as usize].push((b, w));
        around[b as usize].push((a, w));
    }
    let normalize = |mut row: Vec<(u32, f64)>| {
        row.sort_unstable_by_key(|&(v, _)| v);
        let total: f64 = row.iter().map(|(_, w)| w).sum();
        row.iter_mut().for_each(|(_, w)| *w /= total.max(1e-12));
        row
    };
    symmetry.representative.iter().map(|&v| normalize(std::mem::take(&mut around[v as usize]))).collect()
}

fn relative_areas(topology: &Topology, vertices: &[Vector3<f64>], symmetry: &Symmetry) -> Vec<f64> {
    let mut area = vec![0.0; topology.vertex_count];
    for face in &topology.faces {
        let [a, b, c] = face.map(|i| vertices[i as usize]);
        let third = (b - a).cross(&(c - a)).norm() / 6.0;
        face.iter().for_each(|&i| area[i as usize] += third);
    }
    let mean = area.iter().sum::<f64>() / area.len() as f64;
    symmetry
        .representative
        .iter()
        .map(|&v| if mean > 0.0 { (area[v as usize] / mean).max(0.05) } else { 1.0 })
        .collect()
}
