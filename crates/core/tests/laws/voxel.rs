use meshslam_core::voxel::voxel_iou;
use nalgebra::Vector3;

use crate::common::{Faces, Random, cuboid, icosphere, joined};

type Mesh = (Vec<Vector3<f64>>, Faces);

fn iou(a: &Mesh, b: &Mesh, step_m: f64) -> f64 {
    voxel_iou(&a.0, &a.1, &b.0, &b.1, step_m).unwrap()
}

fn moved(mesh: &Mesh, by: Vector3<f64>) -> Mesh {
    (mesh.0.iter().map(|v| v + by).collect(), mesh.1.clone())
}

fn unit_box() -> Mesh {
    cuboid(Vector3::zeros(), Vector3::new(1.0, 1.2, 0.8))
}

#[test]
fn boxes_with_known_overlap() {
    let a = unit_box();
    for shift in [Vector3::new(0.5, 0.0, 0.0), Vector3::new(0.0, 0.3, 0.2), Vector3::new(0.7, 0.6, 0.4)] {
        let overlap = (1.0 - shift.x) * (1.2 - shift.y) * (0.8 - shift.z);
        let expected = overlap / (2.0 * 0.96 - overlap);
        let found = iou(&a, &moved(&a, shift), 0.02);
        assert!((found - expected).abs() < 0.03, "{found} {expected}");
    }
}

#[test]
fn a_mesh_is_itself_and_not_what_lies_apart() {
    let mut random = Random(2);
    for _ in 0..10 {
        let rotation = random.rotation();
        let (sphere, faces) = icosphere(1);
        let mesh: Mesh = (sphere.iter().map(|v| rotation * v * random.uniform(0.4, 1.0)).collect(), faces);
        assert_eq!(iou(&mesh, &mesh, 0.07), 1.0);
        assert_eq!(iou(&mesh, &moved(&mesh, Vector3::new(0.0, 3.0, 0.0)), 0.07), 0.0);
    }
}

#[test]
fn concentric_spheres_and_their_order() {
    let (sphere, faces) = icosphere(3);
    let inner: Mesh = (sphere.iter().map(|v| v * 0.8).collect(), faces.clone());
    let outer: Mesh = (sphere, faces);
    let found = iou(&inner, &outer, 0.03);
    assert!((found - 0.512).abs() < 0.01, "{found}");
    assert_eq!(found, iou(&outer, &inner, 0.03));
}

#[test]
fn the_side_of_faces_does_not_matter_and_parts_add_up() {
    let a = unit_box();
    let inverted: Mesh = (a.0.clone(), a.1.iter().map(|&[i, j, k]| [i, k, j]).collect());
    assert_eq!(iou(&a, &inverted, 0.05), 1.0);
    let left = cuboid(Vector3::zeros(), Vector3::new(0.6, 1.2, 0.8));
    let right = cuboid(Vector3::new(0.4, 0.0, 0.0), Vector3::new(1.0, 1.2, 0.8));
    assert_eq!(iou(&joined(left, right), &a, 0.05), 1.0); // overlapping parts are one volume
}

#[test]
fn samples_agree_with_the_winding_number() {
    let mut random = Random(7);
    let turned = |r: &mut Random| -> Mesh {
        let (rotation, shift) = (r.rotation(), r.vector(0.3));
        let (points, faces) = unit_box();
        (points.iter().map(|v| rotation * v + shift).collect(), faces)
    };
    for _ in 0..5 {
        let (a, b) = (turned(&mut random), turned(&mut random));
        let (mut both, mut either) = (0, 0);
        for _ in 0..8000 {
            let p = random.vector(2.2);
            let (in_a, in_b) = (winding(&a, &p) > 0.5, winding(&b, &p) > 0.5);
            both += i32::from(in_a && in_b);
            either += i32::from(in_a || in_b);
        }
        let expected = f64::from(both) / f64::from(either);
        let found = iou(&a, &b, 0.04);
        assert!((found - expected).abs() < 0.12, "{found} {expected}");
    }
}

/// Solid angle over 4π (van Oosterom and Strackee 1983).
fn winding(mesh: &Mesh, p: &Vector3<f64>) -> f64 {
    let angle = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|i| mesh.0[i as usize] - p);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * a.dot(&b.cross(&c)).atan2(below)
    };
    mesh.1.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

#[test]
fn nothing_overlaps_nothing() {
    let empty: Mesh = (Vec::new(), Vec::new());
    assert_eq!(iou(&empty, &empty, 0.05), 0.0);
    assert_eq!(iou(&unit_box(), &empty, 0.05), 0.0);
    let flat: Mesh = (vec![Vector3::zeros(); 3], vec![[0, 1, 2]]);
    assert_eq!(iou(&flat, &flat, 0.05), 0.0);
}
