//! What one frame shows of one object.

use std::sync::Arc;

use nalgebra::Vector2;

use crate::camera::Camera;
use crate::error::{Error, Result, check_finite, check_length};
use crate::lie::Pose;
use crate::raster::Rect;
use crate::rounding::{floor, nearest};

/// A point of an observed mask's border.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BorderPoint {
    /// Where it lies.
    pub pixel: Vector2<f64>,
    /// Length of border that it stands for, pixels.
    pub length: f64,
    /// Whether the border is the object's own; if not (image border, occluder) the object reaches at least this far.
    pub own: bool,
}

/// A key point that was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeypointObservation {
    /// Which of the category's key points.
    pub index: usize,
    /// Where it was seen.
    pub pixel: Vector2<f64>,
    /// Standard deviation of each coordinate, pixels.
    pub sigma_px: f64,
}

/// An object's mask and key points in one frame, and the camera that saw them. Copies share the pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// Where it stood.
    pub world_from_camera: Pose,
    /// When, in seconds from the time at which an object's state holds.
    pub time_s: f64,
    /// The pixels that the fields below cover, row-major; beyond them the distance goes on growing.
    pub crop: Rect,
    /// Signed distance to the observed border, pixels, negative inside the mask.
    pub distance_px: Arc<[f32]>,
    /// Where the nearest border is not the object's own.
    pub cut: Arc<[u8]>,
    /// Where an occluder hides what is behind.
    pub hidden: Arc<[u8]>,
    /// The observed border.
    pub border: Vec<BorderPoint>,
    /// Area of the observed mask, pixels.
    pub area_px: usize,
    /// Length of the border that is the object's own, pixels.
    pub border_length_px: f64,
    /// How far the true surface may lie from any mesh of the model, as seen here, pixels.
    pub surface_sigma_px: f64,
    /// The key points seen.
    pub keypoints: Vec<KeypointObservation>,
}

/// What the observed border says at a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Signed distance to the border, pixels, negative inside the mask.
    pub distance_px: f64,
    /// Its gradient.
    pub direction: Vector2<f64>,
    /// Whether the nearest border is the object's own.
    pub own: bool,
}

impl View {
    /// Check that the fields fit each other.
    ///
    /// # Errors
    /// [`Error`] with the field that does not fit.
    pub fn checked(mut self, keypoint_count: usize) -> Result<Self> {
        self.camera = self.camera.checked()?;
        let area = self.crop.area();
        if area == 0 {
            return Err(Error::Range { what: "crop", expected: "at least one pixel", found: 0.0 });
        }
        check_length("distance", self.distance_px.len(), area)?;
        check_length("cut", self.cut.len(), area)?;
        check_length("hidden", self.hidden.len(), area)?;
        if let Some(index) = self.distance_px.iter().position(|x| !x.is_finite()) {
            return Err(Error::NotFinite { what: "distance", index, value: f64::from(self.distance_px[index]) });
        }
        check_finite("time", &[self.time_s])?;
        if !(self.surface_sigma_px.is_finite() && self.surface_sigma_px >= 0.0) {
            return Err(Error::Range { what: "surface sigma", expected: "at least 0", found: self.surface_sigma_px });
        }
        check_finite("world_from_camera", self.world_from_camera.rotation.as_slice())?;
        check_finite("world_from_camera", self.world_from_camera.translation.as_slice())?;
        for point in &self.border {
            check_finite("border", &[point.pixel.x, point.pixel.y, point.length])?;
        }
        for k in &self.keypoints {
            check_finite("key point", &[k.pixel.x, k.pixel.y, k.sigma_px])?;
            if k.index >= keypoint_count {
                return Err(Error::Index { what: "key point", index: k.index as i64, count: keypoint_count });
            }
            if k.sigma_px <= 0.0 {
                return Err(Error::Range { what: "key point sigma", expected: "positive", found: k.sigma_px });
            }
        }
        self.area_px = self.distance_px.iter().filter(|d| **d < 0.0).count();
        self.border_length_px = self.border.iter().filter(|p| p.own).map(|p| p.length).sum();
        Ok(self)
    }

    /// Whether a pixel lies on the image.
    #[must_use]
    pub fn in_image(&self, pixel: &Vector2<f64>) -> bool {
        pixel.x >= -0.5
            && pixel.y >= -0.5
            && pixel.x < self.camera.width as f64 - 0.5
            && pixel.y < self.camera.height as f64 - 0.5
    }

