//! Mesh topology, cotangent Laplacian, mirror symmetry.

use std::collections::HashMap;
use std::sync::Arc;

use nalgebra::Vector3;

use crate::error::{Error, Result, check_length};

/// An edge and the faces that hold it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edge {
    /// Its vertices, the smaller index first.
    pub vertices: [u32; 2],
    /// Its first two faces; a boundary edge repeats its only face.
    pub faces: [u32; 2],
    /// How many faces hold it: 2 inside a manifold, 1 on a boundary.
    pub count: u32,
    /// +1 where the first two faces run from the first vertex to the second, −1 where back.
    pub directions: [i8; 2],
}

/// Tells topologies apart without a look at their faces: copies of one are the same, others are not.
#[derive(Debug, Clone, Default)]
pub(crate) struct Identity(Arc<()>);

impl Identity {
    /// Whether both are copies of one.
    pub(crate) fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl PartialEq for Identity {
    /// What is compared is what topologies say, not where it came from.
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for Identity {}

/// No edge: the side of a face that names a vertex twice.
pub(crate) const NO_EDGE: u32 = u32::MAX;

/// Faces with their edges, as [`Topology::new`] puts them together; to be read, not changed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topology {
    /// How many vertices the faces may name.
    pub vertex_count: usize,
    /// Vertex indices of each face, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Every edge once, in the order of its first appearance.
    pub edges: Vec<Edge>,
    /// Whether every edge is held by two faces that run along it in opposite directions.
    pub closed: bool,
    /// Edges of each face, from its first vertex to its second and so on.
    pub(crate) sides: Vec<[u32; 3]>,
    pub(crate) identity: Identity,
}

impl Topology {
    /// Collect the edges of a face list.
    ///
    /// # Errors
    /// [`Error::FaceIndex`] for a face that names a vertex that does not exist.
    pub fn new(vertex_count: usize, faces: &[[i64; 3]]) -> Result<Self> {
        let mut checked = Vec::with_capacity(faces.len());
        for (face, corners) in faces.iter().enumerate() {
            for &index in corners {
                if index < 0 || index as usize >= vertex_count {
                    return Err(Error::FaceIndex { face, index, vertices: vertex_count });
                }
            }
            checked.push(corners.map(|i| i as u32));
        }
        let (edges, sides) = collect_edges(&checked);
        let proper = checked.iter().all(|[a, b, c]| a != b && b != c && c != a);
        let closed = proper && edges.iter().all(|e| e.count == 2 && e.directions[0] == -e.directions[1]);
        Ok(Self { vertex_count, faces: checked, edges, closed, sides, identity: Identity::default() })
    }

    /// Neighbours of each vertex along edges, sorted.
    #[must_use]
    pub fn neighbours(&self) -> Vec<Vec<u32>> {
        let mut out = vec![Vec::new(); self.vertex_count];
        for edge in &self.edges {
            let [a, b] = edge.vertices;
            out[a as usize].push(b);
            out[b as usize].push(a);
        }
        out.iter_mut().for_each(|list| list.sort_unstable());
        out
    }
}

fn collect_edges(faces: &[[u32; 3]]) -> (Vec<Edge>, Vec<[u32; 3]>) {
    let mut index_of: HashMap<[u32; 2], usize> = HashMap::new();
    let mut edges: Vec<Edge> = Vec::new();
    let mut sides = vec![[NO_EDGE; 3]; faces.len()];
    for (face, corners) in faces.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if a == b {
                continue;
            }
            let (vertices, direction) = ([a.min(b), a.max(b)], if a < b { 1 } else { -1 });
            let at = *index_of.entry(vertices).or_insert_with(|| {
                edges.push(Edge { vertices, faces: [face as u32; 2], count: 0, directions: [direction; 2] });
                edges.len() - 1
            });
            sides[face][k] = at as u32;
            edges[at].count += 1;
            if edges[at].count == 2 {
                edges[at].faces[1] = face as u32;
                edges[at].directions[1] = direction;
            }
        }
    }
    (edges, sides)
}

