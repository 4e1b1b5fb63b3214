//! The exact gradient against differences of areas, for every kind of mesh; drawing by contours against triangles; a mesh
//! that stays against one that is looked at anew.

use meshslam_core::camera::Camera;
use meshslam_core::gradients::exact::{Workspace, exact_gradient, prepared_gradient};
use meshslam_core::gradients::{MaskGradient, ObservedMask};
use meshslam_core::lie::Pose;
use meshslam_core::mesh::Topology;
use meshslam_core::prepared::Prepared;
use meshslam_core::raster::{NEAR_M, Rect, for_each_triangle};
use meshslam_core::silhouette::Silhouette;
use meshslam_core::visible::{Visible, outer_winding};
use nalgebra::{Vector3, Vector6};

use crate::common::{Faces, Random, camera, cuboid, drawn, icosphere, joined, placed, signed};

type Mesh = (Vec<Vector3<f64>>, Faces);

/// A sphere with bumps.
fn lump(seed: u64, depth: usize) -> Mesh {
    let mut random = Random(seed);
    let (sphere, faces) = icosphere(depth);
    (sphere.iter().map(|v| v * random.uniform(0.7, 1.2)).collect(), faces)
}

/// Some of a mesh's faces.
fn some((vertices, faces): Mesh, keep: impl FnMut(&[u32; 3]) -> bool) -> Mesh {
    let mut keep = keep;
    (vertices, faces.into_iter().filter(|face| keep(face)).collect())
}

fn half(mesh: Mesh) -> Mesh {
    let vertices = mesh.0.clone();
    some(mesh, |face| face.iter().map(|&v| vertices[v as usize].y).sum::<f64>() > 0.0)
}

fn with_holes(seed: u64, mesh: Mesh) -> Mesh {
    let mut random = Random(seed);
    some(mesh, |_| random.below(5) > 0)
}

/// Faces turned at random: neighbours no longer agree.
fn turned(seed: u64, (vertices, mut faces): Mesh) -> Mesh {
    let mut random = Random(seed);
    faces.iter_mut().filter(|_| random.below(3) == 0).for_each(|face| face.swap(0, 1));
    (vertices, faces)
}

/// A box with a wall through it, whose edges are held by three faces.
fn walled() -> Mesh {
    let (vertices, mut faces) = cuboid(Vector3::new(-1.0, -0.6, -0.5), Vector3::new(1.0, 0.6, 0.5));
    faces.extend([[0, 3, 7], [0, 7, 4]]);
    (vertices, faces)
}

fn soup(seed: u64) -> Mesh {
    let mut random = Random(seed);
    let vertices = (0..12).map(|_| random.vector(1.0)).collect();
    let corner = |r: &mut Random| r.below(12) as u32;
    (vertices, (0..14).map(|_| std::array::from_fn(|_| corner(&mut random))).collect())
}

fn meshes() -> Vec<(&'static str, Mesh)> {
    let shells =
        || joined(lump(3, 2), (lump(4, 1).0.iter().map(|v| v * 0.8 + Vector3::x() * 0.7).collect(), lump(4, 1).1));
    vec![
        ("lump", lump(1, 2)),
        ("crossing shells", shells()),
        ("open half", half(lump(1, 2))),
        ("half of shells", half(shells())),
        ("holes", with_holes(5, lump(2, 2))),
        ("turned faces", turned(6, lump(2, 2))),
        ("edge of three faces", walled()),
        ("soup", soup(7)),
    ]
}

/// Lines parallel to the rows: `fine` of them in each pixel, in a range of rows.
#[derive(Clone)]
struct Lines {
    rows: std::ops::Range<usize>,
    fine: usize,
}

impl Lines {
    fn place(&self, line: usize) -> f64 {
        self.rows.start as f64 + (line as f64 + 0.5) / self.fine as f64 - 0.5
    }

    /// Intervals of columns that triangles cover on each line.
    fn spans(&self, camera: &Camera, points: &[Vector3<f64>], faces: &[[u32; 3]]) -> Vec<Vec<(f64, f64)>> {
        let mut lines = vec![Vec::new(); self.rows.len() * self.fine];
        for_each_triangle(camera, points, faces, |_, corners| {
            let corners = corners.map(|(p, _)| p);
            let low = corners.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
            let high = corners.iter().map(|p| p.y).fold(f64::NEG_INFINITY, f64::max);
            let first = ((low - self.place(0)) * self.fine as f64).max(0.0) as usize;
            for (line, spans) in
                lines.iter_mut().enumerate().skip(first).take_while(|(line, _)| self.place(*line) < high)
            {
                let y = self.place(line);
                let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
                for k in 0..3 {
                    let (a, b) = (corners[k], corners[(k + 1) % 3]);
                    if (a.y <= y) != (b.y <= y) {
                        let x = a.x + (y - a.y) * (b.x - a.x) / (b.y - a.y);
                        (left, right) = (left.min(x), right.max(x));
                    }
                }
                spans.push((left, right));
            }
        });
        lines
    }

