//! A mesh whose vertices stay while the camera moves: its contour without a look at every face.
//!
//! A face is a front face where the camera's centre c lies before its plane, n·c > d. Planes are kept in single precision
//! and asked many at a time; edges that lie near each other form a group, and a box around the planes of a group's
//! faces often says that none of its edges is on the contour (hierarchical back-face tests, Kumar et al. 1996). So the
//! cost follows the contour, not the faces. What is closer to a plane than all rounding is not judged here: the pixels
//! decide it as for any mesh, and so the contour found is the same to the last bit.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use crate::camera::Camera;
use crate::lie::Pose;
use crate::mesh::{Edge, Identity, Topology};
use crate::raster::NEAR_M;
use crate::simd::{LANES, Raised, wide};

type Lanes = [f32; LANES];

/// A face lower than this, as a share of the mesh's radius, is not judged by its plane.
const LEAST_HEIGHT: f64 = 1e-5;

/// Rounding of n·c − d in single precision, relative to the distance of the camera and the mesh's radius; generous.
const SINGLE: f64 = 2e-6;

/// A rotation matrix is one up to this.
const ORTHONORMAL: f64 = 1e-9;

/// Beyond this share of the mesh's radius planes tell too little.
const LARGEST_TOLERANCE: f64 = 0.01;

/// A mesh with what finds its contour; vertices are in the object's frame.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The vertices that it was prepared for.
    pub vertices: Vec<Vector3<f64>>,
    identity: Identity,
    edge_count: usize,
    /// Middle of the box around the vertices, and how far from it they reach.
    middle: Vector3<f64>,
    radius: f64,
    /// For as many groups as a group has edges, middle and half width of the box around their planes (n, d).
    boxes: Vec<[Lanes; 8]>,
    /// For each group, the planes of the first and of the second faces of its edges.
    planes: Vec<[Lanes; 8]>,
    numbers: Vec<[u32; LANES]>,
}

/// The camera's centre as a prepared mesh asks its planes about it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sight {
    centre: [f32; 3],
    tolerance: f32,
}

/// Which edges are on the contour; the buffers are reused.
#[derive(Debug, Clone, Default)]
pub(crate) struct Verdicts {
    /// Edges that the planes do not decide.
    pub unsure: Vec<u32>,
    chosen: Vec<u64>,
    first_is_front: Vec<u64>,
}

impl Verdicts {
    fn clear(&mut self, edge_count: usize) {
        self.unsure.clear();
        for bits in [&mut self.chosen, &mut self.first_is_front] {
            bits.clear();
            bits.resize(edge_count.div_ceil(64), 0);
        }
    }

    /// Take an edge into the contour.
    #[inline(always)]
    pub fn choose(&mut self, edge: u32, first_is_front: bool) {
        let (word, bit) = (edge as usize / 64, edge % 64);
        self.chosen[word] |= 1 << bit;
        self.first_is_front[word] |= u64::from(first_is_front) << bit;
    }

    /// Visit the edges chosen in the order of their numbers, and whether the first face of each is a front face.
    pub fn for_each(&self, mut visit: impl FnMut(u32, bool)) {
        for (word, (&chosen, &front)) in self.chosen.iter().zip(&self.first_is_front).enumerate() {
            let mut left = chosen;
            while left != 0 {
                let bit = left.trailing_zeros();
                visit(word as u32 * 64 + bit, front >> bit & 1 > 0);
                left &= left - 1;
            }
        }
    }
}

impl Prepared {
    /// Prepare a mesh, if its edges have two faces or one and its vertices are finite.
    #[must_use]
    pub fn new(topology: &Topology, vertices: &[Vector3<f64>]) -> Option<Self> {
        let sound = vertices.len() == topology.vertex_count && vertices.iter().all(|v| v.iter().all(|x| x.is_finite()));
        if !sound || topology.edges.is_empty() || topology.edges.iter().any(|edge| edge.count > 2) {
            return None;
        }
        let (low, high) = vertices.iter().fold((vertices[0], vertices[0]), |(low, high), v| (low.inf(v), high.sup(v)));
        let middle = low + (high - low) * 0.5;
        let radius = vertices.iter().map(|v| (v - middle).norm()).fold(0.0, f64::max);
        if !(radius > 0.0 && radius < 1e9) {
            return None;
        }
        let of_faces: Vec<[f32; 4]> =
            topology.faces.iter().map(|face| plane(&face.map(|v| vertices[v as usize] - middle), radius)).collect();
        let order = order_in_space(topology, vertices, &middle, radius);
        let mut out = Self {
            vertices: vertices.to_vec(),
            identity: topology.identity.clone(),
            edge_count: topology.edges.len(),
            middle,
            radius,
            boxes: Vec::new(),
            planes: Vec::new(),
            numbers: Vec::new(),
        };
        for group in order.chunks(LANES) {
            out.push_group(group, &topology.edges, &of_faces);
        }
        Some(out)
    }

