//! Repeats an OpenEXR file side by side and below until it fills a size, all parts and channels, sample types kept,
//! ZIP: how `tests/scale` makes large frames of small ones.
//!
//!     cargo run --release --example tile -- IN.exr OUT.exr WIDTH HEIGHT

use exr::compression::Compression;
use exr::image::FlatSamples;
use exr::math::Vec2;
use exr::meta::attribute::IntegerBounds;
use exr::prelude::{ReadChannels, ReadLayers, WritableImage};
use sspc_core::io::atomic_write;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, width, height] = arguments.as_slice() else {
        return Err("expected IN.exr OUT.exr WIDTH HEIGHT".into());
    };
    let size = Vec2(width.parse()?, height.parse()?);
    let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().all_layers();
    let mut image = reader.all_attributes().from_file(input)?;
    image.attributes.display_window = IntegerBounds::from_dimensions(size);
    for layer in &mut image.layer_data {
        let small = std::mem::replace(&mut layer.size, size);
        layer.attributes.layer_position = Vec2(0, 0);
        layer.encoding.compression = Compression::ZIP16;
        for channel in &mut layer.channel_data.list {
            channel.sample_data = match &channel.sample_data {
                FlatSamples::F16(samples) => FlatSamples::F16(tiled(samples, small, size)),
                FlatSamples::F32(samples) => FlatSamples::F32(tiled(samples, small, size)),
                FlatSamples::U32(samples) => FlatSamples::U32(tiled(samples, small, size)),
            };
        }
    }
    let inputs = [PathBuf::from(input)];
    atomic_write(output.as_ref(), &inputs, |out| image.write().to_buffered(out).map_err(std::io::Error::other))?;
    Ok(())
}

/// Rows of `small` repeated to rows of `size`.
fn tiled<T: Copy>(samples: &[T], small: Vec2<usize>, size: Vec2<usize>) -> Vec<T> {
    let mut out = Vec::with_capacity(size.area());
    for y in 0..size.height() {
        let row = &samples[y % small.height() * small.width()..][..small.width()];
        out.extend(row.iter().cycle().take(size.width()));
    }
    out
}
