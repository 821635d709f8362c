//! Frames as files whose colour is the sum of passes.

use crate::exr_parts::write_mixed;
use sspc_core::rng::Rng;
use sspc_frames::error::Purpose;
use sspc_frames::exr_file::ExrFile;
use sspc_image::Image;
use std::path::Path;

/// A pass: its layer, its mean value, and the layer that it is multiplied by.
#[derive(Clone, Debug)]
pub struct Light {
    pub layer: String,
    pub level: f32,
    pub colour: Option<String>,
}

/// A frame of passes that add up to its colour.
#[derive(Clone, Debug)]
pub struct LitFrame {
    pub height: usize,
    pub width: usize,
    /// Layer of the colour: "" for R, G, B at the root.
    pub picture: String,
    pub lights: Vec<Light>,
    /// Whether the passes, and the colour, are half floats.
    pub half: [bool; 2],
    /// A pixel that is NaN in the first pass and the colour.
    pub missing: Option<(usize, usize)>,
    /// Columns from which on there is no noise.
    pub still_from: usize,
}

impl LitFrame {
    /// Of these layers, each twice as dark as the one before.
    pub fn new(height: usize, width: usize, layers: &[&str]) -> Self {
        let light = |(k, layer): (usize, &&str)| Light {
            layer: layer.to_string(),
            level: 0.5f32.powi(k.min(6) as i32),
            colour: None,
        };
        let lights = layers.iter().enumerate().map(light).collect();
        Self { height, width, picture: String::new(), lights, half: [false; 2], missing: None, still_from: width }
    }

    /// Writes `a.exr` and `b.exr`: the passes with noise of their own, their sum, a denoised picture of it and alpha.
    ///
    /// # Panics
    /// When the folder cannot be written to.
    pub fn write(&self, folder: &Path) {
        let colours: Vec<&String> = self.lights.iter().filter_map(|light| light.colour.as_ref()).collect();
        let (height, width) = (self.height, self.width);
        let mean = |k: usize, c: usize, y: usize, x: usize| {
            let wave = ((x as f32 * (0.2 + 0.1 * k as f32) + c as f32).sin() * (y as f32 * 0.3 + k as f32).cos()).abs();
            self.lights[k].level * (0.3 + wave)
        };
        let colour = |k: usize| {
            Image::from_fn(3, height, width, |c, y, x| {
                let dark = self.lights[k].colour.is_some() && (x / 4 + y / 4) % 5 == 0;
                let texture = 0.2 + 0.6 * ((x + 2 * y + c) % 3) as f32 / 3.0;
                if self.lights[k].colour.is_none() {
                    1.0
                } else if dark {
                    0.0
                } else {
                    texture
                }
            })
        };
        for (half, seed) in [("a.exr", 1), ("b.exr", 2)] {
            let (mut rng, mut still) = (Rng::new(seed), Rng::new(3));
            let mut passes: Vec<Image> = Vec::new();
            for k in 0..self.lights.len() {
                passes.push(Image::from_fn(3, height, width, |c, y, x| {
                    let noise = if x >= self.still_from { still.normal() } else { rng.normal() };
                    let value = mean(k, c, y, x) * (1.0 + 0.3 * noise);
                    if self.missing == Some((y, x)) && k == 0 { f32::NAN } else { value }
                }));
            }
            let sum = |of: &dyn Fn(usize, usize, usize, usize) -> f32| {
                Image::from_fn(3, height, width, |c, y, x| {
                    (0..self.lights.len()).map(|k| colour(k).at(c, y, x) * of(k, c, y, x)).sum()
                })
            };
            // Colours are made once: frames are small.
            let of_passes: Vec<Image> = (0..self.lights.len()).map(colour).collect();
            let noisy = Image::from_fn(3, height, width, |c, y, x| {
                passes.iter().zip(&of_passes).map(|(p, q)| q.at(c, y, x) * p.at(c, y, x)).sum()
            });
            let denoised = if self.lights.len() * height * width < 20_000 {
                sum(&|k, c, y, x| mean(k, c, y, x) * if seed == 1 { 1.02 } else { 0.99 })
            } else {
                noisy.clone()
            };
            let alpha = Image::from_fn(1, height, width, |_, _, x| {
                let share = (1.0 - x as f32 / width as f32).clamp(0.0, 1.0);
                // Hair before nothing: samples hit it or miss it.
                let hits = (0..4).filter(|_| rng.uniform() < share).count();
                hits as f32 / 4.0
            });
            let dot = |layer: &str, end: &str| if layer.is_empty() { end.to_string() } else { format!("{layer}{end}") };
            let denoised_layer = dot(&self.picture, "_denoised").trim_start_matches('_').to_string();
            let mut layers: Vec<(&str, &str, &Image, bool)> = vec![
                (&self.picture, "RGB", &noisy, self.half[1]),
                (&self.picture, "A", &alpha, self.half[1]),
                (&denoised_layer, "RGB", &denoised, false),
            ];
            for (light, pass) in self.lights.iter().zip(&passes) {
                layers.push((&light.layer, "RGB", pass, self.half[0]));
            }
            let mut written: Vec<&str> = Vec::new();
            for (k, name) in self.lights.iter().enumerate().filter_map(|(k, light)| Some((k, light.colour.as_ref()?))) {
                if !written.contains(&name.as_str()) {
                    written.push(name);
                    layers.push((name, "RGB", &of_passes[k], self.half[0]));
                }
            }
            assert_eq!(written.is_empty(), colours.is_empty());
            write_mixed(&folder.join(half), &layers);
        }
    }

    /// The largest |Σ passes - colour| of a file, in parts of the largest pass of the pixel.
    ///
    /// # Panics
    /// When a layer is missing, or a value is not finite.
    pub fn sum_error(&self, path: &Path) -> f64 {
        let layer = |name: &str| read_layer(path, name, "RGB");
        let picture = layer(&self.picture);
        let passes: Vec<(Image, Option<Image>)> =
            self.lights.iter().map(|light| (layer(&light.layer), light.colour.as_deref().map(layer))).collect();
        let mut worst: f64 = 0.0;
        for i in 0..3 * picture.pixels() {
            let value = |(pass, colour): &(Image, Option<Image>)| {
                f64::from(pass.data()[i]) * colour.as_ref().map_or(1.0, |colour| f64::from(colour.data()[i]))
            };
            let values: Vec<f64> = passes.iter().map(value).collect();
            let target = f64::from(picture.data()[i]);
            assert!(target.is_finite() && values.iter().all(|v| v.is_finite()), "value {i}: {target}, {values:?}");
            let largest = values.iter().fold(target.abs(), |largest, v| largest.max(v.abs()));
            worst = worst.max((values.iter().sum::<f64>() - target).abs() / largest.max(1e-6));
        }
        worst
    }
}

/// A layer of a file, by its whole name and its endings.
///
/// # Panics
/// When it is not there.
pub fn read_layer(path: &Path, layer: &str, endings: &str) -> Image {
    let file = ExrFile::open(path, Purpose::Picture).expect("a file");
    let name = |end: char| if layer.is_empty() { end.to_string() } else { format!("{layer}.{end}") };
    let channels = endings.chars().map(|end| file.channel_named(&name(end)).expect("a channel")).collect();
    file.images(&[channels]).expect("pixels").remove(0)
}
