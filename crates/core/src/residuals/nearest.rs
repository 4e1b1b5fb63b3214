//! The outline sample nearest to a point of the image, by cells.

use nalgebra::Vector2;

/// Side of a cell, pixels.
const CELL_PX: f32 = 8.0;

/// A guess farther off than this is not worth a search of all cells that it reaches, pixels.
const MOST_REACH_PX: f32 = 32.0;

/// More than coordinates on an image lose in rounding, pixels: the guess itself is always within reach.
const ROUNDING_PX: f32 = 0.1;

/// How many points are compared at once.
const LANES: usize = 16;

/// Points on the image, sorted into cells row by row: the cells side by side in a row are one run of points.
#[derive(Debug, Clone, Default)]
pub struct Cells {
    low: [f32; 2],
    count: [i32; 2],
    places: Vec<[f32; 2]>,
    start: Vec<u32>,
    next: Vec<u32>,
    /// Coordinates and indices in the order of the cells; lanes to spare at the end lie nowhere.
    x: Vec<f32>,
    y: Vec<f32>,
    index: Vec<u32>,
}

impl Cells {
    /// Sort points into cells, instead of those before; they must be finite and lie on an image.
    pub fn sort(&mut self, points: impl Iterator<Item = Vector2<f64>>) {
        self.places.clear();
        self.places.extend(points.map(|p| [p.x as f32, p.y as f32]));
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for p in &self.places {
            for k in 0..2 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k]);
            }
        }
        let count = [0, 1].map(|k| if high[k] < low[k] { 0 } else { ((high[k] - low[k]) / CELL_PX) as i32 + 1 });
        (self.low, self.count) = (low, count);
        let cell = |p: &[f32; 2]| {
            let [column, row] = [0, 1].map(|k| ((p[k] - low[k]) / CELL_PX) as i32);
            (row * count[0] + column) as usize
        };
        self.start.clear();
        self.start.resize((count[0] * count[1]) as usize + 1, 0);
        self.places.iter().for_each(|p| self.start[cell(p) + 1] += 1);
        for k in 1..self.start.len() {
            self.start[k] += self.start[k - 1];
        }
        self.next.clone_from(&self.start);
        let lanes = self.places.len() + LANES;
        self.x.clear();
        self.x.resize(lanes, f32::INFINITY);
        self.y.clear();
        self.y.resize(lanes, f32::INFINITY);
        self.index.clear();
        self.index.resize(lanes, u32::MAX);
        for (p, index) in self.places.iter().zip(0u32..) {
            let slot = &mut self.next[cell(p)];
            let at = *slot as usize;
            (self.x[at], self.y[at], self.index[at]) = (p[0], p[1], index);
            *slot += 1;
        }
    }

    /// Index of the nearest point, of several the first; none if there is no point. A point that may be near, such as the
    /// last one found along a curve, makes the search short.
    #[inline(always)]
    #[must_use]
    pub fn nearest(&self, point: &Vector2<f64>, guess: Option<usize>) -> Option<usize> {
        if self.places.is_empty() {
            return None;
        }
        let (x, y) = (point.x as f32, point.y as f32);
        let guessed = guess.and_then(|i| self.places.get(i));
        let away = guessed.map_or(f32::INFINITY, |p| distance(p[0] - x, p[1] - y).sqrt());
        let mut best = Best::new(x, y);
        if away < MOST_REACH_PX {
            let reach = away + ROUNDING_PX;
            let [left, right] = [x - reach, x + reach].map(|v| self.cell(v, 0));
            for row in self.cell(y - reach, 1)..=self.cell(y + reach, 1) {
                self.scan(row, left, right, &mut best);
            }
        } else {
            self.search_rings(&mut best);
        }
        best.index()
    }

    /// Scan ring after ring of cells around the point, until no cell left can hold a nearer one.
    fn search_rings(&self, best: &mut Best) {
        let (column, row) = (self.cell(best.x, 0), self.cell(best.y, 1));
        for ring in 0..self.count[0].max(self.count[1]) {
            // cells not yet scanned lie at least so many cells away
            let reached = (ring - 1) as f32 * CELL_PX;
            if ring > 0 && best.least().0 <= reached * reached {
                break;
            }
            let (left, right) = (column - ring, column + ring);
            self.scan(row - ring, left, right, best);
            for r in row - ring + 1..row + ring {
                self.scan(r, left, left, best);
                self.scan(r, right, right, best);
            }
            if ring > 0 {
                self.scan(row + ring, left, right, best);
            }
        }
    }

    /// The cell that holds a coordinate, or the one next to it.
    #[inline(always)]
    fn cell(&self, at: f32, axis: usize) -> i32 {
        (((at - self.low[axis]) / CELL_PX) as i32).clamp(0, self.count[axis] - 1)
    }

    /// Look at the points of a row's cells `from..=to`, as far as there are any, and at some more to fill the lanes.
    #[inline(always)]
    fn scan(&self, row: i32, from: i32, to: i32, best: &mut Best) {
        if row < 0 || row >= self.count[1] || to < 0 || from >= self.count[0] {
            return;
        }
        let (first, last) = (row * self.count[0] + from.max(0), row * self.count[0] + to.min(self.count[0] - 1));
        let (start, end) = (self.start[first as usize] as usize, self.start[last as usize + 1] as usize);
        for at in (start..end).step_by(LANES) {
            let lanes = (self.x[at..].first_chunk(), self.y[at..].first_chunk(), self.index[at..].first_chunk());
            if let (Some(x), Some(y), Some(index)) = lanes {
                best.compare(x, y, index);
            }
        }
    }
}

#[inline(always)]
fn distance(x: f32, y: f32) -> f32 {
    x * x + y * y
}

/// The nearest point so far in each lane: which lane is nearer cannot be predicted, and is not asked before the end.
struct Best {
    x: f32,
    y: f32,
    squared: [f32; LANES],
    index: [u32; LANES],
}

impl Best {
    #[inline(always)]
    fn new(x: f32, y: f32) -> Self {
        Self { x, y, squared: [f32::INFINITY; LANES], index: [u32::MAX; LANES] }
    }

    #[inline(always)]
    fn compare(&mut self, x: &[f32; LANES], y: &[f32; LANES], index: &[u32; LANES]) {
        for k in 0..LANES {
            let squared = distance(x[k] - self.x, y[k] - self.y);
            let nearer = (squared < self.squared[k]) | ((squared == self.squared[k]) & (index[k] < self.index[k]));
            self.squared[k] = if nearer { squared } else { self.squared[k] };
            self.index[k] = if nearer { index[k] } else { self.index[k] };
        }
    }

    /// The smallest squared distance with its index, of several the first: bits of positive numbers are in their order.
    #[inline(always)]
    fn least(&self) -> (f32, u32) {
        let key = |k: usize| u64::from(self.squared[k].to_bits()) << 32 | u64::from(self.index[k]);
        let least = (0..LANES).map(key).fold(u64::MAX, u64::min);
        (f32::from_bits((least >> 32) as u32), least as u32)
    }

    #[inline(always)]
    fn index(&self) -> Option<usize> {
        let (_, index) = self.least();
        (index != u32::MAX).then_some(index as usize)
    }
}