/// Cotangent weight of each edge of `topology` (Pinkall and Polthier 1993): ½ Σ cot of the angles opposite to it.
///
/// Weights are held above `1e-3`, so that obtuse or degenerate faces leave the Laplacian positive semidefinite and finite.
#[must_use]
pub fn cotangent_weights(topology: &Topology, vertices: &[Vector3<f64>]) -> Vec<f64> {
    let mut index_of: HashMap<[u32; 2], usize> = HashMap::new();
    for (i, edge) in topology.edges.iter().enumerate() {
        index_of.insert(edge.vertices, i);
    }
    let mut weights = vec![0.0; topology.edges.len()];
    for corners in &topology.faces {
        for k in 0..3 {
            let (a, b, c) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
            let (u, v) = (vertices[a as usize] - vertices[c as usize], vertices[b as usize] - vertices[c as usize]);
            let area = u.cross(&v).norm();
            let cotangent = u.dot(&v) / area;
            let sound = area > 1e-12 && cotangent.is_finite();
            if let (true, Some(&edge)) = (sound, index_of.get(&[a.min(b), a.max(b)])) {
                weights[edge] += 0.5 * cotangent;
            }
        }
    }
    weights.iter().map(|w| w.max(1e-3)).collect()
}

/// How the free parameters of a shape move its vertices: S of the method, one block of 3 (pair or lone vertex) or 2
/// (vertex on the mirror plane, pinned to it) degrees of freedom for each free vertex.
#[derive(Debug, Clone, PartialEq)]
pub struct Symmetry {
    /// Block of each vertex.
    pub block_of: Vec<u32>,
    /// +1 where a vertex moves with its block, −1 where its y is mirrored.
    pub side: Vec<f64>,
    /// First degree of freedom of each block; one entry more than blocks.
    pub offset: Vec<usize>,
    /// The vertex that represents each block.
    pub representative: Vec<u32>,
}

impl Symmetry {
    /// From each vertex's mirror image in y → −y (a vertex of the plane is its own), or without symmetry.
    ///
    /// # Errors
    /// [`Error::Length`] or [`Error::Index`] if `mirror` is no involution on the vertices.
    pub fn new(vertex_count: usize, mirror: Option<&[i64]>) -> Result<Self> {
        let image: Vec<usize> = match mirror {
            None => (0..vertex_count).collect(),
            Some(list) => {
                check_length("mirror", list.len(), vertex_count)?;
                let valid = |&m: &i64| m >= 0 && (m as usize) < vertex_count;
                for (i, m) in list.iter().enumerate() {
                    if !valid(m) || list[*m as usize] != i as i64 {
                        return Err(Error::Index { what: "mirror image", index: *m, count: vertex_count });
                    }
                }
                list.iter().map(|&m| m as usize).collect()
            }
        };
        let mut out = Self {
            block_of: vec![0; vertex_count],
            side: vec![1.0; vertex_count],
            offset: vec![0],
            representative: Vec::new(),
        };
        for (i, &mirrored) in image.iter().enumerate() {
            if mirrored < i {
                out.block_of[i] = out.block_of[mirrored];
                out.side[i] = -1.0;
                continue;
            }
            let block = out.representative.len() as u32;
            out.block_of[i] = block;
            out.representative.push(i as u32);
            let pinned = mirror.is_some() && mirrored == i;
            let last = out.offset[block as usize];
            out.offset.push(last + if pinned { 2 } else { 3 });
        }
        Ok(out)
    }

    /// How many degrees of freedom the blocks have together.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.offset.last().copied().unwrap_or(0)
    }

    /// The degrees of freedom that move a vertex: (index, axis, sign) of each.
    pub fn freedoms(&self, vertex: usize) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        let block = self.block_of[vertex] as usize;
        let (start, end) = (self.offset[block], self.offset[block + 1]);
        let pinned = end - start == 2;
        let side = self.side[vertex];
        (start..end).map(move |i| {
            let k = i - start;
            let axis = if pinned { 2 * k } else { k };
            (i, axis, if axis == 1 { side } else { 1.0 })
        })
    }

    /// Sᵀ g: a gradient over vertices as one over the degrees of freedom.
    #[must_use]
    pub fn pull_back(&self, vertex_gradient: &[Vector3<f64>]) -> Vec<f64> {
        let mut out = vec![0.0; self.dimension()];
        for (vertex, gradient) in vertex_gradient.iter().enumerate() {
            self.freedoms(vertex).for_each(|(i, axis, sign)| out[i] += sign * gradient[axis]);
        }
        out
    }

    /// Displacement S d of one vertex.
    #[must_use]
    pub fn displacement(&self, vertex: usize, d: &[f64]) -> Vector3<f64> {
        let mut out = Vector3::zeros();
        for (i, axis, sign) in self.freedoms(vertex) {
            out[axis] += sign * d[i];
        }
        out
    }
}
