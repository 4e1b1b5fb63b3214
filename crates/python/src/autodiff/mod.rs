//! `batch` of the core: losses of many views with their gradients, for frameworks of automatic differentiation.

mod inputs;

use meshslam_core::areas::{Areas, ViewGradient};
use meshslam_core::batch::{self, Mask, Method, Threads};
use nalgebra::Vector2;
use numpy::ndarray::ArrayD;
use numpy::{IntoPyArray, PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Floats2, check_shape, to_python};
use crate::gradients::pool;
use inputs::{Broadcast, Inputs, Real, Reals, Scene, broadcast, finite};

/// Run on so many threads (0: all).
fn on_threads<R: Send>(threads: usize, work: impl FnOnce(Threads) -> R + Send) -> PyResult<R> {
    if threads == 1 {
        return Ok(work(Threads::Own));
    }
    Ok(pool(threads)?.install(|| work(Threads::Pool)))
}

fn array<'py, T: Real>(py: Python<'py>, shape: Vec<usize>, values: Vec<T>) -> PyResult<Bound<'py, PyAny>> {
    let made = ArrayD::from_shape_vec(shape, values).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(made.into_pyarray(py).into_any())
}

/// Gradients (…, V, 3) and (…, 4, 4), of the vertices' own type; the matrix's last row moves nothing.
fn gradients<'py>(
    py: Python<'py>,
    single: bool,
    batch: &[usize],
    vertex_count: usize,
    found: &[ViewGradient],
) -> PyResult<[Bound<'py, PyAny>; 2]> {
    fn rows<'py, T: Real>(
        py: Python<'py>,
        batch: &[usize],
        vertex_count: usize,
        found: &[ViewGradient],
    ) -> PyResult<[Bound<'py, PyAny>; 2]> {
        let mut vertices = Vec::with_capacity(found.len() * vertex_count * 3);
        let mut matrices = Vec::with_capacity(found.len() * 16);
        for gradient in found {
            vertices.extend(gradient.vertices.iter().flat_map(|v| [v.x, v.y, v.z]).map(T::of));
            let matrix = &gradient.camera_from_object;
            let entry = |k: usize| if k < 12 { matrix[(k / 4, k % 4)] } else { 0.0 };
            matrices.extend((0..16).map(entry).map(T::of));
        }
        let shape = |last: [usize; 2]| [batch, last.as_slice()].concat();
        Ok([array(py, shape([vertex_count, 3]), vertices)?, array(py, shape([4, 4]), matrices)?])
    }
    if single { rows::<f32>(py, batch, vertex_count, found) } else { rows::<f64>(py, batch, vertex_count, found) }
}

fn scalars<'py>(py: Python<'py>, single: bool, batch: &[usize], values: &[f64]) -> PyResult<Bound<'py, PyAny>> {
    if single {
        return array(py, batch.to_vec(), values.iter().map(|&v| f32::of(v)).collect());
    }
    array(py, batch.to_vec(), values.to_vec())
}

/// Observed masks (…, h, w).
#[derive(FromPyObject)]
pub enum Masks<'py> {
    Bytes(PyReadonlyArrayDyn<'py, u8>),
    Real(Reals<'py>),
}

impl Masks<'_> {
    fn shape(&self) -> &[usize] {
        match self {
            Self::Bytes(array) => array.shape(),
            Self::Real(array) => array.shape(),
        }
    }

    /// The masks one by one; arrays that are not contiguous are copied first.
    fn with<R>(&self, area: usize, indices: &[usize], go: impl FnOnce(Vec<Mask>) -> R) -> R {
        fn parts<'a, T>(
            values: &'a [T],
            area: usize,
            indices: &[usize],
            of: impl Fn(&'a [T]) -> Mask<'a>,
        ) -> Vec<Mask<'a>> {
            indices.iter().map(|&k| of(&values[k * area..(k + 1) * area])).collect()
        }
        fn flat<T: numpy::Element + Copy>(array: &PyReadonlyArrayDyn<T>) -> Vec<T> {
            array.as_array().iter().copied().collect()
        }
        match self {
            Self::Bytes(array) => match array.as_slice() {
                Ok(values) => go(parts(values, area, indices, Mask::Bytes)),
                Err(_) => go(parts(&flat(array), area, indices, Mask::Bytes)),
            },
            Self::Real(Reals::Single(array)) => match array.as_slice() {
                Ok(values) => go(parts(values, area, indices, Mask::Singles)),
                Err(_) => go(parts(&flat(array), area, indices, Mask::Singles)),
            },
            Self::Real(Reals::Double(array)) => match array.as_slice() {
                Ok(values) => go(parts(values, area, indices, Mask::Doubles)),
                Err(_) => go(parts(&flat(array), area, indices, Mask::Doubles)),
            },
        }
    }
}

