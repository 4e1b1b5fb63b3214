//! Normal equations of border pulls, gathered over vertices before pose, modes and free form come in.
//!
//! A pull's derivative over the parameters is gᵀD of its edge's two vertices, D = ∂v/∂(pose, z, velocity, d), so that the
//! normal matrix is Σ Dᵤᵀ Hᵤᵥ Dᵥ with 3 × 3 blocks Hᵤᵥ. Pulls are summed on the image first (2 × 2), over a sample and then
//! over the samples of an edge; the projection comes in once for each edge, D once for each vertex and edge.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

use super::border::{BorderMatch, BorderNoise};
use crate::camera::Camera;
use crate::mesh::Symmetry;
use crate::outline::OutlineSample;
use crate::simd::wide;
use crate::solve::envelope::Envelope;

const NONE: u32 = u32::MAX;

/// Most columns of the dense derivative.
pub const MOST_COLUMNS: usize = 64;

/// Σ w g gᵀ (xx, xy, yy) and Σ w g r of one sample's pulls, over its pixel.
#[derive(Debug, Clone, Copy, Default)]
struct OnImage {
    square: [f64; 3],
    right: Vector2<f64>,
}

/// The same over the pixels of an edge's ends: first with itself, first with second, second with itself.
#[derive(Debug, Clone, Copy, Default)]
struct OnEdge {
    squares: [[f64; 3]; 3],
    right: [Vector2<f64>; 2],
}

/// Two vertices that an edge joins.
#[derive(Debug, Clone, Copy)]
struct Pair {
    slots: [u32; 2],
    block: Matrix3<f64>,
    next: u32,
}

/// Σ w g gᵀ and Σ w g r over the vertices that pulls touch; the buffers are reused.
#[derive(Debug, Clone, Default)]
pub struct VertexNormal {
    slot_of: Vec<u32>,
    vertices: Vec<u32>,
    diagonal: Vec<Matrix3<f64>>,
    right: Vec<Vector3<f64>>,
    pairs: Vec<Pair>,
    first_pair: Vec<u32>,
    on_image: Vec<OnImage>,
    dense: Vec<f64>,
    product: Vec<f64>,
}

/// How a vertex moves with the dense parameters, in the object's frame: with the pose's right perturbation (ρ, φ) by ρ + φ × v,
/// with each mode by its displacement, with a velocity in the world by Rᵀ t.
#[derive(Clone, Copy)]
pub struct Dense<'a> {
    /// Vertices in the object's frame.
    pub vertices: &'a [Vector3<f64>],
    /// Modes, vertex-major, and how many there are.
    pub modes: (&'a [Vector3<f64>], usize),
    /// Rᵀ t, where the velocity is estimated.
    pub velocity: Option<Matrix3<f64>>,
}

impl Dense<'_> {
    /// How many parameters there are.
    #[must_use]
    pub fn columns(&self) -> usize {
        6 + self.modes.1 + if self.velocity.is_some() { 3 } else { 0 }
    }

    /// ∂v/∂(pose, z, velocity) of a vertex, one row an axis.
    #[inline(always)]
    fn derivative<const N: usize>(&self, vertex: u32, rows: &mut [[f64; N]; 3]) {
        let v = self.vertices[vertex as usize];
        *rows = [[0.0; N]; 3];
        let [x, y, z] = rows;
        (x[0], y[1], z[2]) = (1.0, 1.0, 1.0);
        (x[4], x[5]) = (v.z, -v.y);
        (y[3], y[5]) = (-v.z, v.x);
        (z[3], z[4]) = (v.y, -v.x);
        let (modes, count) = self.modes;
        for (k, mode) in modes[vertex as usize * count..(vertex as usize + 1) * count].iter().enumerate() {
            (x[6 + k], y[6 + k], z[6 + k]) = (mode.x, mode.y, mode.z);
        }
        if let Some(moved) = &self.velocity {
            for (axis, row) in rows.iter_mut().enumerate() {
                (0..3).for_each(|k| row[6 + count + k] = moved[(axis, k)]);
            }
        }
    }
}