    /// Whether this is a mesh of the topology.
    #[must_use]
    pub fn is_of(&self, topology: &Topology) -> bool {
        self.identity.is(&topology.identity)
    }

    fn push_group(&mut self, group: &[u32], edges: &[Edge], of_faces: &[[f32; 4]]) {
        // what fills up a group lies far before both of its planes
        let mut planes = [[0.0; LANES]; 8];
        planes[3] = [f32::MIN / 4.0; LANES];
        planes[7] = planes[3];
        let (mut low, mut high) = ([f32::INFINITY; 4], [f32::NEG_INFINITY; 4]);
        for (lane, &number) in group.iter().enumerate() {
            let edge = &edges[number as usize];
            let decided = edge.count == 2 && edge.directions[0] == -edge.directions[1];
            for side in 0..2 {
                let plane = if decided { of_faces[edge.faces[side] as usize] } else { [0.0; 4] };
                for (k, &x) in plane.iter().enumerate() {
                    planes[4 * side + k][lane] = x;
                    (low[k], high[k]) = (low[k].min(x), high[k].max(x));
                }
            }
        }
        let mut numbers = [0; LANES];
        numbers[..group.len()].copy_from_slice(group);
        let lane = self.numbers.len() % LANES;
        if lane == 0 {
            let mut empty = [[0.0; LANES]; 8];
            empty[3] = [f32::MIN / 4.0; LANES];
            self.boxes.push(empty);
        }
        if let Some(boxes) = self.boxes.last_mut() {
            for k in 0..4 {
                let middle = 0.5 * (low[k] + high[k]);
                boxes[k][lane] = middle;
                // a little wider than rounding leaves it
                boxes[4 + k][lane] = (high[k] - middle).max(middle - low[k]) * 1.000_01;
            }
        }
        self.planes.push(planes);
        self.numbers.push(numbers);
    }

    /// Where the camera sees the mesh from, if the mesh lies before the near plane and no vertex's pixel is beyond a limit.
    pub(crate) fn sight(&self, camera: &Camera, camera_from_object: &Pose, farthest_px: f64) -> Option<Sight> {
        let Pose { rotation, translation } = camera_from_object;
        let off = rotation.transpose() * rotation - Matrix3::identity();
        if !(off.amax() <= ORTHONORMAL && rotation.determinant() > 0.0) {
            return None;
        }
        let centre = camera_from_object.transform(&self.middle);
        let reach = translation.norm() + self.middle.norm() + self.radius;
        let radius = self.radius + 1e-8 * reach;
        let (near, far) = (centre.z - radius, centre.z + radius);
        // written so that what is not a number fails
        let before = near > NEAR_M;
        let slope = ((centre.x.abs() + radius) / near).max((centre.y.abs() + radius) / near);
        let focal = camera.fx.max(camera.fy) + camera.skew.abs();
        let pixel = focal * slope + camera.cx.abs().max(camera.cy.abs());
        let within = pixel < 0.999 * farthest_px;
        // error of a pixel, and how far off its plane the camera is seen to be where a face's turn on the image has a sure sign:
        // the turn is fx fy ℓ h r / z³ for a face of length ℓ and height h, its error 16 δ ℓ focal (1 + slope) / z
        let delta = 8.0 * f64::EPSILON * (pixel + focal * (1.0 + slope) * reach / near);
        let turn = 16.0 * delta * focal * (1.0 + slope) * far.powi(3) / (camera.fx * camera.fy * near);
        let from_middle = -(rotation.transpose() * centre);
        let tolerance = turn / (LEAST_HEIGHT * self.radius)
            + (SINGLE + 8.0 * ORTHONORMAL) * (from_middle.norm() + self.radius)
            + 8.0 * ORTHONORMAL * reach;
        (before && within && tolerance < LARGEST_TOLERANCE * self.radius)
            .then(|| Sight { centre: from_middle.map(|x| x as f32).into(), tolerance: tolerance as f32 })
    }

    /// Which edges are on the contour.
    pub(crate) fn judge(&self, sight: &Sight, verdicts: &mut Verdicts) {
        verdicts.clear(self.edge_count);
        wide(
            #[inline(always)]
            || {
                for (block, boxes) in self.boxes.iter().enumerate() {
                    for (lane, _) in Raised::new(&open_groups(boxes, sight)) {
                        let group = block * LANES + lane;
                        for (edge, verdict) in Raised::new(&judge_group(&self.planes[group], sight)) {
                            let number = self.numbers[group][edge];
                            if verdict & UNSURE > 0 {
                                verdicts.unsure.push(number);
                            } else {
                                verdicts.choose(number, verdict & FRONT > 0);
                            }
                        }
                    }
                }
            },
        );
    }
}

