//! Motion: what a pass means, and what is found without one, on made-up scenes whose motion is known.

use sspc_image::Image;
use sspc_shots::convention::{Alignment, Convention, ConventionSearch, Unit, holds, says_nothing};
use sspc_shots::field::{Field, still};
use sspc_shots::flow::{Matchable, estimated};
use sspc_shots::relation::{Noisy, are_same, likeness, shared_noise};
use sspc_shots::validity::Guides;

const HEIGHT: usize = 90;
const WIDTH: usize = 141;

/// A texture of several waves, moved by (dx, dy): the pixel (x, y) shows what (x - dx, y - dy) showed.
fn texture(dx: f32, dy: f32) -> Image {
    Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| wave(c, x as f32 - dx, y as f32 - dy))
}

fn wave(c: usize, x: f32, y: f32) -> f32 {
    let c = c as f32;
    0.8 + 0.3 * (0.045 * x - 0.06 * y).sin()
        + 0.2 * (0.31 * x + 0.17 * y + c).sin()
        + 0.15 * (0.23 * y - 0.11 * x + 2.0 * c).cos()
        + 0.1 * (0.7 * x).sin()
}

/// Motion that grows from left to right, so that no constant explains it, pixels: (to the right, down).
fn moved(x: usize) -> (f32, f32) {
    (3.0 + 4.0 * x as f32 / WIDTH as f32, -2.0)
}

/// What the neighbour shows where the frame's pixel x lies there at x + moved(x).
fn scene() -> (Image, Image) {
    let own = texture(0.0, 0.0);
    let neighbour = Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| {
        // x = s + 3 + 4 s / W
        let s = (x as f32 - 3.0) / (1.0 + 4.0 / WIDTH as f32);
        wave(c, s, y as f32 + 2.0)
    });
    (own, neighbour)
}

fn pass(convention: &Convention) -> Image {
    let (width, height) = (WIDTH as f32, HEIGHT as f32);
    let (right, down, zero) = match convention.unit {
        Unit::Pixel => (1.0, 1.0, 0.0),
        Unit::HalfScreen => (0.5 * width, 0.5 * height, 0.0),
        Unit::Screen => (width, height, 0.0),
        Unit::Colour(pixels) => (pixels, pixels, 0.5),
    };
    Image::from_fn(4, HEIGHT, WIDTH, |c, _, x| match c.checked_sub(convention.first) {
        Some(0) => moved(x).0 / (f32::from(convention.right) * right) + zero,
        Some(1) => moved(x).1 / (f32::from(convention.down) * down) + zero,
        // The other pair leads elsewhere.
        _ => zero + if convention.unit == Unit::Pixel { 1.0 } else { 0.01 },
    })
}

fn guides(image: &Image) -> Guides<'_> {
    Guides { albedo: Some(image), normal: None }
}

#[test]
fn every_reading_is_found_by_looking() {
    let (own, neighbour) = scene();
    for unit in [Unit::Pixel, Unit::HalfScreen, Unit::Screen] {
        for (first, right, down) in [(0, 1, -1), (2, -1, 1), (0, -1, -1), (2, 1, 1)] {
            let expected = Convention { first, unit, right, down };
            let mut search = ConventionSearch::default();
            search.look(&pass(&expected), &Alignment::of(&guides(&own), &guides(&neighbour)));
            let found = search.finish().expect("a pass was looked at");
            assert!(found.best == expected && found.is_decisive(), "{expected}: {found}");
            assert!(found.opposite > found.still, "{found}");
        }
    }
}

#[test]
fn motion_as_a_colour_is_found_within_a_fifth_of_its_scale() {
    let (own, neighbour) = scene();
    let expected = Convention { first: 0, unit: Unit::Colour(30.0), right: 1, down: -1 };
    let mut search = ConventionSearch::default();
    search.look(&pass(&expected), &Alignment::of(&guides(&own), &guides(&neighbour)));
    let found = search.finish().expect("a pass was looked at");
    let Unit::Colour(pixels) = found.best.unit else { panic!("{found}") };
    assert!((25.0..36.0).contains(&pixels) && found.is_decisive(), "{found}");
    assert_eq!((found.best.right, found.best.down), (1, -1));
}

/// The wrong reading of a frame is found out; a pass of the wrong motion is not decisive.
#[test]
fn a_pass_that_leads_elsewhere_is_refused() {
    let (own, neighbour) = scene();
    let alignment = Alignment::of(&guides(&own), &guides(&neighbour));
    let right = Convention { first: 0, unit: Unit::Pixel, right: 1, down: -1 };
    let wrong = Convention { right: -1, down: 1, ..right };
    assert!(holds(&right, &pass(&right), &alignment) && !holds(&wrong, &pass(&right), &alignment));
    let noise = {
        fastrand::seed(5);
        Image::from_fn(2, HEIGHT, WIDTH, |_, _, _| 20.0 * fastrand::f32() - 10.0)
    };
    let mut search = ConventionSearch::default();
    search.look(&noise, &alignment);
    assert!(!search.finish().expect("looked at").is_decisive());
    assert!(says_nothing(&Image::zeros(4, 5, 5)) && says_nothing(&Image::filled(2, 5, 5, f32::NAN)));
    assert!(!says_nothing(&noise));
}