    /// Index of the crop's pixel nearest to a point.
    fn nearest(&self, pixel: &Vector2<f64>) -> usize {
        let column = nearest(pixel.x).saturating_sub(self.crop.x0).clamp(0, self.crop.width as i64 - 1) as usize;
        let row = nearest(pixel.y).saturating_sub(self.crop.y0).clamp(0, self.crop.height as i64 - 1) as usize;
        row * self.crop.width + column
    }

    /// What the observed border says at a pixel; nothing off the image and behind occluders.
    #[inline(always)]
    #[must_use]
    pub fn look(&self, pixel: &Vector2<f64>) -> Option<Look> {
        if !self.in_image(pixel) {
            return None;
        }
        let (x, y) = (pixel.x - self.crop.x0 as f64, pixel.y - self.crop.y0 as f64);
        let (i, j) = (floor(x) as usize, floor(y) as usize);
        if i >= self.crop.width - 1 || j >= self.crop.height - 1 {
            let (distance_px, direction) = self.distance(pixel);
            return (!self.is_hidden(pixel)).then(|| Look { distance_px, direction, own: self.border_is_own(pixel) });
        }
        let (s, t) = (x - i as f64, y - j as f64);
        let at = j * self.crop.width + i;
        let nearest = at + usize::from(s >= 0.5) + if t >= 0.5 { self.crop.width } else { 0 };
        let corners =
            (&self.distance_px[at..at + 2], &self.distance_px[at + self.crop.width..at + self.crop.width + 2]);
        let (distance_px, direction) = bilinear(corners, s, t);
        (self.hidden[nearest] == 0).then(|| Look { distance_px, direction, own: self.cut[nearest] == 0 })
    }

    /// Whether an occluder covers a pixel; one that covers the crop's edge goes on beyond it.
    #[must_use]
    pub fn is_hidden(&self, pixel: &Vector2<f64>) -> bool {
        self.hidden[self.nearest(pixel)] > 0
    }

    /// Whether the observed border nearest to a pixel is the object's own.
    #[must_use]
    pub fn border_is_own(&self, pixel: &Vector2<f64>) -> bool {
        self.cut[self.nearest(pixel)] == 0
    }

    /// Signed distance to the observed border, bilinear, with its gradient.
    #[must_use]
    pub fn distance(&self, pixel: &Vector2<f64>) -> (f64, Vector2<f64>) {
        let (w, h) = (self.crop.width, self.crop.height);
        let relative = pixel - Vector2::new(self.crop.x0 as f64, self.crop.y0 as f64);
        let clamped = Vector2::new(relative.x.clamp(0.0, w as f64 - 1.0), relative.y.clamp(0.0, h as f64 - 1.0));
        let (i, j) = ((clamped.x as usize).min(w.saturating_sub(2)), (clamped.y as usize).min(h.saturating_sub(2)));
        let (s, t) = (clamped.x - i as f64, clamped.y - j as f64);
        let at = |u: usize, v: usize| self.distance_px[v.min(h - 1) * w + u.min(w - 1)];
        let (value, gradient) = bilinear((&[at(i, j), at(i + 1, j)], &[at(i, j + 1), at(i + 1, j + 1)]), s, t);
        let beyond = relative - clamped;
        let far = beyond.norm();
        if far > 0.0 {
            // off the crop the distance grows by what the point lies beyond it
            let outward = beyond / far;
            let inward = Vector2::new(
                if beyond.x == 0.0 { gradient.x } else { 0.0 },
                if beyond.y == 0.0 { gradient.y } else { 0.0 },
            );
            return (value + far, inward + outward);
        }
        (value, gradient)
    }
}

/// A bilinear function with the values (a, b) and (c, d) at its corners, at (s, t) of the way, with its gradient.
#[inline(always)]
fn bilinear((above, below): (&[f32], &[f32]), s: f64, t: f64) -> (f64, Vector2<f64>) {
    let [a, b, c, d] = [above[0], above[1], below[0], below[1]].map(f64::from);
    let value = (a * (1.0 - s) + b * s) * (1.0 - t) + (c * (1.0 - s) + d * s) * t;
    (value, Vector2::new((b - a) * (1.0 - t) + (d - c) * t, (c - a) * (1.0 - s) + (d - b) * s))
}