fn same_bits(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> bool {
    bytemuck::cast_slice::<_, u8>(a) == bytemuck::cast_slice::<_, u8>(b)
}

/// A mesh is prepared when it was asked for so often: preparing takes as long as some evaluations without.
const ASKED: usize = 4;

/// The mesh that was asked for last, prepared once it came often enough. What comes of it does not depend on that.
#[derive(Debug, Clone, Default)]
pub struct Recent {
    prepared: Option<Arc<Prepared>>,
    vertices: Vec<Vector3<f64>>,
    identity: Identity,
    asked: usize,
}

impl Recent {
    /// Whether these vertices of this topology were the last.
    #[must_use]
    pub fn holds(&self, topology: &Topology, vertices: &[Vector3<f64>]) -> bool {
        self.identity.is(&topology.identity) && same_bits(&self.vertices, vertices)
    }

    /// Take vertices of a topology, if they are not there yet.
    pub fn hold(&mut self, topology: &Topology, vertices: &[Vector3<f64>]) {
        if !self.holds(topology, vertices) {
            (self.prepared, self.asked) = (None, 0);
            self.identity = topology.identity.clone();
            self.vertices.clear();
            self.vertices.extend_from_slice(vertices);
        }
    }

    /// The vertices held.
    #[must_use]
    pub fn vertices(&self) -> &[Vector3<f64>] {
        &self.vertices
    }

    /// Ask for the mesh that is held, of this topology, `times` times at once.
    pub fn ask(&mut self, topology: &Topology, times: usize) -> Option<Arc<Prepared>> {
        let before = self.asked;
        self.asked = before.saturating_add(times);
        if before < ASKED && self.asked >= ASKED {
            self.prepared = Prepared::new(topology, &self.vertices).map(Arc::new);
        }
        self.prepared.clone()
    }
}

/// Plane (n, d) of a face whose corners are relative to the mesh's middle; zeros where it is too low.
fn plane([a, b, c]: &[Vector3<f64>; 3], radius: f64) -> [f32; 4] {
    let normal = (b - a).cross(&(c - a));
    let (twice_area, longest) = (normal.norm(), (b - a).norm().max((c - b).norm()).max((a - c).norm()));
    let sound = twice_area > LEAST_HEIGHT * radius * longest; // not for what is no number
    if !sound {
        return [0.0; 4];
    }
    let normal = normal / twice_area;
    [normal.x as f32, normal.y as f32, normal.z as f32, normal.dot(a) as f32]
}

/// Edges in the order of a Z-curve through their middles (Morton 1966).
fn order_in_space(topology: &Topology, vertices: &[Vector3<f64>], middle: &Vector3<f64>, radius: f64) -> Vec<u32> {
    let spread = |x: f64| {
        let mut bits = ((x + radius) / (2.0 * radius) * 1023.0).clamp(0.0, 1023.0) as u32;
        bits = (bits | bits << 16) & 0x0300_00ff;
        bits = (bits | bits << 8) & 0x0300_f00f;
        bits = (bits | bits << 4) & 0x030c_30c3;
        (bits | bits << 2) & 0x0924_9249
    };
    let code = |edge: &Edge| {
        let [a, b] = edge.vertices.map(|v| vertices[v as usize]);
        let at = (a + b) * 0.5 - middle;
        spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
    };
    let mut keyed: Vec<u64> =
        topology.edges.iter().enumerate().map(|(i, edge)| u64::from(code(edge)) << 32 | i as u64).collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|key| key as u32).collect()
}

/// Which groups may hold contour edges.
#[inline(always)]
fn open_groups(boxes: &[Lanes; 8], sight: &Sight) -> [u8; LANES] {
    let [x, y, z] = sight.centre;
    let mut flags = [0; LANES];
    for lane in 0..LANES {
        let value = boxes[0][lane] * x + boxes[1][lane] * y + boxes[2][lane] * z - boxes[3][lane];
        let reach = boxes[4][lane] * x.abs() + boxes[5][lane] * y.abs() + boxes[6][lane] * z.abs() + boxes[7][lane];
        flags[lane] = u8::from(value.abs() <= reach + 2.0 * sight.tolerance);
    }
    flags
}

/// An edge is on the contour; its first face is a front face; the planes do not tell.
const CONTOUR: u8 = 1;
const FRONT: u8 = 2;
const UNSURE: u8 = 4;

/// Verdicts on a group's edges: 0 where an edge is not on the contour.
#[inline(always)]
fn judge_group(planes: &[Lanes; 8], sight: &Sight) -> [u8; LANES] {
    let [x, y, z] = sight.centre;
    let mut verdicts = [0; LANES];
    for lane in 0..LANES {
        let first = planes[0][lane] * x + planes[1][lane] * y + planes[2][lane] * z - planes[3][lane];
        let second = planes[4][lane] * x + planes[5][lane] * y + planes[6][lane] * z - planes[7][lane];
        let unsure = (first.abs() <= sight.tolerance) | (second.abs() <= sight.tolerance);
        let contour = if first > 0.0 { CONTOUR | FRONT } else { CONTOUR };
        let differs = if (first > 0.0) != (second > 0.0) { contour } else { 0 };
        verdicts[lane] = if unsure { UNSURE } else { differs };
    }
    verdicts
}
