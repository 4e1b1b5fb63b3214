//! The outline sample nearest to a point of the image, by cells.

use nalgebra::Vector2;

/// Side of a cell, pixels.
const CELL_PX: f32 = 8.0;

/// Points on the image, sorted into cells.
#[derive(Debug, Clone, Default)]
pub struct Cells {
    low: [f32; 2],
    columns: i32,
    rows: i32,
    start: Vec<u32>,
    points: Vec<(f32, f32, u32)>,
}

impl Cells {
    /// Sort points into cells; they must be finite and lie on an image.
    #[must_use]
    pub fn new(points: &[Vector2<f64>]) -> Self {
        let places: Vec<[f32; 2]> = points.iter().map(|p| [p.x as f32, p.y as f32]).collect();
        if places.is_empty() {
            return Self::default();
        }
        let (mut low, mut high) = (places[0], places[0]);
        for p in &places {
            for k in 0..2 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k]);
            }
        }
        let count = |k: usize| ((high[k] - low[k]) / CELL_PX) as i32 + 1;
        let (columns, rows) = (count(0), count(1));
        let cell = |p: &[f32; 2]| {
            let (column, row) = (((p[0] - low[0]) / CELL_PX) as i32, ((p[1] - low[1]) / CELL_PX) as i32);
            (row * columns + column) as usize
        };
        let mut start = vec![0u32; (columns * rows) as usize + 1];
        places.iter().for_each(|p| start[cell(p) + 1] += 1);
        for k in 1..start.len() {
            start[k] += start[k - 1];
        }
        let (mut at, mut sorted) = (start.clone(), vec![(0.0, 0.0, 0); places.len()]);
        for (index, p) in places.iter().enumerate() {
            let slot = &mut at[cell(p)];
            sorted[*slot as usize] = (p[0], p[1], index as u32);
            *slot += 1;
        }
        Self { low, columns, rows, start, points: sorted }
    }

    /// Index of the nearest point, of several the first; none if there is no point.
    #[must_use]
    pub fn nearest(&self, point: &Vector2<f64>) -> Option<usize> {
        if self.points.is_empty() {
            return None;
        }
        let (x, y) = (point.x as f32, point.y as f32);
        let place = |v: f32, low: f32, count: i32| (((v - low) / CELL_PX) as i32).clamp(0, count - 1);
        let (column, row) = (place(x, self.low[0], self.columns), place(y, self.low[1], self.rows));
        let (mut best, mut index) = (f32::INFINITY, u32::MAX);
        for ring in 0..=self.columns.max(self.rows) {
            for r in (row - ring).max(0)..=(row + ring).min(self.rows - 1) {
                let whole = r == row - ring || r == row + ring;
                let step = if whole || ring == 0 { 1 } else { 2 * ring };
                let mut c = column - ring;
                while c <= column + ring {
                    if c >= 0 && c < self.columns {
                        self.scan((r * self.columns + c) as usize, x, y, &mut best, &mut index);
                    }
                    c += step;
                }
            }
            // cells farther out lie at least so many cells away
            let reached = ring as f32 * CELL_PX;
            if best <= reached * reached {
                break;
            }
        }
        (index != u32::MAX).then_some(index as usize)
    }

    #[inline]
    fn scan(&self, cell: usize, x: f32, y: f32, best: &mut f32, index: &mut u32) {
        for &(u, v, i) in &self.points[self.start[cell] as usize..self.start[cell + 1] as usize] {
            let squared = (u - x) * (u - x) + (v - y) * (v - y);
            if squared < *best || (squared == *best && i < *index) {
                (*best, *index) = (squared, i);
            }
        }
    }
}
