//! The mask of a mesh from its contour alone.
//!
//! In the image all front faces turn the same way, so how many of them cover a point is the winding number of the
//! boundary of their region: of the contour edges, a tenth of all edges. A closed mesh needs no triangle to be filled:
//! the few crossings of each pixel row are sorted, and where the winding number is not 0 is the mask. A mesh that is
//! open, or that the near plane cuts, is filled triangle by triangle; both give the same pixels.

use nalgebra::{Vector2, Vector3};

use crate::camera::Camera;
use crate::contour::Contour;
use crate::lie::Pose;
use crate::mesh::Topology;
use crate::prepared::{Prepared, Verdicts};
use crate::raster::{NEAR_M, Rect, fill_mask};
use crate::rounding::ceil_near;
use crate::strips::Strips;

/// Vertices of closed meshes farther off the image than this are left to the triangles, pixels.
const FARTHEST_PX: f64 = 1e5;

/// So are those of any mesh; the near plane sends vertices far off.
const FARTHEST_CONTOUR_PX: f64 = 1e7;

/// What the near plane cuts lies within this distance, metres.
const FARTHEST_M: f64 = 1e5;

/// Where a contour edge meets a pixel row.
#[derive(Debug, Clone, Copy, Default)]
struct Crossing {
    /// Position along the row, pixels.
    at: f64,
    /// Its entry in [`Rows::outer`].
    entry: u32,
    /// How the winding number changes there.
    change: i32,
}

impl Crossing {
    #[inline]
    fn is_after(&self, other: &Self) -> bool {
        (self.at > other.at) | ((self.at == other.at) & (self.entry > other.entry))
    }
}

/// Contour edges against the rows of pixel centres.
#[derive(Debug, Clone, Default)]
pub struct Rows {
    /// For each edge the first row that it crosses (relative to the rectangle), its first entry in `outer`, and how many
    /// rows it crosses.
    pub edges: Vec<(u32, u32, u32)>,
    /// Winding number on the outer side at each crossing, edge by edge and row by row.
    pub outer: Vec<i32>,
    starts: Vec<u32>,
    crossings: Vec<Crossing>,
}

/// Buffers that one drawing after another reuses.
#[derive(Debug, Clone, Default)]
pub struct Silhouette {
    /// Pixels of the contour's vertices; those of others are meaningless.
    pub pixels: Vec<Vector2<f64>>,
    /// The rectangle drawn: what the mesh may cover of the image.
    pub rect: Rect,
    /// Contour edges of a mesh that is drawn by them.
    pub contour: Contour,
    /// Runs of covered pixels of such a mesh: (row, first column, column after the last), relative to `rect`.
    pub spans: Vec<(u32, u32, u32)>,
    /// First span of each row of `rect`; one entry more than rows.
    pub span_start: Vec<u32>,
    /// Whether the image's edge cuts the mesh off.
    pub clipped: bool,
    /// Whether contour, rows and spans are filled in; else `mask` is.
    pub by_contour: bool,
    /// The contour's crossings with rows.
    pub rows: Rows,
    /// Its edges from left to right.
    pub(crate) strips: Strips,
    mask: Vec<u8>,
    verdicts: Verdicts,
}

impl Silhouette {
    /// Draw a mesh whose vertices are given in the camera's frame: a closed one before the near plane by its contour, others by
    /// their triangles.
    pub fn draw(&mut self, camera: &Camera, points_in_camera: &[Vector3<f64>], topology: &Topology) {
        self.project(camera, points_in_camera);
        let before = points_in_camera.iter().fold(true, |all, p| all & (p.z >= NEAR_M)) && self.is_within(FARTHEST_PX);
        if before && topology.closed {
            self.contour.find_closed(&self.pixels, topology);
            self.scan(camera);
        } else {
            let image = Rect::image(camera);
            let around = if before { Rect::around(self.pixels.iter().copied()) } else { image };
            self.fill(camera, points_in_camera, topology, around);
        }
    }