type Losses<'py> = (Bound<'py, PyAny>, Option<Bound<'py, PyAny>>, Option<Bound<'py, PyAny>>);

/// −IoU of each view, with its gradients if they are asked for.
#[pyfunction]
pub fn mask_iou_losses<'py>(
    py: Python<'py>,
    inputs: Inputs<'py>,
    masks: Masks,
    method: &str,
    with_gradient: bool,
    threads: usize,
) -> PyResult<Losses<'py>> {
    let method = match method {
        "exact" => Method::Exact,
        "kato" => Method::Kato,
        other => return Err(PyValueError::new_err(format!("gradient is 'exact' or 'kato', found {other:?}"))),
    };
    let shape = masks.shape();
    let [before @ .., height, width] = shape else {
        return Err(PyValueError::new_err(format!("masks must have shape (..., height, width), found {shape:?}")));
    };
    let (scene, batch) = Scene::new(&inputs, (*width, *height), before)?;
    let views = scene.views(&batch);
    let found = masks.with(width * height, &batch.indices[3], |masks| {
        py.detach(|| {
            on_threads(threads, |on| batch::mask_iou(&views, &scene.topology, &masks, method, with_gradient, on))
        })
    })?;
    let (losses, found): (Vec<f64>, Vec<Option<ViewGradient>>) = found.map_err(to_python)?.into_iter().unzip();
    let single = inputs.is_single();
    let losses = scalars(py, single, &batch.shape, &losses)?;
    if !with_gradient {
        return Ok((losses, None, None));
    }
    let found: Vec<ViewGradient> = found.into_iter().flatten().collect();
    let [of_vertices, of_poses] = gradients(py, single, &batch.shape, scene.vertex_count, &found)?;
    Ok((losses, Some(of_vertices), Some(of_poses)))
}

/// The shape of the batch that inputs with these leading dimensions make.
#[pyfunction]
pub fn broadcast_shape(shapes: Vec<Vec<usize>>) -> PyResult<Vec<usize>> {
    let shapes: Vec<&[usize]> = shapes.iter().map(Vec::as_slice).collect();
    Ok(broadcast(&shapes)?.shape)
}

/// Pictures to draw into, zeros (…, h, w).
#[derive(FromPyObject)]
pub enum Pictures<'py> {
    Double(PyReadwriteArrayDyn<'py, f64>),
    Single(PyReadwriteArrayDyn<'py, f32>),
}

/// Draw the share of each pixel that the mesh covers.
#[pyfunction]
pub fn silhouettes<'py>(py: Python<'py>, inputs: Inputs<'py>, pictures: Pictures, threads: usize) -> PyResult<()> {
    fn draw<T: Real>(py: Python, scene: &Scene, batch: &Broadcast, out: &mut [T], threads: usize) -> PyResult<()> {
        let (width, height) = scene.size;
        let views = scene.views(batch);
        let targets = views.into_iter().zip(out.chunks_exact_mut(width * height)).collect();
        py.detach(|| {
            on_threads(threads, |on| {
                batch::silhouettes(targets, &scene.topology, |areas, picture| write(areas, width, picture), on);
            })
        })
    }
    let shape = match &pictures {
        Pictures::Double(array) => array.shape().to_vec(),
        Pictures::Single(array) => array.shape().to_vec(),
    };
    let [before @ .., height, width] = shape.as_slice() else {
        return Err(PyValueError::new_err("pictures have shape (..., height, width)"));
    };
    let (scene, batch) = Scene::new(&inputs, (*width, *height), &[])?;
    check_shape("pictures", before, &batch.shape.iter().map(|&n| Some(n)).collect::<Vec<_>>())?;
    let whole = |_| PyValueError::new_err("pictures must be contiguous");
    match pictures {
        Pictures::Double(mut array) => draw(py, &scene, &batch, array.as_slice_mut().map_err(whole)?, threads),
        Pictures::Single(mut array) => draw(py, &scene, &batch, array.as_slice_mut().map_err(whole)?, threads),
    }
}

