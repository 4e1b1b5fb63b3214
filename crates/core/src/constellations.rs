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

/// Objects of a map, sorted by square cells of the ground.
#[derive(Debug, Clone)]
pub struct ParkedMap {
    objects: Vec<Parked>,
    low: [f64; 2],
    cell_m: f64,
    columns: usize,
    rows: usize,
    begins: Vec<u32>,    // of each cell in `sorted`, and the end
    sorted: Vec<Parked>, // by cell
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
    fn near(&self, place: [f64; 2]) -> impl Iterator<Item = &Parked> {
        let [i, j] = [0, 1].map(|axis| floor((place[axis] - self.low[axis]) / self.cell_m));
        let span = |x: i64, count: usize| {
            let (first, end) = ((x - 1).max(0), (x + 2).min(count as i64));
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
        let blocks: Vec<(usize, &[[i32; 2]])> =
            pairs.iter().enumerate().flat_map(|(q, rows)| rows.chunks(BLOCK).map(move |block| (q, block))).collect();
        let found: Vec<Vec<Candidate>> =
            blocks.par_iter().map(|(q, block)| self.of_block(seen, ends[*q], block, rules, keep)).collect();
        Ok(best(found.into_iter().flatten().collect(), keep))
    }

    fn of_block(
        &self,
        seen: &[Parked],
        ends: [usize; 2],
        block: &[[i32; 2]],
        rules: &Rules,
        keep: usize,
    ) -> Vec<Candidate> {
        let (mut found, odds) = (Vec::new(), Odds::of(rules));
        for [i, j] in block {
            for at in [[*i, *j], [*j, *i]] {
                let pair = at.map(|k| self.objects[k as usize]);
                if let Some(laid) = Laid::of(pair, seen, ends, rules) {
                    let score = self.score(seen, &laid, &odds);
                    if score > 0.0 {
                        let Laid { yaw_rad, shift, scale, .. } = laid;
                        found.push(Candidate { score, yaw_rad, shift, scale });
                    }
                }
            }
            if found.len() > 8 * keep {
                found = best(found, keep);
            }
        }
        best(found, keep)
    }

    fn score(&self, seen: &[Parked], laid: &Laid, odds: &Odds) -> f64 {
        let spread = odds.rules.drift_share.powi(2) + laid.turn_variance;
        let log_scale = laid.scale.ln();
        let total: f64 = seen
            .iter()
            .map(|s| {
                let (place, lever) = (laid.transform(s.place), between(s.place, laid.middle));
                let lever_m2 = lever[0] * lever[0] + lever[1] * lever[1];
                let variance = odds.rules.place_variance_m2 + s.variance_m2 + lever_m2 * spread;
                let here = Parked {
                    place,
                    yaw_rad: s.yaw_rad + laid.yaw_rad,
                    log_size: s.log_size.map(|size| size + log_scale),
                    variance_m2: variance,
                };
                self.near(place).map(|k| odds.gain(k, &here)).fold(0.0, f64::max)
            })
            .sum();
        total - laid.scale_cost
    }
}

/// A pose by two objects that are laid on two of the map.
struct Laid {
    yaw_rad: f64,
    turn: [f64; 2], // cosine, sine
    shift: [f64; 2],
    middle: [f64; 2],   // of the seen pair
    turn_variance: f64, // rad²
    scale: f64,
    scale_cost: f64,
}

impl Laid {
    /// None where the two pairs cannot be the same.
    fn of(pair: [Parked; 2], seen: &[Parked], ends: [usize; 2], rules: &Rules) -> Option<Self> {
        let own = ends.map(|s| seen[s]);
        let size = SIGMAS * (rules.size_variance + rules.scale_sigma * rules.scale_sigma).sqrt();
        let alike = |k: &Parked, s: &Parked| k.log_size.iter().zip(&s.log_size).all(|(a, b)| (a - b).abs() <= size);
        if !(alike(&pair[0], &own[0]) && alike(&pair[1], &own[1])) {
            return None;
        }
        let (of_known, of_seen) = (between(pair[0].place, pair[1].place), between(own[0].place, own[1].place));
        let (length, seen_length) = (of_known[0].hypot(of_known[1]), of_seen[0].hypot(of_seen[1]));
        if length < NEAREST_M || seen_length < NEAREST_M {
            return None;
        }
        let variance = 2.0 * rules.place_variance_m2
            + pair.iter().chain(&own).map(|o| o.variance_m2).sum::<f64>()
            + (rules.drift_share * seen_length).powi(2);
        // The scale: the prior about 1, and what the pair's length says
        let (prior, measured) = (rules.scale_sigma * rules.scale_sigma, variance / (seen_length * seen_length));
        let away = length / seen_length - 1.0;
        if away.abs() > SIGMAS * (prior + measured).sqrt() {
            return None;
        }
        let scale = (1.0 + away * prior / (prior + measured)).max(LEAST_SCALE);
        let scale_cost = 0.5 * away * away / (prior + measured);
        let yaw_rad = of_known[1].atan2(of_known[0]) - of_seen[1].atan2(of_seen[0]);
        let turn_variance = variance / (seen_length * seen_length);
        let most_rad = SIGMAS * (2.0 * rules.heading_sigma_rad.powi(2) + turn_variance).sqrt();
        if pair.iter().zip(&own).any(|(k, s)| headings_apart(k.yaw_rad, s.yaw_rad + yaw_rad).abs() > most_rad) {
            return None;
        }
        let (sine, cosine) = yaw_rad.sin_cos();
        let middle = half(own[0].place, own[1].place);
        let turn = [cosine, sine];
        let mut laid = Self { yaw_rad, turn, shift: [0.0; 2], middle, turn_variance, scale, scale_cost };
        let (there, here) = (half(pair[0].place, pair[1].place), laid.transform(middle));
        laid.shift = [there[0] - here[0], there[1] - here[1]];
        Some(laid)
    }

    fn transform(&self, p: [f64; 2]) -> [f64; 2] {
        let [c, s] = self.turn.map(|x| self.scale * x);
        [c * p[0] - s * p[1] + self.shift[0], s * p[0] + c * p[1] + self.shift[1]]
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
    fn gain(&self, known: &Parked, seen: &Parked) -> f64 {
        let away = between(known.place, seen.place);
        let gap = away[0] * away[0] + away[1] * away[1];
        let (variance, most) = (seen.variance_m2 + known.variance_m2, self.rules.gate * self.rules.gate);
        if gap > most * variance || gap > REACH_M * REACH_M {
            return 0.0;
        }
        let turn = headings_apart(known.yaw_rad, seen.yaw_rad) / self.rules.heading_sigma_rad;
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

fn headings_apart(one_rad: f64, other_rad: f64) -> f64 {
    (one_rad - other_rad + PI / 2.0).rem_euclid(PI) - PI / 2.0
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
