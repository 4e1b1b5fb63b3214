//! How well the road's texture agrees in two images, for one length of the displacement between their cameras after the
//! other.
//!
//! Grey values between pixels are bilinear and rounded to whole ones. So all sums are of whole numbers, exact in any order.

use nalgebra::Vector3;

use crate::camera::Camera;
use crate::error::{Error, Result, check_finite, check_length};
use crate::lie::Pose;
use crate::rounding::floor;
use crate::simd::wide;

/// Rays that fall less than this a metre do not reach the road.
const LEAST_FALL: f64 = 1e-3;
/// Share of the points that must lie on the image.
const LEAST_INSIDE: f64 = 0.5;
/// A product of deviations is taken to be no smaller.
const LEAST_SPREAD: f64 = 1e-9;
/// 1.5 · 2²³: added to a positive number below 2²², it leaves the nearest whole one in the low bits.
const WHOLE: f32 = 12_582_912.0;

/// The part of the road that is compared, as the second camera sees it; lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoadPatch {
    /// The road's normal in the second camera, of length 1.
    pub up: Vector3<f64>,
    /// The camera's height above the road.
    pub height_m: f64,
    /// Nearest depth.
    pub min_distance_m: f64,
    /// Farthest depth.
    pub max_distance_m: f64,
    /// How far to the left and right it reaches.
    pub aside_m: f64,
    /// Every so many pixels one is compared.
    pub step_px: usize,
}

/// The road's points that the second camera sees, ready to be looked up in the first image.
#[derive(Debug, Clone)]
pub struct RoadTexture {
    camera: Camera,
    image: Vec<u8>,        // the first one
    seen: Vec<u8>,         // grey values in the second image
    points: [Vec<f64>; 3], // turned into the first camera, but not moved
    direction: Vector3<f64>,
}

/// Whole sums over the points on the image.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: i64,
    a: i64,
    b: i64,
    aa: i64,
    bb: i64,
    ab: i64,
}

impl RoadTexture {
    /// Collect the road's points. `images` are grey, row by row, of the first and the second camera; `free` is not 0 where
    /// nothing hides the road in the second.
    ///
    /// # Errors
    /// [`Error`] for pictures of another size than the camera's, values that are not finite, or a step of 0 pixels.
    pub fn new(
        camera: Camera,
        images: [&[u8]; 2],
        free: &[u8],
        first_from_second: &Pose,
        patch: &RoadPatch,
    ) -> Result<Self> {
        let camera = camera.checked()?;
        for picture in [images[0], images[1], free] {
            check_length("a picture", picture.len(), camera.width * camera.height)?;
        }
        let RoadPatch { up, height_m, min_distance_m, max_distance_m, aside_m, step_px } = *patch;
        check_finite("patch of road", &[up.x, up.y, up.z, height_m, min_distance_m, max_distance_m, aside_m])?;
        check_finite("first_from_second", first_from_second.rotation.as_slice())?;
        check_finite("first_from_second", first_from_second.translation.as_slice())?;
        if step_px == 0 {
            return Err(Error::Range { what: "step", expected: "at least 1 pixel", found: 0.0 });
        }
        let length = first_from_second.translation.norm();
        if length <= 0.0 {
            return Err(Error::Range { what: "displacement", expected: "positive", found: length });
        }
        let direction = first_from_second.translation / length;
        let (mut seen, mut points) = (Vec::new(), [Vec::new(), Vec::new(), Vec::new()]);
        for row in (0..camera.height).step_by(step_px) {
            let y = (row as f64 - camera.cy) / camera.fy;
            for column in (0..camera.width).step_by(step_px) {
                let ray = Vector3::new((column as f64 - camera.cx - camera.skew * y) / camera.fx, y, 1.0);
                let fall = -ray.dot(&up);
                let depth = height_m / fall.max(LEAST_FALL);
                let ahead = fall > LEAST_FALL && depth > min_distance_m && depth < max_distance_m;
                let at = row * camera.width + column;
                if ahead && (ray.x * depth).abs() < aside_m && free[at] > 0 {
                    seen.push(images[1][at]);
                    let turned = first_from_second.rotation * (ray * depth);
                    points.iter_mut().zip(turned.iter()).for_each(|(axis, value)| axis.push(*value));
                }
            }
        }
        Ok(Self { camera, image: images[0].to_vec(), seen, points, direction })
    }

