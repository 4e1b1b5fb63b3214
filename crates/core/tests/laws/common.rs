//! Meshes, cameras and views to test with.

use std::collections::HashMap;

use meshslam_core::camera::Camera;
use meshslam_core::lie::{Pose, exp_so3};
use meshslam_core::raster::{Rect, fill_mask};
use meshslam_core::view::{BorderPoint, KeypointObservation, View};
use nalgebra::{Matrix3, Vector2, Vector3, Vector6};
use proptest::prelude::*;

pub type Faces = Vec<[u32; 3]>;

/// A small generator (SplitMix64, Steele et al. 2014) for samples that need no shrinking.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn vector(&mut self, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.uniform(-size, size))
    }

    pub fn rotation(&mut self) -> Matrix3<f64> {
        exp_so3(&self.vector(1.8))
    }

    pub fn below(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }

    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.below(i + 1));
        }
    }
}

pub fn vector3(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-size..size).prop_map(Vector3::from)
}

/// Axis-angle vectors of every size up to π, many of them tiny or close to π.
pub fn axis_angle() -> impl Strategy<Value = Vector3<f64>> {
    let pi = std::f64::consts::PI;
    let angle = prop_oneof![
        Just(0.0),
        1e-14..1e-9,
        1e-6..1e-3,
        0.99e-4..1.01e-4,
        0.01..3.0,
        (pi - 1e-3)..(pi - 1e-5),
        (pi - 1e-9)..pi
    ];
    (vector3(1.0), angle).prop_filter_map("no direction", |(axis, angle)| axis.try_normalize(1e-3).map(|a| a * angle))
}

pub fn pose() -> impl Strategy<Value = Pose> {
    (axis_angle(), vector3(5.0)).prop_map(|(theta, translation)| Pose { rotation: exp_so3(&theta), translation })
}

pub fn camera() -> Camera {
    Camera { width: 160, height: 120, fx: 150.0, fy: 140.0, cx: 81.3, cy: 58.6, skew: 2.5 }
}

/// Central differences of a vector-valued function.
pub fn differences<const N: usize>(f: impl Fn(&[f64; N]) -> f64, step: f64) -> [f64; N] {
    std::array::from_fn(|i| {
        let (mut low, mut high) = ([0.0; N], [0.0; N]);
        (low[i], high[i]) = (-step, step);
        (f(&high) - f(&low)) / (2.0 * step)
    })
}

pub fn six(values: &[f64; 6]) -> Vector6<f64> {
    Vector6::from_column_slice(values)
}

pub fn signed(faces: &[[u32; 3]]) -> Vec<[i64; 3]> {
    faces.iter().map(|f| f.map(i64::from)).collect()
}

/// A unit sphere from the icosahedron, each face parted in four `depth` times; outward, symmetric in y.
pub fn icosphere(depth: usize) -> (Vec<Vector3<f64>>, Faces) {
    let golden = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut vertices = Vec::new();
    for a in [-1.0, 1.0] {
        for b in [-golden, golden] {
            vertices.extend([Vector3::new(0.0, a, b), Vector3::new(a, b, 0.0), Vector3::new(b, 0.0, a)]);
        }
    }
    let near = |i: usize, j: usize, v: &[Vector3<f64>]| ((v[i] - v[j]).norm() - 2.0).abs() < 1e-9;
    let mut faces = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(i, j, &vertices) && near(j, k, &vertices) && near(i, k, &vertices) {
                    let (a, b, c) = (vertices[i], vertices[j], vertices[k]);
                    let outward = (b - a).cross(&(c - a)).dot(&a) > 0.0;
                    faces.push(if outward { [i, j, k] } else { [i, k, j] }.map(|x| x as u32));
                }
            }
        }
    }
    for _ in 0..depth {
        faces = split(&mut vertices, &faces);
    }
    (vertices.into_iter().map(|v| v.normalize()).collect(), faces)
}