fn write<T: Real>(areas: &Areas, width: usize, picture: &mut [T]) {
    let rect = areas.rect();
    let at = |row: u32, column: u32| (rect.y0 as usize + row as usize) * width + rect.x0 as usize + column as usize;
    for &(row, from, to) in areas.spans() {
        picture[at(row, from)..at(row, from) + (to - from) as usize].fill(T::of(1.0));
    }
    for cell in areas.touched() {
        picture[at(cell.row, cell.column)] = T::of(cell.share);
    }
}

/// Gradients (…, V, 3) and (…, 4, 4) of a loss from its slopes (…, h, w) over the shares of `silhouettes`.
#[pyfunction]
pub fn silhouette_gradients<'py>(
    py: Python<'py>,
    inputs: Inputs<'py>,
    slopes: Reals,
    threads: usize,
) -> PyResult<[Bound<'py, PyAny>; 2]> {
    let shape = slopes.shape();
    let [before @ .., height, width] = shape else {
        return Err(PyValueError::new_err(format!("slopes must have shape (..., height, width), found {shape:?}")));
    };
    let (scene, batch) = Scene::new(&inputs, (*width, *height), before)?;
    let views = scene.views(&batch);
    let (width, area, which) = (*width, width * height, &batch.indices[3]);
    let run = |slope: &(dyn Fn(usize) -> f64 + Sync)| {
        let at = |view: usize, column: usize, row: usize| slope(which[view] * area + row * width + column);
        py.detach(|| on_threads(threads, |on| batch::silhouette_gradients(&views, &scene.topology, at, on)))
    };
    let found = match &slopes {
        Reals::Double(array) => match array.as_slice() {
            Ok(values) => run(&|k| values[k]),
            Err(_) => {
                let values: Vec<f64> = array.as_array().iter().copied().collect();
                run(&|k| values[k])
            }
        },
        Reals::Single(array) => match array.as_slice() {
            Ok(values) => run(&|k| f64::from(values[k])),
            Err(_) => {
                let values: Vec<f32> = array.as_array().iter().copied().collect();
                run(&|k| f64::from(values[k]))
            }
        },
    }?;
    gradients(py, inputs.is_single(), &batch.shape, scene.vertex_count, &found)
}

