//! Entry points of the core on hostile input, for `make fuzz`: no panic, no NaN out of finite input, and laws that hold
//! everywhere. A finding prints its seed; `FUZZ_SEED` repeats it, `FUZZ_SECONDS` says how long to go on.
#![allow(clippy::unwrap_used, clippy::panic)] // a finding is a panic

use std::time::{Duration, Instant};

use meshslam_core::areas::Areas;
use meshslam_core::camera::Camera;
use meshslam_core::constellations::{Parked, ParkedMap, Rules};
use meshslam_core::error::check_finite;
use meshslam_core::gradients::exact::{Workspace, exact_gradient};
use meshslam_core::gradients::kato::kato_gradient;
use meshslam_core::gradients::{MaskGradient, ObservedMask};
use meshslam_core::kernel::Kernel;
use meshslam_core::lie::{Pose, exp_so3, log_so3, right_jacobian};
use meshslam_core::mesh::{Topology, cotangent_weights};
use meshslam_core::object::{Model, ObjectState, Scope, mask_iou, refine, uncertainty};
use meshslam_core::outline::outline;
use meshslam_core::raster::{Raster, Rect, coverage, fill_mask};
use meshslam_core::residuals::border::BorderNoise;
use meshslam_core::silhouette::Silhouette;
use meshslam_core::solve::levenberg_marquardt::Options;
use meshslam_core::solve::triangulate::{Sight, triangulate};
use meshslam_core::template::Template;
use meshslam_core::view::{BorderPoint, KeypointObservation, View};
use meshslam_core::voxel::voxel_iou;
use nalgebra::{Vector2, Vector3};

/// SplitMix64 (Steele et al. 2014).
struct Source(u64);

