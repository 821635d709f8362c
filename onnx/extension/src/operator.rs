//! The operator `sspc.PostCorrection`: g_c (Eqs. 10, 11) of whole pictures, in tiles that any number of threads may take.

use sspc_kernels::features::{DENOISED, FEATURE_CHANNELS, FeatureSet, MAX_RADIUS, ORDER};
use sspc_kernels::gc::{Correction, ParameterPlanes, Taps};
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use sspc_onnx::RADIUS_ATTRIBUTE;
use std::ops::Range;

/// Rows of a tile: fewer cost more per pixel, more leave threads without.
const TILE_ROWS: usize = 32;
/// Columns of a tile: whole strips of the kernel, and windows that a core's second cache holds.
const TILE_COLUMNS: usize = 256;

/// Names of the inputs, in their order, with the shapes that errors show.
const INPUTS: [(&str, &str); 3] =
    [("features", "[N, 13, H, W]"), ("parameters", "[N, 15 or 16, H, W]"), ("valid", "[1, 1, H, W]")];

/// How many inputs the operator has.
pub const INPUT_COUNT: usize = INPUTS.len();

/// A tensor of f32 as onnxruntime gives it.
#[derive(Clone, Debug)]
pub struct Tensor<'a> {
    /// Sizes of its dimensions.
    pub shape: Vec<usize>,
    /// Its values, as many as the shape says.
    pub values: &'a [f32],
}

/// The operator of a node.
#[derive(Clone, Debug)]
pub struct Operator {
    taps: Taps,
    isa: Isa,
}

impl Operator {
    /// The operator in a window of a radius, 1 to 12, on the instruction set that `SSPC_ISA` names, or the widest one.
    ///
    /// # Errors
    /// Another radius, or an instruction set that the machine has not.
    pub fn new(radius: i64) -> Result<Self, String> {
        let isa = Isa::from_env().map_err(|error| error.to_string())?;
        let known = usize::try_from(radius).ok().filter(|radius| (1..=MAX_RADIUS).contains(radius));
        let radius = known.ok_or_else(|| format!("{RADIUS_ATTRIBUTE}: expected 1 to {MAX_RADIUS}, found {radius}"))?;
        Ok(Self { taps: Taps::square(radius), isa })
    }
}

/// One call: an operator and its inputs.
pub struct Job<'a> {
    operator: &'a Operator,
    features: &'a [f32],
    parameters: &'a [f32],
    valid: &'a [f32],
    form: Form,
    images: usize,
    height: usize,
    width: usize,
    /// Of each image.
    sets: Vec<FeatureSet>,
    masked: bool,
}

/// A tile of an image and where its values go: rows of the three channels.
pub struct Part<'a> {
    image: usize,
    top: usize,
    rows: [&'a mut [f32]; 3],
}

