//! Points tracked over several cameras, as a cost over the cameras alone: each point is where its rays meet, and is
//! eliminated (Schur complement).

use nalgebra::{Matrix2x3, Matrix2x6, Matrix3, Matrix6x3, Vector2, Vector3};

use crate::camera::Camera;
use crate::error::{Error, Result, check_finite, check_length};
use crate::lie::{Pose, hat};

/// Depths of points that are triangulated, in units of the cameras' largest displacement.
const MIN_DEPTH: f64 = 0.05;
const MAX_DEPTH: f64 = 400.0;
/// Smallest displacement, metres, that counts.
const MIN_DISPLACEMENT_M: f64 = 1e-6;
/// Points are projected as if they were no nearer, metres.
const NEAREST_M: f64 = 0.1;
/// Share of the trace that keeps the point's normal equations whole.
const DAMPING: f64 = 1e-9;
/// Steps of Gauss and Newton, after the midpoint of the rays.
const STEPS: usize = 3;
/// Of the eigenvalues' iteration, which ends after some ten.
const EIGEN_STEPS: usize = 200;

/// Tracks of one length: `pixels` holds those of one track after the other.
#[derive(Debug, Clone)]
struct Group {
    length: usize,
    pixels: Vec<Vector2<f64>>,
    rays: Vec<Vector3<f64>>, // of length 1, in the cameras
}

/// Tracks that begin in the first of several cameras.
#[derive(Debug, Clone)]
pub struct TrackedPoints {
    camera: Camera,
    sigma_px: f64,
    kernel: f64,
    groups: Vec<Group>,
}

/// Normal equations over (translation, rotation) of each camera, right perturbations, and the robust cost.
#[derive(Debug, Clone, PartialEq)]
pub struct NormalEquations {
    /// Row-major, 6 m rows and columns.
    pub hessian: Vec<f64>,
    /// 6 m.
    pub gradient: Vec<f64>,
    /// Half the sum of the robust squares.
    pub cost: f64,
}

/// A track with its point, as its cameras see it.
struct Seen {
    in_cameras: Vec<Vector3<f64>>,
    is_finite: bool,
    by_point: Vec<Matrix2x3<f64>>, // whitened, over the axes of the point's normal matrix
    rest: Vec<Vector2<f64>>,       // whitened residuals with what a move of the point explains taken away
    size: Vector3<f64>,            // eigenvalues of the point's normal matrix
    damping: f64,                  // that is added to them
    soft: f64,                     // 1 + r² / k², r² being the residual's square per degree of freedom
}

impl TrackedPoints {
    /// Each group is a length m of at least 2 and the pixels of its tracks, m by m. `sigma_px` is a corner's noise,
    /// `kernel` Geman and McClure's threshold in sigmas.
    ///
    /// # Errors
    /// [`Error`] for lengths that do not fit, values that are not finite, or a sigma or kernel that is not positive.
    pub fn new(camera: Camera, sigma_px: f64, kernel: f64, groups: Vec<(usize, Vec<Vector2<f64>>)>) -> Result<Self> {
        for (what, value) in [("sigma of corners", sigma_px), ("kernel of corners", kernel)] {
            check_finite(what, &[value])?;
            if value <= 0.0 {
                return Err(Error::Range { what, expected: "positive", found: value });
            }
        }
        let groups =
            groups.into_iter().map(|(length, pixels)| group(&camera, length, pixels)).collect::<Result<_>>()?;
        Ok(Self { camera, sigma_px, kernel, groups })
    }

    /// The tracks as they were given: their length, and their pixels one track after the other.
    pub fn groups(&self) -> impl Iterator<Item = (usize, &[Vector2<f64>])> {
        self.groups.iter().map(|group| (group.length, group.pixels.as_slice()))
    }

    /// How many cameras the longest track sees.
    #[must_use]
    pub fn camera_count(&self) -> usize {
        self.groups.iter().map(|group| group.length).max().unwrap_or(0)
    }

    /// Half the sum of the robust squares at these cameras' poses.
    ///
    /// # Errors
    /// [`Error`] if there are fewer cameras than the longest track has.
    pub fn cost(&self, world_from_camera: &[Pose]) -> Result<f64> {
        self.check(world_from_camera)?;
        Ok(self.each(world_from_camera).map(|seen| seen.cost()).sum())
    }

