//! Which parts of a contour bound the mask.
//!
//! A point of a contour edge bounds the mask where no face covers the edge's outer side: where one does, the mesh lies on both
//! sides. Along a chain of contour edges the number of these faces changes only where another contour edge crosses, and by
//! that edge's step, so it is known everywhere once it is known anywhere; the rows of the silhouette say it at many places. Where these disagree (edges that lie on each other up to rounding), each piece is asked by a ray of its own.

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
    /// How many faces cover the outer side.
    pub winding: i32,
}

/// Another contour edge crosses this one.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Event {
    at: f64,
    change: i32,
    /// Another event of the edge.
    next: u32,
}

/// Buffers that one search after another reuses.
#[derive(Debug, Clone, Default)]
pub struct Visible {
    /// Pieces that bound the mask.
    pub pieces: Vec<Piece>,
    pairs: Vec<[u32; 2]>,
    events: Vec<Event>,
    first_event: Vec<u32>,
    leaving: Vec<u32>,
    irregular: Vec<u32>,
    done: Vec<bool>,
    chain: Vec<Piece>,
    on_edge: Vec<(f64, i32)>,
}

impl Visible {
    /// Find the pieces of a silhouette drawn by its contour that bound the mask.
    pub fn find(&mut self, drawn: &Silhouette) {
        self.pieces.clear();
        self.find_events(drawn);
        self.index_vertices(drawn);
        self.done.clear();
        self.done.resize(drawn.contour.edges.len(), false);
        for k in 0..self.irregular.len() {
            self.follow(drawn, self.irregular[k]);
        }
        for edge in 0..drawn.contour.edges.len() as u32 {
            if !self.done[edge as usize] {
                self.follow(drawn, edge);
            }
        }
    }

    /// All crossings of contour edges with each other; each event names the next of its edge.
    fn find_events(&mut self, drawn: &Silhouette) {
        let Self { pairs, events, first_event, .. } = self;
        drawn.strips.find_pairs(&drawn.contour.edges, pairs);
        events.clear();
        events.resize(2 * pairs.len(), Event { next: NONE, at: 0.0, change: 0 });
        first_event.clear();
        first_event.resize(drawn.contour.edges.len(), NONE);
        let mut count = 0;
        for pair in pairs.iter() {
            let (cross, [on_first, on_second]) = cross(drawn, pair);
            for (k, event) in [on_first, on_second].into_iter().enumerate() {
                let first = &mut first_event[pair[k] as usize];
                events[2 * count + k] = Event { next: *first, ..event };
                *first = if cross { (2 * count + k) as u32 } else { *first };
            }
            count += usize::from(cross);
        }
    }

    /// Which edge leaves each vertex, and the edges that leave a vertex which others leave too.
    fn index_vertices(&mut self, drawn: &Silhouette) {
        self.leaving.resize(drawn.pixels.len(), NONE);
        drawn.contour.edges.iter().for_each(|edge| self.leaving[edge[0] as usize] = NONE);
        self.irregular.clear();
        for (number, edge) in drawn.contour.edges.iter().enumerate() {
            let slot = &mut self.leaving[edge[0] as usize];
            if *slot == NONE {
                *slot = number as u32;
            } else {
                self.irregular.push(number as u32);
            }
        }
        // at such a vertex a chain ends: which of the ways out goes on with it is not asked
        for k in 0..self.irregular.len() {
            let vertex = drawn.contour.edges[self.irregular[k] as usize][0] as usize;
            if self.leaving[vertex] != NONE {
                self.irregular.push(self.leaving[vertex]);
                self.leaving[vertex] = NONE;
            }
        }
    }

