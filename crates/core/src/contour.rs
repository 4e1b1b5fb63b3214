//! The contour of a mesh on the image: the edges across which the number of faces that cover a point changes.
//!
//! Each face that is drawn covers its points once. Where its sides are taken to run around it with the inside to the right
//! as the image is seen, a common side of two front faces (or two back faces) runs both ways and cancels. What is left are
//! the sides between a front and a back face, which change the number by two, and the borders of an open mesh, which
//! change it by one. The near plane cuts faces into smaller ones, whose sides on that plane are borders too.

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::camera::Camera;
use crate::mesh::{NO_EDGE, Topology};
use crate::prepared::Verdicts;
use crate::raster::{NEAR_M, near_crossing};

/// Where the near plane cuts an edge: the point (1 − s) γ_a + s γ_b.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// Vertices a and b of the edge.
    pub vertices: [u32; 2],
    /// The point, in the camera's frame.
    pub point: Vector3<f64>,
}

impl Cut {
    /// Derivatives of the point over a and b: it moves with them and stays on the near plane.
    #[must_use]
    pub fn levers(&self, points_in_camera: &[Vector3<f64>]) -> [Matrix3<f64>; 2] {
        let [a, b] = self.vertices.map(|v| points_in_camera[v as usize]);
        let along = (b - a) / (b.z - a.z);
        let share = (NEAR_M - a.z) / (b.z - a.z);
        let mut sliding = Matrix3::identity();
        sliding.set_column(2, &(Vector3::z() - along));
        [sliding * (1.0 - share), sliding * share]
    }
}

/// Contour edges of a mesh in a view; the buffers are reused.
#[derive(Debug, Clone, Default)]
pub struct Contour {
    /// Vertices of each edge, its outer side to the left of the way from the first to the second as the image is seen.
    /// Numbers from the mesh's vertex count on are those of `cuts`.
    pub edges: Vec<[u32; 2]>,
    /// By how many more faces the inner side is covered than the outer.
    pub steps: Vec<i32>,
    /// Where the near plane cuts edges.
    pub cuts: Vec<Cut>,
    front: Vec<u8>,
    chosen: Vec<u32>,
    sums: Vec<i32>,
    cut_of: Vec<u32>,
}

/// Whether a face is turned to the camera, by its corners' pixels.
#[inline(always)]
pub(crate) fn is_front(p: &Vector2<f64>, q: &Vector2<f64>, r: &Vector2<f64>) -> bool {
    (q.x - p.x) * (r.y - p.y) - (q.y - p.y) * (r.x - p.x) < 0.0
}

impl Contour {
    pub(crate) fn clear(&mut self) {
        self.edges.clear();
        self.steps.clear();
        self.cuts.clear();
    }

    /// Add an edge that is run through from its first vertex to its second `sum` times more often than back.
    #[inline]
    pub(crate) fn push(&mut self, [a, b]: [u32; 2], sum: i32) {
        if sum != 0 {
            self.edges.push(if sum > 0 { [a, b] } else { [b, a] });
            self.steps.push(sum.abs());
        }
    }

    /// The contour of a closed mesh before the near plane.
    pub(crate) fn find_closed(&mut self, pixels: &[Vector2<f64>], topology: &Topology) {
        self.clear();
        self.front.clear();
        self.front.extend(topology.faces.iter().map(|face| {
            let [p, q, r] = face.map(|v| pixels[v as usize]);
            u8::from(is_front(&p, &q, &r))
        }));
        // one edge in ten is chosen: written without a branch that would be mispredicted
        self.chosen.resize(topology.edges.len() + 1, 0);
        let (front, chosen, mut count) = (self.front.as_slice(), self.chosen.as_mut_slice(), 0);
        for (i, edge) in topology.edges.iter().enumerate() {
            chosen[count] = i as u32;
            count += usize::from(front[edge.faces[0] as usize] != front[edge.faces[1] as usize]);
        }
        self.edges.extend(chosen[..count].iter().map(|&i| {
            let edge = &topology.edges[i as usize];
            let first_is_front = front[edge.faces[0] as usize] > 0;
            let direction = edge.directions[usize::from(!first_is_front)];
            let [a, b] = edge.vertices;
            if direction > 0 { [a, b] } else { [b, a] }
        }));
        self.steps.resize(count, 2);
    }