    /// Draw any mesh by its contour: open ones and those that the near plane cuts, too. Only what reaches too far off the
    /// image is left to the triangles.
    pub fn draw_by_contour(&mut self, camera: &Camera, points_in_camera: &[Vector3<f64>], topology: &Topology) {
        self.project(camera, points_in_camera);
        let before = points_in_camera.iter().fold(true, |all, p| all & (p.z >= NEAR_M));
        if before && topology.closed && self.is_within(FARTHEST_PX) {
            self.contour.find_closed(&self.pixels, topology);
            return self.scan(camera);
        }
        // where edges reach farther, the points at which the near plane cuts them have no digits left
        if !before && !points_in_camera.iter().all(|p| p.amax() < FARTHEST_M) {
            return self.fill(camera, points_in_camera, topology, Rect::image(camera));
        }
        for (pixel, point) in self.pixels.iter_mut().zip(points_in_camera) {
            if point.z < NEAR_M {
                *pixel = Vector2::zeros();
            }
        }
        self.contour.find(camera, points_in_camera, &mut self.pixels, topology);
        if self.is_within(FARTHEST_CONTOUR_PX) {
            self.scan(camera);
        } else {
            self.fill(camera, points_in_camera, topology, Rect::image(camera));
        }
    }

    /// Draw a prepared mesh by its contour, if it lies before the near plane and not too far off; `points_in_camera` gets the
    /// contour's vertices, what it holds of others is meaningless. All is as [`Silhouette::draw_by_contour`] finds it.
    pub fn draw_prepared(
        &mut self,
        camera: &Camera,
        camera_from_object: &Pose,
        mesh: &Prepared,
        topology: &Topology,
        points_in_camera: &mut Vec<Vector3<f64>>,
    ) -> bool {
        let Some(sight) = mesh.sight(camera, camera_from_object, FARTHEST_PX) else { return false };
        let Self { contour, pixels, verdicts, .. } = self;
        mesh.judge(&sight, verdicts);
        let point = |v: u32| camera_from_object.transform(&mesh.vertices[v as usize]);
        contour.find_judged(verdicts, topology, |v| camera.project(&point(v)));
        points_in_camera.resize(topology.vertex_count, Vector3::zeros());
        pixels.resize(topology.vertex_count, Vector2::zeros());
        for &[vertex, _] in &contour.edges {
            let here = point(vertex);
            points_in_camera[vertex as usize] = here;
            pixels[vertex as usize] = camera.project(&here);
        }
        self.scan(camera);
        true
    }

    /// Whether a mesh drawn by its contour covers the centre of an image pixel.
    #[inline]
    #[must_use]
    pub fn covers(&self, x: i64, y: i64) -> bool {
        let (u, v) = (x.wrapping_sub(self.rect.x0) as u64, y.wrapping_sub(self.rect.y0) as u64);
        if v >= self.rect.height as u64 {
            return false;
        }
        let (from, to) = (self.span_start[v as usize] as usize, self.span_start[v as usize + 1] as usize);
        self.spans[from..to].iter().any(|&(_, start, end)| u >= u64::from(start) && u < u64::from(end))
    }

    /// The mask drawn: 1 where the mesh covers the pixel's centre, row-major over `rect`.
    pub fn mask(&mut self) -> &[u8] {
        if self.by_contour {
            self.mask.clear();
            self.mask.resize(self.rect.area(), 0);
            for &(row, start, end) in &self.spans {
                let base = row as usize * self.rect.width;
                self.mask[base + start as usize..base + end as usize].fill(1);
            }
        }
        &self.mask
    }

    fn project(&mut self, camera: &Camera, points: &[Vector3<f64>]) {
        self.pixels.clear();
        self.pixels.extend(points.iter().map(|p| camera.project(p)));
    }

    /// Whether all pixels are numbers below a limit; written so that what is not a number fails.
    fn is_within(&self, farthest_px: f64) -> bool {
        self.pixels.iter().fold(true, |all, y| all & (y.x.abs() < farthest_px) & (y.y.abs() < farthest_px))
    }

    fn set_rect(&mut self, camera: &Camera, around: Rect) {
        self.rect = around.intersection(&Rect::image(camera));
        self.clipped = self.rect != around;
        self.spans.clear();
    }

    fn fill(&mut self, camera: &Camera, points: &[Vector3<f64>], topology: &Topology, around: Rect) {
        self.set_rect(camera, around);
        self.contour.clear();
        self.by_contour = false;
        self.mask.clear();
        self.mask.resize(self.rect.area(), 0);
        fill_mask(camera, points, &topology.faces, &self.rect, &mut self.mask);
    }

