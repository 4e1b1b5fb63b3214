use std::collections::HashSet;

use meshslam_core::error::Error;
use meshslam_core::mesh::{Symmetry, Topology, cotangent_weights};
use nalgebra::Vector3;

use crate::common::{Random, cuboid, icosphere, mirror, signed};

#[test]
fn closed_meshes_obey_euler() {
    for depth in 0..4 {
        let (vertices, faces) = icosphere(depth);
        let topology = Topology::new(vertices.len(), &signed(&faces)).unwrap();
        assert_eq!(vertices.len() + faces.len(), topology.edges.len() + 2);
        assert_eq!(2 * topology.edges.len(), 3 * faces.len());
        assert!(topology.edges.iter().all(|e| e.count == 2 && e.faces[0] != e.faces[1]));
    }
    assert_eq!(icosphere(3).0.len(), 642);
}

#[test]
fn edges_name_their_faces() {
    let (vertices, faces) = icosphere(2);
    let topology = Topology::new(vertices.len(), &signed(&faces)).unwrap();
    let mut seen = HashSet::new();
    for edge in &topology.edges {
        let [a, b] = edge.vertices;
        assert!(a < b && seen.insert([a, b]));
        for f in edge.faces {
            assert!(faces[f as usize].contains(&a) && faces[f as usize].contains(&b));
        }
    }
}

#[test]
fn a_removed_face_leaves_its_three_edges_on_the_boundary() {
    let (vertices, faces) = icosphere(1);
    for removed in [0, 17, faces.len() - 1] {
        let mut rest = faces.clone();
        let gone = rest.remove(removed);
        let topology = Topology::new(vertices.len(), &signed(&rest)).unwrap();
        let boundary: Vec<_> = topology.edges.iter().filter(|e| e.count == 1).collect();
        assert_eq!(boundary.len(), 3);
        for edge in boundary {
            assert!(edge.vertices.iter().all(|v| gone.contains(v)));
            assert_eq!(edge.faces[0], edge.faces[1]);
        }
    }
}

#[test]
fn three_faces_on_one_edge_are_counted() {
    let topology = Topology::new(5, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]).unwrap();
    let edge = topology.edges.iter().find(|e| e.vertices == [0, 1]).unwrap();
    assert_eq!((edge.count, edge.faces), (3, [0, 1]));
}

#[test]
fn degenerate_faces_give_no_loop() {
    let topology = Topology::new(3, &[[0, 0, 1], [2, 2, 2]]).unwrap();
    assert!(topology.edges.iter().all(|e| e.vertices[0] < e.vertices[1]));
}

#[test]
fn neighbours_are_the_edges_both_ways() {
    let (vertices, faces) = icosphere(1);
    let topology = Topology::new(vertices.len(), &signed(&faces)).unwrap();
    let around = topology.neighbours();
    assert_eq!(around.iter().map(Vec::len).sum::<usize>(), 2 * topology.edges.len());
    for (i, list) in around.iter().enumerate() {
        assert!(list.windows(2).all(|w| w[0] < w[1]));
        assert!(list.iter().all(|&j| around[j as usize].contains(&(i as u32))));
        assert!(list.len() == 5 || list.len() == 6);
    }
}

#[test]
fn faces_that_name_no_vertex_are_refused() {
    for (bad, face) in [([0, 1, 3], 1), ([0, -1, 2], 1), ([i64::MAX, 0, 1], 1), ([i64::MIN, 0, 1], 1)] {
        match Topology::new(3, &[[0, 1, 2], bad]) {
            Err(Error::FaceIndex { face: found, vertices: 3, .. }) => assert_eq!(found, face),
            other => panic!("{bad:?} gave {other:?}"),
        }
    }
    assert!(Topology::new(0, &[]).unwrap().edges.is_empty());
}

fn weights(vertices: &[Vector3<f64>], faces: &[[u32; 3]]) -> Vec<f64> {
    cotangent_weights(&Topology::new(vertices.len(), &signed(faces)).unwrap(), vertices)
}

#[test]
fn regular_tetrahedron_has_equal_weights() {
    let vertices: Vec<Vector3<f64>> =
        [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Vector3::from).into();
    let found = weights(&vertices, &[[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]);
    assert_eq!(found.len(), 6);
    assert!(found.iter().all(|w| (w - 1.0 / 3.0_f64.sqrt()).abs() < 1e-12)); // cot 60° = 1/√3
}

#[test]
fn weights_of_a_square_are_known() {
    let square: Vec<Vector3<f64>> =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]].map(Vector3::from).into();
    let topology = Topology::new(4, &[[0, 1, 2], [0, 2, 3]]).unwrap();
    for (edge, w) in topology.edges.iter().zip(cotangent_weights(&topology, &square)) {
        let expected = if edge.vertices == [0, 2] { 1e-3 } else { 0.5 }; // cot 90° = 0 is held, ½ cot 45° = ½
        assert!((w - expected).abs() < 1e-12);
    }
}

