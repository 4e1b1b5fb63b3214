//! Where a handful of parked objects may lie in a map, seen from above: its pairs are laid on pairs of the map, and each
//! pose that this gives is weighed by what it lays on what.

use std::f64::consts::PI;

use rayon::prelude::*;

use crate::error::{Error, Result, check_finite, check_length};
use crate::rounding::floor;

/// Objects farther apart than this are not taken for one, whatever their sigmas, metres.
const REACH_M: f64 = 4.0;
/// By which headings, sizes and distances of a pair may differ, in sigmas.
const SIGMAS: f64 = 2.5;
/// At most so many cells of the grid; they grow where the map is wider.
const MOST_CELLS: f64 = 4e6;
/// Rows that one thread takes together.
const BLOCK: usize = 2048;
/// No scale is taken to be less.
const LEAST_SCALE: f64 = 0.5;
/// Pairs nearer than this tell no direction, metres.
const NEAREST_M: f64 = 1e-3;

/// An object from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parked {
    /// On the ground, metres.
    pub place: [f64; 2],
    /// Heading, radians; the opposite one counts as the same.
    pub yaw_rad: f64,
    /// Logarithms of length, width, height.
    pub log_size: [f64; 3],
    /// Of the place, along each axis.
    pub variance_m2: f64,
}

/// What is assumed of two sets of objects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// Of two places together, beside the objects' own.
    pub place_variance_m2: f64,
    /// Sigma that a place gains for each metre from the others.
    pub drift_share: f64,
    /// Of a heading.
    pub heading_sigma_rad: f64,
    /// Of the difference of one object's logarithmic sizes.
    pub size_variance: f64,
    /// Likewise of two objects.
    pub other_size_variance: f64,
    /// How many objects stand on a square metre by chance.
    pub objects_per_m2: f64,
    /// Sigmas beyond which nothing is the same object.
    pub gate: f64,
    /// Of the scale of the handful's world, about 1; 0 where it is known.
    pub scale_sigma: f64,
}

/// A place of the handful in the map: a scale and a turn, then a shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Sum over its objects of the logarithm of the odds that the map's nearest is the same.
    pub score: f64,
    /// Turn about z.
    pub yaw_rad: f64,
    /// Metres.
    pub shift: [f64; 2],
    /// By which lengths are multiplied.
    pub scale: f64,
}

/// An object with its heading as a direction.
#[derive(Debug, Clone, Copy)]
struct Ready {
    place: [f64; 2],
    heading: [f64; 2],
    log_size: [f64; 3],
    variance_m2: f64,
}

impl Ready {
    fn of(object: &Parked) -> Self {
        let (sine, cosine) = object.yaw_rad.sin_cos();
        let Parked { place, log_size, variance_m2, .. } = *object;
        Self { place, heading: [cosine, sine], log_size, variance_m2 }
    }
}

/// Objects of a map, sorted by square cells of the ground.
#[derive(Debug, Clone)]
pub struct ParkedMap {
    objects: Vec<Ready>,
    low: [f64; 2],
    cell_m: f64,
    columns: usize,
    rows: usize,
    begins: Vec<u32>,   // of each cell in `sorted`, and the end
    sorted: Vec<Ready>, // by cell
}

impl ParkedMap {
    /// Sort objects by cells.
    ///
    /// # Errors
    /// [`Error`] for values that are not finite.
    pub fn new(objects: Vec<Parked>) -> Result<Self> {
        check("objects", &objects)?;
        let bound = |axis: usize, pick: fn(f64, f64) -> f64| {
            objects.iter().map(|o| o.place[axis]).reduce(pick).unwrap_or_default()
        };
        let (low, high) = ([bound(0, f64::min), bound(1, f64::min)], [bound(0, f64::max), bound(1, f64::max)]);
        let area = (high[0] - low[0] + REACH_M) * (high[1] - low[1] + REACH_M);
        let widest = (high[0] - low[0]).max(high[1] - low[1]) / MOST_CELLS;
        let cell_m = REACH_M.max((area / MOST_CELLS).sqrt()).max(widest);
        let [columns, rows] = [0, 1].map(|axis| floor((high[axis] - low[axis]) / cell_m) as usize + 1);
        let objects = objects.iter().map(Ready::of).collect();
        let mut map = Self { objects, low, cell_m, columns, rows, begins: vec![], sorted: vec![] };
        let cells: Vec<usize> = map.objects.iter().map(|o| map.cell(o.place)).collect();
        map.begins = vec![0; columns * rows + 1];
        for cell in &cells {
            map.begins[cell + 1] += 1;
        }
        for cell in 0..columns * rows {
            map.begins[cell + 1] += map.begins[cell];
        }
        let mut next = map.begins.clone();
        map.sorted.clone_from(&map.objects);
        for (object, cell) in map.objects.iter().zip(&cells) {
            map.sorted[next[*cell] as usize] = *object;
            next[*cell] += 1;
        }
        Ok(map)
    }

