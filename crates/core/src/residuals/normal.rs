//! Normal equations of rows that touch two vertices each, gathered over vertices before pose and modes come in.
//!
//! A row's derivative over pose and modes is gᵀD of its vertices, D = ∂v/∂(pose, z) = (I, −v×, B), so that the normal matrix
//! is Σ Dᵤᵀ Hᵤᵥ Dᵥ with 3 × 3 blocks Hᵤᵥ. A thousand rows of a border touch a hundred vertices: Hᵤᵥ is small work for each
//! row, and D comes in once for each pair of neighbours.

use nalgebra::{Matrix3, Vector3};

use super::{Row, Term};
use crate::solve::envelope::Envelope;
use crate::template::Template;

const NONE: u32 = u32::MAX;

/// Two vertices that rows touch together.
#[derive(Debug, Clone, Copy)]
struct Pair {
    slots: [u32; 2],
    block: Matrix3<f64>,
    next: u32,
}

/// Σ w g gᵀ and Σ w g r over the vertices that rows touch.
#[derive(Debug, Clone)]
pub struct VertexNormal {
    slot_of: Vec<u32>,
    vertices: Vec<u32>,
    diagonal: Vec<Matrix3<f64>>,
    gradient: Vec<Vector3<f64>>,
    pairs: Vec<Pair>,
    first_pair: Vec<u32>,
    last: u32,
}

impl VertexNormal {
    /// Nothing yet, for a mesh of so many vertices.
    #[must_use]
    pub fn new(vertex_count: usize) -> Self {
        Self {
            slot_of: vec![NONE; vertex_count],
            vertices: Vec::new(),
            diagonal: Vec::new(),
            gradient: Vec::new(),
            pairs: Vec::new(),
            first_pair: Vec::new(),
            last: NONE,
        }
    }

    /// Add a row with its two terms.
    #[inline]
    pub fn add(&mut self, row: &Row, first: &Term, second: &Term) {
        let weight = row.weight * row.kernel.weight(row.residual * row.residual);
        if weight == 0.0 {
            return;
        }
        let (a, b) = (self.slot(first.vertex), self.slot(second.vertex));
        let pair = self.pair(a, b);
        let (g, h) = (first.gradient * weight, second.gradient * weight);
        self.diagonal[a as usize] += g * first.gradient.transpose();
        self.diagonal[b as usize] += h * second.gradient.transpose();
        self.pairs[pair as usize].block += g * second.gradient.transpose();
        self.gradient[a as usize] += g * row.residual;
        self.gradient[b as usize] += h * row.residual;
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
        self.gradient.push(Vector3::zeros());
        self.first_pair.push(NONE);
        slot
    }

    /// Number of the pair (a, b); pairs of one first vertex are a list.
    #[inline]
    fn pair(&mut self, a: u32, b: u32) -> u32 {
        if self.last != NONE && self.pairs[self.last as usize].slots == [a, b] {
            return self.last;
        }
        let mut at = self.first_pair[a as usize];
        while at != NONE && self.pairs[at as usize].slots[1] != b {
            at = self.pairs[at as usize].next;
        }
        if at == NONE {
            at = self.pairs.len() as u32;
            self.pairs.push(Pair { slots: [a, b], block: Matrix3::zeros(), next: self.first_pair[a as usize] });
            self.first_pair[a as usize] = at;
        }
        self.last = at;
        at
    }

    /// Add to normal equations whose pose, then modes (of `template`, if they move) start at row `base`.
    pub fn gather(
        &self,
        vertices: &[Vector3<f64>],
        template: Option<&Template>,
        base: usize,
        hessian: &mut Envelope,
        gradient: &mut [f64],
    ) {
        let modes = template.map_or(0, |t| t.mode_count);
        match 6 + modes {
            0..=8 => self.gather_in::<8>(vertices, template, base, hessian, gradient),
            9..=16 => self.gather_in::<16>(vertices, template, base, hessian, gradient),
            17..=24 => self.gather_in::<24>(vertices, template, base, hessian, gradient),
            25..=32 => self.gather_in::<32>(vertices, template, base, hessian, gradient),
            _ => {
                // more modes than a fixed size holds: block by block
                let size = 6 + modes;
                let by_vertex: Vec<[Vec<f64>; 3]> = (0..self.vertices.len())
                    .map(|slot| derivative(self.vertices[slot], vertices, template, size))
                    .collect();
                self.gather_any(&by_vertex, size, base, hessian, gradient);
            }
        }
    }

