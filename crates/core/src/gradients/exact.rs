//! The exact gradient of the IoU: an integral over the mask's outline.
//!
//! Moving a vertex moves only the border of the mask, so dL = ∫ ∂L/∂ŝ n·dx dl over the outline. Where the mesh lies on
//! both sides of an edge, coverage stays 1 and the edge adds nothing. Within a pixel ∂L/∂ŝ is constant and the weights of
//! the edge's ends are linear, so the midpoint of each pixel's piece of an edge gives its integral.

use nalgebra::{Vector2, Vector3};

use super::walk::Walk;
use super::{Chain, MaskGradient, ObservedMask, loss_slopes};
use crate::camera::Camera;
use crate::contour::Cut;
use crate::lie::Pose;
use crate::mesh::Topology;
use crate::outline::outline;
use crate::prepared::{Prepared, Recent};
use crate::silhouette::Silhouette;
use crate::visible::{Piece, Visible};

/// What one evaluation after another reuses; no result depends on it.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    /// The mesh evaluated last.
    pub recent: Recent,
    buffers: Buffers,
}

#[derive(Debug, Clone, Default)]
struct Buffers {
    silhouette: Silhouette,
    visible: Visible,
    points: Vec<Vector3<f64>>,
    moved: Moved,
    marked: Vec<usize>,
}

/// Spacing of outline samples where a mesh reaches too far off the image, pixels.
const SAMPLE_STEP_PX: f64 = 0.5;

/// L_mask of a drawn mesh and its exact gradient.
pub fn exact_gradient(
    camera: &Camera,
    camera_from_object: &Pose,
    vertices: &[Vector3<f64>],
    topology: &Topology,
    observed: &ObservedMask,
    work: &mut Workspace,
) -> MaskGradient {
    work.recent.hold(topology, vertices);
    held_gradient(camera, camera_from_object, topology, observed, work)
}

/// The same of the vertices of this topology that [`Workspace::recent`] holds.
pub fn held_gradient(
    camera: &Camera,
    camera_from_object: &Pose,
    topology: &Topology,
    observed: &ObservedMask,
    work: &mut Workspace,
) -> MaskGradient {
    let prepared = work.recent.ask(topology, 1);
    let Workspace { recent, buffers } = work;
    evaluate(camera, camera_from_object, recent.vertices(), prepared.as_deref(), topology, observed, buffers)
}

/// The same of a mesh prepared for this topology (another's is not made use of); what the workspace holds is left as it is.
pub fn prepared_gradient(
    camera: &Camera,
    camera_from_object: &Pose,
    mesh: &Prepared,
    topology: &Topology,
    observed: &ObservedMask,
    work: &mut Workspace,
) -> MaskGradient {
    evaluate(camera, camera_from_object, &mesh.vertices, Some(mesh), topology, observed, &mut work.buffers)
}

fn evaluate(
    camera: &Camera,
    camera_from_object: &Pose,
    vertices: &[Vector3<f64>],
    prepared: Option<&Prepared>,
    topology: &Topology,
    observed: &ObservedMask,
    buffers: &mut Buffers,
) -> MaskGradient {
    let Buffers { silhouette, points, .. } = buffers;
    let drawn = prepared
        .filter(|mesh| mesh.is_of(topology))
        .is_some_and(|mesh| silhouette.draw_prepared(camera, camera_from_object, mesh, topology, points));
    if !drawn {
        points.clear();
        points.extend(vertices.iter().map(|v| camera_from_object.transform(v)));
        silhouette.draw_by_contour(camera, points, topology);
    }
    differentiate(camera, camera_from_object, vertices, topology, observed, buffers)
}

/// Loss and gradient of what is drawn.
fn differentiate(
    camera: &Camera,
    camera_from_object: &Pose,
    vertices: &[Vector3<f64>],
    topology: &Topology,
    observed: &ObservedMask,
    buffers: &mut Buffers,
) -> MaskGradient {
    let Buffers { silhouette, visible, points, moved, marked } = buffers;
    let (intersection, union) = overlap(silhouette, observed);
    let slopes = loss_slopes(intersection, union);
    let loss = if union > 0.0 { -intersection / union } else { -1.0 };
    let chain =
        Chain { camera, rotation: &camera_from_object.rotation, points_in_camera: points, points_in_object: vertices };
    if !silhouette.by_contour {
        let in_camera = integrate_samples(&chain, topology, silhouette, observed, slopes);
        return chain.gather(loss, intersection, union, in_camera.into_iter().enumerate());
    }
    visible.find(silhouette);
    moved.resize(vertices.len() + silhouette.contour.cuts.len());
    for piece in &visible.pieces {
        integrate_piece(silhouette, piece, observed, slopes, moved);
    }
    moved.take_marks(marked);
    if silhouette.contour.cuts.is_empty() {
        let lifted = marked.iter().map(|&v| (v, chain.lift(&points[v], &moved.take(v))));
        chain.gather(loss, intersection, union, lifted)
    } else {
        let in_camera = lift_with_cuts(&chain, &silhouette.contour.cuts, marked, moved);
        chain.gather(loss, intersection, union, in_camera.into_iter().enumerate())
    }
}

