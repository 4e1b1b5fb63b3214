//! The boundary of any mesh: open, cut by the near plane, with duplicate vertices or faces of any winding.
//!
//! Every face, turned to the camera, adds 1 to the winding number of the points that it covers. Edges whose faces do not
//! cancel each other part regions of different numbers; a piece of one bounds the mask where the number on its outer side
//! is 0. Every pair of such edges is compared: this way is for the meshes that the contour alone does not describe.

use std::collections::HashMap;

use nalgebra::{Vector2, Vector3};

use super::boundary::{Boundary, Cut, Segment};
use crate::camera::Camera;
use crate::mesh::Topology;
use crate::raster::{NEAR_M, Rect, fill_mask, near_crossing};

/// A face with a corner farther off the image is not drawn: beyond this, numbers do not tell pixels apart.
const FARTHEST_PX: f64 = 1e9;

/// Where numbers on both sides of an edge differ, directed as [`Segment`] is.
#[derive(Debug, Clone, Copy)]
struct Step {
    ends: [u32; 2],
    /// By how much the number on the inner side is greater.
    rise: i32,
}

/// Buffers and tables of one search.
#[derive(Debug, Clone, Default)]
pub(super) struct General {
    /// The first vertex at the same place as each vertex.
    same: Vec<u32>,
    of_place: HashMap<[u64; 3], u32>,
    of_cut: HashMap<[u32; 2], u32>,
    change: HashMap<[u32; 2], usize>,
    net: Vec<([u32; 2], i32)>,
    kept: Vec<[u32; 3]>,
    steps: Vec<Step>,
    mask: Vec<u8>,
}

impl General {
    /// Fill in a boundary.
    pub fn find(
        &mut self,
        boundary: &mut Boundary,
        camera: &Camera,
        points_in_camera: &[Vector3<f64>],
        topology: &Topology,
    ) {
        self.merge(points_in_camera);
        boundary.cuts.clear();
        boundary.segments.clear();
        boundary.points.clear();
        boundary.points.extend(points_in_camera.iter().map(|p| camera.project(p)));
        self.collect(boundary, camera, points_in_camera, &topology.faces);
        self.fill(boundary, camera, points_in_camera);
        self.cut(boundary);
    }

    /// Vertices at one place are one.
    fn merge(&mut self, points: &[Vector3<f64>]) {
        self.of_place.clear();
        self.same.clear();
        for (number, p) in points.iter().enumerate() {
            let place = [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits()); // −0 is 0
            self.same.push(*self.of_place.entry(place).or_insert(number as u32));
        }
    }

    /// Sum up the faces along each edge.
    fn collect(&mut self, boundary: &mut Boundary, camera: &Camera, points: &[Vector3<f64>], faces: &[[u32; 3]]) {
        self.of_cut.clear();
        self.change.clear();
        self.net.clear();
        self.kept.clear();
        for face in faces {
            let corners = face.map(|v| self.same[v as usize]);
            if corners.iter().any(|&v| !points[v as usize].iter().all(|c| c.is_finite())) {
                continue;
            }
            let polygon = self.clip(boundary, camera, points, corners);
            let pixel = |v: &u32| boundary.points[*v as usize];
            if polygon.len() < 3 || polygon.iter().any(|v| !pixel(v).iter().all(|c| c.abs() < FARTHEST_PX)) {
                continue;
            }
            self.kept.push(*face);
            let first = pixel(&polygon[0]);
            let turn = |k: usize| (pixel(&polygon[k]) - first).perp(&(pixel(&polygon[k + 1]) - first));
            let area: f64 = (1..polygon.len() - 1).map(turn).sum();
            if area == 0.0 {
                continue;
            }
            for (k, &a) in polygon.iter().enumerate() {
                let b = polygon[(k + 1) % polygon.len()];
                let direction = if (a < b) == (area < 0.0) { 1 } else { -1 };
                let key = [a.min(b), a.max(b)];
                let at = *self.change.entry(key).or_insert_with(|| {
                    self.net.push((key, 0));
                    self.net.len() - 1
                });
                self.net[at].1 += direction;
            }
        }
        self.steps.clear();
        self.steps.extend(
            self.net
                .iter()
                .filter(|(_, change)| *change != 0)
                .map(|&([a, b], change)| Step { ends: if change > 0 { [a, b] } else { [b, a] }, rise: change.abs() }),
        );
    }

