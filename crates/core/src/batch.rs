//! Losses of many meshes in many views at once, with their gradients: what automatic differentiation calls.
//!
//! Each view is evaluated by itself and the results stay in order, so that neither the number of threads nor what else is in
//! the batch changes a bit.

use nalgebra::{Matrix3x4, RowVector4, Vector2, Vector3};
use rayon::prelude::*;

use crate::areas::{Areas, ViewGradient};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::gradients::ObservedMask;
use crate::gradients::exact::overlap;
use crate::gradients::kato::kato_gradient;
use crate::lie::Pose;
use crate::mesh::Topology;
use crate::raster::{NEAR_M, Rect};
use crate::silhouette::Silhouette;

/// One mesh in one view.
#[derive(Debug, Clone, Copy)]
pub struct Placed<'a> {
    /// The camera.
    pub camera: Camera,
    /// Where it sees the object; any affine map.
    pub camera_from_object: Pose,
    /// In the object's frame, metres.
    pub vertices: &'a [Vector3<f64>],
}

/// An observed mask of the camera's whole image, row-major.
#[derive(Debug, Clone, Copy)]
pub enum Mask<'a> {
    /// In the mask where not 0.
    Bytes(&'a [u8]),
    /// Shares, 0 to 1.
    Singles(&'a [f32]),
    /// Shares, 0 to 1.
    Doubles(&'a [f64]),
}

/// How to go back through the mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// A loss of areas, and its exact gradient.
    Exact,
    /// A loss of pixels whose centres are covered, and Kato's approximation (Kato, Ushiku and Harada 2018).
    Kato,
}

/// Work is parted into so many pieces for each thread, so that none waits long for another; each starts with empty buffers.
const PIECES_A_THREAD: usize = 4;

/// Where to compute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// On the caller's thread alone.
    Own,
    /// On those of the pool that this runs in.
    Pool,
}

/// Evaluate all items, in order.
fn for_all<T: Sync, B: Default + Send, R: Send>(
    threads: Threads,
    items: &[T],
    one: impl Fn(&mut B, usize, &T) -> R + Sync,
) -> Vec<R> {
    if items.len() < 2 || threads == Threads::Own {
        let mut work = B::default();
        return items.iter().enumerate().map(|(k, item)| one(&mut work, k, item)).collect();
    }
    let least = items.len().div_ceil(PIECES_A_THREAD * rayon::current_num_threads());
    let pieces = items.par_iter().enumerate().with_min_len(least);
    pieces.map_init(B::default, |work, (k, item)| one(work, k, item)).collect()
}

/// L_mask = −I/U of each view with its gradient; −1 where nothing is drawn and nothing was observed (paper, Eq. 2).
///
/// # Errors
/// [`Error`] for a mask that does not fit its image or has other values than shares.
pub fn mask_iou(
    views: &[Placed],
    topology: &Topology,
    masks: &[Mask],
    method: Method,
    with_gradient: bool,
    threads: Threads,
) -> Result<Vec<(f64, Option<ViewGradient>)>> {
    crate::error::check_length("masks", masks.len(), views.len())?;
    let found = for_all(threads, views, |areas: &mut Areas, k, view| match (method, masks[k]) {
        (Method::Kato, mask) => kato_iou(view, topology, &mask, with_gradient),
        (Method::Exact, Mask::Bytes(mask)) => area_iou(areas, view, topology, mask, with_gradient),
        (Method::Exact, Mask::Singles(mask)) => area_iou(areas, view, topology, mask, with_gradient),
        (Method::Exact, Mask::Doubles(mask)) => area_iou(areas, view, topology, mask, with_gradient),
    });
    found.into_iter().collect()
}

/// An entry of a mask.
trait Share: Copy {
    /// From 0 to 1.
    fn share(self) -> f64;
    /// Sum of a run.
    fn sum(values: &[Self]) -> f64 {
        values.iter().map(|m| m.share()).sum()
    }
    /// Sum of all.
    ///
    /// # Errors
    /// [`Error`] for an entry that is no share.
    fn total(values: &[Self]) -> Result<f64> {
        match values.iter().position(|m| !(0.0..=1.0).contains(&m.share())) {
            Some(index) => {
                Err(Error::Range { what: "a mask's value", expected: "from 0 to 1", found: values[index].share() })
            }
            None => Ok(Self::sum(values)),
        }
    }
}

