//! The mask of a mesh, and which parts of its contour bound it, from the contour alone.
//!
//! In the image all front faces turn the same way, so how many of them cover a point is the winding number of the
//! boundary of their region: of the contour edges, a tenth of all edges. A closed mesh needs no triangle to be filled:
//! the few crossings of each scanline are sorted, and where the winding number is not 0 is the mask. A crossing bounds
//! the mask if the winding number is 0 on one of its sides; where it is not, the mesh lies on both sides. A mesh that is
//! open, or that the near plane cuts, is filled triangle by triangle; both give the same pixels.

use nalgebra::{Vector2, Vector3};

use crate::camera::Camera;
use crate::mesh::Topology;
use crate::raster::{NEAR_M, Rect, fill_mask};

/// A contour edge on the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContourEdge {
    /// Its vertices.
    pub vertices: [u32; 2],
    /// +1 if its front face runs from the first vertex to the second, −1 if back.
    pub side: i8,
}

/// Which crossings of contour edges with scanlines bound the mask.
#[derive(Debug, Clone, Default)]
pub struct Scan {
    /// Scanlines a pixel; odd, so that one runs through the pixels' centres.
    pub lines_per_pixel: i64,
    /// 1 for crossings that bound the mask, edge by edge and line by line.
    pub bounds: Vec<u8>,
    /// First line that each edge crosses, its first entry in `bounds`, and how many lines it crosses.
    pub edges: Vec<(i64, u32, u32)>,
    starts: Vec<u32>,
    crossings: Vec<Crossing>,
}

/// Where a contour edge meets a scanline.
#[derive(Debug, Clone, Copy, Default)]
struct Crossing {
    /// Position along the line, pixels.
    at: f64,
    /// Its entry in `bounds`.
    entry: u32,
    /// How the winding number changes there.
    change: i32,
}

/// Buffers that one drawing after another reuses.
#[derive(Debug, Clone, Default)]
pub struct Silhouette {
    /// Pixels of the vertices; meaningless behind the near plane.
    pub pixels: Vec<Vector2<f64>>,
    /// The rectangle drawn: what the mesh may cover of the image.
    pub rect: Rect,
    /// 1 where the mesh covers the pixel's centre, row-major over `rect`.
    pub mask: Vec<u8>,
    /// Contour edges, of a closed mesh before the near plane only.
    pub contour: Vec<ContourEdge>,
    /// Runs of covered pixels: (row, first column, column after the last), relative to `rect`; of such meshes only.
    pub spans: Vec<(u32, u32, u32)>,
    /// Whether contour, spans and scans are filled in.
    pub by_contour: bool,
    /// Crossings with rows.
    pub rows: Scan,
    /// Crossings with columns; filled in by [`Silhouette::scan_columns`].
    pub columns: Scan,
    front: Vec<u8>,
}

impl Silhouette {
    /// Draw a mesh whose vertices are given in the camera's frame, with `lines_per_pixel` scanlines (odd).
    pub fn draw(
        &mut self,
        camera: &Camera,
        points_in_camera: &[Vector3<f64>],
        topology: &Topology,
        lines_per_pixel: i64,
    ) {
        let before = self.project(camera, points_in_camera);
        let image = Rect::image(camera);
        self.rect = if before { Rect::around(self.pixels.iter().copied()).intersection(&image) } else { image };
        self.mask.clear();
        self.mask.resize(self.rect.area(), 0);
        self.contour.clear();
        self.spans.clear();
        self.by_contour = before && topology.closed;
        if self.by_contour {
            self.find_contour(topology);
            self.scan_rows(lines_per_pixel);
        } else {
            fill_mask(camera, points_in_camera, &topology.faces, &self.rect, &mut self.mask);
        }
    }

    /// Whether the mesh covers a pixel.
    #[must_use]
    pub fn covers(&self, x: i64, y: i64) -> bool {
        self.rect.index(x, y).is_some_and(|i| self.mask[i] > 0)
    }

    /// Project all vertices; whether all lie before the near plane and not too far off the image.
    fn project(&mut self, camera: &Camera, points: &[Vector3<f64>]) -> bool {
        self.pixels.clear();
        let (mut nearest, mut farthest) = (f64::INFINITY, 0.0f64);
        for p in points {
            nearest = nearest.min(p.z);
            let pixel = camera.project(p);
            farthest = farthest.max(pixel.x.abs()).max(pixel.y.abs());
            self.pixels.push(pixel);
        }
        nearest >= NEAR_M && farthest < 1e5
    }

    fn find_contour(&mut self, topology: &Topology) {
        let pixels = &self.pixels;
        self.front.clear();
        self.front.extend(topology.faces.iter().map(|&[a, b, c]| {
            let (p, q, r) = (pixels[a as usize], pixels[b as usize], pixels[c as usize]);
            u8::from((q.x - p.x) * (r.y - p.y) - (q.y - p.y) * (r.x - p.x) < 0.0)
        }));
        for edge in &topology.edges {
            let (first, second) = (self.front[edge.faces[0] as usize], self.front[edge.faces[1] as usize]);
            if first != second {
                let side = if first > 0 { edge.directions[0] } else { edge.directions[1] };
                self.contour.push(ContourEdge { vertices: edge.vertices, side });
            }
        }
    }

