use meshslam_core::camera::Camera;
use meshslam_core::lie::Pose;
use meshslam_core::raster::{NEAR_M, Raster, Rect, fill_mask, for_each_span, for_each_triangle};
use nalgebra::{Vector2, Vector3};

use crate::common::{Faces, Random, camera, cuboid, drawn, icosphere, placed};

/// A camera whose pixels are the points' x and y at depth 1, exactly.
fn plain(width: usize, height: usize) -> Camera {
    Camera { width, height, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0, skew: 0.0 }
}

/// How often each pixel is drawn.
fn counts(camera: &Camera, points: &[Vector3<f64>], faces: &[[u32; 3]], rect: &Rect) -> Vec<u32> {
    let mut out = vec![0; rect.area()];
    for_each_triangle(camera, points, faces, |_, corners| {
        for_each_span(corners, rect, |row, start, end| {
            out[row * rect.width + start..row * rect.width + end].iter_mut().for_each(|n| *n += 1);
        });
    });
    out
}

/// A grid over the image and beyond, its vertices moved by up to `jitter` and rounded to `1 / snap`, its diagonals random.
fn triangulation(
    random: &mut Random,
    jitter: f64,
    snap: f64,
    cell: f64,
    depth: impl Fn(f64, f64) -> f64,
) -> (Vec<Vector3<f64>>, Faces) {
    let n = 9;
    let mut points = Vec::new();
    for i in 0..n * n {
        let moved = |k: usize, r: &mut Random| (k as f64 * cell - cell + r.uniform(-jitter, jitter)) * snap;
        let (x, y) = (moved(i % n, random).round() / snap, moved(i / n, random).round() / snap);
        points.push(Vector3::new(x, y, 1.0) * depth(x, y));
    }
    let mut faces = Vec::new();
    for i in 0..(n - 1) * (n - 1) {
        let a = ((i / (n - 1)) * n + i % (n - 1)) as u32;
        let (b, c, d) = (a + 1, a + n as u32, a + n as u32 + 1);
        let mut both = if random.below(2) == 0 { [[a, b, d], [a, d, c]] } else { [[a, b, c], [b, d, c]] };
        for face in &mut both {
            face.rotate_left(random.below(3));
            if random.below(2) == 0 {
                face.swap(0, 1);
            }
        }
        faces.extend(both);
    }
    (points, faces)
}

#[test]
fn a_triangulation_draws_every_pixel_once() {
    let mut random = Random(1);
    for round in 0..200 {
        let snap = [1.0, 2.0, 4.0, 1e9][round % 4]; // on pixel centres, between them, anywhere
        let (points, faces) = triangulation(&mut random, 1.4, snap, 7.0, |_, _| 1.0);
        let camera = plain(40, 41);
        let found = counts(&camera, &points, &faces, &Rect::image(&camera));
        assert!(found.iter().all(|n| *n == 1), "round {round}");
    }
}

#[test]
fn a_road_of_many_faces_is_drawn_once_up_to_the_near_plane() {
    let (mut random, camera) = (Random(2), camera());
    for _ in 0..100 {
        // a plane that runs under the camera and far behind it
        let normal = Vector3::new(random.uniform(-0.3, 0.3), 1.0, random.uniform(-0.3, 0.1)).normalize();
        let across = normal.cross(&Vector3::z()).normalize();
        let along = across.cross(&normal);
        let height = random.uniform(0.05, 0.5);
        let (flat, faces) = triangulation(&mut random, 1.5, 1e9, 7.0, |_, _| 1.0);
        let place = |p: &Vector3<f64>| normal * height + across * (p.x - 20.0) * 0.2 + along * (p.y - 20.0) * 0.2;
        let points: Vec<Vector3<f64>> = flat.iter().map(place).collect();
        for (i, n) in counts(&camera, &points, &faces, &Rect::image(&camera)).iter().enumerate() {
            let y = ((i / camera.width) as f64 - camera.cy) / camera.fy;
            let ray = Vector3::new(((i % camera.width) as f64 - camera.cx - camera.skew * y) / camera.fx, y, 1.0);
            let depth = height / normal.dot(&ray);
            let hit = ray * depth - normal * height;
            let on_road = hit.dot(&across).abs().max(hit.dot(&along).abs()) < 3.9;
            if depth < NEAR_M {
                assert_eq!(*n, 0, "pixel {i}");
            } else if on_road && depth > NEAR_M + 1e-9 {
                assert_eq!(*n, 1, "pixel {i} at {depth} m");
            }
            assert!(*n <= 1);
        }
    }
}

#[test]
fn the_top_left_rule_decides_on_edges() {
    let square = |x: f64| [[x, 2.0, 1.0], [x + 3.0, 2.0, 1.0], [x + 3.0, 5.0, 1.0], [x, 5.0, 1.0]].map(Vector3::from);
    let camera = plain(12, 9);
    let found = drawn(&camera, &square(4.0), &[[0, 1, 2], [0, 2, 3]]);
    for (i, &m) in found.iter().enumerate() {
        let (x, y) = (i % 12, i / 12);
        assert_eq!(m == 1, (4..7).contains(&x) && (2..5).contains(&y), "pixel {x} {y}");
    }
}

