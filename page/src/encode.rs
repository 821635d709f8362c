//! Pictures as data URIs that fit a number of bytes: PNG where it does, else JPEG of the highest quality that does.
//!
//! Denoised, corrected and reference share one quality, so that a difference between them is not one of compression. The
//! noisy picture and the maps, noise themselves, take most of the bytes and show least of what compression takes: theirs
//! falls first.

use crate::picture::{NOISY, Picture, Scale};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use rayon::prelude::*;
use sspc_frames::preview::Rgb8;

/// Qualities of JPEG that are tried, best first, of smooth pictures and of noisy ones: colour at full resolution, then
/// (below [`FULL_COLOUR`]) at half.
const QUALITIES: [[u8; 2]; 10] =
    [[98, 98], [96, 94], [95, 90], [94, 84], [93, 78], [92, 68], [90, 58], [87, 50], [84, 44], [78, 38]];
/// Lowest quality with colour at full resolution.
const FULL_COLOUR: u8 = 84;
/// PNG of a render takes more bytes per pixel than this: where there are fewer it is not tried.
const LEAST_OF_PNG: f64 = 0.8;
/// Rows of a picture in the strip of a shot.
const THUMBNAIL_ROWS: usize = 96;
/// Quality of a picture in the strip.
const THUMBNAIL_QUALITY: u8 = 85;
/// Longest side that JPEG can have.
const LONGEST_JPEG: usize = 65_535;
/// Below this many pixels a picture is not made smaller any more.
const SMALLEST: usize = 32 * 32;

/// A picture that cannot be encoded.
#[derive(Debug, thiserror::Error)]
pub enum EncodeError {
    /// By the PNG encoder.
    #[error("cannot encode a picture as PNG: {0}")]
    Png(#[from] png::EncodingError),
    /// By the JPEG encoder.
    #[error("cannot encode a picture as JPEG: {0}")]
    Jpeg(#[from] jpeg_encoder::EncodingError),
}

/// How the pictures of a frame were stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// A data URI for each picture.
    pub uris: Vec<String>,
    /// In words: format, quality, size.
    pub how: String,
}

/// All pictures of a frame in at most `bytes` bytes of text, or as few as a small picture takes.
///
/// # Errors
/// [`EncodeError`], which no picture with at least one pixel should raise.
pub fn encode(pictures: &[Picture], bytes: usize) -> Result<Encoded, EncodeError> {
    let pixels: usize = pictures.iter().map(|p| p.pixels.width * p.pixels.height).sum();
    if bytes as f64 >= LEAST_OF_PNG * pixels as f64 {
        let uris = uris(pictures, |picture| png_uri(&picture.pixels))?;
        if length(&uris) <= bytes {
            return Ok(Encoded { uris, how: "PNG, lossless".into() });
        }
    }
    let mut smaller: Vec<Picture> = Vec::new();
    let mut shrunk = 1;
    loop {
        let now = if shrunk == 1 { pictures } else { &smaller };
        let fits_jpeg = now.iter().all(|p| p.pixels.width.max(p.pixels.height) <= LONGEST_JPEG);
        let last = now.iter().all(|p| p.pixels.width * p.pixels.height <= SMALLEST);
        for qualities in QUALITIES.into_iter().filter(|_| fits_jpeg) {
            let [smooth, noisy] = qualities;
            let uris = uris(now, |picture| jpeg_uri(&picture.pixels, if is_noisy(picture) { noisy } else { smooth }))?;
            if length(&uris) <= bytes || (last && qualities == QUALITIES[QUALITIES.len() - 1]) {
                let size = if shrunk == 1 { String::new() } else { format!(", at 1/{shrunk} of the frame's size") };
                let how = format!("JPEG of quality {smooth}, noisy picture and maps {noisy}{size}");
                return Ok(Encoded { uris, how });
            }
        }
        smaller = now.par_iter().map(|p| Picture { pixels: halved(&p.pixels), ..p.clone() }).collect();
        shrunk *= 2;
    }
}

/// A small picture for the strip of a shot, as a data URI.
///
/// # Errors
/// As [`encode`].
pub fn thumbnail(picture: &Rgb8) -> Result<String, EncodeError> {
    let mut small = picture.clone();
    while small.height > 2 * THUMBNAIL_ROWS || small.width > LONGEST_JPEG {
        small = halved(&small);
    }
    jpeg_uri(&small, THUMBNAIL_QUALITY)
}

fn uris(
    pictures: &[Picture],
    encode: impl Fn(&Picture) -> Result<String, EncodeError> + Sync,
) -> Result<Vec<String>, EncodeError> {
    pictures.par_iter().map(&encode).collect()
}

/// Whether compression may take more of a picture.
fn is_noisy(picture: &Picture) -> bool {
    picture.scale != Scale::Radiance || picture.label == NOISY
}

fn length(uris: &[String]) -> usize {
    uris.iter().map(String::len).sum()
}

fn png_uri(picture: &Rgb8) -> Result<String, EncodeError> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, picture.width as u32, picture.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&picture.data)?;
    writer.finish()?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(&out)))
}