    /// The contour of any mesh. Where the near plane cuts it, `pixels` grows by those of `cuts`.
    pub(crate) fn find(
        &mut self,
        camera: &Camera,
        points: &[Vector3<f64>],
        pixels: &mut Vec<Vector2<f64>>,
        topology: &Topology,
    ) {
        self.clear();
        self.find_cuts(camera, points, pixels, topology);
        self.sums.clear();
        self.sums.resize(topology.edges.len(), 0);
        for (face, sides) in topology.faces.iter().zip(&topology.sides) {
            let near = face.map(|v| points[v as usize].z < NEAR_M);
            if near == [true; 3] {
                continue;
            }
            if near == [false; 3] {
                let [p, q, r] = face.map(|v| pixels[v as usize]);
                self.add_sides(face, sides, &near, if is_front(&p, &q, &r) { 1 } else { -1 });
            } else {
                self.add_cut_face(face, sides, &near, pixels);
            }
        }
        for (number, edge) in topology.edges.iter().enumerate() {
            if self.sums[number] != 0 {
                let ends = edge.vertices.map(|v| if points[v as usize].z < NEAR_M { self.cut_of[number] } else { v });
                self.push(ends, self.sums[number]);
            }
        }
    }

    fn find_cuts(
        &mut self,
        camera: &Camera,
        points: &[Vector3<f64>],
        pixels: &mut Vec<Vector2<f64>>,
        topology: &Topology,
    ) {
        self.cut_of.clear();
        self.cut_of.resize(topology.edges.len(), NO_EDGE);
        for (number, edge) in topology.edges.iter().enumerate() {
            let [a, b] = edge.vertices;
            if (points[a as usize].z < NEAR_M) != (points[b as usize].z < NEAR_M) {
                let point = near_crossing(points, a, b);
                self.cut_of[number] = pixels.len() as u32;
                pixels.push(camera.project(&point));
                self.cuts.push(Cut { vertices: edge.vertices, point });
            }
        }
    }

    /// Count the sides of a face; `turn` is 1 where it is run around as its vertices say, −1 where the other way.
    fn add_sides(&mut self, face: &[u32; 3], sides: &[u32; 3], near: &[bool; 3], turn: i32) {
        for k in 0..3 {
            let j = (k + 1) % 3;
            if sides[k] != NO_EDGE && !(near[k] && near[j]) {
                self.sums[sides[k] as usize] += if face[k] < face[j] { turn } else { -turn };
            }
        }
    }

    /// Count the sides of a face that the near plane cuts, and its side on that plane.
    fn add_cut_face(&mut self, face: &[u32; 3], sides: &[u32; 3], near: &[bool; 3], pixels: &[Vector2<f64>]) {
        // around the part before the plane: at most four corners
        let (mut corners, mut count) = ([Vector2::zeros(); 4], 0);
        let (mut leaves, mut returns) = (NO_EDGE, NO_EDGE);
        for k in 0..3 {
            let j = (k + 1) % 3;
            if !near[k] {
                corners[count] = pixels[face[k] as usize];
                count += 1;
            }
            if near[k] != near[j] {
                let cut = self.cut_of[sides[k] as usize];
                *(if near[k] { &mut returns } else { &mut leaves }) = cut;
                corners[count] = pixels[cut as usize];
                count += 1;
            }
        }
        let twice_area: f64 = (2..count).map(|k| (corners[k - 1] - corners[0]).perp(&(corners[k] - corners[0]))).sum();
        let turn = if twice_area < 0.0 { 1 } else { -1 };
        self.add_sides(face, sides, near, turn);
        self.push([leaves, returns], turn);
    }
}

impl Contour {
    /// The contour of a prepared mesh; `pixel` gives a vertex's, and is asked where the verdicts are not sure.
    pub(crate) fn find_judged(
        &mut self,
        verdicts: &mut Verdicts,
        topology: &Topology,
        pixel: impl Fn(u32) -> Vector2<f64>,
    ) {
        self.clear();
        let turn = |face: u32| {
            let [p, q, r] = topology.faces[face as usize].map(&pixel);
            if is_front(&p, &q, &r) { 1 } else { -1 }
        };
        for k in 0..verdicts.unsure.len() {
            let number = verdicts.unsure[k];
            let edge = &topology.edges[number as usize];
            let first = turn(edge.faces[0]);
            let second = if edge.count == 2 { turn(edge.faces[1]) * i32::from(edge.directions[1]) } else { 0 };
            if first * i32::from(edge.directions[0]) + second != 0 {
                verdicts.choose(number, first > 0);
            }
        }
        verdicts.for_each(|number, first_is_front| {
            let edge = &topology.edges[number as usize];
            let [a, b] = edge.vertices;
            self.edges.push(if (edge.directions[0] > 0) == first_is_front { [a, b] } else { [b, a] });
            self.steps.push(edge.count as i32);
        });
    }
}