#[test]
fn a_closed_mesh_is_entered_as_often_as_it_is_left() {
    let (sphere, faces) = icosphere(2);
    let mut random = Random(4);
    let camera = camera();
    for _ in 0..20 {
        let pose = Pose { rotation: random.rotation(), translation: Vector3::new(0.0, 0.0, 4.0) + random.vector(1.0) };
        let lumps: Vec<Vector3<f64>> = sphere.iter().map(|v| v * random.uniform(0.6, 1.2)).collect();
        let mut balance = vec![0; camera.width * camera.height];
        for_each_triangle(&camera, &placed(&pose, &lumps), &faces, |_, corners| {
            let [a, b, c] = corners.map(|(p, _)| p);
            let side = if (b - a).perp(&(c - a)) > 0.0 { 1 } else { -1 };
            for_each_span(corners, &Rect::image(&camera), |row, start, end| {
                balance[row * camera.width + start..row * camera.width + end].iter_mut().for_each(|n| *n += side);
            });
        });
        assert!(balance.iter().all(|n| *n == 0));
    }
}

#[test]
fn pixels_are_those_whose_centre_lies_inside() {
    let mut random = Random(6);
    for _ in 0..300 {
        let corners: [Vector3<f64>; 3] =
            std::array::from_fn(|_| Vector3::new(random.uniform(-10.0, 40.0), random.uniform(-10.0, 40.0), 1.0));
        let found = drawn(&plain(30, 30), &corners, &[[0, 1, 2]]);
        let [a, b, c] = corners.map(|p| p.xy());
        for (i, &m) in found.iter().enumerate() {
            let p = Vector2::new((i % 30) as f64, (i / 30) as f64);
            let sides = [(b - a).perp(&(p - a)), (c - b).perp(&(p - b)), (a - c).perp(&(p - c))];
            let inside = sides.iter().all(|s| *s > 0.0) || sides.iter().all(|s| *s < 0.0);
            assert_eq!(m == 1, inside, "{p}");
        }
    }
}

#[test]
fn a_rectangle_is_a_window_of_the_image() {
    let (sphere, faces) = icosphere(2);
    let points: Vec<Vector3<f64>> = sphere.iter().map(|v| v + Vector3::new(0.3, -0.2, 3.0)).collect();
    let camera = camera();
    let whole = drawn(&camera, &points, &faces);
    let rect = Rect { x0: 60, y0: -7, width: 45, height: 90 };
    let mut part = vec![0; rect.area()];
    fill_mask(&camera, &points, &faces, &rect, &mut part);
    for (i, &m) in part.iter().enumerate() {
        let (x, y) = (60 + (i % 45) as i64, (i / 45) as i64 - 7);
        if let Some(at) = Rect::image(&camera).index(x, y) {
            assert_eq!(m, whole[at]);
        }
    }
}

#[test]
fn mask_and_depth_know_no_order_of_faces() {
    let (sphere, faces) = icosphere(2);
    let (mut random, camera) = (Random(8), camera());
    let points: Vec<Vector3<f64>> =
        sphere.iter().map(|v| v * random.uniform(0.5, 1.2) + Vector3::new(0.1, 0.2, 3.0)).collect();
    let mut reference = Raster::new(Rect::image(&camera));
    reference.draw(&camera, &points, &faces, 0);
    for _ in 0..5 {
        let mut order: Vec<usize> = (0..faces.len()).collect();
        random.shuffle(&mut order);
        let shuffled: Faces = order
            .iter()
            .map(|&i| {
                let mut f = faces[i];
                f.rotate_left(random.below(3));
                f
            })
            .collect();
        assert_eq!(drawn(&camera, &points, &shuffled), drawn(&camera, &points, &faces));
        let mut raster = Raster::new(Rect::image(&camera));
        raster.draw(&camera, &points, &shuffled, 0);
        for i in 0..raster.face.len() {
            let name = if raster.face[i] < 0 { -1 } else { order[raster.face[i] as usize] as i32 };
            assert_eq!(name, reference.face[i]);
            assert!((raster.inverse_depth[i] - reference.inverse_depth[i]).abs() < 1e-12);
        }
    }
}

