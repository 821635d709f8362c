//! Cuts a rectangle out of an OpenEXR file, all parts and channels, sample types kept, ZIP: how the sample frames of
//! the repository were made.
//!
//!     cargo run --release -p sspc-core --example crop -- IN.exr OUT.exr LEFT TOP WIDTH HEIGHT

use exr::compression::Compression;
use exr::image::FlatSamples;
use exr::math::Vec2;
use exr::meta::attribute::IntegerBounds;
use exr::prelude::{ReadChannels, ReadLayers, WritableImage};
use sspc_core::io::atomic_write;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, numbers @ ..] = arguments.as_slice() else {
        return Err("expected IN.exr OUT.exr LEFT TOP WIDTH HEIGHT".into());
    };
    let numbers: Vec<usize> = numbers.iter().map(|text| text.parse()).collect::<Result<_, _>>()?;
    let &[left, top, width, height] = numbers.as_slice() else {
        return Err("expected LEFT TOP WIDTH HEIGHT".into());
    };
    let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().all_layers();
    let mut image = reader.all_attributes().from_file(input)?;
    image.attributes.display_window = IntegerBounds::from_dimensions((width, height));
    for layer in &mut image.layer_data {
        let Vec2(full_width, full_height) = layer.size;
        if left + width > full_width || top + height > full_height {
            return Err(format!("{width}x{height} at ({left}, {top}) leaves {full_width}x{full_height}").into());
        }
        layer.attributes.layer_position = Vec2(0, 0);
        layer.size = Vec2(width, height);
        layer.encoding.compression = Compression::ZIP16;
        for channel in &mut layer.channel_data.list {
            let rectangle = Rectangle { left, top, width, height, stride: full_width };
            channel.sample_data = match &channel.sample_data {
                FlatSamples::F16(samples) => FlatSamples::F16(rectangle.cut(samples)),
                FlatSamples::F32(samples) => FlatSamples::F32(rectangle.cut(samples)),
                FlatSamples::U32(samples) => FlatSamples::U32(rectangle.cut(samples)),
            };
        }
    }
    let inputs = [PathBuf::from(input)];
    atomic_write(output.as_ref(), &inputs, |out| image.write().to_buffered(out).map_err(std::io::Error::other))?;
    Ok(())
}

struct Rectangle {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
    stride: usize,
}

impl Rectangle {
    fn cut<T: Copy>(&self, samples: &[T]) -> Vec<T> {
        let rows = (self.top..self.top + self.height).map(|y| y * self.stride + self.left);
        rows.flat_map(|start| samples[start..start + self.width].iter().copied()).collect()
    }
}
