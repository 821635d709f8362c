//! Motion by world positions: planes seen by a camera that moves, whose motion is known.

use sspc_image::Image;
use sspc_shots::camera::{Camera, Screen, Unusable, moved};
use sspc_shots::convention::Alignment;
use sspc_shots::field::{Field, still};
use sspc_shots::flow::{Matchable, estimated};
use sspc_shots::validity::{Guides, validity};

const HEIGHT: usize = 74;
const WIDTH: usize = 117;
const FOCAL: f64 = 90.0;
/// Pixels that motion is wrong by, at most: of positions in the pixels' middles, and anywhere in the pixels, where motion
/// itself differs as much.
const MOST_WRONG: [f64; 2] = [0.005, 0.1];
/// The display window is larger than the picture and begins left of it and below its top.
const SCREEN: Screen = Screen { left: -9.0, top: 3.0, width: 130.0, height: 80.0 };

/// A camera that looks along +z, turned about the y axis, which points up.
#[derive(Clone, Copy)]
struct Pose {
    eye: [f64; 3],
    turned: f64,
}

const HERE: Pose = Pose { eye: [0.3, 1.1, -2.0], turned: 0.05 };
const NEXT: Pose = Pose { eye: [0.55, 1.0, -1.6], turned: 0.02 };
/// Where the near plane, z = 2, is behind.
const PAST: Pose = Pose { eye: [0.3, 1.1, 2.5], turned: 0.05 };

impl Pose {
    /// To the right, upwards and away, each of (X, Y, Z, 1).
    fn axes(&self) -> [[f64; 4]; 3] {
        let (sin, cos) = self.turned.sin_cos();
        [[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]].map(|[x, y, z]| {
            let [a, b, c] = self.eye;
            [x, y, z, -(x * a + y * b + z * c)]
        })
    }

    /// Pixels from the centre of the first.
    fn place(&self, [x, y, z]: [f64; 3]) -> (f64, f64) {
        let [right, up, away] = self.axes().map(|axis| axis[0] * x + axis[1] * y + axis[2] * z + axis[3]);
        (centre().0 + FOCAL * right / away, centre().1 - FOCAL * up / away)
    }

    /// What is seen there: a plane at z = 2 for X < 0.2, else one at z = 6.
    fn hit(&self, x: f64, y: f64) -> [f64; 3] {
        let (right, up) = ((x - centre().0) / FOCAL, (centre().1 - y) / FOCAL);
        let (sin, cos) = self.turned.sin_cos();
        let along = [cos * right + sin, up, cos - sin * right];
        let at = |z: f64| {
            let far = (z - self.eye[2]) / along[2];
            [0, 1, 2].map(|k| self.eye[k] + far * along[k])
        };
        if at(2.0)[0] < 0.2 && self.eye[2] < 2.0 { at(2.0) } else { at(6.0) }
    }

    /// Positions of all pixels, each sampled anywhere in its pixel, as renderers do.
    fn positions(&self) -> Image {
        self.sampled(1.0)
    }

    /// The same, sampled in a part of so many pixels around the middle.
    fn sampled(&self, spread: f32) -> Image {
        let mut rng = fastrand::Rng::with_seed(3);
        let mut off = Image::zeros(2, HEIGHT, WIDTH);
        off.data_mut().iter_mut().for_each(|off| *off = spread * (rng.f32() - 0.5));
        let at = |y: usize, x: usize, c: usize| f64::from(off.at(c, y, x));
        Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| self.hit(x as f64 + at(y, x, 0), y as f64 + at(y, x, 1))[c] as f32)
    }

    /// The matrix as a renderer writes it: (0, 0) is the upper left corner of the display window, (1, 1) the lower right.
    fn to_ndc(self) -> [f32; 16] {
        let [right, up, away] = self.axes();
        let middle = [(centre().0 + 0.5 - SCREEN.left) / SCREEN.width, (centre().1 + 0.5 - SCREEN.top) / SCREEN.height];
        let x = [0, 1, 2, 3].map(|k| FOCAL / SCREEN.width * right[k] + middle[0] * away[k]);
        let y = [0, 1, 2, 3].map(|k| -FOCAL / SCREEN.height * up[k] + middle[1] * away[k]);
        by_rows([x, y, away, away])
    }
}

/// (X, Y, Z, 1) M.
fn by_rows(columns: [[f64; 4]; 4]) -> [f32; 16] {
    std::array::from_fn(|i| columns[i % 4][i / 4] as f32)
}

fn transposed(matrix: [f32; 16]) -> [f32; 16] {
    std::array::from_fn(|i| matrix[i % 4 * 4 + i / 4])
}

/// A matrix to 0..1 as one to -1..1, with signs, and of w too.
fn centred(matrix: [f32; 16], right: f32, down: f32, away: f32) -> [f32; 16] {
    std::array::from_fn(|i| {
        let w = matrix[i / 4 * 4 + 3];
        away * [right * (2.0 * matrix[i] - w), down * (2.0 * matrix[i] - w), matrix[i], w][i % 4]
    })
}