impl<'a> Job<'a> {
    /// Checks the shapes.
    ///
    /// # Errors
    /// Names the input that does not fit, and how.
    pub fn new(operator: &'a Operator, inputs: &'a [Tensor<'a>; INPUT_COUNT]) -> Result<Self, String> {
        let fault = |index: usize| {
            let (name, expected) = INPUTS[index];
            format!("{name}: expected {expected}, found {:?}", inputs[index].shape)
        };
        let [features, parameters, valid] = inputs;
        let [images, FEATURE_CHANNELS, height, width] = features.shape[..] else { return Err(fault(0)) };
        let form = match parameters.shape[..] {
            [n, 15, h, w] if (n, h, w) == (images, height, width) => Form::Paper,
            [n, 16, h, w] if (n, h, w) == (images, height, width) => Form::Gated,
            _ => return Err(format!("{} for features {:?}", fault(1), features.shape)),
        };
        if valid.shape[..] != [1, 1, height, width] {
            return Err(format!("{} for features {:?}", fault(2), features.shape));
        }
        for (index, input) in inputs.iter().enumerate() {
            let count = input.shape.iter().try_fold(1usize, |count, &size| count.checked_mul(size));
            if count != Some(input.values.len()) {
                return Err(format!("{} with {} values", fault(index), input.values.len()));
            }
        }
        let image = FEATURE_CHANNELS * height * width;
        let set_of = |k: usize| set_of(&features.values[k * image..][..image]);
        Ok(Self {
            operator,
            features: features.values,
            parameters: parameters.values,
            valid: valid.values,
            form,
            images,
            height,
            width,
            sets: if image == 0 { Vec::new() } else { (0..images).map(set_of).collect() },
            masked: valid.values.iter().any(|&valid| valid != 1.0),
        })
    }

    /// Shape of the output.
    pub fn output_shape(&self) -> [usize; 4] {
        [self.images, 3, self.height, self.width]
    }

    /// Divides the output into tiles' rows: the same parts for any number of threads.
    pub fn parts(&self, out: &'a mut [f32]) -> Vec<Part<'a>> {
        let plane = self.height * self.width;
        if plane == 0 {
            return Vec::new();
        }
        let mut parts = Vec::new();
        for (image, planes) in out.chunks_exact_mut(3 * plane).enumerate() {
            let (red, rest) = planes.split_at_mut(plane);
            let (green, blue) = rest.split_at_mut(plane);
            let [red, green, blue] = [red, green, blue].map(|plane| plane.chunks_mut(TILE_ROWS * self.width));
            for (band, ((red, green), blue)) in red.zip(green).zip(blue).enumerate() {
                parts.push(Part { image, top: band * TILE_ROWS, rows: [red, green, blue] });
            }
        }
        parts
    }

    /// Corrects the pixels of a part.
    pub fn compute(&self, part: Part) {
        let height = part.rows[0].len() / self.width;
        let (mut buffer, mut corrected) = (Vec::new(), Vec::new());
        for left in (0..self.width).step_by(TILE_COLUMNS) {
            let region = Region { top: part.top, left, height, width: TILE_COLUMNS.min(self.width - left) };
            corrected.resize(3 * region.pixels(), 0.0);
            buffer = self.tile(part.image, region, buffer, &mut corrected);
            let pixels = region.pixels();
            for (y, x) in (0..height).flat_map(|y| (0..region.width).map(move |x| (y, x))) {
                let at = y * region.width + x;
                let value: [f32; 3] = std::array::from_fn(|k| corrected[k * pixels + at]);
                let finite = value.iter().all(|v| v.is_finite());
                for (k, value) in value.into_iter().enumerate() {
                    let z = || self.row(part.image, DENOISED + k, region.top + y)[left + x];
                    part.rows[k][y * self.width + left + x] = if finite { value } else { z() };
                }
            }
        }
    }

    /// g_c of a tile; gives the windows' memory back.
    fn tile(&self, image: usize, region: Region, buffer: Vec<f32>, corrected: &mut [f32]) -> Vec<f32> {
        let Operator { taps, isa } = self.operator;
        let fill = |c: usize, y: usize, columns: Range<usize>, out: &mut [f32]| {
            out.copy_from_slice(&self.row(image, c, y)[columns]);
        };
        let size = (self.height, self.width);
        let windows = Windows::of_region(size, region, fill, self.masked, self.sets[image], taps.radius(), buffer);
        let plane = self.height * self.width;
        let parameters = ParameterPlanes {
            form: self.form,
            values: self.parameters,
            start: image * self.form.parameters() * plane + region.top * self.width + region.left,
            plane,
            row: self.width,
        };
        Correction { windows: &windows, taps, region: region.at_origin(), parameters }.forward(*isa, corrected);
        windows.into_data()
    }

    /// A row of a feature, or, of channel 13, of the mask.
    fn row(&self, image: usize, c: usize, y: usize) -> &'a [f32] {
        let line = |planes: &'a [f32], plane: usize| &planes[(plane * self.height + y) * self.width..][..self.width];
        if c == FEATURE_CHANNELS { line(self.valid, 0) } else { line(self.features, image * FEATURE_CHANNELS + c) }
    }
}

/// Features that are not zero everywhere: the others' differences vanish, and the kernel skips them.
fn set_of(features: &[f32]) -> FeatureSet {
    let plane = features.len() / FEATURE_CHANNELS;
    FeatureSet::of(|role| {
        let first: usize = ORDER.iter().take_while(|&&other| other != role).map(|role| role.channels()).sum();
        features[first * plane..][..role.channels() * plane].iter().any(|&value| value != 0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use fastrand::Rng;
    use sspc_image::Image;

    struct Case {
        shapes: [Vec<usize>; 3],
        values: [Vec<f32>; 3],
    }

    impl Case {
        fn new(images: usize, parameters: usize, height: usize, width: usize) -> Self {
            let rng = &mut Rng::with_seed(1);
            let shapes = [
                vec![images, FEATURE_CHANNELS, height, width],
                vec![images, parameters, height, width],
                vec![1, 1, height, width],
            ];
            let mut values = shapes.each_ref().map(|shape| vec![0.0; shape.iter().product::<usize>()]);
            values[..2].iter_mut().flatten().for_each(|v| *v = rng.f32());
            values[2].fill(1.0);
            Self { shapes, values }
        }

        fn tensors(&self) -> [Tensor<'_>; 3] {
            std::array::from_fn(|i| Tensor { shape: self.shapes[i].clone(), values: &self.values[i] })
        }

        fn fault(&self) -> String {
            let (operator, tensors) = (Operator::new(9).unwrap(), self.tensors());
            Job::new(&operator, &tensors).err().expect("it does not fit")
        }

        fn run(&self, radius: i64) -> Vec<f32> {
            let (operator, tensors) = (Operator::new(radius).unwrap(), self.tensors());
            let job = Job::new(&operator, &tensors).unwrap();
            let mut out = vec![f32::NAN; job.output_shape().iter().product()];
            job.parts(&mut out).into_iter().for_each(|part| job.compute(part));
            out
        }
    }

    #[test]
    fn shapes_that_do_not_fit_are_named() {
        assert_eq!(
            Case { shapes: [vec![1, 12, 2, 2], vec![1, 15, 2, 2], vec![1, 1, 2, 2]], ..Case::new(1, 15, 2, 2) }.fault(),
            "features: expected [N, 13, H, W], found [1, 12, 2, 2]"
        );
        let expected = "parameters: expected [N, 15 or 16, H, W], found [1, 14, 2, 2] for features [1, 13, 2, 2]";
        assert_eq!(Case::new(1, 14, 2, 2).fault(), expected);
        let mut case = Case::new(2, 16, 3, 4);
        case.shapes[2] = vec![2, 1, 3, 4];
        assert_eq!(case.fault(), "valid: expected [1, 1, H, W], found [2, 1, 3, 4] for features [2, 13, 3, 4]");
        let mut case = Case::new(2, 16, 3, 4);
        case.values[1].pop();
        assert_eq!(case.fault(), "parameters: expected [N, 15 or 16, H, W], found [2, 16, 3, 4] with 383 values");
        let mut case = Case::new(2, 16, 3, 4);
        case.shapes[0] = vec![13, 12, 2];
        assert!(case.fault().starts_with("features: expected"));
        for radius in [0, 13, -1, i64::MAX] {
            let fault = Operator::new(radius).expect_err("no window");
            assert_eq!(fault, format!("window_radius: expected 1 to 12, found {radius}"));
        }
    }

    /// Against the kernel on windows of the whole picture; sizes on both sides of a tile's.
    #[test]
    fn tiles_do_not_show() {
        for (height, width, radius) in [(1, 1, 12), (33, 5, 3), (40, 300, 9), (64, 256, 1)] {
            let mut case = Case::new(2, 16, height, width);
            case.values[2][height * width / 2] = 0.0;
            let found = case.run(radius as i64);
            let (taps, pixels) = (Taps::square(radius), height * width);
            let valid = Image::from_planes(1, height, width, case.values[2].clone());
            for image in 0..2 {
                let of = |values: &[f32], planes: usize| values[image * planes * pixels..][..planes * pixels].to_vec();
                let features = Image::from_planes(13, height, width, of(&case.values[0], 13));
                let parameters = of(&case.values[1], 16);
                let windows = Windows::new(&features, Some(&valid), FeatureSet::ALL, radius);
                let region = Region::whole(height, width);
                let parameters = ParameterPlanes::of_region(Form::Gated, &parameters, &region);
                let mut expected = vec![0.0; 3 * pixels];
                Correction { windows: &windows, taps: &taps, region, parameters }.forward(Isa::best(), &mut expected);
                assert_eq!(of(&found, 3), expected, "{height}x{width}, image {image}");
            }
        }
    }

    #[test]
    fn z_stays_where_values_are_not_finite() {
        let mut case = Case::new(1, 15, 9, 70);
        case.values[0][3 * 70 + 5] = f32::NAN;
        case.values[1][14 * 630 + 600] = f32::INFINITY;
        let z = |case: &Case, k: usize, at: usize| case.values[0][(DENOISED + k) * 630 + at];
        let out = case.run(2);
        for k in 0..3 {
            // The window of the one, and the pixel of the other.
            for at in [70 + 5, 3 * 70 + 5, 3 * 70 + 7, 600] {
                assert_eq!(out[k * 630 + at], z(&case, k, at), "{at}");
            }
            assert_ne!(out[k * 630 + 3 * 70 + 8], z(&case, k, 3 * 70 + 8));
        }
        assert!(out.iter().all(|value| value.is_finite()));
    }

    #[test]
    fn pictures_without_pixels_give_none() {
        for (images, height, width) in [(0, 4, 4), (2, 0, 4), (2, 4, 0)] {
            assert!(Case::new(images, 16, height, width).run(9).is_empty());
        }
    }

    #[test]
    fn features_of_zeros_change_nothing() {
        let mut case = Case::new(1, 16, 20, 30);
        case.values[0][3 * 600..7 * 600].fill(0.0);
        assert_eq!(set_of(&case.values[0]), FeatureSet { normal: true, ..FeatureSet::NONE });
        let skipped = case.run(4);
        // Too small to count, but it makes the feature take part.
        case.values[0][3 * 600] = f32::MIN_POSITIVE;
        let counted = case.run(4);
        assert!(skipped.iter().zip(&counted).all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs()));
    }
}
