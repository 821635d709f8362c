//! Denoised pictures of additive passes: of each one of all samples, and what those of a set make together, of each half too.

use crate::denoising::{BUFFERS, Denoising, ROWS, mean};
use crate::failure::Failure;
use crate::interrupt;
use sspc_frames::open::NoisyHalf;
use sspc_frames::passes::OpenSet;
use sspc_frames::{MadeVariant, OpenFrame, OpenPasses};
use sspc_image::{Buffer, CompactImage, HalfWeights, Image, Role};
use sspc_oidn::buffers::mean_of_finite;
use sspc_oidn::{Picture, Rows};

/// A pass whose sum is below this share of its size subtracts light.
const POSITIVE: f64 = 0.999;
/// Most memory for pictures that are read together; larger ones are read one by one.
const TOGETHER_BYTES: usize = 512 << 20;
/// Of a pixel: colour, albedo and normal.
const BYTES_PER_PIXEL: usize = 9 * size_of::<f32>();

/// Denoised pictures of additive passes.
#[derive(Default)]
pub struct DenoisedPasses {
    /// Of each pass, of all samples; `None` for a pass without noise, and for one with light that is subtracted, which the
    /// library does not know.
    pub full: Vec<Option<CompactImage>>,
    /// Passes that add up, each times its colour, of each half and of all samples.
    pub composite: Option<MadeVariant>,
}

impl Denoising<'_> {
    /// Denoises every pass by itself, and of the set that is put together each half too.
    ///
    /// # Errors
    /// As [`Self::supply`].
    pub fn passes(&self, open: &OpenFrame, passes: &OpenPasses) -> Result<DenoisedPasses, Failure> {
        // Lobes, whose colours are not denoised, rather than lights.
        let has_colour = |set: &&OpenSet| passes.passes[set.passes.clone()].iter().any(|pass| pass.colour.is_some());
        let together = passes.sets.iter().find(has_colour).or(passes.sets.first()).map(|set| set.passes.clone());
        let mut sums = together.is_some().then(|| BUFFERS.map(|_| Image::zeros(3, open.height(), open.width())));
        let mut full = Vec::new();
        let held = Held::read(open, passes)?;
        for k in 0..passes.passes.len() {
            let is_part = together.as_ref().is_some_and(|set| set.contains(&k));
            let buffers: &[Buffer] = if is_part { &BUFFERS } else { &[Buffer::Full] };
            let pictures = self.pass(open, passes, held.as_ref(), k, buffers)?;
            if let Some(sums) = sums.as_mut().filter(|_| is_part) {
                let pictures = (0..BUFFERS.len()).map(|at| pictures.as_ref().map(|pictures| &pictures[at]));
                add_pass(sums, passes, k, open.weights(), &pictures.collect::<Vec<_>>())?;
            }
            full.push(pictures.and_then(|mut pictures| pictures.pop()));
        }
        let made = |sums: [Image; 3]| {
            let [a, b, full] = sums.map(|sum| CompactImage::of(&sum));
            MadeVariant { halves: [a, b], full }
        };
        Ok(DenoisedPasses { full, composite: sums.map(made) })
    }

    /// Denoised pictures of a pass of these buffers.
    fn pass(
        &self,
        open: &OpenFrame,
        passes: &OpenPasses,
        held: Option<&Held>,
        k: usize,
        buffers: &[Buffer],
    ) -> Result<Option<Vec<CompactImage>>, Failure> {
        let bytes = buffers.len() * BYTES_PER_PIXEL * open.height() * open.width();
        let at_once = if bytes <= TOGETHER_BYTES { buffers.len() } else { 1 };
        let mut denoised = Vec::new();
        for buffers in buffers.chunks(at_once) {
            let Some(pictures) = read_pass(open, passes, held, k, buffers)? else { return Ok(None) };
            for picture in pictures {
                interrupt::check()?;
                denoised.extend(self.plain(open, picture)?);
            }
        }
        Ok(Some(denoised))
    }
}

/// All passes of a frame and what guides their denoiser, where memory holds them: files keep all layers of some rows together,
/// so that whoever reads one pass decompresses all.
struct Held {
    passes: Vec<[Image; 2]>,
    guides: [NoisyHalf; 2],
    of_both: NoisyHalf,
}