    /// Areas of the overlap with the observed mask and of the drawn mask, pixels: exact along lines, sums across them.
    fn areas(&self, camera: &Camera, points: &[Vector3<f64>], faces: &[[u32; 3]], observed: &ObservedMask) -> [f64; 2] {
        let (mut both, mut area) = (0.0, 0.0);
        for (line, mut spans) in self.spans(camera, points, faces).into_iter().enumerate() {
            spans.sort_by(|a, b| a.0.total_cmp(&b.0));
            let row = (self.rows.start + line / self.fine) as i64;
            let mut end = -0.5; // what lies left of it is counted
            for (left, right) in spans {
                let (left, right) = (left.max(end), right.min(camera.width as f64 - 0.5));
                if left < right {
                    area += right - left;
                    for column in (left + 0.5) as i64..=(right + 0.5) as i64 {
                        let part = right.min(column as f64 + 0.5) - left.max(column as f64 - 0.5);
                        both += part * f64::from(observed.at(column, row));
                    }
                    end = right;
                }
            }
        }
        [both / self.fine as f64, area / self.fine as f64]
    }
}

struct Case {
    camera: Camera,
    pose: Pose,
    mesh: Mesh,
    observed: ObservedMask,
}

impl Case {
    /// The mask of the same thing, a little turned and moved.
    fn new(camera: Camera, pose: Pose, mesh: Mesh) -> Self {
        let step = Vector6::new(0.05, -0.06, 0.04, 0.06, 0.04, -0.05);
        let mask = drawn(&camera, &placed(&pose.retract(&step), &mesh.0), &mesh.1);
        Self { camera, pose, mesh, observed: ObservedMask::new(Rect::image(&camera), &mask).unwrap() }
    }

    fn topology(&self) -> Topology {
        Topology::new(self.mesh.0.len(), &signed(&self.mesh.1)).unwrap()
    }

    fn gradient(&self) -> MaskGradient {
        let work = &mut Workspace::default();
        exact_gradient(&self.camera, &self.pose, &self.mesh.0, &self.topology(), &self.observed, work)
    }

    /// Derivative of the loss by areas along a way that vertices go.
    fn difference(&self, found: &MaskGradient, lines: &Lines, vertices: impl Fn(f64) -> Vec<Vector3<f64>>) -> f64 {
        const STEP: f64 = 1e-6;
        let at = |by: f64| lines.areas(&self.camera, &placed(&self.pose, &vertices(by)), &self.mesh.1, &self.observed);
        let (low, high) = (at(-STEP), at(STEP));
        let [both, area] = [0, 1].map(|k| (high[k] - low[k]) / (2.0 * STEP));
        -both / found.union + found.intersection / found.union.powi(2) * (area - both)
    }

    /// Lines that see what a vertex moves: through the faces that hold it, or all where one of them is cut.
    fn lines_around(&self, vertex: usize) -> Lines {
        let around = self.mesh.1.iter().filter(|face| face.contains(&(vertex as u32))).flatten();
        let points: Vec<_> = around.map(|&v| self.pose.transform(&self.mesh.0[v as usize])).collect();
        let height = self.camera.height;
        if points.iter().any(|p| p.z < NEAR_M) {
            return Lines { rows: 0..height, fine: 96 };
        }
        let rect = Rect::around(points.iter().map(|p| self.camera.project(p))).intersection(&Rect::image(&self.camera));
        // as many to a small vertex as to a large one
        let fine = (4000 / rect.height.max(1)).clamp(64, 1024);
        Lines { rows: rect.y0 as usize..rect.y0 as usize + rect.height, fine }
    }

    /// Cosine of the gradient over some vertices with differences, and ratio of their lengths.
    fn agreement(&self, random: &mut Random, most: usize) -> (f64, f64) {
        let found = self.gradient();
        let mut moving: Vec<usize> = (0..found.vertices.len()).filter(|v| found.vertices[*v].norm() > 0.0).collect();
        random.shuffle(&mut moving);
        let (mut dot, mut of_found, mut of_areas) = (0.0, 0.0, 0.0);
        for &vertex in moving.iter().take(most) {
            let lines = self.lines_around(vertex);
            for axis in 0..3 {
                let moved = |by: f64| {
                    let mut vertices = self.mesh.0.clone();
                    vertices[vertex][axis] += by;
                    vertices
                };
                let (a, b) = (found.vertices[vertex][axis], self.difference(&found, &lines, moved));
                (dot, of_found, of_areas) = (dot + a * b, of_found + a * a, of_areas + b * b);
            }
        }
        (dot / (of_found * of_areas).sqrt(), (of_found / of_areas).sqrt())
    }
}