    fn cell(&self, place: [f64; 2]) -> usize {
        let [i, j] = [0, 1].map(|axis| floor((place[axis] - self.low[axis]) / self.cell_m) as usize);
        j.min(self.rows - 1) * self.columns + i.min(self.columns - 1)
    }

    /// Objects in the cell of a place and in those about it.
    fn near(&self, place: [f64; 2]) -> impl Iterator<Item = &Ready> {
        let [i, j] = [0, 1].map(|axis| floor((place[axis] - self.low[axis]) / self.cell_m));
        let span = |x: i64, count: usize| {
            let (first, end) = (x.saturating_sub(1).max(0), x.saturating_add(2).min(count as i64));
            if first < end { first as usize..end as usize } else { 0..0 }
        };
        let (across, along) = (span(i, self.columns), span(j, self.rows));
        let along = if across.is_empty() { 0..0 } else { along };
        along.flat_map(move |row| {
            let at = row * self.columns;
            let range = self.begins[at + across.start] as usize..self.begins[at + across.end] as usize;
            &self.sorted[range]
        })
    }

    /// The best poses of `seen`, the best first: `ends[q]` is one of its pairs, `pairs[q]` are those of the map that may
    /// be the same two objects, either way round.
    ///
    /// # Errors
    /// [`Error`] for values that are not finite, indices of objects that there are not, or lists of different lengths.
    pub fn candidates(
        &self,
        seen: &[Parked],
        ends: &[[usize; 2]],
        pairs: &[&[[i32; 2]]],
        rules: &Rules,
        keep: usize,
    ) -> Result<Vec<Candidate>> {
        check("seen objects", seen)?;
        check_length("pairs", pairs.len(), ends.len())?;
        let count = self.objects.len();
        for (what, index, count) in ends
            .iter()
            .flatten()
            .map(|end| ("seen object", *end as i64, seen.len()))
            .chain(pairs.iter().flat_map(|rows| rows.iter().flatten()).map(|at| ("object", i64::from(*at), count)))
        {
            if index < 0 || index >= count as i64 {
                return Err(Error::Index { what, index, count });
            }
        }
        let seen: Vec<Ready> = seen.iter().map(Ready::of).collect();
        let laying: Vec<Laying> = ends.iter().map(|ends| Laying::of(&seen, *ends, rules)).collect();
        let blocks: Vec<(&Laying, &[[i32; 2]])> = laying
            .iter()
            .zip(pairs)
            .flat_map(|(laying, rows)| rows.chunks(BLOCK).map(move |block| (laying, block)))
            .collect();
        let found: Vec<Vec<Candidate>> =
            blocks.par_iter().map(|(laying, block)| self.of_block(&seen, laying, block, rules, keep)).collect();
        Ok(best(found.into_iter().flatten().collect(), keep))
    }

    fn of_block(
        &self,
        seen: &[Ready],
        laying: &Laying,
        block: &[[i32; 2]],
        rules: &Rules,
        keep: usize,
    ) -> Vec<Candidate> {
        let (mut found, odds) = (Vec::new(), Odds::of(rules));
        for [i, j] in block {
            for at in [[*i, *j], [*j, *i]] {
                let pair = at.map(|k| &self.objects[k as usize]);
                if let Some(laid) = laying.on(pair) {
                    let score = self.score(seen, laying.ends, pair, &laid, &odds);
                    if score > 0.0 {
                        let Laid { turn, shift, scale, .. } = laid;
                        found.push(Candidate { score, yaw_rad: turn[1].atan2(turn[0]), shift, scale });
                    }
                }
            }
            if found.len() > 8 * keep {
                found = best(found, keep);
            }
        }
        best(found, keep)
    }

