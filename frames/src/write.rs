//! Files of one picture that no template exists for.

use crate::atomic::atomic_write;
use crate::container::attributes::{Header, Preamble, VERSION};
use crate::container::channels::{ChannelEntry, channel_bytes};
use crate::container::chunks::{block, blocks_of_rows, chunk_bytes, compress};
use crate::container::fault::Fault;
use crate::container::part::Part;
use crate::container::pixels::store_line;
use crate::error::Error;
use crate::output::attribute_text;
use exr::meta::attribute::SampleType;
use rayon::prelude::*;
use sspc_image::Image;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// ZIP of 16 rows, by its number in the format.
const ZIP: u8 = 3;

/// Writes a picture of its own, `[3, H, W]` as f32 R,G,B with ZIP, with provenance as text attributes.
///
/// # Errors
/// As [`atomic_write`].
pub fn write_picture(
    path: &Path,
    inputs: &[PathBuf],
    picture: &Image,
    provenance: &[(String, String)],
) -> Result<(), Error> {
    let part = part_of(picture, provenance);
    atomic_write(path, inputs, |out| {
        let part = part.map_err(io_error)?;
        let preamble = Preamble { version: VERSION, headers: vec![part.header.clone()] }.to_bytes();
        let encode = |index| encode(&part, index, picture);
        let chunks: Vec<Vec<u8>> = blocks_of_rows(&part, &(0..picture.height()))
            .into_par_iter()
            .map(encode)
            .collect::<Result<_, _>>()
            .map_err(io_error)?;
        let mut offset = (preamble.len() + 8 * chunks.len()) as u64;
        out.write_all(&preamble)?;
        for chunk in &chunks {
            out.write_all(&offset.to_le_bytes())?;
            offset += chunk.len() as u64;
        }
        chunks.iter().try_for_each(|chunk| out.write_all(chunk))
    })
}

fn part_of(picture: &Image, provenance: &[(String, String)]) -> Result<Part, Fault> {
    let channels = [b"B", b"G", b"R"].map(|name| ChannelEntry::new(name, SampleType::F32));
    let corner = |length: usize| i32::try_from(length).unwrap_or(i32::MAX) - 1;
    let window = [0, 0, corner(picture.width()), corner(picture.height())].map(i32::to_le_bytes).concat();
    let mut header = Header::default();
    header.set("channels", "chlist", channel_bytes(&channels));
    header.set("compression", "compression", vec![ZIP]);
    header.set("dataWindow", "box2i", window.clone());
    header.set("displayWindow", "box2i", window);
    header.set("lineOrder", "lineOrder", vec![0]);
    header.set("pixelAspectRatio", "float", 1.0f32.to_le_bytes().to_vec());
    header.set("screenWindowCenter", "v2f", vec![0; 8]);
    header.set("screenWindowWidth", "float", 1.0f32.to_le_bytes().to_vec());
    for (name, value) in provenance.iter().map(attribute_text) {
        header.set(&name, "string", value.into_bytes());
    }
    Part::of(header, VERSION)
}

/// The chunk of some rows: B, G, R line by line.
fn encode(part: &Part, index: usize, picture: &Image) -> Result<Vec<u8>, Fault> {
    let place = block(part, index);
    let mut pixels = Vec::with_capacity(place.width * place.height * part.bytes_per_pixel());
    for y in place.top..place.top + place.height {
        (0..3).rev().for_each(|c| store_line(picture.row(c, y), SampleType::F32, &mut pixels));
    }
    let data = compress(&part.codec_header(), place, pixels)?;
    Ok(chunk_bytes(part, None, place, &data))
}

fn io_error(fault: Fault) -> io::Error {
    match fault {
        Fault::Io(error) => error,
        other => io::Error::other(format!("{other:?}")),
    }
}