    fn gather_in<const N: usize>(
        &self,
        vertices: &[Vector3<f64>],
        template: Option<&Template>,
        base: usize,
        hessian: &mut Envelope,
        gradient: &mut [f64],
    ) {
        let size = 6 + template.map_or(0, |t| t.mode_count);
        let mut by_vertex = vec![[[0.0; N]; 3]; self.vertices.len()];
        for (rows, &vertex) in by_vertex.iter_mut().zip(&self.vertices) {
            fill_derivative(vertex, vertices, template, rows);
        }
        let mut product = vec![[[0.0; N]; 3]; self.vertices.len()];
        for (slot, block) in self.diagonal.iter().enumerate() {
            add_product(block, &by_vertex[slot], &mut product[slot]);
        }
        for pair in &self.pairs {
            let [a, b] = pair.slots.map(|s| s as usize);
            add_product(&pair.block, &by_vertex[b], &mut product[a]);
            add_product(&pair.block.transpose(), &by_vertex[a], &mut product[b]);
        }
        let mut sum = [[0.0; N]; N];
        let mut right = [0.0; N];
        for ((left, rows), g) in by_vertex.iter().zip(&product).zip(&self.gradient) {
            for i in 0..size {
                let [x, y, z] = [left[0][i], left[1][i], left[2][i]];
                // whole eights: what lies beyond the diagonal is not read
                let width = (i / 8 + 1) * 8;
                let entries = sum[i][..width].iter_mut().zip(&rows[0]).zip(&rows[1]).zip(&rows[2]);
                for (((entry, p), q), r) in entries {
                    *entry += x * p + y * q + z * r;
                }
            }
            for (i, entry) in right[..size].iter_mut().enumerate() {
                *entry += left[0][i] * g.x + left[1][i] * g.y + left[2][i] * g.z;
            }
        }
        for i in 0..size {
            gradient[base + i] += right[i];
            hessian.run_mut(base + i, base, i + 1).iter_mut().zip(&sum[i]).for_each(|(h, s)| *h += s);
        }
    }

    fn gather_any(
        &self,
        by_vertex: &[[Vec<f64>; 3]],
        size: usize,
        base: usize,
        hessian: &mut Envelope,
        gradient: &mut [f64],
    ) {
        let mut add = |a: usize, b: usize, block: &Matrix3<f64>, both: bool| {
            let entry = |i: usize, j: usize| -> f64 {
                (0..3)
                    .flat_map(|k| (0..3).map(move |l| (k, l)))
                    .map(|(k, l)| by_vertex[a][k][i] * block[(k, l)] * by_vertex[b][l][j])
                    .sum()
            };
            for i in 0..size {
                for j in 0..=i {
                    hessian.add(base + i, base + j, entry(i, j) + if both { entry(j, i) } else { 0.0 });
                }
            }
        };
        self.diagonal.iter().enumerate().for_each(|(slot, block)| add(slot, slot, block, false));
        for pair in &self.pairs {
            add(pair.slots[0] as usize, pair.slots[1] as usize, &pair.block, true);
        }
        for (rows, g) in by_vertex.iter().zip(&self.gradient) {
            for i in 0..size {
                gradient[base + i] += rows[0][i] * g.x + rows[1][i] * g.y + rows[2][i] * g.z;
            }
        }
    }
}

/// ∂v/∂(pose, z) of a vertex as three rows.
fn derivative(vertex: u32, vertices: &[Vector3<f64>], template: Option<&Template>, size: usize) -> [Vec<f64>; 3] {
    let mut rows = [vec![0.0; size], vec![0.0; size], vec![0.0; size]];
    let [x, y, z] = &mut rows;
    write_derivative(vertex, vertices, template, [x, y, z]);
    rows
}

fn fill_derivative<const N: usize>(
    vertex: u32,
    vertices: &[Vector3<f64>],
    template: Option<&Template>,
    rows: &mut [[f64; N]; 3],
) {
    let [x, y, z] = rows;
    write_derivative(vertex, vertices, template, [x, y, z]);
}

/// A right perturbation (ρ, φ) moves v by ρ + φ × v, a mode by its displacement.
fn write_derivative(vertex: u32, vertices: &[Vector3<f64>], template: Option<&Template>, rows: [&mut [f64]; 3]) {
    let v = vertices[vertex as usize];
    let [x, y, z] = rows;
    (x[0], y[1], z[2]) = (1.0, 1.0, 1.0);
    (x[4], x[5]) = (v.z, -v.y);
    (y[3], y[5]) = (-v.z, v.x);
    (z[3], z[4]) = (v.y, -v.x);
    if let Some(template) = template {
        for (k, mode) in template.modes_of(vertex as usize).iter().enumerate() {
            (x[6 + k], y[6 + k], z[6 + k]) = (mode.x, mode.y, mode.z);
        }
    }
}

/// product += block · rows.
#[inline]
fn add_product<const N: usize>(block: &Matrix3<f64>, rows: &[[f64; N]; 3], product: &mut [[f64; N]; 3]) {
    for (k, out) in product.iter_mut().enumerate() {
        let [x, y, z] = [block[(k, 0)], block[(k, 1)], block[(k, 2)]];
        for i in 0..N {
            out[i] += x * rows[0][i] + y * rows[1][i] + z * rows[2][i];
        }
    }
}
