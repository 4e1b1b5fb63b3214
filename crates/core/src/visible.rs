//! Which parts of a contour bound the mask.
//!
//! A point of a contour edge bounds the mask where the winding number on the edge's outer side is 0: where it is not,
//! the mesh lies on both sides. Along a chain of contour edges that number changes only where another contour edge
//! crosses, and by one, so it is known everywhere once it is known anywhere; the rows of the silhouette say it at many
//! places. Where these disagree (edges that lie on each other up to rounding), each piece is asked by a ray of its own.

use nalgebra::Vector2;

use crate::silhouette::Silhouette;

/// No edge, or no event.
const NONE: u32 = u32::MAX;

/// Part of a contour edge, from parameter to parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Number of the edge in [`Silhouette::contour`].
    pub edge: u32,
    /// Where it starts: 0 at the edge's first vertex, 1 at its second.
    pub from: f64,
    /// Where it ends.
    pub to: f64,
    /// Winding number on the outer side.
    pub winding: i32,
}

/// Another contour edge crosses this one.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Event {
    edge: u32,
    at: f64,
    change: i32,
}

/// Buffers that one search after another reuses.
#[derive(Debug, Clone, Default)]
pub struct Visible {
    /// Pieces that bound the mask.
    pub pieces: Vec<Piece>,
    boxes: Vec<[f64; 4]>,
    order: Vec<u32>,
    events: Vec<Event>,
    first_event: Vec<u32>,
    leaving: Vec<u32>,
    irregular: Vec<u32>,
    done: Vec<bool>,
    chain: Vec<Piece>,
}

impl Visible {
    /// Find the pieces of a silhouette drawn by its contour that bound the mask.
    pub fn find(&mut self, drawn: &Silhouette) {
        self.pieces.clear();
        self.find_events(drawn);
        self.index_vertices(drawn);
        self.done.clear();
        self.done.resize(drawn.contour.len(), false);
        for k in 0..self.irregular.len() {
            self.follow(drawn, self.irregular[k]);
        }
        for edge in 0..drawn.contour.len() as u32 {
            if !self.done[edge as usize] {
                self.follow(drawn, edge);
            }
        }
    }

    /// All crossings of contour edges with each other, by edge and along it.
    fn find_events(&mut self, drawn: &Silhouette) {
        self.sort_by_row(drawn);
        self.events.clear();
        let Self { boxes, order, events, .. } = self;
        for (i, one) in boxes.iter().enumerate() {
            let [left, right, _, bottom] = *one;
            for (j, other) in boxes.iter().enumerate().skip(i + 1) {
                if other[2] > bottom {
                    break;
                }
                if other[0] <= right && other[1] >= left {
                    cross(drawn, order[i], order[j], events);
                }
            }
        }
        events.sort_unstable_by(|a, b| a.edge.cmp(&b.edge).then(a.at.total_cmp(&b.at)));
        self.first_event.clear();
        self.first_event.resize(drawn.contour.len(), NONE);
        for (k, event) in events.iter().enumerate().rev() {
            self.first_event[event.edge as usize] = k as u32;
        }
    }

    /// Edges in the order of their upper ends, with their boxes (left, right, top, bottom).
    fn sort_by_row(&mut self, drawn: &Silhouette) {
        let Self { boxes, order, .. } = self;
        let span = |edge: &[u32; 2]| {
            let (a, b) = (drawn.pixels[edge[0] as usize], drawn.pixels[edge[1] as usize]);
            [a.x.min(b.x), a.x.max(b.x), a.y.min(b.y), a.y.max(b.y)]
        };
        order.clear();
        order.extend(0..drawn.contour.len() as u32);
        boxes.clear();
        boxes.extend(drawn.contour.iter().map(span));
        order.sort_unstable_by(|&a, &b| boxes[a as usize][2].total_cmp(&boxes[b as usize][2]));
        boxes.clear();
        boxes.extend(order.iter().map(|&edge| span(&drawn.contour[edge as usize])));
    }

    /// Which edge leaves each vertex, and the edges that leave a vertex which others leave too.
    fn index_vertices(&mut self, drawn: &Silhouette) {
        self.leaving.clear();
        self.leaving.resize(drawn.pixels.len(), NONE);
        self.irregular.clear();
        for (number, edge) in drawn.contour.iter().enumerate() {
            let slot = &mut self.leaving[edge[0] as usize];
            if *slot == NONE {
                *slot = number as u32;
            } else {
                self.irregular.push(number as u32);
            }
        }
        // at such a vertex a chain ends: which of the ways out goes on with it is not asked
        for k in 0..self.irregular.len() {
            let vertex = drawn.contour[self.irregular[k] as usize][0] as usize;
            if self.leaving[vertex] != NONE {
                self.irregular.push(self.leaving[vertex]);
                self.leaving[vertex] = NONE;
            }
        }
    }