fn split(vertices: &mut Vec<Vector3<f64>>, faces: &[[u32; 3]]) -> Faces {
    let mut middle_of: HashMap<[u32; 2], u32> = HashMap::new();
    let mut out = Vec::new();
    for &[a, b, c] in faces {
        let mut middle = |i: u32, j: u32| {
            *middle_of.entry([i.min(j), i.max(j)]).or_insert_with(|| {
                let point = vertices[i as usize].normalize() + vertices[j as usize].normalize();
                vertices.push(point.normalize());
                vertices.len() as u32 - 1
            })
        };
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        out.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    out
}

/// Each vertex's mirror image in y → −y.
pub fn mirror(vertices: &[Vector3<f64>]) -> Vec<i64> {
    let image = |v: &Vector3<f64>| Vector3::new(v.x, -v.y, v.z);
    let find = |v: &Vector3<f64>| vertices.iter().position(|w| (w - image(v)).norm() < 1e-9).unwrap() as i64;
    vertices.iter().map(find).collect()
}

/// A closed box, outward.
pub fn cuboid(low: Vector3<f64>, high: Vector3<f64>) -> (Vec<Vector3<f64>>, Faces) {
    let corner = |i: usize| Vector3::from_fn(|axis, _| if i >> axis & 1 == 1 { high[axis] } else { low[axis] });
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    ((0..8).map(corner).collect(), faces)
}

/// Two meshes as one.
pub fn joined(a: (Vec<Vector3<f64>>, Faces), b: (Vec<Vector3<f64>>, Faces)) -> (Vec<Vector3<f64>>, Faces) {
    let shift = a.0.len() as u32;
    let faces = a.1.into_iter().chain(b.1.into_iter().map(|f| f.map(|i| i + shift))).collect();
    (a.0.into_iter().chain(b.0).collect(), faces)
}

pub fn placed(pose: &Pose, points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    points.iter().map(|p| pose.transform(p)).collect()
}

pub fn drawn(camera: &Camera, points_in_camera: &[Vector3<f64>], faces: &[[u32; 3]]) -> Vec<u8> {
    let rect = Rect::image(camera);
    let mut mask = vec![0; rect.area()];
    fill_mask(camera, points_in_camera, faces, &rect, &mut mask);
    mask
}

/// Convex hull, in the order of increasing angle (Andrew's monotone chain).
pub fn convex_hull(points: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let chain = |items: &mut dyn Iterator<Item = Vector2<f64>>| {
        let mut out: Vec<Vector2<f64>> = Vec::new();
        for p in items {
            while out.len() > 1 && (out[out.len() - 1] - out[out.len() - 2]).perp(&(p - out[out.len() - 1])) <= 0.0 {
                out.pop();
            }
            out.push(p);
        }
        out.pop();
        out
    };
    let mut lower = chain(&mut sorted.iter().copied());
    lower.extend(chain(&mut sorted.iter().rev().copied()));
    lower
}

pub fn polygon_edges(polygon: &[Vector2<f64>]) -> impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + '_ {
    (0..polygon.len()).map(|i| (polygon[i], polygon[(i + 1) % polygon.len()]))
}

pub fn perimeter(polygon: &[Vector2<f64>]) -> f64 {
    polygon_edges(polygon).map(|(a, b)| (b - a).norm()).sum()
}

/// Distance of a point to a convex polygon's border, negative inside.
pub fn signed_distance(hull: &[Vector2<f64>], point: &Vector2<f64>) -> f64 {
    let (mut nearest, mut inside) = (f64::INFINITY, true);
    for (a, b) in polygon_edges(hull) {
        let along = b - a;
        let t = ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        nearest = nearest.min((point - a - along * t).norm());
        inside &= along.perp(&(point - a)) >= 0.0;
    }
    if inside { -nearest } else { nearest }
}

/// What an ideal camera sees of a convex mesh: exact distances, exact border points every 2 px or less.
pub fn ideal_view(
    camera: &Camera,
    world_from_camera: Pose,
    points_in_world: &[Vector3<f64>],
    keypoints: &[Vector3<f64>],
) -> View {
    let camera_from_world = world_from_camera.inverse();
    let pixel = |p: &Vector3<f64>| camera.project(&camera_from_world.transform(p));
    let hull = convex_hull(&points_in_world.iter().map(pixel).collect::<Vec<_>>());
    let tight = Rect::around(hull.iter().copied());
    let roomy = Rect { x0: tight.x0 - 12, y0: tight.y0 - 12, width: tight.width + 24, height: tight.height + 24 };
    let crop = roomy.intersection(&Rect::image(camera));
    let at =
        |i: usize| Vector2::new((i % crop.width) as f64 + crop.x0 as f64, (i / crop.width) as f64 + crop.y0 as f64);
    let border = polygon_edges(&hull).flat_map(|(a, b)| {
        let count = ((b - a).norm() / 2.0).ceil().max(1.0) as usize;
        (0..count).map(move |k| BorderPoint {
            pixel: a + (b - a) * ((k as f64 + 0.5) / count as f64),
            length: (b - a).norm() / count as f64,
            own: true,
        })
    });
    let seen = keypoints.iter().enumerate();
    View {
        camera: *camera,
        world_from_camera,
        time_s: 0.0,
        crop,
        distance_px: (0..crop.area()).map(|i| signed_distance(&hull, &at(i)) as f32).collect(),
        cut: vec![0; crop.area()].into(),
        hidden: vec![0; crop.area()].into(),
        border: border.collect(),
        area_px: 0,
        border_length_px: 0.0,
        surface_sigma_px: 0.0,
        keypoints: seen.map(|(index, p)| KeypointObservation { index, pixel: pixel(p), sigma_px: 1.0 }).collect(),
    }
    .checked(keypoints.len())
    .unwrap()
}

/// A camera at `from` that looks at `target`, its y axis down in a world with z up.
pub fn looking(from: Vector3<f64>, target: Vector3<f64>) -> Pose {
    let forward = (target - from).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    Pose { rotation: Matrix3::from_columns(&[right, forward.cross(&right), forward]), translation: from }
}