    /// Normal equations at these cameras' poses.
    ///
    /// # Errors
    /// As of [`TrackedPoints::cost`].
    pub fn normal_equations(&self, world_from_camera: &[Pose]) -> Result<NormalEquations> {
        self.check(world_from_camera)?;
        let width = 6 * world_from_camera.len();
        let mut found = NormalEquations { hessian: vec![0.0; width * width], gradient: vec![0.0; width], cost: 0.0 };
        for seen in self.each(world_from_camera) {
            found.cost += seen.cost();
            self.add(&seen, width, &mut found);
        }
        for i in 0..width {
            for j in 0..i {
                found.hessian[i * width + j] = found.hessian[j * width + i];
            }
        }
        Ok(found)
    }

    /// The point of each track (in the world; the direction towards it where its rays do not meet), and whether they do.
    ///
    /// # Errors
    /// As of [`TrackedPoints::cost`].
    pub fn points(&self, world_from_camera: &[Pose]) -> Result<Vec<(Vector3<f64>, bool)>> {
        self.check(world_from_camera)?;
        let of_group = |group: &Group| {
            let cameras = &world_from_camera[..group.length];
            group.tracks().map(|(pixels, rays)| self.triangulate(pixels, rays, cameras)).collect::<Vec<_>>()
        };
        Ok(self.groups.iter().flat_map(of_group).collect())
    }

    fn check(&self, cameras: &[Pose]) -> Result<()> {
        if cameras.len() < self.camera_count() {
            return check_length("cameras", cameras.len(), self.camera_count());
        }
        Ok(())
    }

    fn each<'a>(&'a self, cameras: &'a [Pose]) -> impl Iterator<Item = Seen> + 'a {
        self.groups.iter().flat_map(move |group| {
            let cameras = &cameras[..group.length];
            group.tracks().map(move |(pixels, rays)| self.seen(pixels, rays, cameras))
        })
    }