#[test]
fn dirichlet_energy_of_the_embedding_is_the_area() {
    let mut random = Random(3);
    for _ in 0..20 {
        let (sphere, faces) = icosphere(2);
        let stretch = Vector3::new(random.uniform(0.7, 1.3), random.uniform(0.7, 1.3), random.uniform(0.7, 1.3));
        let vertices: Vec<Vector3<f64>> = sphere.iter().map(|v| v.component_mul(&stretch)).collect();
        let topology = Topology::new(vertices.len(), &signed(&faces)).unwrap();
        let w = cotangent_weights(&topology, &vertices);
        assert!(w.iter().all(|w| *w > 1e-3), "no weight of this mesh is held");
        let ends = |e: [u32; 2]| (vertices[e[1] as usize] - vertices[e[0] as usize]).norm_squared();
        let energy: f64 = topology.edges.iter().zip(&w).map(|(e, w)| 0.5 * w * ends(e.vertices)).sum();
        let corners = |f: &[u32; 3]| f.map(|i| vertices[i as usize]);
        let area: f64 = faces.iter().map(corners).map(|[a, b, c]| 0.5 * (b - a).cross(&(c - a)).norm()).sum();
        assert!((energy - area).abs() < 1e-9 * area);
    }
}

#[test]
fn weights_know_no_scale_and_no_pose_and_survive_degenerate_faces() {
    let mut random = Random(5);
    let (sphere, faces) = icosphere(1);
    let rotation = random.rotation();
    let moved: Vec<Vector3<f64>> = sphere.iter().map(|v| rotation * v * 7.0 + Vector3::new(3.0, -1.0, 2.0)).collect();
    for (a, b) in weights(&sphere, &faces).iter().zip(weights(&moved, &faces)) {
        assert!((a - b).abs() < 1e-9);
    }
    let flat = vec![Vector3::zeros(); sphere.len()];
    assert!(weights(&flat, &faces).iter().all(|w| *w == 1e-3));
}

#[test]
fn symmetric_displacements_are_mirrored_and_span_all_of_them() {
    let (vertices, _) = icosphere(3);
    let image = mirror(&vertices);
    let symmetry = Symmetry::new(vertices.len(), Some(&image)).unwrap();
    let on_plane = image.iter().enumerate().filter(|(i, m)| *i as i64 == **m).count();
    let pairs = (vertices.len() - on_plane) / 2;
    assert_eq!(symmetry.representative.len(), on_plane + pairs);
    assert_eq!(symmetry.dimension(), 2 * on_plane + 3 * pairs);
    let mut random = Random(11);
    let d: Vec<f64> = (0..symmetry.dimension()).map(|_| random.uniform(-1.0, 1.0)).collect();
    for (v, &m) in image.iter().enumerate() {
        let (here, there) = (symmetry.displacement(v, &d), symmetry.displacement(m as usize, &d));
        assert_eq!(here, Vector3::new(there.x, -there.y, there.z));
    }
}

#[test]
fn a_gradient_pulled_back_is_the_transpose_of_displacement() {
    let (vertices, _) = icosphere(2);
    let symmetry = Symmetry::new(vertices.len(), Some(&mirror(&vertices))).unwrap();
    let mut random = Random(12);
    let d: Vec<f64> = (0..symmetry.dimension()).map(|_| random.uniform(-1.0, 1.0)).collect();
    let gradient: Vec<Vector3<f64>> =
        vertices.iter().map(|_| Vector3::from_fn(|_, _| random.uniform(-1.0, 1.0))).collect();
    let over_vertices: f64 = gradient.iter().enumerate().map(|(v, g)| g.dot(&symmetry.displacement(v, &d))).sum();
    let over_d: f64 = symmetry.pull_back(&gradient).iter().zip(&d).map(|(g, d)| g * d).sum();
    assert!((over_vertices - over_d).abs() < 1e-12 * over_vertices.abs().max(1.0));
}

#[test]
fn each_freedom_moves_its_own_pair_by_one() {
    let (vertices, _) = icosphere(1);
    let symmetry = Symmetry::new(vertices.len(), Some(&mirror(&vertices))).unwrap();
    for dof in 0..symmetry.dimension() {
        let mut d = vec![0.0; symmetry.dimension()];
        d[dof] = 1.0;
        let moved: Vec<f64> =
            (0..vertices.len()).map(|v| symmetry.displacement(v, &d).norm()).filter(|n| *n > 0.0).collect();
        assert!(!moved.is_empty() && moved.len() <= 2 && moved.iter().all(|n| *n == 1.0));
    }
}

#[test]
fn without_a_mirror_every_vertex_is_free() {
    let (vertices, _) = cuboid(Vector3::repeat(-1.0), Vector3::repeat(1.0));
    let symmetry = Symmetry::new(vertices.len(), None).unwrap();
    let d: Vec<f64> = (0..24).map(f64::from).collect();
    assert_eq!(symmetry.dimension(), 24);
    for v in 0..8 {
        assert_eq!(symmetry.displacement(v, &d).as_slice(), &d[3 * v..3 * v + 3]);
    }
}

#[test]
fn a_mirror_that_is_no_involution_is_refused() {
    assert!(matches!(Symmetry::new(3, Some(&[0, 1])), Err(Error::Length { .. })));
    for bad in [[1, 2, 0], [0, 1, 3], [-1, 1, 2], [1, 1, 2]] {
        assert!(matches!(Symmetry::new(3, Some(&bad)), Err(Error::Index { .. })), "{bad:?}");
    }
}