    fn scan_rows(&mut self, lines_per_pixel: i64) {
        let rect = self.rect;
        let (mask, spans) = (&mut self.mask, &mut self.spans);
        let column = |x: f64| (x.ceil() as i64 - rect.x0).clamp(0, rect.width as i64) as usize;
        self.rows.scan::<true>(&self.contour, &self.pixels, &rect, lines_per_pixel, |row, from, to| {
            let (start, end) = (column(from), column(to));
            if start < end {
                spans.push((row as u32, start as u32, end as u32));
                mask[row * rect.width + start..row * rect.width + end].fill(1);
            }
        });
    }

    /// Scan the columns too, for edges that are flatter than steep.
    pub fn scan_columns(&mut self, lines_per_pixel: i64) {
        self.columns.scan::<false>(&self.contour, &self.pixels, &self.rect, lines_per_pixel, |_, _, _| {});
    }
}

impl Scan {
    /// Cross every contour edge with every line, sort each line's crossings, walk them. `covered` gets the runs of the
    /// lines through pixel centres: which pixel line, from where to where.
    fn scan<const ROWS: bool>(
        &mut self,
        contour: &[ContourEdge],
        pixels: &[Vector2<f64>],
        rect: &Rect,
        lines_per_pixel: i64,
        mut covered: impl FnMut(usize, f64, f64),
    ) {
        self.lines_per_pixel = lines_per_pixel;
        let (first_pixel, size) = if ROWS { (rect.y0, rect.height) } else { (rect.x0, rect.width) };
        let lines = size as i64 * lines_per_pixel;
        let (scale, shift) = (lines_per_pixel as f64, 0.5 - first_pixel as f64);
        // (along the lines' normal, along the lines)
        let place = |v: u32| {
            let p = pixels[v as usize];
            if ROWS { (p.y, p.x) } else { (p.x, p.y) }
        };
        self.edges.clear();
        self.starts.clear();
        self.starts.resize(lines as usize + 1, 0);
        let mut entries = 0;
        for edge in contour {
            let (a, b) = (place(edge.vertices[0]).0, place(edge.vertices[1]).0);
            let line = |y: f64| (((y + shift) * scale - 0.5).ceil() as i64).clamp(0, lines);
            let (from, to) = (line(a.min(b)), line(a.max(b)));
            self.edges.push((from, entries, (to - from) as u32));
            entries += (to - from) as u32;
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
        self.crossings.clear();
        self.crossings.resize(entries as usize, Crossing::default());
        self.bounds.clear();
        self.bounds.resize(entries as usize, 0);
        for (edge, &(from, first, count)) in contour.iter().zip(&self.edges) {
            let (a, b) = (place(edge.vertices[0]), place(edge.vertices[1]));
            let (low, high, down) = if a <= b { (a, b, true) } else { (b, a, false) };
            let slope = (high.1 - low.1) / (high.0 - low.0);
            let change = if (edge.side > 0) == down { 1 } else { -1 };
            for k in 0..count {
                let line = from + i64::from(k);
                let y = strip_centre(first_pixel, line, scale);
                let x = low.1 + (y - low.0) * slope;
                let at = &mut self.starts[line as usize];
                self.crossings[*at as usize] = Crossing { at: x, entry: first + k, change };
                *at += 1;
            }
        }
        self.walk(lines, |line, from, to| {
            if line % lines_per_pixel == lines_per_pixel / 2 {
                covered((line / lines_per_pixel) as usize, from, to);
            }
        });
    }

    /// Walk each line's crossings in order: those next to winding number 0 bound the mask. `starts` hold the ends.
    fn walk(&mut self, lines: i64, mut covered: impl FnMut(i64, f64, f64)) {
        let mut start = 0;
        for line in 0..lines {
            let end = self.starts[line as usize] as usize;
            let crossings = &mut self.crossings[start..end];
            insertion_sort(crossings);
            let (mut winding, mut from) = (0, 0.0);
            for crossing in crossings.iter() {
                let before = winding;
                winding += crossing.change;
                if before == 0 {
                    from = crossing.at;
                } else if winding == 0 {
                    covered(line, from, crossing.at);
                }
                if before == 0 || winding == 0 {
                    self.bounds[crossing.entry as usize] = 1;
                }
            }
            start = end;
        }
    }
}

/// Where a line runs: the centre of its strip, the pixel's own centre for the middle one.
#[inline]
fn strip_centre(first_pixel: i64, line: i64, lines_per_pixel: f64) -> f64 {
    if lines_per_pixel == 1.0 {
        return (first_pixel + line) as f64;
    }
    let per = lines_per_pixel as i64;
    let within = (line % per - per / 2) as f64 / lines_per_pixel;
    (first_pixel + line / per) as f64 + within
}

/// Lines have a handful of crossings.
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
