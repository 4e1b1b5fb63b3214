//! `view` of the core.

use std::sync::Arc;

use meshslam_core::raster::Rect;
use meshslam_core::view::{BorderPoint, KeypointObservation, View as CoreView};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Floats1, Floats2, check_shape, pixels, pose, to_python};
use crate::named::Camera;

/// What one frame shows of one object.
#[pyclass(frozen)]
pub struct View {
    pub inner: CoreView,
}

pub fn core_views(views: &[Py<View>]) -> Vec<&CoreView> {
    views.iter().map(|v| &v.get().inner).collect()
}

#[pymethods]
impl View {
    #[new]
    #[allow(clippy::too_many_arguments)] // the fields of a view
    fn new(
        camera: Camera,
        world_from_camera: Floats2,
        time_s: f64,
        origin: (i64, i64),
        distance_px: PyReadonlyArray2<f32>,
        cut: PyReadonlyArray2<u8>,
        hidden: PyReadonlyArray2<u8>,
        border: Floats2,
        border_length: Floats1,
        border_own: PyReadonlyArray1<bool>,
        keypoint_index: PyReadonlyArray1<i64>,
        keypoint_pixels: Floats2,
        keypoint_sigma_px: Floats1,
        keypoint_count: usize,
    ) -> PyResult<Self> {
        let (height, width) = (distance_px.shape()[0], distance_px.shape()[1]);
        check_shape("cut", cut.shape(), &[Some(height), Some(width)])?;
        check_shape("hidden", hidden.shape(), &[Some(height), Some(width)])?;
        let border = pixels("border", &border)?;
        check_shape("border_length", border_length.shape(), &[Some(border.len())])?;
        check_shape("border_own", border_own.shape(), &[Some(border.len())])?;
        let keypoints = keypoints(&keypoint_index, &keypoint_pixels, &keypoint_sigma_px)?;
        let (length, own) = (border_length.as_array(), border_own.as_array());
        let border = border
            .into_iter()
            .enumerate()
            .map(|(i, pixel)| BorderPoint { pixel, length: length[i], own: own[i] })
            .collect();
        let inner = CoreView {
            camera: camera.0,
            world_from_camera: pose("world_from_camera", &world_from_camera)?,
            time_s,
            crop: Rect { x0: origin.0, y0: origin.1, width, height },
            distance_px: picture(&distance_px),
            cut: picture(&cut),
            hidden: picture(&hidden),
            border,
            area_px: 0,
            border_length_px: 0.0,
            surface_sigma_px: 0.0,
            keypoints,
        };
        Ok(Self { inner: inner.checked(keypoint_count).map_err(to_python)? })
    }

    /// First pixel (x, y) of the crop.
    #[getter]
    fn origin(&self) -> (i64, i64) {
        (self.inner.crop.x0, self.inner.crop.y0)
    }

    #[getter]
    fn surface_sigma_px(&self) -> f64 {
        self.inner.surface_sigma_px
    }

    /// Signed distance (h, w) to the observed border, and where this is not the object's own, and what is hidden.
    fn pictures<'py>(&self, py: Python<'py>) -> PyResult<Pictures<'py>> {
        let View { inner } = self;
        Ok((whole(py, inner, &inner.distance_px)?, whole(py, inner, &inner.cut)?, whole(py, inner, &inner.hidden)?))
    }

    /// Border points (n, 4): pixel, length, whether it is the object's own.
    fn border<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let border = &self.inner.border;
        let value = |(i, k): (usize, usize)| match k {
            0 => border[i].pixel.x,
            1 => border[i].pixel.y,
            2 => border[i].length,
            _ => f64::from(u8::from(border[i].own)),
        };
        Array2::from_shape_fn((border.len(), 4), value).into_pyarray(py)
    }

    /// Key points (k, 4): number, pixel, sigma.
    fn keypoints<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let keypoints = &self.inner.keypoints;
        let value = |(i, k): (usize, usize)| match k {
            0 => keypoints[i].index as f64,
            1 => keypoints[i].pixel.x,
            2 => keypoints[i].pixel.y,
            _ => keypoints[i].sigma_px,
        };
        Array2::from_shape_fn((keypoints.len(), 4), value).into_pyarray(py)
    }

    /// The same view, where the true surface may lie this far from any mesh.
    fn with_surface_sigma(&self, sigma_px: f64) -> PyResult<Self> {
        check_sigma("surface", sigma_px)?;
        Ok(Self { inner: CoreView { surface_sigma_px: sigma_px, ..self.inner.clone() } })
    }

    /// The same view, where each key point's pixel sigma grows by this one, in variance.
    fn with_keypoint_sigma(&self, sigma_px: f64) -> PyResult<Self> {
        check_sigma("key point", sigma_px)?;
        let mut inner = self.inner.clone();
        for keypoint in &mut inner.keypoints {
            keypoint.sigma_px = keypoint.sigma_px.hypot(sigma_px);
        }
        Ok(Self { inner })
    }
}

fn check_sigma(whose: &str, sigma_px: f64) -> PyResult<()> {
    if sigma_px.is_finite() && sigma_px >= 0.0 {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("a {whose}'s sigma must not be negative, found {sigma_px}")))
}

/// Distances, and two masks.
type Pictures<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<u8>>, Bound<'py, PyArray2<u8>>);

fn whole<'py, T: numpy::Element + Copy>(
    py: Python<'py>,
    view: &CoreView,
    pixels: &[T],
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let shape = (view.crop.height, view.crop.width);
    let picture = Array2::from_shape_vec(shape, pixels.to_vec()).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(picture.into_pyarray(py))
}

/// Pixels row by row.
fn picture<T: numpy::Element + Copy>(pixels: &PyReadonlyArray2<T>) -> Arc<[T]> {
    match pixels.as_slice() {
        Ok(contiguous) => contiguous.into(),
        Err(_) => pixels.as_array().iter().copied().collect(),
    }
}

fn keypoints(
    index: &PyReadonlyArray1<i64>,
    pixel_array: &Floats2,
    sigma_px: &Floats1,
) -> PyResult<Vec<KeypointObservation>> {
    let seen = pixels("keypoint_pixels", pixel_array)?;
    check_shape("keypoint_index", index.shape(), &[Some(seen.len())])?;
    check_shape("keypoint_sigma_px", sigma_px.shape(), &[Some(seen.len())])?;
    let (index, sigma) = (index.as_array(), sigma_px.as_array());
    seen.into_iter()
        .enumerate()
        .map(|(i, pixel)| {
            let number = usize::try_from(index[i]).map_err(|_| {
                pyo3::exceptions::PyIndexError::new_err(format!("key point index {} is negative", index[i]))
            })?;
            Ok(KeypointObservation { index: number, pixel, sigma_px: sigma[i] })
        })
        .collect()
}
