//! The mask of a mesh from its contour alone.
//!
//! In the image all front faces turn the same way, so how many of them cover a point is the winding number of the
//! boundary of their region: of the contour edges, a tenth of all edges. A closed mesh needs no triangle to be filled:
//! the few crossings of each pixel row are sorted, and where the winding number is not 0 is the mask. A mesh that is
//! open, or that the near plane cuts, is filled triangle by triangle; both give the same pixels.

use nalgebra::{Vector2, Vector3};

use crate::camera::Camera;
use crate::mesh::Topology;
use crate::raster::{NEAR_M, Rect, fill_mask};
use crate::rounding::ceil;

/// Vertices farther off the image than this are left to the triangles, pixels.
const FARTHEST_PX: f64 = 1e5;

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
    /// Pixels of the vertices; meaningless behind the near plane.
    pub pixels: Vec<Vector2<f64>>,
    /// The rectangle drawn: what the mesh may cover of the image.
    pub rect: Rect,
    /// Contour edges of a closed mesh before the near plane, each in the direction of its front face: the outer side of
    /// the way from the first vertex to the second is to the left as the image is seen.
    pub contour: Vec<[u32; 2]>,
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
    mask: Vec<u8>,
    front: Vec<u8>,
    chosen: Vec<u32>,
}

impl Silhouette {
    /// Draw a mesh whose vertices are given in the camera's frame.
    pub fn draw(&mut self, camera: &Camera, points_in_camera: &[Vector3<f64>], topology: &Topology) {
        let before = self.project(camera, points_in_camera);
        let image = Rect::image(camera);
        let around = if before { Rect::around(self.pixels.iter().copied()) } else { image };
        self.rect = around.intersection(&image);
        self.clipped = self.rect != around;
        self.contour.clear();
        self.spans.clear();
        self.by_contour = before && topology.closed;
        if self.by_contour {
            self.find_contour(topology);
            self.scan();
        } else {
            self.mask.clear();
            self.mask.resize(self.rect.area(), 0);
            fill_mask(camera, points_in_camera, &topology.faces, &self.rect, &mut self.mask);
        }
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

    /// Project all vertices; whether all lie before the near plane and not too far off the image.
    fn project(&mut self, camera: &Camera, points: &[Vector3<f64>]) -> bool {
        self.pixels.clear();
        self.pixels.extend(points.iter().map(|p| camera.project(p)));
        let near = points.iter().fold(true, |all, p| all & (p.z >= NEAR_M));
        // written so that what is not a number fails
        near && self.pixels.iter().fold(true, |all, y| all & (y.x.abs() < FARTHEST_PX) & (y.y.abs() < FARTHEST_PX))
    }

    fn find_contour(&mut self, topology: &Topology) {
        let pixels = self.pixels.as_slice();
        self.front.clear();
        self.front.extend(topology.faces.iter().map(|&[a, b, c]| {
            let (p, q, r) = (pixels[a as usize], pixels[b as usize], pixels[c as usize]);
            u8::from((q.x - p.x) * (r.y - p.y) - (q.y - p.y) * (r.x - p.x) < 0.0)
        }));
        // one edge in ten is chosen: written without a branch that would be mispredicted
        self.chosen.resize(topology.edges.len() + 1, 0);
        let (front, chosen, mut count) = (self.front.as_slice(), self.chosen.as_mut_slice(), 0);
        for (i, edge) in topology.edges.iter().enumerate() {
            chosen[count] = i as u32;
            count += usize::from(front[edge.faces[0] as usize] != front[edge.faces[1] as usize]);
        }
        self.contour.extend(chosen[..count].iter().map(|&i| {
            let edge = &topology.edges[i as usize];
            let first_is_front = front[edge.faces[0] as usize] > 0;
            let direction = edge.directions[usize::from(!first_is_front)];
            let [a, b] = edge.vertices;
            if direction > 0 { [a, b] } else { [b, a] }
        }));
    }

    fn scan(&mut self) {
        let Self { rows, contour, pixels, rect, spans, span_start, .. } = self;
        rows.cross(contour, pixels, rect);
        rows.walk(rect, spans, span_start);
    }
}

impl Rows {
    /// Cross every contour edge with every row.
    fn cross(&mut self, contour: &[[u32; 2]], pixels: &[Vector2<f64>], rect: &Rect) {
        let height = rect.height as i64;
        self.edges.clear();
        self.starts.clear();
        self.starts.resize(rect.height + 1, 0);
        let mut entries = 0;
        for edge in contour {
            let (a, b) = (pixels[edge[0] as usize].y, pixels[edge[1] as usize].y);
            let row = |y: f64| (ceil(y) - rect.y0).clamp(0, height) as u32;
            let (from, to) = (row(a.min(b)), row(a.max(b)));
            self.edges.push((from, entries, to - from));
            entries += to - from;
            for count in &mut self.starts[from as usize..to as usize] {
                *count += 1;
            }
        }
        let mut sum = 0;
        for count in &mut self.starts {
            let here = *count;
            *count = sum;
            sum += here;
        }
        self.crossings.resize(entries as usize, Crossing::default());
        self.outer.resize(entries as usize, 0);
        for (edge, &(from, first, count)) in contour.iter().zip(&self.edges) {
            let (a, b) = (pixels[edge[0] as usize], pixels[edge[1] as usize]);
            let down = (a.y, a.x) <= (b.y, b.x);
            let (top, bottom) = if down { (a, b) } else { (b, a) };
            let slope = (bottom.x - top.x) / (bottom.y - top.y);
            let change = if down { 1 } else { -1 };
            for (k, start) in self.starts[from as usize..(from + count) as usize].iter_mut().enumerate() {
                let y = (rect.y0 + i64::from(from) + k as i64) as f64;
                let at = top.x + (y - top.y) * slope;
                self.crossings[*start as usize] = Crossing { at, entry: first + k as u32, change };
                *start += 1;
            }
        }
    }

    /// Walk each row's crossings in order: runs of winding numbers above 0 are covered. `starts` hold the rows' ends.
    fn walk(&mut self, rect: &Rect, spans: &mut Vec<(u32, u32, u32)>, span_start: &mut Vec<u32>) {
        let column = |x: f64| (ceil(x) - rect.x0).clamp(0, rect.width as i64) as u32;
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

/// Rows have a handful of crossings.
#[inline]
fn insertion_sort(values: &mut [Crossing]) {
    for i in 1..values.len() {
        let value = values[i];
        let mut j = i;
        while j > 0 && values[j - 1].at > value.at {
            values[j] = values[j - 1];
            j -= 1;
        }
        values[j] = value;
    }
}