    /// How many points there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.seen.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.seen.is_empty()
    }

    /// Normalized correlation of the grey values at each length of the displacement, metres; −1 where fewer than half of
    /// the points lie on the first image.
    #[must_use]
    pub fn correlations(&self, lengths_m: &[f64]) -> Vec<f64> {
        let (mut columns, mut rows) = (vec![0.0; self.len()], vec![0.0; self.len()]);
        let mut of = |length_m: &f64| {
            self.project(&(self.direction * *length_m), &mut columns, &mut rows);
            self.sums(&columns, &rows).correlation(self.len())
        };
        lengths_m.iter().map(&mut of).collect()
    }

    /// Pixels of the points, moved, in the first image; on no image where they are not before the camera.
    fn project(&self, moved: &Vector3<f64>, columns: &mut [f64], rows: &mut [f64]) {
        let Camera { fx, fy, cx, cy, skew, .. } = self.camera;
        let [x, y, z] = &self.points;
        wide(
            #[inline(always)]
            || {
                let points = x.iter().zip(y).zip(z);
                for (((x, y), z), (column, row)) in points.zip(columns.iter_mut().zip(rows.iter_mut())) {
                    let (x, y, z) = (x + moved.x, y + moved.y, z + moved.z);
                    let depth = if z > 0.0 { z } else { f64::NAN };
                    *column = (fx * x + skew * y) / depth + cx;
                    *row = fy * y / depth + cy;
                }
            },
        );
    }

    fn sums(&self, columns: &[f64], rows: &[f64]) -> Sums {
        let (width, height) = (self.camera.width, self.camera.height);
        let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
        let mut sums = Sums::default();
        for ((x, y), a) in columns.iter().zip(rows).zip(&self.seen) {
            let is_inside = *x >= 0.0 && *x <= right && *y >= 0.0 && *y <= bottom; // not where they are NaN
            if is_inside {
                sums.add(i64::from(*a), i64::from(self.value(*x as f32, *y as f32)));
            }
        }
        sums
    }

    /// Grey value of the first image at a pixel on it.
    #[inline]
    fn value(&self, x: f32, y: f32) -> u32 {
        let (width, height) = (self.camera.width, self.camera.height);
        let (i, j) = (floor(f64::from(x)) as usize, floor(f64::from(y)) as usize);
        let (s, t) = (x - i as f32, y - j as f32);
        let right = usize::from(i + 1 < width);
        let at = j * width + i;
        let below = at + if j + 1 < height { width } else { 0 };
        let [a, b] = [self.image[at], self.image[at + right]].map(f32::from);
        let [c, d] = [self.image[below], self.image[below + right]].map(f32::from);
        let (above, beneath) = (a + s * (b - a), c + s * (d - c));
        (above + t * (beneath - above) + WHOLE).to_bits() - WHOLE.to_bits()
    }
}

impl Sums {
    #[inline]
    fn add(&mut self, a: i64, b: i64) {
        self.count += 1;
        self.a += a;
        self.b += b;
        self.aa += a * a;
        self.bb += b * b;
        self.ab += a * b;
    }

    fn correlation(&self, points: usize) -> f64 {
        if self.count == 0 || (self.count as f64) < LEAST_INSIDE * points as f64 {
            return -1.0;
        }
        let deviation = |ab: i64, a: i64, b: i64| (self.count * ab - a * b) as f64 / self.count as f64;
        let spread = deviation(self.aa, self.a, self.a) * deviation(self.bb, self.b, self.b);
        deviation(self.ab, self.a, self.b) / spread.sqrt().max(LEAST_SPREAD)
    }
}