fn centre() -> (f64, f64) {
    (0.5 * (WIDTH - 1) as f64, 0.5 * (HEIGHT - 1) as f64)
}

fn camera(pose: Pose, matrix: [f32; 16]) -> Camera {
    Camera::of(&pose.positions(), &[matrix], &SCREEN).expect("a camera")
}

/// The largest distance from the motion of what the middle of each pixel shows, but at the edge of the near plane.
fn wrong(field: &Field, from: Pose, to: Pose) -> f64 {
    let mut most = 0.0f64;
    for (y, x) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (y, x))) {
        let (left, right) = (from.hit(x as f64 - 1.0, y as f64), from.hit(x as f64 + 1.0, y as f64));
        if (left[2] - right[2]).abs() > 1.0 {
            continue;
        }
        let (there_x, there_y) = to.place(from.hit(x as f64, y as f64));
        let (dx, dy) = (f64::from(field.at(0, y, x)), f64::from(field.at(1, y, x)));
        let off = (x as f64 + dx - there_x).hypot(y as f64 + dy - there_y);
        assert!(off.is_finite(), "({x}, {y})");
        most = most.max(off);
    }
    most
}

#[test]
fn every_reading_of_a_matrix_gives_the_exact_motion() {
    let written = |form: usize, pose: Pose| {
        let matrix = pose.to_ndc();
        match form {
            0 => matrix,
            1 => transposed(matrix),
            2 => centred(matrix, 1.0, -1.0, 1.0),
            3 => centred(matrix, 1.0, 1.0, 1.0),
            // Mantra's, of which w is negative for what is seen.
            4 => centred(matrix, 1.0, -1.0, -1.0),
            _ => transposed(centred(matrix, -1.0, -1.0, 1.0)),
        }
    };
    let none = Image::filled(2, HEIGHT, WIDTH, f32::NAN);
    for form in 0..6 {
        let (own, other) = (camera(HERE, written(form, HERE)), camera(NEXT, written(form, NEXT)));
        for (spread, most) in [0.0, 1.0].into_iter().zip(MOST_WRONG) {
            let off = wrong(&moved(&HERE.sampled(spread), &own, &other, &none), HERE, NEXT);
            assert!(off < most, "form {form}: {off} pixels off");
        }
    }
    // It is a motion that no shift explains, and that leads out of the picture.
    assert!(wrong(&still(HEIGHT, WIDTH), HERE, NEXT) > 10.0);
}

#[test]
fn a_matrix_that_is_not_this_frame_s_is_refused() {
    let positions = HERE.positions();
    let of = |matrices: &[[f32; 16]]| Camera::of(&positions, matrices, &SCREEN);
    assert_eq!(of(&[]), Err(Unusable::NoMatrix));
    let Err(Unusable::Off(off)) = of(&[NEXT.to_ndc()]) else { panic!("{:?}", of(&[NEXT.to_ndc()])) };
    assert!((1.0..50.0).contains(&off), "{off}");
    assert_eq!(of(&[[f32::NAN; 16]]), Err(Unusable::Off(f64::INFINITY)));
    assert_eq!(of(&[[0.0; 16]]), Err(Unusable::Off(f64::INFINITY)));
    let other_screen = Screen { left: 0.0, ..SCREEN };
    assert!(Camera::of(&positions, &[HERE.to_ndc()], &other_screen).is_err());
    // The right one is found beside others.
    assert_eq!(of(&[NEXT.to_ndc(), [f32::NAN; 16], HERE.to_ndc()]), of(&[HERE.to_ndc()]));
    assert!(of(&[HERE.to_ndc()]).is_ok());
}

#[test]
fn a_pass_without_positions_says_nothing() {
    for value in [0.0, 1e30, f32::NAN] {
        let flat = Image::filled(3, HEIGHT, WIDTH, value);
        assert_eq!(Camera::of(&flat, &[HERE.to_ndc()], &SCREEN), Err(Unusable::NoPositions));
    }
}

/// Most of the picture is background; what stands in front of it has its own motion all the same.
#[test]
fn the_background_moves_as_estimated() {
    let otherwise = Image::filled(2, HEIGHT, WIDTH, 7.0);
    for background in [0.0, 1e30, f32::INFINITY, f32::NAN] {
        let cut = |pose: Pose| {
            let seen = pose.positions();
            Image::from_fn(
                3,
                HEIGHT,
                WIDTH,
                |c, y, x| if seen.at(2, y, x) > 3.0 { background } else { seen.at(c, y, x) },
            )
        };
        let (own, other) = (cut(HERE), cut(NEXT));
        let camera =
            |positions: &Image, pose: Pose| Camera::of(positions, &[pose.to_ndc()], &SCREEN).expect("a camera");
        let field = moved(&own, &camera(&own, HERE), &camera(&other, NEXT), &otherwise);
        let whole = moved(&HERE.positions(), &camera(&own, HERE), &camera(&other, NEXT), &otherwise);
        let near = |y: usize, x: usize| HERE.positions().at(2, y, x) < 3.0;
        assert!(near(5, 2) && !near(5, WIDTH - 2));
        for (y, x) in [(5, 2), (40, 20), (5, WIDTH - 2), (60, WIDTH - 9)] {
            let expected = if near(y, x) { whole.at(0, y, x) } else { 7.0 };
            assert_eq!(field.at(0, y, x), expected, "{background}: ({x}, {y})");
        }
    }
}