/// Gradients over all vertices; those over points on the near plane are handed on to the ends of the edges that it cuts.
fn lift_with_cuts(chain: &Chain, cuts: &[Cut], marked: &[usize], moved: &mut Moved) -> Vec<Vector3<f64>> {
    let count = chain.points_in_object.len();
    let mut in_camera = vec![Vector3::zeros(); count];
    for &number in marked {
        let on_image = moved.take(number);
        if number < count {
            in_camera[number] += chain.lift(&chain.points_in_camera[number], &on_image);
            continue;
        }
        let cut = &cuts[number - count];
        let on_point = chain.lift(&cut.point, &on_image);
        for (vertex, lever) in cut.vertices.into_iter().zip(cut.levers(chain.points_in_camera)) {
            in_camera[vertex as usize] += lever.transpose() * on_point;
        }
    }
    in_camera
}

/// Gradients over the pixels of vertices; those that are not marked are 0.
#[derive(Debug, Clone, Default)]
struct Moved {
    on_image: Vec<Vector2<f64>>,
    marks: Vec<u64>,
}

impl Moved {
    fn resize(&mut self, count: usize) {
        self.on_image.resize(count, Vector2::zeros());
        self.marks.resize(count.div_ceil(64), 0);
    }

    #[inline]
    fn mark(&mut self, vertex: usize) {
        self.marks[vertex / 64] |= 1 << (vertex % 64);
    }

    #[inline]
    fn add(&mut self, vertex: usize, on_image: Vector2<f64>) {
        self.mark(vertex);
        self.on_image[vertex] += on_image;
    }

    /// Numbers of the marked vertices in ascending order; the marks are taken off.
    fn take_marks(&mut self, out: &mut Vec<usize>) {
        out.clear();
        for (word, marks) in self.marks.iter_mut().enumerate() {
            let mut left = std::mem::take(marks);
            while left != 0 {
                out.push(word * 64 + left.trailing_zeros() as usize);
                left &= left - 1;
            }
        }
    }

    /// A vertex's gradient; 0 is left behind.
    #[inline]
    fn take(&mut self, vertex: usize) -> Vector2<f64> {
        std::mem::replace(&mut self.on_image[vertex], Vector2::zeros())
    }
}

/// Areas of intersection and union of the drawn and the observed mask, pixels.
#[must_use]
pub fn overlap(drawn: &mut Silhouette, observed: &ObservedMask) -> (f64, f64) {
    let rect = drawn.rect;
    let (mut both, mut area) = (0, 0);
    if drawn.by_contour {
        for &(row, start, end) in &drawn.spans {
            area += u64::from(end - start);
            let (y, from, to) = (rect.y0 + i64::from(row), rect.x0 + i64::from(start), rect.x0 + i64::from(end));
            both += observed.count(y, from, to);
        }
    } else {
        for (i, _) in drawn.mask().iter().enumerate().filter(|(_, m)| **m > 0) {
            area += 1;
            let (x, y) = (rect.x0 + (i % rect.width) as i64, rect.y0 + (i / rect.width) as i64);
            both += u64::from(observed.at(x, y));
        }
    }
    (both as f64, (area + observed.area - both) as f64)
}

/// Add a piece's integral to the gradients over its edge's ends on the image.
fn integrate_piece(drawn: &Silhouette, piece: &Piece, observed: &ObservedMask, slopes: (f64, f64), moved: &mut Moved) {
    let [first, second] = drawn.contour.edges[piece.edge as usize].map(|v| v as usize);
    let (a, b) = (drawn.pixels[first], drawn.pixels[second]);
    let along = b - a;
    let steep = along.y.abs() >= along.x.abs();
    let Some(walk) = Walk::new(&a, &along, steep, piece, &drawn.rect) else { return };
    let (of_first, of_second) = walk.integrate(observed, slopes);
    if of_first != 0.0 || of_second != 0.0 {
        // a shift of the border along its outward normal, of the edge's length, sweeps as much area as it is long
        let outward = if steep { Vector2::new(-1.0, walk.slope) } else { Vector2::new(-walk.slope, 1.0) };
        let outward = outward * if steep { along.y.signum() } else { along.x.signum() };
        moved.add(first, outward * of_first);
        moved.add(second, outward * of_second);
    }
}

/// The same integral by samples of the outline, for meshes that reach too far off the image.
fn integrate_samples(
    chain: &Chain,
    topology: &Topology,
    drawn: &mut Silhouette,
    observed: &ObservedMask,
    slopes: (f64, f64),
) -> Vec<Vector3<f64>> {
    let mut in_camera = vec![Vector3::zeros(); chain.points_in_object.len()];
    let rect = drawn.rect;
    for s in outline(chain.camera, chain.points_in_camera, topology, &rect, drawn.mask(), SAMPLE_STEP_PX) {
        let inside = observed.at(s.pixel.x.round() as i64, s.pixel.y.round() as i64) > 0;
        let on_image = s.normal * (s.length * if inside { slopes.0 } else { slopes.1 });
        for (vertex, lever) in s.vertices.into_iter().zip(s.levers(chain.camera, chain.points_in_camera)) {
            in_camera[vertex as usize] += lever.transpose() * on_image;
        }
    }
    in_camera
}