fn away(random: &mut Random, depth_m: f64) -> Pose {
    Pose { rotation: random.rotation(), translation: Vector3::new(0.1, -0.15, depth_m) }
}

#[test]
fn it_is_that_of_the_areas_for_every_kind_of_mesh() {
    let mut random = Random(1);
    for (name, mesh) in meshes() {
        for depth_m in [2.5, 5.0, 11.0] {
            let case = Case::new(camera(), away(&mut random, depth_m), mesh.clone());
            let (cosine, ratio) = case.agreement(&mut random, 5);
            assert!(cosine > 0.9995 && (ratio - 1.0).abs() < 0.02, "{name} at {depth_m} m: {cosine} {ratio}");
        }
    }
}

#[test]
fn it_is_that_of_the_areas_where_the_near_plane_cuts() {
    let mut random = Random(2);
    let (mut cut, mut count) = (0, 0);
    for (name, mesh) in meshes() {
        for _ in 0..3 {
            // a wide camera sees where the near plane cuts what it stands in
            let camera = Camera { fx: 25.0, fy: 22.0, ..camera() };
            let pose = Pose { rotation: random.rotation(), translation: Vector3::new(0.4, -0.35, 0.3) };
            let mesh = (mesh.0.iter().map(|v| v * 0.5).collect(), mesh.1.clone());
            let case = Case::new(camera, pose, mesh);
            let points = placed(&case.pose, &case.mesh.0);
            let found = case.gradient();
            if found.vertices.iter().all(|g| g.norm() == 0.0) {
                continue;
            }
            cut += usize::from(points.iter().any(|p| p.z < NEAR_M));
            let (cosine, ratio) = case.agreement(&mut random, 3);
            count += 1;
            assert!(cosine > 0.9995 && (ratio - 1.0).abs() < 0.02, "{name}: {cosine} {ratio}");
        }
    }
    assert!(cut > 12 && count > 12, "{cut} of {count}");
}

#[test]
fn contours_draw_the_pixels_of_the_triangles() {
    let mut random = Random(3);
    let mut work = Silhouette::default();
    let mut by_contour = 0;
    for round in 0..24 {
        for (name, mesh) in meshes() {
            let depth_m = [0.3, 1.0, 3.0, 30.0][round % 4];
            let points = placed(&away(&mut random, depth_m), &mesh.0);
            let topology = Topology::new(points.len(), &signed(&mesh.1)).unwrap();
            work.draw_by_contour(&camera(), &points, &topology);
            by_contour += usize::from(work.by_contour);
            let (expected, rect) = (drawn(&camera(), &points, &mesh.1), work.rect);
            let mask = work.mask();
            for (i, &m) in expected.iter().enumerate() {
                let (x, y) = ((i % camera().width) as i64, (i / camera().width) as i64);
                assert_eq!(m, rect.index(x, y).map_or(0, |at| mask[at]), "{name} at {depth_m} m, pixel {x} {y}");
            }
        }
    }
    assert!(by_contour > 180, "{by_contour}");
}

fn assert_same(a: &MaskGradient, b: &MaskGradient, what: &str) {
    let bits = |g: &MaskGradient| {
        let vertices = g.vertices.iter().flat_map(|v| v.iter().copied());
        let all = vertices.chain(g.object.iter().copied()).chain(g.camera.iter().copied()).chain([g.loss, g.union]);
        all.map(f64::to_bits).collect::<Vec<u64>>()
    };
    assert_eq!(bits(a), bits(b), "{what}");
}

#[test]
fn a_prepared_mesh_gives_the_same_bits() {
    let mut random = Random(4);
    let flat = cuboid(Vector3::new(-1.0, -0.5, -0.5), Vector3::new(1.0, 0.5, 0.5));
    let all = meshes().into_iter().chain([("box", flat), ("fine lump", lump(9, 4)), ("open fine", half(lump(9, 4)))]);
    let (mut work, mut prepared) = (Workspace::default(), 0);
    for (name, mesh) in all {
        for round in 0..24 {
            // some cameras look along faces, some stand close, some so far away that planes tell little
            let mut pose = away(&mut random, [0.8, 2.5, 9.0, 80.0, 4000.0][round % 5]);
            if round % 3 == 0 {
                pose = Pose { rotation: nalgebra::Matrix3::identity(), translation: Vector3::new(1.0, 0.5, 3.5) };
            }
            let case = Case::new(camera(), pose, mesh.clone());
            let topology = case.topology();
            let Some(found) = Prepared::new(&topology, &mesh.0) else { continue };
            let (camera, observed) = (&case.camera, &case.observed);
            let with = prepared_gradient(camera, &case.pose, &found, &topology, observed, &mut work);
            assert_same(&with, &case.gradient(), name);
            prepared += 1;
        }
    }
    assert!(prepared >= 24 * 8, "{prepared}");
}