impl Share for u8 {
    fn share(self) -> f64 {
        f64::from(u8::from(self > 0))
    }
    fn sum(values: &[Self]) -> f64 {
        // runs short enough that a byte counts them
        values.chunks(128).map(|run| u64::from(run.iter().map(|&m| u8::from(m > 0)).sum::<u8>())).sum::<u64>() as f64
    }
    fn total(values: &[Self]) -> Result<f64> {
        Ok(Self::sum(values))
    }
}

impl Share for f32 {
    fn share(self) -> f64 {
        f64::from(self)
    }
}

impl Share for f64 {
    fn share(self) -> f64 {
        self
    }
}

fn area_iou<M: Share>(
    areas: &mut Areas,
    view: &Placed,
    topology: &Topology,
    mask: &[M],
    with_gradient: bool,
) -> Result<(f64, Option<ViewGradient>)> {
    let (camera, pose) = (&view.camera, &view.camera_from_object);
    crate::error::check_length("mask", mask.len(), camera.width * camera.height)?;
    let observed = M::total(mask)?;
    areas.draw(camera, pose, view.vertices, topology);
    let rect = areas.rect();
    let index = |column: usize, row: usize| (rect.y0 as usize + row) * camera.width + rect.x0 as usize + column;
    let (mut both, mut drawn) = (0.0, 0.0);
    for &(row, from, to) in areas.spans() {
        drawn += f64::from(to - from);
        both += M::sum(&mask[index(from as usize, row as usize)..index(to as usize, row as usize)]);
    }
    for cell in areas.touched() {
        let more = cell.share - f64::from(u8::from(cell.centre));
        drawn += more;
        both += more * mask[index(cell.column as usize, cell.row as usize)].share();
    }
    let union = drawn + observed - both;
    let loss = if union > 0.0 { -both / union } else { -1.0 };
    if !with_gradient {
        return Ok((loss, None));
    }
    // paper, Proposition 1
    let (inside, outside) = crate::gradients::loss_slopes(both, union);
    let slope = |column: usize, row: usize| {
        let m = mask[index(column, row)].share();
        m * inside + (1.0 - m) * outside
    };
    Ok((loss, Some(areas.gradient(camera, pose, view.vertices, slope))))
}

fn kato_iou(
    view: &Placed,
    topology: &Topology,
    mask: &Mask,
    with_gradient: bool,
) -> Result<(f64, Option<ViewGradient>)> {
    fn bytes<M: Share>(mask: &[M]) -> Result<Vec<u8>> {
        let odd = |m: &M| m.share() != 0.0 && m.share() != 1.0;
        match mask.iter().find(|m| odd(m)) {
            Some(m) => {
                Err(Error::Range { what: "a mask's value", expected: "0 or 1 for Kato's gradient", found: m.share() })
            }
            None => Ok(mask.iter().map(|m| u8::from(m.share() > 0.0)).collect()),
        }
    }
    let (camera, pose) = (&view.camera, &view.camera_from_object);
    let mask = match mask {
        Mask::Bytes(mask) => mask.to_vec(),
        Mask::Singles(mask) => bytes(mask)?,
        Mask::Doubles(mask) => bytes(mask)?,
    };
    let observed = ObservedMask::new(Rect::image(camera), &mask)?;
    if !with_gradient {
        let mut drawn = Silhouette::default();
        let points: Vec<Vector3<f64>> = view.vertices.iter().map(|v| pose.transform(v)).collect();
        drawn.draw(camera, &points, topology);
        let (both, union) = overlap(&mut drawn, &observed);
        return Ok((if union > 0.0 { -both / union } else { -1.0 }, None));
    }
    let Some(forth) = pose.rotation.transpose().try_inverse() else {
        return Err(Error::Range { what: "the determinant of camera_from_object", expected: "not 0", found: 0.0 });
    };
    let found = kato_gradient(camera, pose, view.vertices, topology, &observed);
    let mut matrix = Matrix3x4::zeros();
    for (v, gradient) in view.vertices.iter().zip(&found.vertices) {
        matrix += (forth * gradient) * RowVector4::new(v.x, v.y, v.z, 1.0);
    }
    Ok((found.loss, Some(ViewGradient { vertices: found.vertices, camera_from_object: matrix })))
}

