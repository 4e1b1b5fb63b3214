//! A boundary walked pixel by pixel: areas forwards, gradients backwards.

use nalgebra::Vector2;

use super::boundary::{Boundary, Segment};
use crate::raster::Rect;
use crate::rounding::nearest;

/// A pixel that the boundary passes through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touched {
    /// Row, relative to the rectangle drawn.
    pub row: u32,
    /// Column, likewise.
    pub column: u32,
    /// How much of it is covered, 0 to 1.
    pub share: f64,
    /// Whether its centre is.
    pub centre: bool,
}

/// Part of a segment within one pixel; column −1 stands for all that is left of the rectangle.
#[derive(Debug, Clone, Copy)]
struct Portion {
    row: u32,
    column: i32,
    segment: u32,
    /// The middle of the portion as a parameter of its edge, and its length.
    at: f64,
    length: f64,
    /// What it adds to the share of its pixel, and of each pixel right of it.
    here: f64,
    right: f64,
}

/// Buffers of the walk.
#[derive(Debug, Clone, Default)]
pub(super) struct Cells {
    pub touched: Vec<Touched>,
    portions: Vec<Portion>,
    start: Vec<u32>,
    order: Vec<u32>,
}

impl Cells {
    /// Walk along a boundary and gather the pixels that it touches, row by row from the left.
    pub fn find(&mut self, boundary: &Boundary) {
        self.portions.clear();
        self.touched.clear();
        if boundary.rect.area() == 0 {
            return;
        }
        for (number, segment) in boundary.segments.iter().enumerate() {
            walk(boundary, segment, number as u32, &mut self.portions);
        }
        self.sort(boundary.rect.height);
        for row in 0..boundary.rect.height {
            self.add_up(boundary, row);
        }
    }

    /// Order the portions by row, and within a row by column.
    fn sort(&mut self, rows: usize) {
        self.start.clear();
        self.start.resize(rows + 2, 0);
        for portion in &self.portions {
            self.start[portion.row as usize + 2] += 1;
        }
        for row in 1..self.start.len() {
            self.start[row] += self.start[row - 1];
        }
        self.order.clear();
        self.order.resize(self.portions.len(), 0);
        for (number, portion) in self.portions.iter().enumerate() {
            let slot = &mut self.start[portion.row as usize + 1];
            self.order[*slot as usize] = number as u32;
            *slot += 1;
        }
        for row in 0..rows {
            let line = &mut self.order[self.start[row] as usize..self.start[row + 1] as usize];
            insertion_sort(line, |&number| self.portions[number as usize].column);
        }
    }

    /// Shares of the touched pixels of a row. Left of each run of them the shares are known to be 0 or 1, so that
    /// rounding does not add up along the row.
    fn add_up(&mut self, boundary: &Boundary, row: usize) {
        let line = &self.order[self.start[row] as usize..self.start[row + 1] as usize];
        let spans = &boundary.spans[boundary.span_start[row] as usize..boundary.span_start[row + 1] as usize];
        let covered = |column: i32| spans.iter().any(|&(_, from, to)| column >= from as i32 && column < to as i32);
        let (mut carry, mut expected) = (0.0, -1);
        let mut k = 0;
        while k < line.len() {
            let column = self.portions[line[k] as usize].column;
            if column != expected {
                carry = f64::from(u8::from(covered(column - 1)));
            }
            let (mut share, mut right) = (carry, carry);
            while let Some(portion) = line.get(k).map(|&n| &self.portions[n as usize]).filter(|p| p.column == column) {
                share += portion.here;
                right += portion.right;
                k += 1;
            }
            (carry, expected) = (right, column + 1);
            if column >= 0 {
                let (row, centre) = (row as u32, covered(column));
                self.touched.push(Touched { row, column: column as u32, share: share.clamp(0.0, 1.0), centre });
            }
        }
    }

    /// Gradients over the boundary's points: ∫ slope n (1 − t) dl and ∫ slope n t dl of each segment.
    pub fn pull(&self, boundary: &Boundary, slope: impl Fn(usize, usize) -> f64, on_image: &mut [Vector2<f64>]) {
        for portion in self.portions.iter().filter(|p| p.column >= 0) {
            let [a, b] = boundary.segments[portion.segment as usize].ends.map(|v| v as usize);
            let along = boundary.points[b] - boundary.points[a];
            let weight = slope(portion.column as usize, portion.row as usize) * portion.length;
            let outward = Vector2::new(-along.y, along.x) * weight;
            on_image[a] += outward * (1.0 - portion.at);
            on_image[b] += outward * portion.at;
        }
    }
}

/// Rows have a handful of portions, and most of them are in order.
fn insertion_sort(values: &mut [u32], key: impl Fn(&u32) -> i32) {
    for i in 1..values.len() {
        let (value, own) = (values[i], key(&values[i]));
        let mut j = i;
        while j > 0 && key(&values[j - 1]) > own {
            values[j] = values[j - 1];
            j -= 1;
        }
        values[j] = value;
    }
}

