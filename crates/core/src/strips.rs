//! Contour edges in strips of the image, from left to right.
//!
//! In that order the edges that reach as far left as another's right end lie behind it in a row, and the crossings of a pixel
//! row come nearly sorted. What is kept is chosen without branches: half of them would be mispredicted.

use nalgebra::Vector2;

/// Edges in the order of their left ends, to a fraction of the contour's width; the buffers are reused.
#[derive(Debug, Clone, Default)]
pub(crate) struct Strips {
    /// The edges' numbers in that order.
    pub order: Vec<u32>,
    /// Left, right, top and bottom of what all span.
    pub bounds: [f64; 4],
    /// Box of each edge: left, right, top, bottom.
    boxes: Vec<[f64; 4]>,
    /// Strip that holds each edge's left end, and where each strip ends in `order`.
    strip_of: Vec<u32>,
    ends: Vec<u32>,
    /// The boxes in that order, as left, −right, top, −bottom.
    sorted: Vec<[f64; 4]>,
}

/// No points.
const NOWHERE: [f64; 4] = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];

impl Strips {
    /// Sort edges whose ends are finite.
    pub fn sort(&mut self, edges: &[[u32; 2]], pixels: &[Vector2<f64>]) {
        let Self { order, bounds, boxes, strip_of, ends, sorted } = self;
        *bounds = NOWHERE;
        boxes.clear();
        boxes.extend(edges.iter().map(|edge| {
            let [a, b] = edge.map(|v| pixels[v as usize]);
            let (x, y) = (ordered(a.x, b.x), ordered(a.y, b.y));
            let one = [x.0, x.1, y.0, y.1];
            for k in 0..4 {
                let beyond = if k % 2 == 0 { one[k] < bounds[k] } else { one[k] > bounds[k] };
                bounds[k] = if beyond { one[k] } else { bounds[k] };
            }
            one
        }));
        let count = boxes.len();
        let scale = scale(bounds, count);
        strip_of.clear();
        strip_of.extend(boxes.iter().map(|one| strip(one[0], bounds, scale)));
        ends.clear();
        ends.resize(count, 0);
        strip_of.iter().for_each(|&at| ends[at as usize] += 1);
        let mut sum = 0;
        for end in ends.iter_mut() {
            let here = *end;
            *end = sum;
            sum += here;
        }
        order.resize(count, 0);
        sorted.resize(count, NOWHERE);
        for (edge, (&at, &[left, right, top, bottom])) in strip_of.iter().zip(boxes.iter()).enumerate() {
            let place = ends[at as usize] as usize;
            ends[at as usize] += 1; // from the strip's start to its end
            order[place] = edge as u32;
            sorted[place] = [left, -right, top, -bottom];
        }
    }

    /// Pairs of edges without a common vertex whose boxes meet.
    pub fn find_pairs(&self, edges: &[[u32; 2]], found: &mut Vec<[u32; 2]>) {
        let Self { order, bounds, sorted, ends, .. } = self;
        let scale = scale(bounds, order.len());
        let mut count = 0;
        for (i, &[left, right, top, bottom]) in sorted.iter().enumerate() {
            let end = ends[strip(-right, bounds, scale) as usize] as usize;
            let reach = [-right, -left, -bottom, -top];
            if found.len() < count + end - i {
                found.resize(2 * (count + end - i), [0; 2]);
            }
            for (j, other) in sorted.iter().enumerate().take(end).skip(i + 1) {
                found[count] = [i as u32, j as u32];
                count += usize::from((0..4).fold(true, |meets, k| meets & (other[k] <= reach[k])));
            }
        }
        found.truncate(count);
        count = 0;
        for k in 0..found.len() {
            let pair = found[k].map(|place| order[place as usize]);
            let [[a, b], [c, d]] = pair.map(|edge| edges[edge as usize]);
            found[count] = pair;
            count += usize::from((a != c) & (a != d) & (b != c) & (b != d));
        }
        found.truncate(count);
    }
}

fn ordered(a: f64, b: f64) -> (f64, f64) {
    if a < b { (a, b) } else { (b, a) }
}

/// Strips a pixel, for as many strips as edges.
fn scale(bounds: &[f64; 4], count: usize) -> f64 {
    count.saturating_sub(1) as f64 / (bounds[1] - bounds[0]).max(1e-9)
}

/// The strip that holds a column.
#[inline(always)]
fn strip(x: f64, bounds: &[f64; 4], scale: f64) -> u32 {
    // the sum's rounding may lead one strip too far
    (((x - bounds[0]) * scale) as i32).max(0) as u32
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::Strips;

    /// Numbers from 0 to 1 (Knuth's linear congruential generator).
    fn numbers(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    fn every_pair(edges: &[[u32; 2]], pixels: &[Vector2<f64>]) -> Vec<[u32; 2]> {
        let span = |edge: [u32; 2], axis: usize| {
            let [a, b] = edge.map(|v| pixels[v as usize][axis]);
            (a.min(b), a.max(b))
        };
        let meet = |e: [u32; 2], f: [u32; 2]| {
            (0..2).all(|axis| {
                let ((low, high), (other_low, other_high)) = (span(e, axis), span(f, axis));
                low <= other_high && other_low <= high
            })
        };
        let apart = |e: [u32; 2], f: [u32; 2]| e.iter().all(|v| !f.contains(v));
        let mut out = Vec::new();
        for i in 0..edges.len() {
            for j in i + 1..edges.len() {
                if meet(edges[i], edges[j]) && apart(edges[i], edges[j]) {
                    out.push([i as u32, j as u32]);
                }
            }
        }
        out
    }

    #[test]
    fn pairs_are_those_of_all_edges_asked_with_all() {
        let (mut strips, mut found) = (Strips::default(), Vec::new());
        for round in 0..300 {
            let mut number = numbers(round);
            let count = [0, 1, 2, 30, 120][round as usize % 5];
            // on whole numbers boxes touch; some contours are a line
            let (size, snap) = ([0.0, 4.0, 90.0][round as usize % 3], round % 2 == 0);
            let mut place = |reach: f64| if snap { (number() * reach).round() } else { number() * reach - 7.0 };
            let pixels: Vec<_> = (0..60).map(|_| Vector2::new(place(40.0), place(size))).collect();
            let mut end = numbers(round + 1000);
            let edges: Vec<[u32; 2]> = (0..count).map(|_| [0; 2].map(|_: u32| (end() * 60.0) as u32)).collect();
            strips.sort(&edges, &pixels);
            strips.find_pairs(&edges, &mut found);
            found.iter_mut().for_each(|pair| pair.sort_unstable());
            found.sort_unstable();
            assert_eq!(found, every_pair(&edges, &pixels), "round {round}");
            let mut order = strips.order.clone();
            order.sort_unstable();
            assert_eq!(order, (0..count).collect::<Vec<u32>>());
        }
    }
}
