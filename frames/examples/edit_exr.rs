//! Cuts, repeats or blanks OpenEXR files, all parts and channels, sample types kept, ZIP: how the sample frames of the
//! repository were made, and how benchmarks make large frames and one with an empty half.
//!
//!     cargo run --release -p sspc-frames --example edit_exr -- crop IN.exr OUT.exr LEFT TOP WIDTH HEIGHT
//!     ... mirror IN.exr OUT.exr WIDTH HEIGHT                  copies, every second one mirrored, until the size is filled
//!     ... blank IN.exr OUT.exr LEFT TOP WIDTH HEIGHT          a rectangle of zeros

use exr::compression::Compression;
use exr::image::FlatSamples;
use exr::math::Vec2;
use exr::meta::attribute::IntegerBounds;
use exr::prelude::{ReadChannels, ReadLayers, WritableImage};
use sspc_frames::atomic_write;
use sspc_kernels::windows::mirrored;
use std::path::PathBuf;

const USAGE: &str = "expected crop|blank IN.exr OUT.exr LEFT TOP WIDTH HEIGHT, or mirror IN.exr OUT.exr WIDTH HEIGHT";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [what, input, output, numbers @ ..] = arguments.as_slice() else { return Err(USAGE.into()) };
    let numbers: Vec<usize> = numbers.iter().map(|text| text.parse()).collect::<Result<_, _>>()?;
    let edit = Edit::of(what, &numbers).ok_or(USAGE)?;
    let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().all_layers();
    let mut image = reader.all_attributes().from_file(input)?;
    for layer in &mut image.layer_data {
        let Vec2(width, height) = layer.size;
        let size = edit.size(width, height)?;
        image.attributes.display_window = IntegerBounds::from_dimensions(size);
        layer.attributes.layer_position = Vec2(0, 0);
        layer.size = size.into();
        layer.encoding.compression = Compression::ZIP16;
        for channel in &mut layer.channel_data.list {
            channel.sample_data = match &channel.sample_data {
                FlatSamples::F16(samples) => FlatSamples::F16(edit.apply(samples, width, size)),
                FlatSamples::F32(samples) => FlatSamples::F32(edit.apply(samples, width, size)),
                FlatSamples::U32(samples) => FlatSamples::U32(edit.apply(samples, width, size)),
            };
        }
    }
    let inputs = [PathBuf::from(input)];
    atomic_write(output.as_ref(), &inputs, |out| image.write().to_buffered(out).map_err(std::io::Error::other))?;
    Ok(())
}

enum Edit {
    Crop(Rectangle),
    Mirror { width: usize, height: usize },
    Blank(Rectangle),
}

struct Rectangle {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Edit {
    fn of(what: &str, numbers: &[usize]) -> Option<Edit> {
        match (what, numbers) {
            ("crop", &[left, top, width, height]) => Some(Edit::Crop(Rectangle { left, top, width, height })),
            ("blank", &[left, top, width, height]) => Some(Edit::Blank(Rectangle { left, top, width, height })),
            ("mirror", &[width, height]) if width * height > 0 => Some(Edit::Mirror { width, height }),
            _ => None,
        }
    }

    /// Width and height of the result.
    fn size(&self, width: usize, height: usize) -> Result<(usize, usize), String> {
        match self {
            Edit::Mirror { width, height } => Ok((*width, *height)),
            Edit::Crop(r) | Edit::Blank(r) if r.left + r.width > width || r.top + r.height > height => {
                Err(format!("{}x{} at ({}, {}) leaves {width}x{height}", r.width, r.height, r.left, r.top))
            }
            Edit::Crop(r) => Ok((r.width, r.height)),
            Edit::Blank(_) => Ok((width, height)),
        }
    }

    /// One channel, of pictures `width` and then `size` wide.
    fn apply<T: Copy + Default>(&self, samples: &[T], width: usize, size: (usize, usize)) -> Vec<T> {
        let height = samples.len() / width.max(1);
        let pixels = (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y)));
        let value = |(x, y): (usize, usize)| match self {
            Edit::Crop(r) => samples[(r.top + y) * width + r.left + x],
            Edit::Mirror { .. } => samples[mirrored(y as isize, height) * width + mirrored(x as isize, width)],
            Edit::Blank(r) if (r.left..r.left + r.width).contains(&x) && (r.top..r.top + r.height).contains(&y) => {
                T::default()
            }
            Edit::Blank(_) => samples[y * width + x],
        };
        pixels.map(value).collect()
    }
}