#[test]
fn what_is_behind_the_other_camera_or_outside_has_no_part() {
    let otherwise = still(HEIGHT, WIDTH);
    let positions = HERE.positions();
    let (own, past) = (camera(HERE, HERE.to_ndc()), camera(PAST, PAST.to_ndc()));
    let field = moved(&positions, &own, &past, &otherwise);
    let valid = validity(&Guides::default(), &Guides::default(), &field);
    let (mut behind, mut outside) = (0, 0);
    for (y, x) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (y, x))) {
        let point = [0, 1, 2].map(|c| f64::from(positions.at(c, y, x)));
        let (there_x, there_y) = PAST.place(point);
        if point[2] < 3.0 {
            behind += 1;
            assert!(field.at(0, y, x).is_nan() && field.at(1, y, x).is_nan());
            assert_eq!(valid.at(0, y, x), 0.0);
        } else if there_x < -1.0 || there_y < -1.0 || there_x > WIDTH as f64 || there_y > HEIGHT as f64 {
            outside += 1;
            assert_eq!(valid.at(0, y, x), 0.0);
        }
    }
    assert!(behind > 500 && outside > 500, "{behind} {outside}");
}

/// Of two fields the one that lays features over each other is found, whatever leads out of the picture.
#[test]
fn fields_are_compared_where_both_lead_to() {
    let texture =
        |dx: f32| Image::from_fn(3, 40, 60, |c, y, x| (0.4 * (x as f32 - dx) + 0.3 * y as f32 + c as f32).sin());
    let (own, neighbour) = (texture(0.0), texture(9.0));
    let guides = |albedo| Guides { albedo: Some(albedo), normal: None };
    let alignment = Alignment::of(&guides(&own), &guides(&neighbour));
    let by = |dx: f32| Image::from_fn(2, 40, 60, |c, _, _| if c == 0 { dx } else { 0.0 });
    assert!(alignment.is_as_good(&by(9.0), &by(8.0)) && !alignment.is_as_good(&by(8.0), &by(9.0)));
    // The same, but for pixels that one of both leads out.
    let shy = Image::from_fn(2, 40, 60, |c, _, x| if c == 0 && x < 51 { 9.0 } else { 0.0 });
    assert!(alignment.is_as_good(&by(9.0), &shy) && alignment.is_as_good(&shy, &by(9.0)));
}
/// Albedo of some detail and noise; the near plane's own texture has slid so far.
fn albedo(pose: Pose, detail: f64, noise: f32, slid: f64) -> Image {
    let mut rng = fastrand::Rng::with_seed(9 + u64::from(pose.turned > HERE.turned - 0.01));
    let mut albedo = Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| {
        let [px, py, z] = pose.hit(x as f64, y as f64);
        let across = if z < 3.0 { px - slid } else { px };
        let waves = (24.0 / z * across + c as f64).sin() + (19.0 / z * py + 0.3 * across).sin();
        (0.4 + 0.1 * z / 6.0 + 0.2 * detail * waves) as f32
    });
    albedo.data_mut().iter_mut().for_each(|v| *v += noise * 3.46 * (rng.f32() - 0.5));
    albedo
}

#[test]
fn exact_motion_is_taken_unless_things_move_themselves() {
    let is_taken = |detail: f64, noise: f32, slid: f64| {
        let (own, next) = (albedo(HERE, detail, noise, 0.0), albedo(NEXT, detail, noise, slid));
        let guides = |albedo| Guides { albedo: Some(albedo), normal: None };
        let matchable = |albedo| Matchable::of(albedo, &guides(albedo));
        let estimate = estimated(&matchable(&own), &matchable(&next));
        let (here, there) = (camera(HERE, HERE.to_ndc()), camera(NEXT, NEXT.to_ndc()));
        let field = moved(&HERE.positions(), &here, &there, &estimate);
        Alignment::of(&guides(&own), &guides(&next)).is_as_good(&field, &estimate)
    };
    for (detail, noise) in [(1.0, 0.0), (0.3, 0.1), (0.3, 0.3), (0.0, 0.1), (0.0, 0.0)] {
        assert!(is_taken(detail, noise, 0.0), "detail {detail}, noise {noise}");
    }
    assert!(!is_taken(1.0, 0.0, 0.15) && !is_taken(1.0, 0.05, -0.15));
}
