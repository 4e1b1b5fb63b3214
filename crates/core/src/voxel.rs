//! Volume overlap of closed meshes on a grid.

use nalgebra::Vector3;

use crate::error::{Error, Result};

/// A grid holds at most this many samples.
const MOST_SAMPLES: f64 = (1u64 << 28) as f64;

/// Step of a grid laid over two meshes, and where its samples lie.
struct Grid {
    origin: Vector3<f64>,
    step: f64,
    counts: [usize; 3],
}

impl Grid {
    fn over(a: &[Vector3<f64>], b: &[Vector3<f64>], step: f64) -> Result<Self> {
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        for p in a.iter().chain(b) {
            low = low.inf(p);
            high = high.sup(p);
        }
        // offsets that keep samples off the round numbers where a mesh's faces like to lie
        let origin = low - Vector3::repeat(0.1137) + Vector3::new(1.7e-4, 3.4e-4, 5.1e-4);
        let span = high + Vector3::repeat(0.1) - (low - Vector3::repeat(0.1137));
        let counts = [span.x, span.y, span.z].map(|s| (s / step).ceil().max(0.0));
        let samples = counts[0] * counts[1] * (counts[2] + 1.0);
        if !(a.is_empty() && b.is_empty() || samples <= MOST_SAMPLES) {
            return Err(Error::Range { what: "samples of the voxel grid", expected: "at most 2^28", found: samples });
        }
        Ok(Self { origin, step, counts: counts.map(|c| c as usize) })
    }

    /// Signed crossings of each vertical line through the grid, where each takes effect.
    fn crossings(&self, vertices: &[Vector3<f64>], faces: &[[u32; 3]]) -> Vec<i32> {
        let [nx, ny, nz] = self.counts;
        let mut change = vec![0i32; nx * ny * (nz + 1)];
        for face in faces {
            let [a, b, c] = face.map(|i| vertices[i as usize]);
            let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
            if area.abs() < 1e-14 {
                continue;
            }
            let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
            let range = |axis: usize| {
                let first = ((low[axis] - self.origin[axis]) / self.step).ceil().max(0.0) as usize;
                let last = ((high[axis] - self.origin[axis]) / self.step).floor().min(self.counts[axis] as f64 - 1.0);
                first..(last + 1.0).max(0.0) as usize
            };
            for i in range(0) {
                for j in range(1) {
                    let (x, y) = (self.origin.x + i as f64 * self.step, self.origin.y + j as f64 * self.step);
                    let w0 = ((b.x - x) * (c.y - y) - (c.x - x) * (b.y - y)) / area;
                    let w1 = ((c.x - x) * (a.y - y) - (a.x - x) * (c.y - y)) / area;
                    if w0 < 0.0 || w1 < 0.0 || w0 + w1 > 1.0 {
                        continue;
                    }
                    let z = w0 * a.z + w1 * b.z + (1.0 - w0 - w1) * c.z;
                    let k = ((z - self.origin.z) / self.step).ceil().clamp(0.0, nz as f64) as usize;
                    change[(i * ny + j) * (nz + 1) + k] += if area > 0.0 { 1 } else { -1 };
                }
            }
        }
        change
    }
}

/// Intersection over union of two closed meshes' volumes in one frame, sampled every `step_m`; 0 if both are empty.
///
/// # Errors
/// [`Error::Range`] if the step is too fine for the meshes' extent.
pub fn voxel_iou(
    vertices_a: &[Vector3<f64>],
    faces_a: &[[u32; 3]],
    vertices_b: &[Vector3<f64>],
    faces_b: &[[u32; 3]],
    step_m: f64,
) -> Result<f64> {
    let grid = Grid::over(vertices_a, vertices_b, step_m)?;
    let (a, b) = (grid.crossings(vertices_a, faces_a), grid.crossings(vertices_b, faces_b));
    let depth = grid.counts[2] + 1;
    let (mut both, mut either) = (0usize, 0usize);
    for (column_a, column_b) in a.chunks_exact(depth).zip(b.chunks_exact(depth)) {
        let (mut wind_a, mut wind_b) = (0, 0);
        for k in 0..grid.counts[2] {
            wind_a += column_a[k];
            wind_b += column_b[k];
            both += usize::from(wind_a != 0 && wind_b != 0);
            either += usize::from(wind_a != 0 || wind_b != 0);
        }
    }
    Ok(both as f64 / either.max(1) as f64)
}
