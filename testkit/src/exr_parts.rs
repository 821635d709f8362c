//! Small OpenEXR files, written part by part.

use exr::compression::Compression;
use exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image, Layer, Layers};
use exr::meta::attribute::{LineOrder, Text};
use exr::meta::header::LayerAttributes;
use exr::prelude::{WritableImage, f16};
use sspc_frames::error::Error;
use sspc_frames::{FrameFiles, OpenFrame, RoleOverrides};
use sspc_image::Image as Picture;
use std::path::{Path, PathBuf};

pub const W: usize = 7;
pub const H: usize = 5;

/// A part: its name and its channels, each filled by `value(channel, pixel)`.
pub struct Part<'a> {
    pub name: &'a str,
    pub channels: &'a [&'a str],
    pub size: (usize, usize),
    pub position: (i32, i32),
    pub half: bool,
    pub compression: Compression,
    /// Width and height of tiles; scan lines when `None`.
    pub tiles: Option<(usize, usize)>,
}

impl Default for Part<'_> {
    fn default() -> Self {
        Self {
            name: "",
            channels: &[],
            size: (W, H),
            position: (0, 0),
            half: false,
            compression: Compression::ZIP16,
            tiles: None,
        }
    }
}

/// Different in every file (`seed`), channel and pixel, in 0..1, without any structure.
pub fn value(seed: u64, channel: &str, pixel: usize) -> f32 {
    let mut x = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (pixel as u64).wrapping_mul(0xD1B5_4A32_D192_ED03);
    for byte in channel.bytes() {
        x = (x ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
    }
    x ^= x >> 31;
    x = x.wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^= x >> 29;
    (x >> 40) as f32 / (1u64 << 24) as f32
}

/// Writes a file of these parts; one part makes a single-part file.
pub fn write_parts(path: &Path, seed: u64, parts: &[Part]) -> PathBuf {
    let layers: Layers<AnyChannels<FlatSamples>> = parts.iter().map(|part| layer(seed, part)).collect();
    let attributes = exr::meta::header::ImageAttributes::with_size(parts[0].size);
    Image::from_layers(attributes, layers).write().to_file(path).expect("test file");
    path.to_path_buf()
}

/// One part, f32, W x H.
pub fn write_file(path: &Path, seed: u64, channels: &[&str]) -> PathBuf {
    write_parts(path, seed, &[Part { channels, ..Part::default() }])
}

fn layer(seed: u64, part: &Part) -> Layer<AnyChannels<FlatSamples>> {
    let pixels = part.size.0 * part.size.1;
    let list = part.channels.iter().map(|&name| {
        let values = (0..pixels).map(|pixel| value(seed, name, pixel));
        let samples = match part.half {
            true => FlatSamples::F16(values.map(f16::from_f32).collect()),
            false => FlatSamples::F32(values.collect()),
        };
        AnyChannel::new(name, samples)
    });
    let blocks = part.tiles.map_or(Blocks::ScanLines, |tile| Blocks::Tiles(tile.into()));
    let encoding = Encoding { compression: part.compression, blocks, line_order: LineOrder::Increasing };
    let mut attributes = LayerAttributes { layer_position: part.position.into(), ..LayerAttributes::default() };
    if !part.name.is_empty() {
        attributes.layer_name = Some(Text::from(part.name));
    }
    Layer::new(part.size, attributes, encoding, AnyChannels::sort(list.collect()))
}

pub const HALF: &[&str] = &[
    "R",
    "G",
    "B",
    "A",
    "denoised.R",
    "denoised.G",
    "denoised.B",
    "albedo.R",
    "albedo.G",
    "albedo.B",
    "normal.X",
    "normal.Y",
    "normal.Z",
    "visibility.Y",
];

/// Two complete halves in `folder`.
pub fn write_halves(folder: &Path) -> (PathBuf, PathBuf) {
    (write_file(&folder.join("a.exr"), 1, HALF), write_file(&folder.join("b.exr"), 2, HALF))
}

/// Writes a picture `[3, H, W]` by itself, as f32 R,G,B with ZIP, top row first.
///
/// # Panics
/// When the folder cannot be written to.
pub fn write_picture(path: &Path, picture: &Picture) {
    write_layers(path, &[("", "RGB", picture)]);
}

/// Writes pictures of one size as layers of one part, each with the endings of its channels.
///
/// # Panics
/// When there is none, or the folder cannot be written to.
pub fn write_layers(path: &Path, layers: &[(&str, &str, &Picture)]) {
    write_mixed(
        path,
        &layers.iter().map(|(layer, endings, picture)| (*layer, *endings, *picture, false)).collect::<Vec<_>>(),
    );
}

/// The same, each as half floats where that is said.
///
/// # Panics
/// When there is none, or the folder cannot be written to.
pub fn write_mixed(path: &Path, layers: &[(&str, &str, &Picture, bool)]) {
    write_seen(path, layers, None);
}

/// The same, with the camera's matrix in the attribute `worldToNDC`.
///
/// # Panics
/// When there is none, or the folder cannot be written to.
pub fn write_seen(path: &Path, layers: &[(&str, &str, &Picture, bool)], camera: Option<[f32; 16]>) {
    let picture = layers[0].2;
    let list = layers.iter().flat_map(|(layer, endings, picture, half)| {
        endings.chars().enumerate().map(move |(c, ending)| {
            let name = if layer.is_empty() { ending.to_string() } else { format!("{layer}.{ending}") };
            let plane = picture.plane(c);
            let samples = match half {
                true => FlatSamples::F16(plane.iter().map(|v| f16::from_f32(*v)).collect()),
                false => FlatSamples::F32(plane.to_vec()),
            };
            AnyChannel::new(name.as_str(), samples)
        })
    });
    let line_order = LineOrder::Increasing;
    let encoding = Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order };
    let size = (picture.width(), picture.height());
    let attributes = LayerAttributes { world_to_normalized_device: camera, ..LayerAttributes::default() };
    let layer = Layer::new(size, attributes, encoding, AnyChannels::sort(list.collect()));
    Image::from_layer(layer).write().to_file(path).expect("test file");
}

/// Writes a picture in the place of the noisy colour of `template`, as the programs do of half a.
///
/// # Errors
/// What the programs refuse.
pub fn write_over(
    path: &Path,
    template: &Path,
    picture: &Picture,
    provenance: &[(String, String)],
) -> Result<(), Error> {
    let pair = FrameFiles::halves(template, template).with_denoised(Some(template.into()), Some(template.into()), None);
    let open = OpenFrame::open(&pair, &RoleOverrides::none())
        .or_else(|_| OpenFrame::open(&FrameFiles::both_in_one(template), &RoleOverrides::none()))?;
    open.output()?.write(path, &[], &[picture], provenance)
}