/// L_kps of each view with its gradients; `association` (V, K), `observed` (…, K, 2), `visible` (…, K).
#[pyfunction]
pub fn keypoint_losses<'py>(
    py: Python<'py>,
    inputs: Inputs<'py>,
    association: Floats2,
    observed: Reals,
    visible: PyReadonlyArrayDyn<bool>,
    threads: usize,
) -> PyResult<Losses<'py>> {
    let count = association.shape()[1];
    let (of_points, of_visible) = (observed.shape(), visible.shape());
    let ([before @ .., k, 2], [visible_before @ .., j]) = (of_points, of_visible) else {
        let wanted = "observed must have shape (..., K, 2) and visible (..., K)";
        return Err(PyValueError::new_err(format!("{wanted}, found {of_points:?} and {of_visible:?}")));
    };
    if *k != count || *j != count {
        let found = format!("found {k} in observed and {j} in visible");
        return Err(PyValueError::new_err(format!("association has {count} key points, {found}")));
    }
    let pair = broadcast(&[before, visible_before])?;
    let (scene, batch) = Scene::new(&inputs, (1, 1), &pair.shape)?;
    check_shape("association", association.shape(), &[Some(scene.vertex_count), None])?;
    let weights: Vec<f64> = association.as_array().iter().copied().collect();
    finite("association", &weights)?;
    let of_point = |k: usize| {
        let entries = (0..scene.vertex_count).map(|v| (v as u32, weights[v * count + k]));
        entries.filter(|(_, w)| *w != 0.0).collect::<batch::Association>()
    };
    let association: Vec<batch::Association> = (0..count).map(of_point).collect();
    let (pixels, seen) = (observed.flat(), visible.as_array().iter().copied().collect::<Vec<bool>>());
    let mut each = Vec::with_capacity(batch.indices[3].len());
    for &number in &batch.indices[3] {
        let (p, s) = (pair.indices[0][number] * count, pair.indices[1][number] * count);
        let mut points = Vec::with_capacity(count);
        for k in 0..count {
            let pixel = Vector2::new(pixels[2 * (p + k)], pixels[2 * (p + k) + 1]);
            if seen[s + k] {
                finite("observed, where visible,", pixel.as_slice())?;
            }
            points.push(seen[s + k].then_some(pixel));
        }
        each.push(points);
    }
    let views = scene.views(&batch);
    let found = py.detach(|| on_threads(threads, |on| batch::keypoint_losses(&views, &association, &each, on)))?;
    let (losses, found): (Vec<f64>, Vec<ViewGradient>) = found.map_err(to_python)?.into_iter().unzip();
    let single = inputs.is_single();
    let [of_vertices, of_poses] = gradients(py, single, &batch.shape, scene.vertex_count, &found)?;
    Ok((scalars(py, single, &batch.shape, &losses)?, Some(of_vertices), Some(of_poses)))
}

/// Σ weight · value over the views that share an input, in the order of the views: values (…, r, c), weights (…), to the input's own
/// leading shape.
#[pyfunction]
pub fn weighted_sums<'py>(
    py: Python<'py>,
    values: Reals,
    weights: Option<Reals>,
    leading: Vec<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    fn sums<T: Real>(values: &[T], size: usize, targets: &[usize], weights: Option<&[f64]>, count: usize) -> Vec<T> {
        let mut out = vec![0.0; count * size];
        for (view, &target) in targets.iter().enumerate() {
            let weight = weights.map_or(1.0, |w| w[view]);
            let row = &mut out[target * size..(target + 1) * size];
            for (sum, &value) in row.iter_mut().zip(&values[view * size..(view + 1) * size]) {
                *sum += weight * value.get();
            }
        }
        out.into_iter().map(T::of).collect()
    }
    let shape = values.shape().to_vec();
    let [batch @ .., rows, columns] = shape.as_slice() else {
        return Err(PyValueError::new_err(format!("values must have shape (..., r, c), found {shape:?}")));
    };
    let found = broadcast(&[&leading, batch])?;
    check_shape("values", batch, &found.shape.iter().map(|&n| Some(n)).collect::<Vec<_>>())?;
    if let Some(weights) = &weights {
        check_shape("weights", weights.shape(), &batch.iter().map(|&n| Some(n)).collect::<Vec<_>>())?;
    }
    let weights = weights.map(|w| w.flat());
    let (size, count) = (rows * columns, leading.iter().product());
    let made = [leading.as_slice(), &[*rows, *columns]].concat();
    let (targets, weights) = (&found.indices[0], weights.as_deref());
    match &values {
        Reals::Double(array_in) => match array_in.as_slice() {
            Ok(flat) => array(py, made, sums(flat, size, targets, weights, count)),
            Err(_) => array(py, made, sums(&values.flat(), size, targets, weights, count)),
        },
        Reals::Single(array_in) => {
            let flat: Vec<f32> = array_in.as_array().iter().copied().collect();
            array(py, made, sums(&flat, size, targets, weights, count))
        }
    }
}