#[test]
fn a_prepared_mesh_finds_the_contour_that_all_faces_give() {
    let mut random = Random(11);
    for (name, mesh) in [("lump", lump(9, 4)), ("holes", with_holes(2, lump(8, 3)))] {
        let topology = Topology::new(mesh.0.len(), &signed(&mesh.1)).unwrap();
        let prepared = Prepared::new(&topology, &mesh.0).unwrap();
        for _ in 0..20 {
            let pose = away(&mut random, 6.0);
            let (mut with, mut without, mut points) = (Silhouette::default(), Silhouette::default(), Vec::new());
            assert!(with.draw_prepared(&camera(), &pose, &prepared, &topology, &mut points), "{name}");
            without.draw_by_contour(&camera(), &placed(&pose, &mesh.0), &topology);
            assert_eq!((&with.contour.edges, &with.contour.steps), (&without.contour.edges, &without.contour.steps));
            assert_eq!((with.rect, with.clipped, &with.spans), (without.rect, without.clipped, &without.spans));
        }
    }
}

#[test]
fn what_was_evaluated_before_changes_nothing() {
    let mut random = Random(5);
    let mut work = Workspace::default();
    let meshes = meshes();
    for round in 0..60 {
        let (name, mesh) = &meshes[random.below(meshes.len())];
        let case = Case::new(camera(), away(&mut random, 4.0), mesh.clone());
        let topology = case.topology();
        let alone = case.gradient();
        for _ in 0..1 + round % 7 {
            let found = exact_gradient(&case.camera, &case.pose, &mesh.0, &topology, &case.observed, &mut work);
            assert_same(&found, &alone, name);
        }
        // the same faces and a vertex that is elsewhere
        let mut moved = mesh.0.clone();
        moved[0].x += 1e-9;
        let found = exact_gradient(&case.camera, &case.pose, &moved, &topology, &case.observed, &mut work);
        let fresh =
            exact_gradient(&case.camera, &case.pose, &moved, &topology, &case.observed, &mut Workspace::default());
        assert_same(&found, &fresh, name);
    }
}

#[test]
fn another_topology_of_the_same_vertices_is_not_mistaken() {
    let (mesh, mut work) = (lump(1, 2), Workspace::default());
    let case = Case::new(camera(), away(&mut Random(6), 4.0), mesh.clone());
    let topology = case.topology();
    for _ in 0..6 {
        exact_gradient(&case.camera, &case.pose, &mesh.0, &topology, &case.observed, &mut work);
    }
    let other = Case { mesh: half(mesh.clone()), ..Case::new(camera(), case.pose, mesh.clone()) };
    let found = exact_gradient(&case.camera, &case.pose, &mesh.0, &other.topology(), &other.observed, &mut work);
    assert_same(&found, &other.gradient(), "half");
    let prepared = Prepared::new(&topology, &mesh.0).unwrap();
    let found = prepared_gradient(&case.camera, &case.pose, &prepared, &other.topology(), &other.observed, &mut work);
    assert_same(&found, &other.gradient(), "half, prepared as a whole");
}

#[test]
fn what_bounds_the_mask_has_no_face_on_its_outer_side() {
    let mut random = Random(12);
    let (mut drawn, mut visible, mut asked) = (Silhouette::default(), Visible::default(), 0);
    for round in 0..40 {
        for (name, mesh) in meshes() {
            let points = placed(&away(&mut random, [3.0, 20.0, 90.0, 250.0][round % 4]), &mesh.0);
            let topology = Topology::new(points.len(), &signed(&mesh.1)).unwrap();
            drawn.draw_by_contour(&camera(), &points, &topology);
            visible.find(&drawn);
            for piece in visible.pieces.iter().filter(|piece| piece.to - piece.from > 1e-6) {
                assert_eq!(outer_winding(&drawn, piece), 0, "{name} in round {round}: {piece:?}");
                asked += 1;
            }
        }
    }
    assert!(asked > 5000, "{asked}");
}
