//! Rounding to whole pixels in a few instructions, without calls into the mathematics library and without branches.
//!
//! Adding 1.5 · 2⁵² leaves no bits for fractions, so that the sum is the nearest whole number (of two, the even one), and
//! its low bits are that number as an integer. What is not finite, or far off any image, becomes a number far off.

/// 1.5 · 2⁵².
const WHOLE: f64 = 6_755_399_441_055_744.0;

/// No pixel lies farther off.
const FAR: f64 = 1e12;

/// The nearest whole number as a float and as an integer.
#[inline(always)]
fn round(x: f64) -> (f64, i64) {
    let sum = x + WHOLE;
    (sum - WHOLE, (sum.to_bits() as i64).wrapping_sub(WHOLE.to_bits() as i64))
}

/// The pixel whose centre is nearest to a coordinate; of two, the greater.
#[inline(always)]
pub(crate) fn nearest(x: f64) -> i64 {
    let x = x.clamp(-FAR, FAR);
    let (near, whole) = round(x);
    whole.wrapping_add(i64::from(x - near >= 0.5))
}

/// The same of what is known to lie near the image.
#[inline(always)]
pub(crate) fn near(x: f64) -> i64 {
    let (near, whole) = round(x);
    whole.wrapping_add(i64::from(x - near >= 0.5))
}

/// The greatest whole number not above.
#[inline(always)]
pub(crate) fn floor(x: f64) -> i64 {
    let x = x.clamp(-FAR, FAR);
    let (near, whole) = round(x);
    whole.wrapping_sub(i64::from(near > x))
}

/// The smallest whole number not below.
#[inline(always)]
pub(crate) fn ceil(x: f64) -> i64 {
    let x = x.clamp(-FAR, FAR);
    let (near, whole) = round(x);
    whole.wrapping_add(i64::from(near < x))
}

/// The same of what is known to lie near the image.
#[inline(always)]
pub(crate) fn ceil_near(x: f64) -> i64 {
    let (near, whole) = round(x);
    whole.wrapping_add(i64::from(near < x))
}

#[cfg(test)]
mod tests {
    use super::{ceil, ceil_near, floor, near, nearest};

    #[test]
    fn whole_numbers_are_those_of_the_mathematics_library() {
        let halves = (-4000..4000).map(|k| f64::from(k) * 0.125);
        let beside = halves.flat_map(|x| [x, x.next_up(), x.next_down(), x * 1e5]);
        for x in beside {
            let up = x - x.floor() >= 0.5;
            assert_eq!(nearest(x), x.floor() as i64 + i64::from(up), "{x}");
            assert_eq!(floor(x), x.floor() as i64, "{x}");
            assert_eq!(ceil(x), x.ceil() as i64, "{x}");
            assert_eq!((near(x), ceil_near(x)), (nearest(x), ceil(x)), "{x}");
        }
    }

    #[test]
    fn what_lies_on_no_image_stays_off_it() {
        for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300] {
            for whole in [nearest(x), floor(x), ceil(x)] {
                assert!(whole.unsigned_abs() > 1 << 39, "{x}: {whole}");
            }
        }
    }
}
