//! A way along a piece of the contour, pixel by pixel: ∫ ∂L/∂ŝ (1 − t) and ∫ ∂L/∂ŝ t.
//!
//! The way goes along the longer axis of the edge, so that it changes pixels across at most once in each pixel along. Where
//! it changes none, or into one that the observed mask has as well or has not either, a pixel adds one to a count and its
//! place to a sum of whole numbers.

use nalgebra::Vector2;

use super::ObservedMask;
use crate::raster::Rect;
use crate::rounding::near;
use crate::visible::Piece;

/// The way; points are (along it, across it).
pub(super) struct Walk<'a> {
    rect: &'a Rect,
    steep: bool,
    start: (f64, f64),
    /// How far the way goes across for each pixel along.
    pub slope: f64,
    /// Share of the second vertex that is won by a pixel along.
    inverse: f64,
    low: f64,
    high: f64,
    begin: i64,
    end: i64,
}

/// Integrals of ∂L/∂ŝ and of ∂L/∂ŝ t.
#[derive(Clone, Copy)]
struct Sums {
    whole: f64,
    of_second: f64,
}

impl<'a> Walk<'a> {
    /// A piece of the edge from `a` that goes `along`, within a rectangle; none for an edge without length.
    #[inline(always)]
    pub fn new(a: &Vector2<f64>, along: &Vector2<f64>, steep: bool, piece: &Piece, rect: &'a Rect) -> Option<Self> {
        let (start, direction) =
            if steep { ((a.y, a.x), (along.y, along.x)) } else { ((a.x, a.y), (along.x, along.y)) };
        let (first, size) = if steep { (rect.y0, rect.height) } else { (rect.x0, rect.width) };
        if direction.0 == 0.0 {
            return None;
        }
        let ends = (start.0 + piece.from * direction.0, start.0 + piece.to * direction.0);
        let (low, high) = if ends.0 < ends.1 { ends } else { (ends.1, ends.0) };
        let (begin, end) = (near(low).max(first), near(high).min(first + size as i64 - 1));
        let slope = direction.1 / direction.0;
        Some(Self { rect, steep, start, slope, inverse: 1.0 / direction.0, low, high, begin, end })
    }

    /// The integrals over the shares of the first and the second vertex.
    #[inline(always)]
    pub fn integrate(&self, observed: &ObservedMask, slopes: (f64, f64)) -> (f64, f64) {
        if self.begin > self.end {
            return (0.0, 0.0);
        }
        let sums = if self.is_within(&observed.rect) {
            self.count(observed, slopes)
        } else {
            let mut sums = Sums { whole: 0.0, of_second: 0.0 };
            let from = greatest(self.low, self.begin as f64 - 0.5);
            self.visit(self.begin, self.end, from, &mut sums, |along, across| {
                self.value(observed, slopes, along, across)
            });
            sums
        };
        (sums.whole - sums.of_second, sums.of_second)
    }

    #[inline(always)]
    fn across(&self, along: f64) -> f64 {
        self.start.1 + (along - self.start.0) * self.slope
    }

    /// Whether all pixels of the way, and one more on either side, lie in the drawn and in another rectangle.
    #[inline(always)]
    fn is_within(&self, other: &Rect) -> bool {
        let (a, b) = (near(self.across(self.low)), near(self.across(self.high)));
        let (least, most) = (a.min(b) - 1, a.max(b) + 1);
        let corners = [(self.begin, least), (self.end, most)].map(|(along, across)| self.place(along, across));
        corners.into_iter().all(|(x, y)| self.rect.index(x, y).is_some() & other.index(x, y).is_some())
    }

    #[inline(always)]
    fn place(&self, along: i64, across: i64) -> (i64, i64) {
        if self.steep { (across, along) } else { (along, across) }
    }

    /// ∂L/∂ŝ of a pixel; 0 off the rectangle drawn.
    fn value(&self, observed: &ObservedMask, slopes: (f64, f64), along: i64, across: i64) -> f64 {
        let (x, y) = self.place(along, across);
        if self.rect.index(x, y).is_none() {
            return 0.0;
        }
        if observed.at(x, y) > 0 { slopes.0 } else { slopes.1 }
    }

    #[inline(always)]
    fn add(&self, from: f64, to: f64, value: f64, sums: &mut Sums) {
        let weight = (to - from) * value;
        sums.whole += weight;
        sums.of_second += (0.5 * (from + to) - self.start.0) * self.inverse * weight;
    }

    /// One pixel of the way, from pixel `here` across to pixel `there`.
    #[inline(always)]
    fn cross(&self, (from, to): (f64, f64), (here, there): (i64, i64), values: (f64, f64), sums: &mut Sums) {
        if values.0 == values.1 {
            return self.add(from, to, values.0, sums);
        }
        let border = here.max(there) as f64 - 0.5;
        let middle = least(greatest(self.start.0 + (border - self.start.1) / self.slope, from), to);
        self.add(from, middle, values.0, sums);
        self.add(middle, to, values.1, sums);
    }