impl Held {
    fn read(open: &OpenFrame, passes: &OpenPasses) -> Result<Option<Self>, Failure> {
        let planes = 2 * 3 * (passes.passes.len() + passes.colours.len()) + 3 * BYTES_PER_PIXEL / size_of::<f32>();
        if planes * size_of::<f32>() * open.height() * open.width() > TOGETHER_BYTES {
            return Ok(None);
        }
        let all = 0..open.height();
        let guides = open.noisy_rows(all.clone())?;
        let of_both = mean(&guides[0], &guides[1], open.weights());
        Ok(Some(Self { passes: passes.rows(all)?.passes, guides, of_both }))
    }
}

/// Reads what the denoiser is given of a pass; `None` where there is no noise or light is subtracted.
fn read_pass(
    open: &OpenFrame,
    passes: &OpenPasses,
    held: Option<&Held>,
    k: usize,
    buffers: &[Buffer],
) -> Result<Option<Vec<Picture>>, Failure> {
    let (height, width) = (open.height(), open.width());
    let has = |role| open.has(role, Buffer::A);
    let black = |_: &Buffer| Picture::new(height, width, has(Role::Albedo), has(Role::Normal));
    let mut pictures: Vec<Picture> = buffers.iter().map(black).collect();
    let (mut sum, mut size, mut is_still) = (0.0, 0.0, true);
    let step = if held.is_some() { height } else { ROWS };
    for top in (0..height).step_by(step) {
        interrupt::check()?;
        let rows = top..(top + step).min(height);
        let read;
        let (halves, guides, of_both) = match held {
            Some(Held { passes, guides, of_both }) => (&passes[k], guides, of_both),
            None => {
                let guides = open.noisy_rows(rows.clone())?;
                let of_both = mean(&guides[0], &guides[1], open.weights());
                read = (passes.rows_of(k, rows)?, guides, of_both);
                (&read.0, &read.1, &read.2)
            }
        };
        is_still &= halves[0].data().iter().zip(halves[1].data()).all(|(a, b)| a.to_bits() == b.to_bits());
        let both = mean_of_finite(&halves[0], &halves[1], open.weights());
        for value in both.data().iter().filter(|value| value.is_finite()) {
            sum += f64::from(*value);
            size += f64::from(value.abs());
        }
        for (picture, buffer) in pictures.iter_mut().zip(buffers) {
            let (colour, guides) = match buffer {
                Buffer::A => (&halves[0], &guides[0]),
                Buffer::B => (&halves[1], &guides[1]),
                Buffer::Full => (&both, of_both),
            };
            let NoisyHalf { albedo, normal, .. } = guides;
            picture.put_rows(top, &Rows { colour, albedo: albedo.as_ref(), normal: normal.as_ref() });
        }
    }
    Ok((!is_still && sum >= POSITIVE * size).then_some(pictures))
}

/// Adds a pass times its colour to a picture of each buffer: the `denoised` one, else as it is.
fn add_pass(
    sums: &mut [Image; 3],
    passes: &OpenPasses,
    k: usize,
    weights: HalfWeights,
    denoised: &[Option<&CompactImage>],
) -> Result<(), Failure> {
    let (height, width) = (sums[0].height(), sums[0].width());
    for top in (0..height).step_by(ROWS) {
        interrupt::check()?;
        let rows = top..(top + ROWS).min(height);
        let noisy = denoised.contains(&None).then(|| passes.rows_of(k, rows.clone())).transpose()?;
        let colours = passes.passes[k].colour.map(|at| passes.rows_of_colour(at, rows.clone())).transpose()?;
        for ((sum, buffer), denoised) in sums.iter_mut().zip(BUFFERS).zip(denoised) {
            let of_buffer = |[a, b]: &[Image; 2]| match buffer {
                Buffer::A => a.clone(),
                Buffer::B => b.clone(),
                Buffer::Full => mean_of_finite(a, b, weights),
            };
            let pass = denoised.map(|denoised| denoised.rows(rows.clone())).or_else(|| noisy.as_ref().map(of_buffer));
            let colour = colours.as_ref().map(of_buffer);
            let mut part = sum.crop(top, 0, rows.len(), width);
            part.for_each_row(|c, y, row| {
                for (x, v) in row.iter_mut().enumerate() {
                    let pass = pass.as_ref().map_or(0.0, |pass| pass.at(c, y, x));
                    *v += pass * colour.as_ref().map_or(1.0, |colour| colour.at(c, y, x));
                }
            });
            sum.put_rows(top, &part);
        }
    }
    Ok(())
}