/// The edge of a segment as a line over its parameter.
struct Line {
    start: Vector2<f64>,
    along: Vector2<f64>,
    segment: u32,
}

impl Line {
    /// Parameters at which a coordinate (0: x, 1: y) passes two values, the smaller parameter first; all or nothing if the
    /// coordinate does not change.
    fn between(&self, axis: usize, low: f64, high: f64) -> (f64, f64) {
        let (start, along) = (self.start[axis], self.along[axis]);
        if along == 0.0 {
            let inside = start >= low && start <= high;
            return if inside { (f64::NEG_INFINITY, f64::INFINITY) } else { (f64::INFINITY, f64::NEG_INFINITY) };
        }
        let (a, b) = ((low - start) / along, (high - start) / along);
        (a.min(b), a.max(b))
    }

    /// The portion between two parameters in a pixel.
    fn portion(&self, rect: &Rect, row: i64, column: i64, from: f64, to: f64) -> Portion {
        let (at, length) = (0.5 * (from + to), to - from);
        let down = self.along.y * length;
        let right_border = (rect.x0 + column) as f64 + 0.5;
        let here = down * (right_border - (self.start.x + self.along.x * at));
        Portion { row: row as u32, column: column as i32, segment: self.segment, at, length, here, right: down }
    }
}

/// Cut a segment into portions; what lies above, below or right of the rectangle adds nothing.
fn walk(boundary: &Boundary, segment: &Segment, number: u32, out: &mut Vec<Portion>) {
    let rect = &boundary.rect;
    let [start, end] = segment.ends.map(|v| boundary.points[v as usize]);
    let line = Line { start, along: end - start, segment: number };
    let (left, top) = (rect.x0 as f64 - 0.5, rect.y0 as f64 - 0.5);
    let rows = line.between(1, top, top + rect.height as f64);
    let (from, to) = (segment.from.max(rows.0), segment.to.min(rows.1));
    let inside = line.between(0, left, left + rect.width as f64);
    let beyond = line.between(0, f64::NEG_INFINITY, left);
    walk_pixels(&line, rect, from.max(inside.0), to.min(inside.1), out);
    if beyond.0 < beyond.1 && (line.along.x != 0.0 || inside.0 > inside.1) {
        walk_left(&line, rect, from.max(beyond.0), to.min(beyond.1), out);
    }
}

/// Next border between pixels along an axis, as a parameter.
fn next(line: &Line, axis: usize, pixel: i64) -> f64 {
    let along = line.along[axis];
    if along == 0.0 {
        return f64::INFINITY;
    }
    let border = pixel as f64 + if along > 0.0 { 0.5 } else { -0.5 };
    (border - line.start[axis]) / along
}

/// From pixel to pixel within the rectangle.
fn walk_pixels(line: &Line, rect: &Rect, from: f64, to: f64, out: &mut Vec<Portion>) {
    if from >= to || from.is_nan() || to.is_nan() {
        return;
    }
    let begin = line.start + line.along * from;
    let (last_x, last_y) = (rect.x0 + rect.width as i64 - 1, rect.y0 + rect.height as i64 - 1);
    let (mut x, mut y) = (nearest(begin.x).clamp(rect.x0, last_x), nearest(begin.y).clamp(rect.y0, last_y));
    let step = line.along.map(|d| if d > 0.0 { 1 } else { -1 });
    let (mut next_x, mut next_y) = (next(line, 0, x), next(line, 1, y));
    let mut at = from;
    loop {
        let end = next_x.min(next_y).min(to);
        if end > at {
            out.push(line.portion(rect, y - rect.y0, x - rect.x0, at, end));
            at = end;
        }
        if end >= to {
            return;
        }
        if next_x <= next_y {
            x += step.x;
            next_x = next(line, 0, x);
        } else {
            y += step.y;
            next_y = next(line, 1, y);
        }
        if x < rect.x0 || x > last_x || y < rect.y0 || y > last_y {
            return; // by a rounding
        }
    }
}

/// From row to row left of the rectangle.
fn walk_left(line: &Line, rect: &Rect, from: f64, to: f64, out: &mut Vec<Portion>) {
    if from >= to || from.is_nan() || to.is_nan() || line.along.y == 0.0 {
        return;
    }
    let last = rect.y0 + rect.height as i64 - 1;
    let mut y = nearest(line.start.y + line.along.y * from).clamp(rect.y0, last);
    let step = if line.along.y > 0.0 { 1 } else { -1 };
    let mut at = from;
    while y >= rect.y0 && y <= last && at < to {
        let end = next(line, 1, y).min(to);
        if end > at {
            out.push(line.portion(rect, y - rect.y0, -1, at, end));
            at = end;
        }
        y += step;
    }
}