    /// Add pixel by pixel.
    #[inline(always)]
    fn visit(&self, begin: i64, end: i64, from: f64, sums: &mut Sums, value: impl Fn(i64, i64) -> f64) {
        let mut from = from;
        let mut here = near(self.across(from));
        for pixel in begin..=end {
            let to = least(self.high, pixel as f64 + 0.5);
            let there = near(self.across(to));
            self.cross((from, to), (here, there), (value(pixel, here), value(pixel, there)), sums);
            (from, here) = (to, there);
        }
    }

    /// The same where all pixels of the way are pixels of the observed mask's rectangle: those of them that the way runs
    /// through from end to end are counted.
    #[inline(always)]
    fn count(&self, observed: &ObservedMask, slopes: (f64, f64)) -> Sums {
        let rect = &observed.rect;
        let width = rect.width as i64;
        let (origin, strides) =
            if self.steep { ((rect.y0, rect.x0), (width, 1)) } else { ((rect.x0, rect.y0), (1, width)) };
        let base = origin.0 * strides.0 + origin.1 * strides.1;
        let value = |at: i64| if observed.mask[at as usize] > 0 { slopes.0 } else { slopes.1 };
        let mut sums = Sums { whole: 0.0, of_second: 0.0 };
        // one pixel of the way; columns across are counted in places of the mask
        let mut pixel = |row: i64, ends: (f64, f64), (here, there): (i64, i64)| {
            let values = (value(row + here), value(row + there));
            if values.0 == values.1 {
                self.add(ends.0, ends.1, values.0, &mut sums);
            } else {
                self.cross(ends, (here / strides.1, there / strides.1), values, &mut sums);
            }
        };
        let (begin, end) = (self.begin, self.end);
        let from = greatest(self.low, begin as f64 - 0.5);
        let first = least(self.high, begin as f64 + 0.5);
        let mut here = near(self.across(first)) * strides.1;
        pixel(begin * strides.0 - base, (from, first), (near(self.across(from)) * strides.1, here));
        if begin == end {
            return sums;
        }
        // of the pixels between: those with the mask on both sides of a change or without a change, and those with it on one
        let ((mut inside, mut inside_places), (mut split, mut split_places)) = ((0, 0), (0, 0));
        let mut row = (begin + 1) * strides.0 - base;
        let (mut to, mut place) = (begin as f64 + 1.5, 1);
        for _ in begin + 1..end {
            let there = near(self.across(to)) * strides.1;
            let (a, b) = (observed.mask[(row + here) as usize], observed.mask[(row + there) as usize]);
            let both = i64::from(a & b);
            (inside, inside_places) = (inside + both, inside_places + (place & -both));
            if a != b {
                (split, split_places) = (split + 1, split_places + place);
                pixel(row, (to - 1.0, to), (here, there));
            }
            (here, row, to, place) = (there, row + strides.0, to + 1.0, place + 1);
        }
        let last = least(self.high, end as f64 + 0.5);
        pixel(row, (end as f64 - 0.5, last), (here, near(self.across(last)) * strides.1));
        let count = end - begin - 1;
        let of_outside = (count - inside - split, count * (count + 1) / 2 - inside_places - split_places);
        for ((count, places), value) in [((inside, inside_places), slopes.0), (of_outside, slopes.1)] {
            sums.whole += count as f64 * value;
            let before = begin as f64 - self.start.0;
            sums.of_second += (places as f64 + before * count as f64) * self.inverse * value;
        }
        sums
    }
}

/// The lesser of two numbers; the second where the first is none.
#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The greater of two numbers; the second where the first is none.
#[inline(always)]
fn greatest(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::{ObservedMask, Piece, Rect, Sums, Walk, greatest};

    #[test]
    fn counting_is_adding_pixel_by_pixel() {
        let rect = Rect { x0: -3, y0: 5, width: 70, height: 60 };
        let mask: Vec<u8> = (0..rect.area()).map(|i| u8::from((i / 7 + i / rect.width).is_multiple_of(3))).collect();
        let observed = ObservedMask::new(rect, &mask).expect("a mask that fills its rectangle");
        let slopes = (-0.013, 0.007);
        let mut counted = 0;
        for k in 0..4000_u32 {
            let turn = f64::from(k) * 0.61;
            let (a, length) = (Vector2::new(30.3 + turn.sin(), 34.7), 0.2 + f64::from(k % 97) * 0.28);
            let along = Vector2::new(turn.cos(), turn.sin()) * length;
            let piece = Piece { edge: 0, from: 0.1 * f64::from(k % 3), to: 1.0 - 0.15 * f64::from(k % 4), winding: 0 };
            let steep = along.y.abs() >= along.x.abs();
            let Some(walk) = Walk::new(&a, &along, steep, &piece, &rect) else { continue };
            counted += u32::from(walk.is_within(&observed.rect));
            let (first, second) = walk.integrate(&observed, slopes);
            let mut sums = Sums { whole: 0.0, of_second: 0.0 };
            let from = greatest(walk.low, walk.begin as f64 - 0.5);
            walk.visit(walk.begin, walk.end, from, &mut sums, |x, y| walk.value(&observed, slopes, x, y));
            assert!((first + second - sums.whole).abs() < 1e-14, "{k}");
            assert!((second - sums.of_second).abs() < 1e-14, "{k}");
        }
        assert!(counted > 3000, "{counted}");
    }
}