/// How a vertex moves with the free-form parameters: along the symmetry basis, each at its place in the normal equations.
#[derive(Clone, Copy)]
pub struct FreeForm<'a> {
    /// The basis.
    pub symmetry: &'a Symmetry,
    /// Where each of its degrees of freedom stands.
    pub position: &'a [usize],
}

impl VertexNormal {
    /// Forget all pulls; for a mesh of so many vertices.
    pub fn clear(&mut self, vertex_count: usize) {
        self.slot_of.clear();
        self.slot_of.resize(vertex_count, NONE);
        self.vertices.clear();
        self.diagonal.clear();
        self.right.clear();
        self.pairs.clear();
        self.first_pair.clear();
    }

    /// Add a view's border; its cost. Vertices are given in the camera's frame.
    pub fn add_border(
        &mut self,
        camera: &Camera,
        rotation: &Matrix3<f64>,
        points_in_camera: &[Vector3<f64>],
        samples: &[OutlineSample],
        border: &BorderMatch,
        noise: &BorderNoise,
    ) -> f64 {
        let cost = self.sum_on_image(samples.len(), border, noise);
        let mut at = 0;
        while at < samples.len() {
            let (first, end) = (&samples[at], at + run(&samples[at..]));
            let mut sum = OnEdge::default();
            samples[at..end].iter().zip(&self.on_image[at..end]).for_each(|(s, pulls)| sum.add(s.share, pulls));
            let [a, b] = first.vertices.map(|v| points_in_camera[v as usize]);
            let ends = if first.cut { [a.lerp(&b, first.share); 2] } else { [a, b] };
            let jacobians = ends.map(|p| camera.projection_jacobian(&p) * rotation / noise.sigma_px);
            self.add_edge(first.vertices, &jacobians, &sum);
            at = end;
        }
        border.constant + cost
    }

    fn sum_on_image(&mut self, samples: usize, border: &BorderMatch, noise: &BorderNoise) -> f64 {
        self.on_image.clear();
        self.on_image.resize(samples, OnImage::default());
        let mut cost = 0.0;
        for pull in &border.pulls {
            let squared = pull.residual * pull.residual;
            cost += 0.5 * pull.weight * noise.kernel.loss(squared);
            let g = pull.direction;
            let weighted = g * (pull.weight * noise.kernel.weight(squared));
            let sum = &mut self.on_image[pull.sample as usize];
            sum.square[0] += weighted.x * g.x;
            sum.square[1] += weighted.x * g.y;
            sum.square[2] += weighted.y * g.y;
            sum.right += weighted * pull.residual;
        }
        cost
    }

    fn add_edge(&mut self, vertices: [u32; 2], jacobians: &[Matrix2x3<f64>; 2], sum: &OnEdge) {
        let slots = vertices.map(|v| self.slot(v));
        let pair = self.pair(slots);
        let [p, q] = jacobians;
        let [pp, pq, qq] = sum.squares.map(|[xx, xy, yy]| Matrix2::new(xx, xy, xy, yy));
        let [a, b] = slots.map(|slot| slot as usize);
        self.diagonal[a] += p.transpose() * (pp * p);
        self.diagonal[b] += q.transpose() * (qq * q);
        self.pairs[pair].block += p.transpose() * (pq * q);
        self.right[a] += p.transpose() * sum.right[0];
        self.right[b] += q.transpose() * sum.right[1];
    }

    #[inline]
    fn slot(&mut self, vertex: u32) -> u32 {
        let found = self.slot_of[vertex as usize];
        if found != NONE {
            return found;
        }
        let slot = self.vertices.len() as u32;
        self.slot_of[vertex as usize] = slot;
        self.vertices.push(vertex);
        self.diagonal.push(Matrix3::zeros());
        self.right.push(Vector3::zeros());
        self.first_pair.push(NONE);
        slot
    }