    /// What speaks for a place: the pair that it is made by, and the best for each of the others.
    fn score(&self, seen: &[Ready], ends: [usize; 2], pair: [&Ready; 2], laid: &Laid, odds: &Odds) -> f64 {
        let spread = odds.rules.drift_share.powi(2) + laid.turn_variance;
        let log_scale = laid.scale.ln();
        let total: f64 = seen
            .iter()
            .enumerate()
            .map(|(index, s)| {
                let (place, lever) = (laid.transform(s.place), between(s.place, laid.middle));
                let lever_m2 = lever[0] * lever[0] + lever[1] * lever[1];
                let variance = odds.rules.place_variance_m2 + s.variance_m2 + lever_m2 * spread;
                let here = Ready {
                    place,
                    heading: turned(s.heading, laid.turn),
                    log_size: s.log_size.map(|size| size + log_scale),
                    variance_m2: variance,
                };
                match ends.iter().position(|end| *end == index) {
                    Some(end) => odds.gain(pair[end], &here).max(0.0),
                    None => self.near(place).map(|k| odds.gain(k, &here)).fold(0.0, f64::max),
                }
            })
            .sum();
        total - laid.scale_cost
    }
}

/// Two of the seen objects, which are laid on pairs of the map.
struct Laying {
    ends: [usize; 2],
    own: [Ready; 2],
    length: f64,
    direction: [f64; 2], // from the first to the second
    middle: [f64; 2],
    variance: f64, // of the difference of their distance and another pair's, without that pair's own
    size: f64,
    heading_variance: f64,
    prior: f64, // of the scale
}

/// A place by two objects that are laid on two of the map.
struct Laid {
    turn: [f64; 2], // cosine, sine
    shift: [f64; 2],
    middle: [f64; 2],   // of the seen pair
    turn_variance: f64, // rad²
    scale: f64,
    scale_cost: f64,
}

impl Laying {
    fn of(seen: &[Ready], ends: [usize; 2], rules: &Rules) -> Self {
        let own = ends.map(|end| seen[end]);
        let [x, y] = between(own[0].place, own[1].place);
        let length = x.hypot(y);
        let variance = 2.0 * rules.place_variance_m2
            + own.iter().map(|o| o.variance_m2).sum::<f64>()
            + (rules.drift_share * length).powi(2);
        let prior = rules.scale_sigma * rules.scale_sigma;
        Self {
            ends,
            own,
            length,
            direction: [x / length, y / length],
            middle: half(own[0].place, own[1].place),
            variance,
            size: SIGMAS * (rules.size_variance + prior).sqrt(),
            heading_variance: 2.0 * rules.heading_sigma_rad.powi(2),
            prior,
        }
    }

    /// None where the two pairs cannot be the same.
    fn on(&self, pair: [&Ready; 2]) -> Option<Laid> {
        let alike = |k: &Ready, s: &Ready| k.log_size.iter().zip(&s.log_size).all(|(a, b)| (a - b).abs() <= self.size);
        if !(alike(pair[0], &self.own[0]) && alike(pair[1], &self.own[1])) {
            return None;
        }
        let [x, y] = between(pair[0].place, pair[1].place);
        let length = (x * x + y * y).sqrt();
        if length < NEAREST_M || self.length < NEAREST_M {
            return None;
        }
        // The scale: the prior about 1, and what the pair's length says
        let measured = (self.variance + pair[0].variance_m2 + pair[1].variance_m2) / (self.length * self.length);
        let away = length / self.length - 1.0;
        let spread = self.prior + measured;
        if away * away > SIGMAS * SIGMAS * spread {
            return None;
        }
        let turn = turned([x / length, y / length], [self.direction[0], -self.direction[1]]);
        let most_rad = SIGMAS * (self.heading_variance + measured).sqrt();
        let most = most_rad.min(PI / 2.0).sin();
        if pair.iter().zip(&self.own).any(|(k, s)| cross(k.heading, turned(s.heading, turn)).abs() > most) {
            return None;
        }
        let scale = (1.0 + away * self.prior / spread).max(LEAST_SCALE);
        let mut laid = Laid {
            turn,
            shift: [0.0; 2],
            middle: self.middle,
            turn_variance: measured,
            scale,
            scale_cost: 0.5 * away * away / spread,
        };
        let (there, here) = (half(pair[0].place, pair[1].place), laid.transform(self.middle));
        laid.shift = between(here, there);
        Some(laid)
    }
}