fn jpeg_uri(picture: &Rgb8, quality: u8) -> Result<String, EncodeError> {
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, quality);
    encoder.set_sampling_factor(if quality < FULL_COLOUR { SamplingFactor::F_2_2 } else { SamplingFactor::F_1_1 });
    encoder.set_optimized_huffman_tables(true);
    encoder.encode(&picture.data, picture.width as u16, picture.height as u16, ColorType::Rgb)?;
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(&out)))
}

/// Means of two by two pixels, of fewer at an odd edge.
fn halved(picture: &Rgb8) -> Rgb8 {
    let (width, height) = (picture.width.div_ceil(2), picture.height.div_ceil(2));
    let mut data = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for x in 0..width {
            let rows = 2 * y..(2 * y + 2).min(picture.height);
            let columns = 2 * x..(2 * x + 2).min(picture.width);
            let count = (rows.len() * columns.len()) as u32;
            for channel in 0..3 {
                let at = |row, column| u32::from(picture.data[3 * (row * picture.width + column) + channel]);
                let sum: u32 = rows.clone().flat_map(|row| columns.clone().map(move |c| at(row, c))).sum();
                data.push(((sum + count / 2) / count) as u8);
            }
        }
    }
    Rgb8 { width, height, data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::{FRAME_BYTES, FULL_HD, of_frame};

    /// White noise is the largest picture there is: no format makes it smaller.
    fn noise(width: usize, height: usize) -> Picture {
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        let data = (0..3 * width * height).map(|_| next()).collect();
        Picture { label: NOISY, scale: Scale::Radiance, pixels: Rgb8 { width, height, data } }
    }

    fn decoded_png(uri: &str) -> Rgb8 {
        let bytes = STANDARD.decode(uri.strip_prefix("data:image/png;base64,").expect("a PNG")).expect("base64");
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a header");
        let mut data = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut data).expect("pixels");
        Rgb8 { width: info.width as usize, height: info.height as usize, data }
    }

    #[test]
    fn small_pictures_stay_lossless() {
        let picture = noise(33, 17);
        let encoded = encode(std::slice::from_ref(&picture), FRAME_BYTES).expect("encoded");
        assert_eq!(encoded.how, "PNG, lossless");
        assert_eq!(decoded_png(&encoded.uris[0]), picture.pixels);
    }

    #[test]
    fn the_worst_full_hd_frame_fits_its_bytes() {
        let picture = noise(1920, 1080);
        let pictures = vec![picture; 7];
        let encoded = encode(&pictures, of_frame(FULL_HD, 1)).expect("encoded");
        assert!(length(&encoded.uris) <= FRAME_BYTES, "{} bytes", length(&encoded.uris));
        assert!(encoded.how.contains("JPEG") && encoded.how.contains("1/"), "{}", encoded.how);
    }

    #[test]
    fn what_is_compared_keeps_one_quality_above_that_of_noise() {
        let corrected = Picture { label: "corrected", ..noise(128, 96) };
        let error = Picture { label: "error, corrected", scale: Scale::Error, ..noise(128, 96) };
        let pictures = [noise(128, 96), Picture { label: "denoised", ..corrected.clone() }, corrected, error];
        let uris = encode(&pictures, 120_000).expect("encoded").uris;
        assert_eq!(uris[1], uris[2]);
        assert_eq!(uris[0], uris[3]);
        assert!(uris[0].len() < uris[1].len());
    }

    #[test]
    fn fewer_bytes_give_lower_quality_and_never_more_than_asked() {
        let pictures = [noise(200, 100)];
        let mut before = usize::MAX;
        for bytes in [60_000, 30_000, 10_000, 3_000] {
            let now = length(&encode(&pictures, bytes).expect("encoded").uris);
            assert!(now <= bytes && now < before, "{now} of {bytes}, {before} before");
            before = now;
        }
    }

    #[test]
    fn the_smallest_picture_ends_the_search() {
        let encoded = encode(&[noise(40, 40)], 1).expect("encoded");
        assert!(encoded.how.starts_with("JPEG of quality 78, noisy picture and maps 38"), "{}", encoded.how);
    }

    #[test]
    fn halving_takes_means_and_keeps_odd_edges() {
        let picture = Rgb8 { width: 3, height: 1, data: vec![0, 0, 0, 4, 8, 2, 9, 9, 9] };
        assert_eq!(halved(&picture), Rgb8 { width: 2, height: 1, data: vec![2, 4, 1, 9, 9, 9] });
    }
}