    /// The part of a face before the near plane, as numbers of boundary points.
    fn clip(
        &mut self,
        boundary: &mut Boundary,
        camera: &Camera,
        points: &[Vector3<f64>],
        corners: [u32; 3],
    ) -> Vec<u32> {
        let mut polygon = Vec::with_capacity(4);
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let near = [a, b].map(|v| points[v as usize].z < NEAR_M);
            if !near[0] {
                polygon.push(a);
            }
            if near[0] != near[1] {
                let ends = [a.min(b), a.max(b)];
                polygon.push(*self.of_cut.entry(ends).or_insert_with(|| {
                    let [p, q] = ends.map(|v| points[v as usize].z);
                    boundary.cuts.push(Cut { vertices: ends, share: (NEAR_M - p) / (q - p) });
                    boundary.points.push(camera.project(&near_crossing(points, a, b)));
                    boundary.points.len() as u32 - 1
                }));
            }
        }
        polygon
    }

    /// Which centres are covered, as runs within the rectangle around the faces.
    fn fill(&mut self, boundary: &mut Boundary, camera: &Camera, points: &[Vector3<f64>]) {
        let corners = self.net.iter().flat_map(|(ends, _)| ends.map(|v| boundary.points[v as usize]));
        let rect = Rect::around(corners).intersection(&Rect::image(camera));
        boundary.rect = rect;
        self.mask.clear();
        self.mask.resize(rect.area(), 0);
        fill_mask(camera, points, &self.kept, &rect, &mut self.mask);
        boundary.spans.clear();
        boundary.span_start.clear();
        boundary.span_start.push(0);
        for row in 0..rect.height {
            let line = &self.mask[row * rect.width..(row + 1) * rect.width];
            let mut column = 0;
            for run in line.chunk_by(|a, b| a == b) {
                let end = column + run.len() as u32;
                if run[0] > 0 {
                    boundary.spans.push((row as u32, column, end));
                }
                column = end;
            }
            boundary.span_start.push(boundary.spans.len() as u32);
        }
    }

    /// Cut the edges where they cross each other, and keep the pieces whose outer side nothing covers.
    fn cut(&self, boundary: &mut Boundary) {
        let mut at = Vec::new();
        for (number, step) in self.steps.iter().enumerate() {
            let [p, q] = step.ends.map(|v| boundary.points[v as usize]);
            at.clear();
            at.extend([0.0, 1.0]);
            for other in &self.steps {
                at.extend(crossing((&p, &q), other.ends.map(|v| boundary.points[v as usize])));
            }
            at.sort_unstable_by(f64::total_cmp);
            for pair in at.windows(2).filter(|pair| pair[0] < pair[1]) {
                let middle = p + (q - p) * (0.5 * (pair[0] + pair[1]));
                if self.outer_winding(&boundary.points, number, &middle) == 0 {
                    boundary.segments.push(Segment { ends: step.ends, from: pair[0], to: pair[1] });
                }
            }
        }
    }

    /// Winding number on the outer side of an edge at one of its points: what a ray from low coordinates crosses, along the
    /// axis that the edge is the less parallel to.
    fn outer_winding(&self, points: &[Vector2<f64>], own: usize, middle: &Vector2<f64>) -> i32 {
        let [a, b] = self.steps[own].ends.map(|v| points[v as usize]);
        let along = b - a;
        let axis = usize::from(along.x.abs() >= along.y.abs()); // of the ray: x, or y
        let sign = |d: &Vector2<f64>| if (d[1 - axis] > 0.0) == (axis == 0) { 1 } else { -1 };
        let mut winding = 0;
        for (number, step) in self.steps.iter().enumerate() {
            let [p, q] = step.ends.map(|v| points[v as usize]);
            let (from, to, level) = (p[1 - axis], q[1 - axis], middle[1 - axis]);
            if number == own || (from <= level) == (to <= level) {
                continue;
            }
            if p[axis] + (level - from) / (to - from) * (q[axis] - p[axis]) < middle[axis] {
                winding += sign(&(q - p)) * step.rise;
            }
        }
        // with the outer side beyond the edge, the ray comes out of the inside
        if sign(&along) < 0 { winding - self.steps[own].rise } else { winding }
    }
}

/// Where another edge crosses the way from `p` to `q`, as its parameter.
fn crossing((p, q): (&Vector2<f64>, &Vector2<f64>), [r, s]: [Vector2<f64>; 2]) -> Option<f64> {
    let apart =
        |axis: usize| p[axis].max(q[axis]) < r[axis].min(s[axis]) || p[axis].min(q[axis]) > r[axis].max(s[axis]);
    if apart(0) || apart(1) {
        return None;
    }
    let turn = |a: &Vector2<f64>, b: &Vector2<f64>, c: &Vector2<f64>| (b - a).perp(&(c - a));
    let (of_r, of_s) = (turn(p, q, &r), turn(p, q, &s));
    let (of_p, of_q) = (turn(&r, &s, p), turn(&r, &s, q));
    if (of_r < 0.0) == (of_s < 0.0) || (of_p < 0.0) == (of_q < 0.0) {
        return None;
    }
    let at = of_p / (of_p - of_q);
    (at > 0.0 && at < 1.0).then_some(at)
}