#[test]
fn depth_is_that_of_the_plane_through_the_face() {
    let (mut random, camera) = (Random(9), camera());
    for _ in 0..50 {
        let corners: [Vector3<f64>; 3] = std::array::from_fn(|_| random.vector(2.0) + Vector3::new(0.0, 0.0, 5.0));
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let mut raster = Raster::new(Rect::image(&camera));
        raster.draw(&camera, &corners, &[[0, 1, 2]], 3);
        for (i, w) in raster.inverse_depth.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            let y = ((i / camera.width) as f64 - camera.cy) / camera.fy;
            let ray = Vector3::new(((i % camera.width) as f64 - camera.cx - camera.skew * y) / camera.fx, y, 1.0);
            let depth = normal.dot(&corners[0]) / normal.dot(&ray);
            assert!((1.0 / w - depth).abs() < 1e-6 * depth, "{} {depth}", 1.0 / w);
            assert_eq!((raster.face[i], raster.object[i]), (0, 3));
        }
    }
}

#[test]
fn the_nearest_object_is_seen_whatever_comes_first() {
    let camera = camera();
    let frames = [[-0.2, 0.3, -0.2, 0.1, 2.0], [-0.8, 0.5, -0.3, 0.6, 3.5], [-1.8, 1.2, -1.0, 0.8, 6.0]];
    let meshes = frames.map(|[x0, x1, y0, y1, z]| cuboid(Vector3::new(x0, y0, z), Vector3::new(x1, y1, z + 1.0)));
    let draw = |order: &[usize]| {
        let mut raster = Raster::new(Rect::image(&camera));
        order.iter().for_each(|&k| raster.draw(&camera, &meshes[k].0, &meshes[k].1, k as i32));
        raster
    };
    let reference = draw(&[0, 1, 2]);
    assert_eq!(draw(&[2, 1, 0]), reference);
    assert_eq!(draw(&[1, 2, 0]), reference);
    for k in (0..3).rev() {
        let alone = drawn(&camera, &meshes[k].0, &meshes[k].1);
        for (i, _) in alone.iter().enumerate().filter(|(_, m)| **m > 0) {
            assert!(reference.object[i] >= 0 && reference.object[i] <= k as i32);
        }
    }
    assert!((0..3).all(|k| reference.object.contains(&k)));
}

#[test]
fn ground_under_the_camera_is_cut_at_the_near_plane() {
    let camera = camera();
    let height = 0.1;
    let ground = [[-50.0, height, -50.0], [50.0, height, -50.0], [50.0, height, 50.0], [-50.0, height, 50.0]];
    let found = drawn(&camera, &ground.map(Vector3::from), &[[0, 1, 2], [0, 2, 3]]);
    for (i, &m) in found.iter().enumerate() {
        let slope = ((i / camera.width) as f64 - camera.cy) / camera.fy; // y over z of the pixel's ray
        let depth = height / slope;
        assert_eq!(m == 1, (NEAR_M..50.0).contains(&depth), "pixel {i} at {depth} m");
    }
}

#[test]
fn what_is_behind_the_camera_is_not_drawn() {
    let (points, faces) = cuboid(Vector3::new(-1.0, -1.0, -4.0), Vector3::new(1.0, 1.0, -2.0));
    assert!(drawn(&camera(), &points, &faces).iter().all(|m| *m == 0));
}

#[test]
fn a_camera_in_a_box_sees_only_box() {
    let (points, faces) = cuboid(Vector3::repeat(-2.0), Vector3::repeat(2.0));
    assert!(drawn(&camera(), &points, &faces).iter().all(|m| *m == 1));
}

#[test]
fn faces_without_area_draw_nothing_and_break_nothing() {
    let camera = plain(20, 20);
    let line = [[3.0, 3.0, 1.0], [9.0, 9.0, 1.0], [6.0, 6.0, 1.0], [3.0, 3.0, 1.0]].map(Vector3::from);
    let mut raster = Raster::new(Rect::image(&camera));
    raster.draw(&camera, &line, &[[0, 1, 2], [0, 0, 1], [0, 3, 1], [2, 2, 2]], 0);
    assert!(raster.face.iter().all(|f| *f == -1));
}

#[test]
fn rectangles_behave() {
    let a = Rect { x0: -3, y0: 2, width: 10, height: 5 };
    assert_eq!(a.index(-3, 2), Some(0));
    assert_eq!(a.index(6, 6), Some(49));
    assert_eq!((a.index(7, 6), a.index(-4, 2), a.index(0, 7)), (None, None, None));
    assert_eq!(a.intersection(&Rect { x0: 100, y0: 0, width: 9, height: 9 }).area(), 0);
    assert_eq!(a.intersection(&a), a);
    let around = Rect::around([Vector2::new(0.2, 1.0), Vector2::new(3.9, -2.5)].into_iter());
    assert_eq!((around.x0, around.y0, around.width, around.height), (0, -3, 5, 5));
    assert_eq!(Rect::around(std::iter::empty()).area(), 0);
}

#[test]
fn far_out_points_still_give_a_rectangle_that_meets_the_image() {
    let far = Rect::around([Vector2::repeat(-1e300), Vector2::repeat(1e300)].into_iter());
    assert_eq!(far.intersection(&Rect::image(&camera())), Rect::image(&camera()));
}