    /// Number of the pair (a, b); pairs of one first vertex are a list.
    fn pair(&mut self, [a, b]: [u32; 2]) -> usize {
        let mut at = self.first_pair[a as usize];
        while at != NONE && self.pairs[at as usize].slots[1] != b {
            at = self.pairs[at as usize].next;
        }
        if at == NONE {
            at = self.pairs.len() as u32;
            self.pairs.push(Pair { slots: [a, b], block: Matrix3::zeros(), next: self.first_pair[a as usize] });
            self.first_pair[a as usize] = at;
        }
        at as usize
    }

    /// Add to normal equations: free-form parameters at their places, dense ones from row `base` on, [`MOST_COLUMNS`] at most.
    pub fn gather(
        &mut self,
        dense: &Dense,
        free_form: Option<&FreeForm>,
        base: usize,
        hessian: &mut Envelope,
        gradient: &mut [f64],
    ) {
        match dense.columns() {
            0..=8 => self.gather_dense::<8>(dense, base, hessian, gradient),
            9..=16 => self.gather_dense::<16>(dense, base, hessian, gradient),
            17..=24 => self.gather_dense::<24>(dense, base, hessian, gradient),
            25..=32 => self.gather_dense::<32>(dense, base, hessian, gradient),
            _ => self.gather_dense::<MOST_COLUMNS>(dense, base, hessian, gradient),
        }
        if let Some(free_form) = free_form {
            self.gather_free_form(free_form, dense.columns(), base, hessian, gradient);
        }
    }

    fn gather_dense<const N: usize>(
        &mut self,
        dense: &Dense,
        base: usize,
        hessian: &mut Envelope,
        gradient: &mut [f64],
    ) {
        let (columns, size) = (dense.columns(), 3 * N * self.vertices.len());
        self.dense.resize(size, 0.0);
        self.product.resize(size, 0.0);
        let (rows, _) = self.dense.as_chunks_mut::<N>();
        let (products, _) = self.product.as_chunks_mut::<N>();
        let (rows, _) = rows.as_chunks_mut::<3>();
        let (products, _) = products.as_chunks_mut::<3>();
        let (mut sum, mut right) = ([[0.0; N]; N], [0.0; N]);
        let (vertices, diagonal, pairs, forces) = (&self.vertices, &self.diagonal, &self.pairs, &self.right);
        wide(
            #[inline(always)]
            || {
                for ((rows, product), (&vertex, block)) in
                    rows.iter_mut().zip(products.iter_mut()).zip(vertices.iter().zip(diagonal))
                {
                    dense.derivative(vertex, rows);
                    *product = [[0.0; N]; 3];
                    add_product(block, rows, product);
                }
                for pair in pairs {
                    let [a, b] = pair.slots.map(|s| s as usize);
                    add_product(&pair.block, &rows[b], &mut products[a]);
                    add_product(&pair.block.transpose(), &rows[a], &mut products[b]);
                }
                add_outer(rows, products, columns, &mut sum);
                for (rows, force) in rows.iter().zip(forces) {
                    for axis in 0..3 {
                        for i in 0..N {
                            right[i] = force[axis].mul_add(rows[axis][i], right[i]);
                        }
                    }
                }
            },
        );
        for i in 0..columns {
            gradient[base + i] += right[i];
            hessian.run_mut(base + i, base, i + 1).iter_mut().zip(&sum[i]).for_each(|(h, s)| *h += s);
        }
    }