/// Mean distance of two fields over the pixels `margin` from the border.
fn distance(found: &Field, expected: impl Fn(usize, usize) -> (f32, f32), margin: usize) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (y, x) in (margin..HEIGHT - margin).flat_map(|y| (margin..WIDTH - margin).map(move |x| (y, x))) {
        let (dx, dy) = expected(y, x);
        sum += (found.at(0, y, x) - dx).hypot(found.at(1, y, x) - dy);
        count += 1.0;
    }
    sum / count
}

#[test]
fn motion_is_estimated_to_parts_of_a_pixel() {
    for (dx, dy) in [(0.0, 0.0), (0.4, -0.3), (5.25, 2.5), (-11.5, 7.75)] {
        let (own, neighbour) = (texture(0.0, 0.0), texture(dx, dy));
        for features in [true, false] {
            let of = |image: &Image| match features {
                true => Matchable::of(&Image::filled(3, HEIGHT, WIDTH, 1.0), &guides(image)),
                false => Matchable::of(image, &Guides::default()),
            };
            let found = estimated(&of(&own), &of(&neighbour));
            let off = distance(&found, |_, _| (dx, dy), 16);
            // Of albedo the mean alone is matched, where this texture has little contrast.
            assert!(off < if features { 0.2 } else { 0.1 }, "({dx}, {dy}) by features: {features}: {off} pixels off");
        }
    }
    let (own, neighbour) = scene();
    let of = |image: &Image| Matchable::of(image, &guides(image));
    let off = distance(&estimated(&of(&own), &of(&neighbour)), |_, x| moved(x), 16);
    assert!(off < 0.15, "{off}");
}

/// A square that moves over a still ground: both keep their own motion up to a few pixels from the edge.
#[test]
fn things_that_move_differently_keep_their_own_motion() {
    let inside = |x: f32, y: f32| (40.0..90.0).contains(&x) && (25.0..65.0).contains(&y);
    let frame = |dx: f32| {
        Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| {
            let (x, y) = (x as f32, y as f32);
            if inside(x - dx, y) { 1.5 + wave(c, x - dx, y) } else { wave(2 - c, x, y) }
        })
    };
    let (own, neighbour) = (frame(0.0), frame(6.0));
    let found = estimated(&Matchable::of(&own, &guides(&own)), &Matchable::of(&neighbour, &guides(&neighbour)));
    for (y, x, expected) in [(45, 50, 6.0), (30, 60, 6.0), (60, 84, 6.0), (10, 60, 0.0), (45, 25, 0.0), (80, 120, 0.0)]
    {
        assert!((found.at(0, y, x) - expected).abs() < 0.5, "row {y}, column {x}: {}", found.at(0, y, x));
    }
}

#[test]
fn pictures_of_any_size_have_a_motion() {
    for (height, width) in [(1, 1), (1, 40), (3, 5), (23, 200), (24, 24), (49, 25)] {
        let image = Image::from_fn(3, height, width, |c, y, x| wave(c, x as f32, y as f32));
        let of = || Matchable::of(&image, &Guides::default());
        assert!(estimated(&of(), &of()).data().iter().all(|d| d.abs() < 0.01), "{height}x{width}");
    }
    let nothing = Image::filled(3, 30, 30, f32::NAN);
    let of = || Matchable::of(&nothing, &guides(&nothing));
    assert_eq!(estimated(&of(), &of()), still(30, 30));
}

#[test]
fn another_shot_is_told_from_a_neighbour() {
    let (own, neighbour) = (texture(0.0, 0.0), texture(0.5, 0.5));
    let field = Image::filled(2, HEIGHT, WIDTH, 0.5);
    assert!(likeness(&own, &neighbour, &field) > 0.95);
    let other = Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| wave(c, y as f32 * 1.7 + 40.0, x as f32 * 0.4));
    assert!(likeness(&own, &other, &field).abs() < 0.5);
    // Brighter light is no other shot, and a flat picture tells nothing.
    let brighter = Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| 3.0 * own.at(c, y, x));
    assert!(likeness(&own, &brighter, &still(HEIGHT, WIDTH)) > 0.95);
    let flat = Image::filled(3, HEIGHT, WIDTH, 1.0);
    assert_eq!(likeness(&flat, &own, &still(HEIGHT, WIDTH)), 1.0);
    assert!(are_same(&own, &own.clone()) && !are_same(&own, &neighbour));
}

/// Half b of a frame and half a of the next with the seeds of one render, and with seeds of their own; texture that z lacks
/// is in all of them and is no noise.
#[test]
fn noise_shared_with_a_neighbour_is_found_and_texture_is_not() {
    fastrand::seed(9);
    let (height, width) = (128, 160);
    let noise = || {
        let sum = |_, _, _| (0..4).map(|_| fastrand::f32()).sum::<f32>() - 2.0;
        Image::from_fn(3, height, width, sum)
    };
    let denoised = Image::filled(3, height, width, 1.0);
    let noises = [noise(), noise(), noise()];
    let picture = |noise: &Image| {
        let texture = |y: usize, x: usize| if (x + y).is_multiple_of(2) { 0.15 } else { -0.15 };
        Image::from_fn(3, height, width, |c, y, x| 1.0 + texture(y, x) + 0.3 * noise.at(c, y, x))
    };
    let [own, other, apart] = noises.each_ref().map(picture);
    let noisy = |radiance| Noisy { radiance, denoised: &denoised };
    let found = |neighbour| shared_noise(noisy(&own), noisy(&other), noisy(neighbour), &still(height, width)).unwrap();
    assert!(found(&own) > 0.3, "{}", found(&own));
    assert!(found(&apart).abs() < 0.05, "{}", found(&apart));
}
