use meshslam_core::residuals::nearest::Cells;
use nalgebra::Vector2;
use proptest::prelude::*;

/// Points on an image, some on each other and on the borders of cells.
fn points(most: usize) -> impl Strategy<Value = Vec<Vector2<f64>>> {
    let coordinate = || prop_oneof![3 => -1.0..200.0f64, 1 => (0i32..25).prop_map(|k| f64::from(k) * 8.0)];
    prop::collection::vec((coordinate(), coordinate()).prop_map(|(x, y)| Vector2::new(x, y)), 0..most)
}

proptest! {
    #[test]
    fn cells_find_what_looking_at_every_point_finds(
        places in points(60),
        near in prop::collection::vec((-10.0..210.0f64, -10.0..210.0f64), 1..20),
        far in prop::collection::vec((-400.0..600.0f64, -400.0..600.0f64), 1..20),
    ) {
        let mut cells = Cells::default();
        cells.sort(places.iter().copied());
        for (x, y) in near.into_iter().chain(far).chain(places.first().map(|p| (p.x, p.y))) {
            let squared = |p: &Vector2<f64>| {
                let (u, v) = (p.x as f32 - x as f32, p.y as f32 - y as f32);
                u * u + v * v
            };
            let least = places.iter().map(squared).fold(f32::INFINITY, f32::min);
            let expected = places.iter().position(|p| squared(p) <= least);
            for guess in [None, expected, Some(0), Some(places.len() / 2), Some(1000)] {
                prop_assert_eq!(cells.nearest(&Vector2::new(x, y), guess), expected);
            }
        }
    }
}

#[test]
fn a_guess_just_before_the_border_of_its_cell_is_found() {
    let mut cells = Cells::default();
    let before = f64::from(8.0f32.next_down());
    cells.sort([Vector2::new(0.0, 0.0), Vector2::new(before, 0.0), Vector2::new(90.0, 0.0)].into_iter());
    for k in 0..1000 {
        let asked = Vector2::new(20.0 + 0.01 * f64::from(k), 0.0); // coarser coordinates than the guess's
        assert_eq!(cells.nearest(&asked, Some(1)), Some(1), "{asked}");
    }
}