/// How much of each pixel a mesh covers in each view: each picture is handed to `write` as runs of pixels that are covered,
/// and pixels that are covered in part.
pub fn silhouettes<T: Send>(
    views: Vec<(Placed, T)>,
    topology: &Topology,
    write: impl Fn(&Areas, T) + Sync,
    threads: Threads,
) {
    let one = |areas: &mut Areas, (view, target): (Placed, T)| {
        areas.draw(&view.camera, &view.camera_from_object, view.vertices, topology);
        write(areas, target);
    };
    if views.len() < 2 || threads == Threads::Own {
        let mut areas = Areas::default();
        views.into_iter().for_each(|view| one(&mut areas, view));
    } else {
        views.into_par_iter().for_each_init(Areas::default, one);
    }
}

/// The gradient of any loss from its slope over each pixel's share, `slope` (view, column, row) of the whole image.
pub fn silhouette_gradients(
    views: &[Placed],
    topology: &Topology,
    slope: impl Fn(usize, usize, usize) -> f64 + Sync,
    threads: Threads,
) -> Vec<ViewGradient> {
    for_all(threads, views, |areas: &mut Areas, k, view| {
        areas.draw(&view.camera, &view.camera_from_object, view.vertices, topology);
        let rect = areas.rect();
        let at = |column, row| slope(k, rect.x0 as usize + column, rect.y0 as usize + row);
        areas.gradient(&view.camera, &view.camera_from_object, view.vertices, at)
    })
}

/// One key point of a mesh: its vertices with their weights.
pub type Association = Vec<(u32, f64)>;

/// L_kps = Σ ‖ŷ − y‖² over the key points that were seen, with its gradient (paper, Eq. 2 and 8).
///
/// # Errors
/// [`Error::Range`] for a key point that was seen but lies on, behind or just before the image plane.
pub fn keypoint_losses(
    views: &[Placed],
    association: &[Association],
    observed: &[Vec<Option<Vector2<f64>>>],
    threads: Threads,
) -> Result<Vec<(f64, ViewGradient)>> {
    let found = for_all(threads, views, |_: &mut (), k, view| keypoint_loss(view, association, &observed[k]));
    found.into_iter().collect()
}

fn keypoint_loss(
    view: &Placed,
    association: &[Association],
    observed: &[Option<Vector2<f64>>],
) -> Result<(f64, ViewGradient)> {
    let (camera, pose) = (&view.camera, &view.camera_from_object);
    let back = pose.rotation.transpose();
    let mut loss = 0.0;
    let mut out =
        ViewGradient { vertices: vec![Vector3::zeros(); view.vertices.len()], camera_from_object: Matrix3x4::zeros() };
    for (weights, pixel) in association.iter().zip(observed) {
        let Some(pixel) = pixel else { continue };
        let in_object: Vector3<f64> = weights.iter().map(|&(v, w)| view.vertices[v as usize] * w).sum();
        let in_camera = pose.transform(&in_object);
        if in_camera.z.is_nan() || in_camera.z < NEAR_M {
            let expected = "at least 0.1 m for a key point that was seen";
            return Err(Error::Range { what: "the depth of a key point", expected, found: in_camera.z });
        }
        let gap = camera.project(&in_camera) - pixel;
        loss += gap.norm_squared();
        let pull = camera.projection_jacobian(&in_camera).transpose() * (2.0 * gap);
        out.camera_from_object += pull * RowVector4::new(in_object.x, in_object.y, in_object.z, 1.0);
        let pull = back * pull;
        weights.iter().for_each(|&(v, w)| out.vertices[v as usize] += pull * w);
    }
    Ok((loss, out))
}