    /// Midpoint of the rays, then a few steps on the image.
    fn triangulate(&self, pixels: &[Vector2<f64>], rays: &[Vector3<f64>], cameras: &[Pose]) -> (Vector3<f64>, bool) {
        let origin = cameras[0].translation;
        let mut displacement = MIN_DISPLACEMENT_M;
        let (mut normal, mut right, mut toward) = (Matrix3::identity() * DAMPING, Vector3::zeros(), Vector3::zeros());
        for (ray, pose) in rays.iter().zip(cameras) {
            let (direction, eye) = (pose.rotation * ray, pose.translation - origin);
            let across = Matrix3::identity() - direction * direction.transpose();
            displacement = displacement.max(eye.norm());
            normal += across;
            right += across * eye;
            toward += direction;
        }
        let mut point = origin + solved(&normal, &right);
        for _ in 0..STEPS {
            let (mut hessian, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
            for (pixel, pose) in pixels.iter().zip(cameras) {
                let seen = in_camera(pose, &point);
                let by_point = self.camera.projection_jacobian(&before(seen)) * pose.rotation.transpose();
                hessian += by_point.transpose() * by_point;
                gradient += by_point.transpose() * (self.camera.project(&before(seen)) - pixel);
            }
            hessian += Matrix3::identity() * (DAMPING * hessian.trace());
            point -= solved(&hessian, &gradient);
        }
        let is_finite = cameras.iter().all(|pose| {
            let depth = in_camera(pose, &point).z;
            depth > MIN_DEPTH * displacement && depth < MAX_DEPTH * displacement
        });
        if is_finite { (point, true) } else { (toward / rays.len() as f64, false) }
    }

    fn seen(&self, pixels: &[Vector2<f64>], rays: &[Vector3<f64>], cameras: &[Pose]) -> Seen {
        let (point, is_finite) = self.triangulate(pixels, rays, cameras);
        let place = |pose: &Pose| if is_finite { in_camera(pose, &point) } else { pose.rotation.transpose() * point };
        let in_cameras: Vec<Vector3<f64>> = cameras.iter().map(place).collect();
        let mut by_point = Vec::with_capacity(cameras.len());
        let mut rest = Vec::with_capacity(cameras.len());
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for ((pixel, pose), seen) in pixels.iter().zip(cameras).zip(&in_cameras) {
            let derivative =
                self.camera.projection_jacobian(&before(*seen)) * pose.rotation.transpose() / self.sigma_px;
            let residual = (self.camera.project(&before(*seen)) - pixel) / self.sigma_px;
            normal += derivative.transpose() * derivative;
            right += derivative.transpose() * residual;
            by_point.push(derivative);
            rest.push(residual);
        }
        // Along its eigenvectors, as the inverse of an almost singular matrix would cost more digits than there are
        let axes = normal
            .try_symmetric_eigen(f64::EPSILON, EIGEN_STEPS)
            .unwrap_or_else(|| Matrix3::<f64>::identity().symmetric_eigen());
        let damping = DAMPING * normal.trace();
        by_point.iter_mut().for_each(|derivative| *derivative *= axes.eigenvectors);
        let along = axes.eigenvectors.transpose() * right;
        let step = along.component_div(&axes.eigenvalues.add_scalar(damping));
        rest.iter_mut().zip(&by_point).for_each(|(residual, derivative)| *residual -= derivative * step);
        let freedom = (2 * cameras.len() - 3) as f64;
        let squared: f64 = rest.iter().map(nalgebra::Matrix::norm_squared).sum();
        let soft = 1.0 + squared / (freedom * self.kernel * self.kernel);
        Seen { in_cameras, is_finite, by_point, rest, size: axes.eigenvalues, damping, soft }
    }

    /// Add a track: with J over the cameras and F over the point, P = I − F (FᵀF)⁻¹ Fᵀ, the weight 1 / soft²:
    /// JᵀPPJ and JᵀPPr.
    fn add(&self, seen: &Seen, width: usize, found: &mut NormalEquations) {
        let weight = 1.0 / (seen.soft * seen.soft);
        let shift = Matrix3::identity() * if seen.is_finite { -1.0 } else { 0.0 };
        let by_camera: Vec<Matrix2x6<f64>> = seen
            .in_cameras
            .iter()
            .map(|at| {
                let by_pixel = self.camera.projection_jacobian(&before(*at)) / self.sigma_px;
                let mut out = Matrix2x6::zeros();
                out.fixed_columns_mut::<3>(0).copy_from(&(by_pixel * shift));
                out.fixed_columns_mut::<3>(3).copy_from(&(by_pixel * hat(at)));
                out
            })
            .collect();
        let crossed: Vec<Matrix6x3<f64>> =
            by_camera.iter().zip(&seen.by_point).map(|(camera, point)| camera.transpose() * point).collect();
        let pull: Vector3<f64> =
            seen.by_point.iter().zip(&seen.rest).map(|(point, rest)| point.transpose() * rest).sum();
        let damped = seen.size.add_scalar(seen.damping);
        let left = pull.component_div(&damped);
        let twice = damped.zip_map(&seen.size, |d, size| 2.0 / d - size / (d * d));
        for (i, camera) in by_camera.iter().enumerate() {
            let gradient = (camera.transpose() * seen.rest[i] - crossed[i] * left) * weight;
            found.gradient[6 * i..6 * i + 6].iter_mut().zip(gradient.iter()).for_each(|(sum, x)| *sum += x);
            let reach = crossed[i] * Matrix3::from_diagonal(&twice);
            for (j, other) in crossed.iter().enumerate().skip(i) {
                let mut block = -(reach * other.transpose());
                if i == j {
                    block += camera.transpose() * camera;
                }
                for row in 0..6 {
                    for column in 0..6 {
                        found.hessian[(6 * i + row) * width + 6 * j + column] += weight * block[(row, column)];
                    }
                }
            }
        }
    }
}

impl Group {
    fn tracks(&self) -> impl Iterator<Item = (&[Vector2<f64>], &[Vector3<f64>])> {
        self.pixels.chunks_exact(self.length).zip(self.rays.chunks_exact(self.length))
    }
}

impl Seen {
    fn cost(&self) -> f64 {
        let squared: f64 = self.rest.iter().map(nalgebra::Matrix::norm_squared).sum();
        0.5 * squared / self.soft
    }
}

fn group(camera: &Camera, length: usize, pixels: Vec<Vector2<f64>>) -> Result<Group> {
    if length < 2 {
        return Err(Error::Range { what: "length of a track", expected: "at least 2", found: length as f64 });
    }
    if !pixels.len().is_multiple_of(length) {
        check_length("pixels of tracks", pixels.len(), pixels.len() / length * length + length)?;
    }
    for pixel in &pixels {
        check_finite("pixels of tracks", pixel.as_slice())?;
    }
    let ray = |pixel: &Vector2<f64>| {
        let y = (pixel.y - camera.cy) / camera.fy;
        Vector3::new((pixel.x - camera.cx - camera.skew * y) / camera.fx, y, 1.0).normalize()
    };
    let rays = pixels.iter().map(ray).collect();
    Ok(Group { length, pixels, rays })
}

fn in_camera(world_from_camera: &Pose, point: &Vector3<f64>) -> Vector3<f64> {
    world_from_camera.rotation.transpose() * (point - world_from_camera.translation)
}

/// The same point, no nearer than a little before the camera.
fn before(point: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(point.x, point.y, point.z.max(NEAREST_M))
}

/// Of a damped, so regular, system; no step where it is none.
fn solved(normal: &Matrix3<f64>, right: &Vector3<f64>) -> Vector3<f64> {
    normal.try_inverse().map_or_else(Vector3::zeros, |inverse| inverse * right)
}