impl Laid {
    fn transform(&self, p: [f64; 2]) -> [f64; 2] {
        let [x, y] = turned(p, self.turn);
        [self.scale * x + self.shift[0], self.scale * y + self.shift[1]]
    }
}

/// The rules with what follows from them.
struct Odds<'a> {
    rules: &'a Rules,
    by_density: f64,
    by_sizes: f64, // of equal ones
    size_weight: f64,
}

impl<'a> Odds<'a> {
    fn of(rules: &'a Rules) -> Self {
        let (same, other) = (rules.size_variance, rules.other_size_variance);
        let by_density = -(2.0 * PI * rules.objects_per_m2).ln();
        Self { rules, by_density, by_sizes: 1.5 * (other / same).ln(), size_weight: 0.5 * (1.0 / same - 1.0 / other) }
    }

    /// Logarithm of the odds that an object of the map is the seen one, laid in it; 0 beyond the gate.
    fn gain(&self, known: &Ready, seen: &Ready) -> f64 {
        let away = between(known.place, seen.place);
        let gap = away[0] * away[0] + away[1] * away[1];
        let (variance, most) = (seen.variance_m2 + known.variance_m2, self.rules.gate * self.rules.gate);
        if gap > most * variance || gap > REACH_M * REACH_M {
            return 0.0;
        }
        let turn = headings_apart(known.heading, seen.heading) / self.rules.heading_sigma_rad;
        let miss = gap / variance + 0.5 * turn * turn;
        if miss > most {
            return 0.0;
        }
        let sizes: f64 = known.log_size.iter().zip(&seen.log_size).map(|(a, b)| (a - b) * (a - b)).sum();
        self.by_density - variance.ln() + self.by_sizes - self.size_weight * sizes - 0.5 * miss
    }
}

fn best(mut found: Vec<Candidate>, keep: usize) -> Vec<Candidate> {
    let order = |a: &Candidate, b: &Candidate| {
        let keys = |c: &Candidate| [-c.score, c.yaw_rad, c.shift[0], c.shift[1], c.scale];
        let (a, b) = (keys(a), keys(b));
        a.iter().zip(&b).map(|(x, y)| x.total_cmp(y)).find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
    };
    found.sort_by(order);
    found.truncate(keep);
    found
}

/// Angle between two headings, radians, at most a quarter turn: an object taken the wrong way round has the same.
fn headings_apart(one: [f64; 2], other: [f64; 2]) -> f64 {
    cross(one, other).abs().min(1.0).asin()
}

fn cross(one: [f64; 2], other: [f64; 2]) -> f64 {
    one[0] * other[1] - one[1] * other[0]
}

/// A direction, or a place, turned by an angle of a cosine and a sine.
fn turned(p: [f64; 2], turn: [f64; 2]) -> [f64; 2] {
    let [c, s] = turn;
    [c * p[0] - s * p[1], s * p[0] + c * p[1]]
}

fn between(from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
    [to[0] - from[0], to[1] - from[1]]
}

fn half(one: [f64; 2], other: [f64; 2]) -> [f64; 2] {
    [(one[0] + other[0]) / 2.0, (one[1] + other[1]) / 2.0]
}

fn check(what: &'static str, objects: &[Parked]) -> Result<()> {
    for o in objects {
        let [x, y] = o.place;
        let [length, width, height] = o.log_size;
        check_finite(what, &[x, y, o.yaw_rad, length, width, height, o.variance_m2])?;
    }
    Ok(())
}