    /// Free form with itself and with the dense parameters, whose products H D are there from [`Self::gather_dense`].
    fn gather_free_form(
        &self,
        free_form: &FreeForm,
        columns: usize,
        base: usize,
        hessian: &mut Envelope,
        gradient: &mut [f64],
    ) {
        let Some(width) = self.product.len().checked_div(self.vertices.len()).map(|size| size / 3) else { return };
        let freedoms = |slot: usize| {
            let of_vertex = free_form.symmetry.freedoms(self.vertices[slot] as usize);
            of_vertex.map(|(dof, axis, sign)| (free_form.position[dof], axis, sign))
        };
        let mut add = |a: usize, b: usize, block: &Matrix3<f64>| {
            for (i, k, s) in freedoms(a) {
                for (j, l, t) in freedoms(b).filter(|&(j, _, _)| j <= i) {
                    hessian.add(i, j, s * t * block[(k, l)]);
                }
            }
        };
        self.diagonal.iter().enumerate().for_each(|(slot, block)| add(slot, slot, block));
        for Pair { slots: [a, b], block, .. } in &self.pairs {
            add(*a as usize, *b as usize, block);
            add(*b as usize, *a as usize, &block.transpose());
        }
        for (slot, product) in self.product.chunks_exact(3 * width).enumerate() {
            for (i, axis, sign) in freedoms(slot) {
                gradient[i] += sign * self.right[slot][axis];
                let row = &product[axis * width..axis * width + columns];
                row.iter().enumerate().for_each(|(k, value)| hessian.add(base + k, i, sign * value));
            }
        }
    }
}

/// How many samples from the first on are moved by the same two pixels: those of its edge; of an edge that the near plane
/// cuts, each sample by its own.
fn run(samples: &[OutlineSample]) -> usize {
    let first = &samples[0];
    if first.cut { 1 } else { samples.iter().take_while(|s| s.vertices == first.vertices && !s.cut).count() }
}

impl OnEdge {
    /// Add a sample with a share of the second end.
    #[inline]
    fn add(&mut self, share: f64, pulls: &OnImage) {
        let shares = [1.0 - share, share];
        let products = [shares[0] * shares[0], shares[0] * shares[1], shares[1] * shares[1]];
        for (sum, product) in self.squares.iter_mut().zip(products) {
            sum.iter_mut().zip(&pulls.square).for_each(|(s, value)| *s += product * value);
        }
        for (sum, share) in self.right.iter_mut().zip(shares) {
            *sum += pulls.right * share;
        }
    }
}

/// product += block · rows.
#[inline(always)]
fn add_product<const N: usize>(block: &Matrix3<f64>, rows: &[[f64; N]; 3], product: &mut [[f64; N]; 3]) {
    for (k, out) in product.iter_mut().enumerate() {
        let [x, y, z] = [block[(k, 0)], block[(k, 1)], block[(k, 2)]];
        for i in 0..N {
            out[i] = x.mul_add(rows[0][i], y.mul_add(rows[1][i], z.mul_add(rows[2][i], out[i])));
        }
    }
}

/// Rows and columns of a block of the sum that fits the registers.
const BLOCK: [usize; 2] = [4, 8];

/// sum += Σ leftᵀ rows over vertices, block by block up to the diagonal: what lies beyond it is not read.
#[inline(always)]
fn add_outer<const N: usize>(left: &[[[f64; N]; 3]], rows: &[[[f64; N]; 3]], columns: usize, sum: &mut [[f64; N]; N]) {
    for i in (0..columns).step_by(BLOCK[0]) {
        for j in (0..=i).step_by(BLOCK[1]) {
            let mut block = [[0.0; BLOCK[1]]; BLOCK[0]];
            for (a, b) in left.iter().zip(rows) {
                for axis in 0..3 {
                    let (x, y) = (&a[axis][i..i + BLOCK[0]], &b[axis][j..j + BLOCK[1]]);
                    for k in 0..BLOCK[0] {
                        for l in 0..BLOCK[1] {
                            block[k][l] = x[k].mul_add(y[l], block[k][l]);
                        }
                    }
                }
            }
            for (k, row) in block.iter().enumerate() {
                sum[i + k][j..j + BLOCK[1]].iter_mut().zip(row).for_each(|(s, value)| *s += value);
            }
        }
    }
}
