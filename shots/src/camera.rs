//! Motion of what does not move itself: a pixel's position in the world, seen by the cameras of two frames.
//!
//! Conventions of matrices differ as those of motion passes do: points are rows or columns, the picture is 0..1 or -1..1, to
//! either side, y down or up. So the readings are tried: a matrix belongs to a frame where it lays the positions of that
//! very frame onto their own pixels, and no reading of another frame's does.

use crate::field::Field;
use sspc_image::Image;
use std::fmt;

/// A camera lays positions at most so far off their pixels, pixels, the median: renderers keep one sample of a pixel, which
/// lies up to half a pixel off its middle in x and y.
const MOST_OFF: f64 = 0.75;
/// A position that lies farther off its own pixel, pixels, is no place on a surface that is seen there: the background's, or
/// a mean of several things.
const SAME_PIXEL: f64 = 1.0;
/// Pixels that readings are tried on, about, and at least.
const LOOKED_AT: usize = 20_000;
const FEWEST: usize = 64;

/// The display window, in pixels, from the upper left corner of a frame's first pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Screen {
    /// Its left side.
    pub left: f64,
    /// Its upper side.
    pub top: f64,
    /// Its width.
    pub width: f64,
    /// Its height.
    pub height: f64,
}

/// A camera that was understood: where a point of the world lies in the frame's pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// (x w, y w, w) of the point (X, Y, Z, 1): pixels from the centre of the first one; w > 0 in front of the camera.
    rows: [[f64; 4]; 3],
}

/// Why positions are of no use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unusable {
    /// The files hold no matrix.
    NoMatrix,
    /// Hardly any pixel has a position of its own.
    NoPositions,
    /// Every matrix, however it is read, lays positions so far off their own pixels, the median.
    Off(f64),
}

impl fmt::Display for Unusable {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Unusable::NoMatrix => out.write_str("the file has no camera matrix (worldToNDC)"),
            Unusable::NoPositions => out.write_str("the pass says nothing"),
            Unusable::Off(pixels) if pixels.is_finite() => {
                write!(out, "the camera matrix lays it {pixels:.1} pixels off its own pixels")
            }
            Unusable::Off(_) => out.write_str("the camera matrix leads nowhere"),
        }
    }
}

impl std::error::Error for Unusable {}

/// How a matrix leads to the picture.
#[derive(Clone, Copy, Debug)]
struct Reading {
    /// Points are rows, (X, Y, Z, 1) M.
    rows: bool,
    /// The picture is -1..1, else 0..1.
    centred: bool,
    /// Sign of x to the right.
    right: f64,
    /// Sign of y downwards.
    down: f64,
}

impl Reading {
    fn all() -> impl Iterator<Item = Reading> {
        let forms = [(true, false), (true, true), (false, false), (false, true)];
        forms.into_iter().flat_map(|(rows, centred)| {
            let signs = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)];
            signs.map(|(right, down)| Reading { rows, centred, right, down })
        })
    }

    fn camera(self, matrix: &[f32; 16], screen: &Screen) -> Camera {
        let component = |c: usize| {
            [0, 1, 2, 3].map(|k: usize| f64::from(if self.rows { matrix[4 * k + c] } else { matrix[4 * c + k] }))
        };
        let [x, y, w] = [0, 1, 3].map(component);
        let side = |component: [f64; 4], sign: f64, first: f64, length: f64| {
            let centred = |k: usize| if self.centred { component[k] } else { 2.0 * component[k] - w[k] };
            [0, 1, 2, 3].map(|k| 0.5 * sign * length * centred(k) + (first + 0.5 * length - 0.5) * w[k])
        };
        let x = side(x, self.right, screen.left, screen.width);
        let y = side(y, self.down, screen.top, screen.height);
        Camera { rows: [x, y, w] }
    }
}

/// A pixel and its position.
struct Sample {
    x: f64,
    y: f64,
    point: [f64; 3],
}

fn point(position: &Image, at: usize) -> [f64; 3] {
    [0, 1, 2].map(|c| f64::from(position.plane(c)[at]))
}