    /// Follow the chain that starts with an edge to its end or back to the start, and keep what bounds the mask.
    fn follow(&mut self, drawn: &Silhouette, start: u32) {
        self.chain.clear();
        let (mut edge, mut relative) = (start, 0);
        let mut known: Option<i32> = None;
        let mut sound = true;
        while edge != NONE && !self.done[edge as usize] {
            self.done[edge as usize] = true;
            let before = self.chain.len();
            relative = self.cut(edge, relative);
            if let Some((at, winding)) = on_a_row(drawn, edge) {
                let here = self.chain[before..].iter().find(|piece| at <= piece.to).map_or(relative, |p| p.winding);
                let offset = winding - here;
                sound &= known.is_none_or(|k| k == offset);
                known = Some(offset);
            }
            edge = self.leaving[drawn.contour[edge as usize][1] as usize];
        }
        let closed = edge == start;
        sound &= !closed || relative == 0;
        let Some(first) = self.chain.first().copied() else { return };
        let offset = known.unwrap_or_else(|| outer_winding(drawn, &first) - first.winding);
        for piece in &mut self.chain {
            piece.winding = if sound { piece.winding + offset } else { outer_winding(drawn, piece) };
        }
        self.pieces.extend(self.chain.iter().filter(|piece| piece.winding == 0));
    }

    /// Cut an edge at its events; the winding numbers are relative to the chain's start.
    fn cut(&mut self, edge: u32, mut winding: i32) -> i32 {
        let mut from = 0.0;
        let mut k = self.first_event[edge as usize] as usize;
        while let Some(event) = self.events.get(k).filter(|event| event.edge == edge) {
            self.chain.push(Piece { edge, from, to: event.at, winding });
            (from, winding, k) = (event.at, winding + event.change, k + 1);
        }
        self.chain.push(Piece { edge, from, to: 1.0, winding });
        winding
    }
}

/// Twice the signed area of a triangle.
#[inline]
fn turn(a: &Vector2<f64>, b: &Vector2<f64>, c: &Vector2<f64>) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// The events of two edges that cross each other.
#[inline]
fn cross(drawn: &Silhouette, first: u32, second: u32, events: &mut Vec<Event>) {
    let [[a, b], [c, d]] = [drawn.contour[first as usize], drawn.contour[second as usize]];
    if a == c || a == d || b == c || b == d {
        return; // they meet there and nowhere else
    }
    let [p, q, r, s] = [a, b, c, d].map(|v| drawn.pixels[v as usize]);
    let (of_r, of_s) = (turn(&p, &q, &r), turn(&p, &q, &s));
    if (of_r < 0.0) == (of_s < 0.0) {
        return;
    }
    let (of_p, of_q) = (turn(&r, &s, &p), turn(&r, &s, &q));
    if (of_p < 0.0) == (of_q < 0.0) {
        return;
    }
    // an edge's inner side is where the turn is negative
    events.push(Event { edge: first, at: of_p / (of_p - of_q), change: if of_q < 0.0 { 1 } else { -1 } });
    events.push(Event { edge: second, at: of_r / (of_r - of_s), change: if of_s < 0.0 { 1 } else { -1 } });
}

/// Where an edge crosses the middle one of its rows, and the winding number on its outer side there.
#[inline]
fn on_a_row(drawn: &Silhouette, edge: u32) -> Option<(f64, i32)> {
    let (from, first, count) = drawn.rows.edges[edge as usize];
    if count == 0 {
        return None;
    }
    let [a, b] = drawn.contour[edge as usize].map(|v| drawn.pixels[v as usize].y);
    let row = drawn.rect.y0 + i64::from(from + count / 2);
    Some(((row as f64 - a) / (b - a), drawn.rows.outer[(first + count / 2) as usize]))
}

/// Winding number on the outer side of a piece's middle: what a ray away from it crosses, along the axis that its edge
/// is the less parallel to.
#[must_use]
pub fn outer_winding(drawn: &Silhouette, piece: &Piece) -> i32 {
    let [a, b] = drawn.contour[piece.edge as usize].map(|v| drawn.pixels[v as usize]);
    let middle = a + (b - a) * (0.5 * (piece.from + piece.to));
    let axis = usize::from((b.y - a.y).abs() > (b.x - a.x).abs()); // rows part on y, columns on x
    let mut winding = 0;
    for (number, edge) in drawn.contour.iter().enumerate() {
        let [p, q] = edge.map(|v| drawn.pixels[v as usize]);
        if number == piece.edge as usize || (p[axis] <= middle[axis]) == (q[axis] <= middle[axis]) {
            continue;
        }
        let inner = turn(&p, &q, &middle) < 0.0;
        // crossed if the middle lies beyond the edge, seen from the ray's end at low values of the other axis
        let inner_is_beyond = (p[axis] <= middle[axis]) == (axis == 1);
        if inner == inner_is_beyond {
            winding += if inner_is_beyond { 1 } else { -1 };
        }
    }
    let own_inner_is_beyond = (a[axis] < b[axis]) == (axis == 1);
    if own_inner_is_beyond { winding } else { winding - 1 }
}