impl Source {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count.max(1) as u64) as usize
    }

    fn chance(&mut self, one_in: usize) -> bool {
        self.below(one_in) == 0
    }

    /// Sometimes one more than it should be.
    fn off_by_one(&mut self, count: usize) -> usize {
        count + usize::from(self.chance(30))
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Mostly a number of that size, sometimes one that breaks things.
    fn number(&mut self, size: f64) -> f64 {
        const ODD: [f64; 12] =
            [0.0, -0.0, 0.1, 1e-300, -1e-12, 1e9, -1e12, 1e154, -1e300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
        match self.below(40) {
            0 => ODD[self.below(ODD.len())],
            1..=8 => (self.uniform(-size, size) * 4.0).round() / 4.0,
            _ => self.uniform(-size, size),
        }
    }

    fn vector(&mut self, size: f64) -> Vector3<f64> {
        Vector3::new(self.number(size), self.number(size), self.number(size))
    }

    fn vectors(&mut self, count: usize, size: f64) -> Vec<Vector3<f64>> {
        // half of the meshes are tame throughout, so that the work behind the checks is reached
        let tame = self.chance(2);
        (0..count)
            .map(|_| if tame { Vector3::from_fn(|_, _| self.uniform(-size, size)) } else { self.vector(size) })
            .collect()
    }

    fn pose(&mut self) -> Pose {
        let theta = Vector3::from_fn(|_, _| self.uniform(-3.2, 3.2));
        let ahead = Vector3::new(self.uniform(-2.0, 2.0), self.uniform(-2.0, 2.0), self.uniform(-3.0, 12.0));
        Pose { rotation: exp_so3(&theta), translation: if self.chance(8) { self.vector(5.0) } else { ahead } }
    }

    fn faces(&mut self, vertices: usize) -> Vec<[i64; 3]> {
        if vertices == 4 && self.chance(2) {
            return vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        }
        let bad = self.chance(10);
        (0..self.below(24))
            .map(|_| {
                std::array::from_fn(|_| {
                    if bad && self.chance(9) {
                        -1 + self.below(vertices + 3) as i64
                    } else {
                        self.below(vertices) as i64
                    }
                })
            })
            .collect()
    }

    fn camera(&mut self) -> Camera {
        let size = |s: &mut Self| 1 + s.below(60);
        let (width, height) = (size(self), size(self));
        let (fx, fy) = if self.chance(12) { (self.number(50.0), self.number(50.0)) } else { (40.0, 45.0) };
        let (cx, cy) = (self.uniform(-10.0, 60.0), self.uniform(-10.0, 60.0));
        Camera { width, height, fx, fy, cx, cy, skew: self.uniform(-3.0, 3.0) }
    }
}

fn finite(values: &[Vector3<f64>]) -> bool {
    check_finite("values", &values.iter().flat_map(|v| v.iter().copied()).collect::<Vec<_>>()).is_ok()
}

fn check_gradient(found: &MaskGradient) {
    assert!((-1.0..=0.0).contains(&found.loss), "loss {}", found.loss);
    assert!(finite(&found.vertices), "gradient over vertices");
    assert!(found.object.iter().chain(found.camera.iter()).all(|x| x.is_finite()), "gradient over poses");
}

/// What the mask's functions make of one mesh.
fn masks(s: &mut Source) {
    let count = [0, 3, 4, 4, 12][s.below(5)];
    let (vertices, faces, camera, pose) = (s.vectors(count, 1.5), s.faces(count), s.camera(), s.pose());
    let Ok(camera) = camera.checked() else { return };
    let size = |s: &mut Source| s.below(50);
    let rect = Rect { x0: s.below(40) as i64 - 20, y0: s.below(40) as i64 - 20, width: size(s), height: size(s) };
    let wrong = usize::from(s.chance(20));
    let values: Vec<u8> = (0..rect.area() + wrong).map(|_| u8::from(s.chance(2))).collect();
    let observed = ObservedMask::new(rect, &values);
    assert_eq!(observed.is_err(), wrong > 0);
    let (Ok(topology), Ok(observed)) = (Topology::new(count, &faces), observed) else { return };
    if !finite(&vertices) || !finite(&[pose.translation]) {
        return; // the binding turns these back
    }
    assert!(cotangent_weights(&topology, &vertices).iter().all(|w| w.is_finite()));
    let mut work = Workspace::default();
    let first = exact_gradient(&camera, &pose, &vertices, &topology, &observed, &mut work);
    check_gradient(&first);
    for _ in 0..5 {
        // from the fourth on the mesh is prepared
        assert_eq!(exact_gradient(&camera, &pose, &vertices, &topology, &observed, &mut work), first);
    }
    check_gradient(&kato_gradient(&camera, &pose, &vertices, &topology, &observed));
    let points: Vec<Vector3<f64>> = vertices.iter().map(|v| pose.transform(v)).collect();
    let image = Rect::image(&camera);
    let mut filled = vec![0; image.area()];
    fill_mask(&camera, &points, &topology.faces, &image, &mut filled);
    let mut raster = Raster::new(image);
    raster.draw(&camera, &points, &topology.faces, 0);
    assert!(raster.inverse_depth.iter().all(|w| w.is_finite()));
    for way in [Silhouette::draw, Silhouette::draw_by_contour] {
        let mut drawn = Silhouette::default();
        way(&mut drawn, &camera, &points, &topology);
        let inner = drawn.rect;
        let mask = drawn.mask().to_vec();
        for (i, &m) in filled.iter().enumerate() {
            let (x, y) = ((i % image.width) as i64, (i / image.width) as i64);
            assert_eq!(m, inner.index(x, y).map_or(0, |at| mask[at]), "pixel {x} {y}");
        }
    }
    let soft = coverage(&camera, &points, &topology.faces, &rect, 1 + s.below(5));
    assert!(soft.iter().all(|c| (0.0..=1.0).contains(c)));
    let step = s.uniform(0.3, 5.0);
    for sample in outline(&camera, &points, &topology, &image, &filled, step) {
        assert!(sample.pixel.iter().chain(sample.normal.iter()).all(|x| x.is_finite()));
    }
    if let Ok(iou) = voxel_iou(&vertices, &topology.faces, &points, &topology.faces, s.uniform(0.05, 2.0)) {
        assert!((0.0..=1.0).contains(&iou), "IoU {iou}");
    }
}

/// Exact areas: shares are shares, and tame meshes have gradients that are numbers.
fn areas(s: &mut Source) {
    let count = s.below(12);
    let (vertices, pose) = (s.vectors(count, 3.0), s.pose());
    let Ok(camera) = s.camera().checked() else { return };
    let Ok(topology) = Topology::new(count, &s.faces(count)) else { return };
    let mut areas = Areas::default();
    areas.draw(&camera, &pose, &vertices, &topology);
    let rect = areas.rect();
    assert!(rect.x0 >= 0 && rect.y0 >= 0 || rect.area() == 0);
    assert!(areas.touched().iter().all(|cell| (0.0..=1.0).contains(&cell.share)));
    let found = areas.gradient(&camera, &pose, &vertices, |column, row| (column as f64 - row as f64).cos());
    let tame =
        vertices.iter().all(|v| v.norm() < 1e6) && pose.translation.norm() < 1e6 && camera.fx.max(camera.fy) < 1e6;
    assert!(!tame || finite(&found.vertices), "{found:?}");
}

fn view(s: &mut Source, keypoints: usize) -> View {
    let crop =
        Rect { x0: s.below(30) as i64 - 10, y0: s.below(30) as i64 - 10, width: s.below(20), height: s.below(20) };
    let area = crop.area() + usize::from(s.chance(30));
    let border = |s: &mut Source| BorderPoint {
        pixel: Vector2::new(s.number(60.0), s.number(60.0)),
        length: s.uniform(0.0, 3.0),
        own: s.chance(2),
    };
    let seen = |s: &mut Source| KeypointObservation {
        index: {
            let most = s.off_by_one(keypoints);
            s.below(most)
        },
        pixel: Vector2::new(s.uniform(0.0, 60.0), s.uniform(0.0, 60.0)),
        sigma_px: if s.chance(20) { s.number(2.0) } else { 2.0 },
    };
    View {
        camera: s.camera(),
        world_from_camera: s.pose(),
        time_s: s.uniform(-1.0, 1.0),
        crop,
        distance_px: (0..area).map(|_| s.uniform(-9.0, 9.0) as f32).collect(),
        cut: (0..area).map(|_| u8::from(s.chance(4))).collect(),
        hidden: (0..area).map(|_| u8::from(s.chance(4))).collect(),
        border: (0..s.below(12)).map(|_| border(s)).collect(),
        keypoints: (0..s.below(4)).map(|_| seen(s)).collect(),
        area_px: 0,
        border_length_px: 0.0,
        surface_sigma_px: 0.0,
    }
}

/// The solver on a small template.
fn solver(s: &mut Source) {
    let count = [4, 4, 7][s.below(3)];
    let (mean, faces) = (s.vectors(count, 1.5), s.faces(count));
    let modes = s.below(3);
    let entries = s.off_by_one(count * modes);
    let modes = s.vectors(entries, 0.2);
    let association = |s: &mut Source| {
        let most = s.off_by_one(count);
        vec![(s.below(most) as u32, s.uniform(-1.0, 2.0))]
    };
    let keypoints: Vec<_> = (0..3).map(|_| association(s)).collect();
    let wheels: Vec<i64> = (0..s.below(4)).map(|_| s.below(count) as i64).collect();
    let mirror: Option<Vec<i64>> =
        s.chance(3).then(|| (0..count).map(|i| if s.chance(9) { 9 } else { i as i64 }).collect());
    let Ok(template) = Template::new(mean, &faces, modes, mirror.as_deref(), keypoints, &wheels) else { return };
    let views: Vec<View> = (0..s.below(3)).filter_map(|_| view(s, 3).checked(3).ok()).collect();
    let views: Vec<&View> = views.iter().collect();
    let model = Model {
        border: BorderNoise { sigma_px: 1.5, correlation_px: 20.0, kernel: Kernel::Huber(3.0), cap_px: 60.0 },
        outline_step_px: s.uniform(0.5, 4.0),
        keypoint_position_sigma_m: 0.1,
        keypoint_kernel: Kernel::GemanMcClure(3.0),
        free_form_sigma_m: 0.1,
        smoothness_sigma_m: 0.02,
    };
    let scope = Scope { modes: s.chance(2), free_form: s.chance(2), velocity: s.chance(3) };
    let pose = Pose { translation: Vector3::from_fn(|_, _| s.uniform(-3.0, 3.0)), ..s.pose() };
    let wrong = usize::from(s.chance(30));
    let state = ObjectState {
        world_from_object: pose,
        z: vec![0.1; template.mode_count + wrong],
        d: vec![0.0; template.symmetry.dimension()],
        velocity: Vector3::zeros(),
    };
    let options = Options { max_iterations: 4, ..Options::default() };
    let found = refine(&template, &views, None, model, scope, state, &options);
    assert_eq!(found.is_err(), wrong > 0);
    let Ok(found) = found else { return };
    assert!(found.report.iterations.windows(2).all(|pair| pair[1].cost <= pair[0].cost));
    if let Ok(spread) = uncertainty(&template, &views, None, model, scope, &found.state, true) {
        assert!(spread.vertex_sigma_m.iter().all(|x| !x.is_nan()));
    }
    let vertices = template.vertices(&found.state.z, &found.state.d);
    for view in views {
        let iou = mask_iou(view, &found.state.world_from_object, &vertices, &template.topology);
        assert!((0.0..=1.0).contains(&iou), "IoU {iou}");
    }
}

fn points(s: &mut Source) {
    let theta = s.vector(4.0);
    if finite(&[theta]) && theta.norm() < 1e6 {
        assert!(log_so3(&exp_so3(&theta)).norm() <= std::f64::consts::PI + 1e-6);
        assert!(right_jacobian(&theta).iter().all(|x| x.is_finite()));
    }
    let sight = |s: &mut Source| Sight {
        camera: Camera { width: 60, height: 60, fx: 40.0, fy: 40.0, cx: 30.0, cy: 30.0, skew: 0.0 },
        camera_from_world: s.pose(),
        pixel: Vector2::new(s.uniform(0.0, 60.0), s.uniform(0.0, 60.0)),
        sigma_px: 1.0,
    };
    let sights: Vec<Sight> = (0..s.below(5)).map(|_| sight(s)).collect();
    if let Some((point, covariance)) = triangulate(&sights, Kernel::Cauchy(3.0)) {
        assert!(point.iter().chain(covariance.iter()).all(|x| x.is_finite()));
    }
}

fn parked(s: &mut Source, count: usize) -> Vec<Parked> {
    let spread = 10f64.powf(s.uniform(-1.0, 5.0));
    let one = |s: &mut Source| Parked {
        place: [s.number(spread), s.number(spread)],
        yaw_rad: s.number(3.0),
        log_size: [s.number(1.0), s.number(1.0), s.number(1.0)],
        variance_m2: s.number(0.1).abs(),
    };
    (0..count).map(|_| one(s)).collect()
}

fn places(s: &mut Source) {
    let counts = [s.below(30), s.below(6)];
    let objects = parked(s, counts[0]);
    let Ok(map) = ParkedMap::new(objects) else { return };
    let seen = parked(s, counts[1]);
    let index = |s: &mut Source, count: usize| s.off_by_one(0) + s.below(count);
    let ends: Vec<[usize; 2]> = (0..s.below(4)).map(|_| [0, 1].map(|_| index(s, counts[1]))).collect();
    let lists: Vec<Vec<[i32; 2]>> = (0..s.off_by_one(ends.len()))
        .map(|_| (0..s.below(40)).map(|_| [0, 1].map(|_| index(s, counts[0]) as i32)).collect())
        .collect();
    let rules = Rules {
        place_variance_m2: s.number(0.05).abs(),
        drift_share: s.number(0.01).abs(),
        heading_sigma_rad: s.number(0.1).abs(),
        size_variance: s.number(0.01).abs(),
        other_size_variance: s.number(0.05).abs(),
        objects_per_m2: s.number(0.05).abs(),
        gate: s.number(4.0).abs(),
        scale_sigma: s.number(0.05).abs(),
    };
    let lists: Vec<&[[i32; 2]]> = lists.iter().map(Vec::as_slice).collect();
    let keep = s.below(70);
    if let Ok(found) = map.candidates(&seen, &ends, &lists, &rules, keep) {
        assert!(found.len() <= keep);
        assert!(found.windows(2).all(|two| two[0].score >= two[1].score));
    }
}

#[test]
#[ignore = "runs for as long as FUZZ_SECONDS says: make fuzz"]
fn entry_points() {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let targets = [masks, solver, points, places, areas];
    let run = |seed: u64| targets[(seed % 5) as usize](&mut Source(seed));
    if let Some(seed) = number("FUZZ_SEED") {
        return run(seed);
    }
    let (start, seconds) = (Instant::now(), Duration::from_secs(number("FUZZ_SECONDS").unwrap_or(600)));
    let first = number("FUZZ_START").unwrap_or(0);
    let mut seed = first;
    let mut findings = 0;
    while start.elapsed() < seconds && findings < 5 {
        if std::panic::catch_unwind(|| run(seed)).is_err() {
            eprintln!("finding: FUZZ_SEED={seed}");
            findings += 1;
        }
        seed += 1;
    }
    eprintln!("{} cases in {:.0} s, {findings} findings", seed - first, start.elapsed().as_secs_f64());
    assert_eq!(findings, 0);
}