/// A grid of pixels whose position is finite and not that of the pixel beside, as the background's is.
fn samples(position: &Image) -> Vec<Sample> {
    let (height, width) = (position.height(), position.width());
    let stride = ((height * width) as f64 / LOOKED_AT as f64).sqrt().ceil().max(1.0) as usize;
    let pixels = (0..height).step_by(stride).flat_map(|y| (1..width).step_by(stride).map(move |x| (y, x)));
    let of_pixel = |(y, x): (usize, usize)| {
        let at = y * width + x;
        let own = point(position, at);
        let is_own = own.iter().all(|value| value.is_finite()) && own != point(position, at - 1);
        is_own.then_some(Sample { x: x as f64, y: y as f64, point: own })
    };
    pixels.filter_map(of_pixel).collect()
}

impl Camera {
    /// The camera of a frame by its positions `[3, H, W]` and the matrices in its files, 16 values each in the file's order.
    ///
    /// # Errors
    /// [`Unusable`], where no reading of any matrix lays the positions onto their own pixels.
    pub fn of(position: &Image, matrices: &[[f32; 16]], screen: &Screen) -> Result<Self, Unusable> {
        if matrices.is_empty() {
            return Err(Unusable::NoMatrix);
        }
        let samples = samples(position);
        if samples.len() < FEWEST {
            return Err(Unusable::NoPositions);
        }
        let read = |matrix| Reading::all().map(move |reading: Reading| reading.camera(matrix, screen));
        let tried = matrices.iter().flat_map(read).map(|camera| (camera.off(&samples), camera));
        match tried.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((off, camera)) if off <= MOST_OFF => Ok(camera.facing(&samples)),
            Some((off, _)) => Err(Unusable::Off(off)),
            None => Err(Unusable::NoMatrix),
        }
    }

    /// Median distance of samples from their pixels; infinite where most lead nowhere.
    fn off(&self, samples: &[Sample]) -> f64 {
        let of_sample = |sample: &Sample| {
            let [x, y, w] = self.homogeneous(sample.point);
            let off = (x / w - sample.x).hypot(y / w - sample.y);
            if off.is_finite() { off } else { f64::INFINITY }
        };
        let mut off: Vec<f64> = samples.iter().map(of_sample).collect();
        let middle = off.len() / 2;
        *off.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    /// The same with w > 0 for what is seen: Mantra's is negative there.
    fn facing(self, samples: &[Sample]) -> Self {
        let front = samples.iter().filter(|sample| self.homogeneous(sample.point)[2] > 0.0).count();
        if 2 * front >= samples.len() { self } else { Self { rows: self.rows.map(|row| row.map(|value| -value)) } }
    }

    fn homogeneous(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        self.rows.map(|row| row[0] * x + row[1] * y + row[2] * z + row[3])
    }

    /// Where a point lies in the picture, (x, y) in pixels; NaN behind the camera.
    fn place(&self, point: [f64; 3]) -> (f64, f64) {
        let [x, y, w] = self.homogeneous(point);
        if w > 0.0 { (x / w, y / w) } else { (f64::NAN, f64::NAN) }
    }
}

/// The field from a frame with these positions `[3, H, W]` to that of another camera. What is behind that camera leads
/// nowhere (NaN). Pixels whose position is not known, which do not lie where their own camera has them, move as `otherwise`.
///
/// The difference of both places is taken, not that from the pixel's middle, so that where in its pixel a position was
/// sampled does not matter.
///
/// # Panics
/// When sizes differ.
pub fn moved(position: &Image, own: &Camera, other: &Camera, otherwise: &Field) -> Field {
    assert!(position.same_size(otherwise), "positions and a field of one size");
    let (height, width) = (position.height(), position.width());
    Image::from_rows(2, height, width, |c, y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let point = point(position, y * width + x);
            let from = own.place(point);
            let is_known = (from.0 - x as f64).abs() <= SAME_PIXEL && (from.1 - y as f64).abs() <= SAME_PIXEL;
            let to = other.place(point);
            *out = match is_known {
                true if c == 0 => (to.0 - from.0) as f32,
                true => (to.1 - from.1) as f32,
                false => otherwise.at(c, y, x),
            };
        }
    })
}