    /// Follow the chain that starts with an edge to its end or back to the start, and keep what bounds the mask.
    fn follow(&mut self, drawn: &Silhouette, start: u32) {
        self.chain.clear();
        let steps = &drawn.contour.steps;
        let (mut edge, mut relative) = (start, 0);
        let mut known: Option<i32> = None;
        let mut sound = true;
        while edge != NONE && !self.done[edge as usize] {
            self.done[edge as usize] = true;
            let before = self.chain.len();
            relative = self.cut(edge, relative);
            if let Some((row, covers)) = on_a_row(drawn, edge) {
                let pieces = &self.chain[before..];
                let here = if let [whole] = pieces {
                    whole.winding
                } else {
                    let at = place_on(drawn, edge, row);
                    pieces.iter().find(|piece| at <= piece.to).map_or(relative, |piece| piece.winding)
                };
                let offset = covers - here;
                sound &= known.is_none_or(|k| k == offset);
                known = Some(offset);
            }
            let next = self.leaving[drawn.contour.edges[edge as usize][1] as usize];
            // where others arrive too, at a corner of an open mesh's border, a chain ends
            let goes_on = next != NONE && steps[next as usize] == steps[edge as usize];
            edge = if goes_on { next } else { NONE };
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
        let mut next = self.first_event[edge as usize];
        if next != NONE {
            self.on_edge.clear();
            while let Some(event) = self.events.get(next as usize) {
                self.on_edge.push((event.at, event.change));
                next = event.next;
            }
            self.on_edge.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            for &(at, change) in &self.on_edge {
                self.chain.push(Piece { edge, from, to: at, winding });
                (from, winding) = (at, winding + change);
            }
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

/// Whether two edges cross each other, and the events if they do; written without a branch.
#[inline(always)]
fn cross(drawn: &Silhouette, pair: &[u32; 2]) -> (bool, [Event; 2]) {
    let [[p, q], [r, s]] = pair.map(|e| drawn.contour.edges[e as usize].map(|v| drawn.pixels[v as usize]));
    let (of_r, of_s) = (turn(&p, &q, &r), turn(&p, &q, &s));
    let (of_p, of_q) = (turn(&r, &s, &p), turn(&r, &s, &q));
    let cross = ((of_r < 0.0) != (of_s < 0.0)) & ((of_p < 0.0) != (of_q < 0.0));
    // an edge's inner side is where the turn is negative
    let [of_first, of_second] = pair.map(|edge| drawn.contour.steps[edge as usize]);
    let change = |inward: bool, step: i32| if inward { step } else { -step };
    let on_first = Event { at: of_p / (of_p - of_q), change: change(of_q < 0.0, of_second), next: NONE };
    let on_second = Event { at: of_r / (of_r - of_s), change: change(of_s < 0.0, of_first), next: NONE };
    (cross, [on_first, on_second])
}

/// The middle one of the rows that an edge crosses, and how many faces cover its outer side there.
#[inline]
fn on_a_row(drawn: &Silhouette, edge: u32) -> Option<(u32, i32)> {
    let (from, first, count) = drawn.rows.edges[edge as usize];
    (count > 0).then(|| (from + count / 2, drawn.rows.outer[(first + count / 2) as usize]))
}

/// Where an edge crosses a row, as a share of the way along it.
fn place_on(drawn: &Silhouette, edge: u32, row: u32) -> f64 {
    let [a, b] = drawn.contour.edges[edge as usize].map(|v| drawn.pixels[v as usize].y);
    ((drawn.rect.y0 + i64::from(row)) as f64 - a) / (b - a)
}

/// How many faces cover the outer side of a piece's middle: what a ray away from it crosses, along the axis that its edge
/// is the less parallel to.
#[must_use]
pub fn outer_winding(drawn: &Silhouette, piece: &Piece) -> i32 {
    let [a, b] = drawn.contour.edges[piece.edge as usize].map(|v| drawn.pixels[v as usize]);
    let middle = a + (b - a) * (0.5 * (piece.from + piece.to));
    let axis = usize::from((b.y - a.y).abs() > (b.x - a.x).abs()); // rows part on y, columns on x
    let mut winding = 0;
    for (number, edge) in drawn.contour.edges.iter().enumerate() {
        let [p, q] = edge.map(|v| drawn.pixels[v as usize]);
        if number == piece.edge as usize || (p[axis] <= middle[axis]) == (q[axis] <= middle[axis]) {
            continue;
        }
        let inner = turn(&p, &q, &middle) < 0.0;
        // crossed if the middle lies beyond the edge, seen from the ray's end at low values of the other axis
        let inner_is_beyond = (p[axis] <= middle[axis]) == (axis == 1);
        if inner == inner_is_beyond {
            let step = drawn.contour.steps[number];
            winding += if inner_is_beyond { step } else { -step };
        }
    }
    let own_inner_is_beyond = (a[axis] < b[axis]) == (axis == 1);
    if own_inner_is_beyond { winding } else { winding - drawn.contour.steps[piece.edge as usize] }
}