    /// Fill in what the contour says.
    fn scan(&mut self, camera: &Camera) {
        self.strips.sort(&self.contour.edges, &self.pixels);
        self.set_rect(camera, Rect::spanned(&self.strips.bounds));
        self.by_contour = true;
        let Self { rows, contour, strips, pixels, rect, spans, span_start, .. } = self;
        rows.cross(contour, &strips.order, pixels, rect);
        rows.walk(rect, spans, span_start);
    }
}

impl Rows {
    /// Cross every contour edge with every row; `order` is that in which a row shall get its crossings.
    fn cross(&mut self, contour: &Contour, order: &[u32], pixels: &[Vector2<f64>], rect: &Rect) {
        let height = rect.height as i64;
        let Self { edges, starts, outer, crossings } = self;
        edges.clear();
        starts.clear();
        starts.resize(rect.height + 1, 0);
        let mut entries = 0;
        for edge in &contour.edges {
            let (a, b) = (pixels[edge[0] as usize].y, pixels[edge[1] as usize].y);
            let row = |y: f64| (ceil_near(y) - rect.y0).clamp(0, height) as u32;
            let (from, to) = if a < b { (row(a), row(b)) } else { (row(b), row(a)) };
            edges.push((from, entries, to - from));
            entries += to - from;
            // one more from there on, one less from there on
            starts[from as usize] = starts[from as usize].wrapping_add(1);
            starts[to as usize] = starts[to as usize].wrapping_sub(1);
        }
        let (mut sum, mut here) = (0, 0_u32);
        for start in starts.iter_mut() {
            here = here.wrapping_add(*start);
            *start = sum;
            sum += here;
        }
        crossings.resize(entries as usize, Crossing::default());
        outer.resize(entries as usize, 0);
        for &number in order {
            let (edge, step) = (contour.edges[number as usize], contour.steps[number as usize]);
            let (from, first, count) = edges[number as usize];
            let (a, b) = (pixels[edge[0] as usize], pixels[edge[1] as usize]);
            let down = (a.y, a.x) <= (b.y, b.x);
            let (top, bottom) = if down { (a, b) } else { (b, a) };
            let slope = (bottom.x - top.x) / (bottom.y - top.y);
            let change = if down { step } else { -step };
            for (k, start) in starts[from as usize..(from + count) as usize].iter_mut().enumerate() {
                let y = (rect.y0 + i64::from(from) + k as i64) as f64;
                let at = top.x + (y - top.y) * slope;
                crossings[*start as usize] = Crossing { at, entry: first + k as u32, change };
                *start += 1;
            }
        }
    }

    /// Walk each row's crossings in order: runs of winding numbers above 0 are covered. `starts` hold the rows' ends.
    fn walk(&mut self, rect: &Rect, spans: &mut Vec<(u32, u32, u32)>, span_start: &mut Vec<u32>) {
        let column = |x: f64| (ceil_near(x) - rect.x0).clamp(0, rect.width as i64) as u32;
        let mut start = 0;
        span_start.clear();
        span_start.push(0);
        for row in 0..rect.height {
            let end = self.starts[row] as usize;
            let crossings = &mut self.crossings[start..end];
            insertion_sort(crossings);
            let (mut winding, mut from) = (0, 0.0);
            for crossing in crossings.iter() {
                let before = winding;
                winding += crossing.change;
                self.outer[crossing.entry as usize] = before.min(winding);
                if before == 0 {
                    from = crossing.at;
                } else if winding == 0 {
                    let (first, last) = (column(from), column(crossing.at));
                    if first < last {
                        spans.push((row as u32, first, last));
                    }
                }
            }
            start = end;
            span_start.push(spans.len() as u32);
        }
    }
}

/// Rows have a handful of crossings, which come nearly sorted; at the same place they are in the order of their edges.
#[inline]
fn insertion_sort(values: &mut [Crossing]) {
    for i in 1..values.len() {
        let value = values[i];
        let mut j = i;
        while j > 0 && values[j - 1].is_after(&value) {
            values[j] = values[j - 1];
            j -= 1;
        }
        values[j] = value;
    }
}
