//! The corrected picture inside a copy of half a: every other channel, part, window and attribute is kept, byte for byte
//! where the format allows it.
//!
//! The picture takes the place of the noisy colour that it was made from (`place.rs`). Alpha and all other channels
//! stay those of the template.
//!
//! Half floats stay half floats where they can hold the picture, else these channels become f32. A part that takes the
//! picture and has lossy compression is stored with ZIP, so that nothing is lost a second time; it loses its smaller
//! levels of detail and its thumbnail, which would show another picture.
//!
//! An [`OutputPlan`] is made before any work is done on the picture, and finds what would make the output impossible.
//! What was written is read back before it takes its name. The same picture and provenance give the same bytes.

use crate::align::Placing;
use crate::atomic::atomic_write_checked;
use crate::container::Container;
use crate::container::attributes::LONGEST_NAME;
use crate::container::channels::ChannelEntry;
use crate::container::chunks::ChunkReader;
use crate::container::copy::{COPIED_BYTES, Copy, CopyError, Placed, Target, mean_row};
use crate::container::fault::Fault;
use crate::container::pixels::{Wanted, convert_line, read_planes, store_line};
use crate::error::{Error, Purpose};
use crate::exr_file::ExrFile;
use crate::place::{Place, place_of};
use crate::resolve::Resolution;
use crate::window::Window;
use exr::meta::attribute::SampleType;
use rayon::prelude::*;
use sspc_image::{Image, Storage};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The largest finite half float.
const HALF_MAX: f32 = 65_504.0;
/// Below this mean magnitude half floats run into their subnormals (6.1e-5) and lose relative precision.
const HALF_COARSE: f64 = 1e-3;
/// Values that one thread looks at, at a time.
const VALUES_PER_JOB: usize = 1 << 16;
/// Rows that one thread reads back at a time.
const CHECKED_ROWS: usize = 64;

/// A copy of a template that is known to be possible, waiting for its pictures.
#[derive(Clone, Debug)]
pub struct OutputPlan {
    template: PathBuf,
    purpose: Purpose,
    container: Arc<Container>,
    places: Vec<(Place, Placing)>,
}

impl OutputPlan {
    /// The output of a frame.
    ///
    /// # Errors
    /// [`Error::Unsupported`], [`Error::Damaged`]: a template that cannot be copied.
    pub fn of_frame(resolution: &Resolution) -> Result<Self, Error> {
        let radiance = resolution.radiance();
        let file = &resolution.files[radiance.file];
        let display = Placing::of(file, radiance.channels[0]).display;
        Self::new(file, vec![(place_of(resolution)?, Placing { window: radiance.window, display })])
    }

    /// The output of other pictures in these places of a file, whose pixels lie as `placing` says.
    ///
    /// # Errors
    /// As [`Self::of_frame`].
    pub fn of_places(file: &ExrFile, places: Vec<Place>, placing: Placing) -> Result<Self, Error> {
        let places = places.into_iter().enumerate().map(|(at, mut place)| {
            place.targets.iter_mut().for_each(|target| target.picture = at);
            (place, placing)
        });
        Self::new(file, places.collect())
    }

    fn new(file: &ExrFile, places: Vec<(Place, Placing)>) -> Result<Self, Error> {
        for (place, placing) in &places {
            for target in &place.targets {
                let window = file.container.parts[target.part].window;
                if !window.contains(&placing.window) {
                    return Err(Error::SizeMismatch {
                        path: file.path.clone(),
                        purpose: file.purpose,
                        expected: placing.window.to_string(),
                        found: format!("{window} in {}", place.name),
                        like: file.path.clone(),
                    });
                }
            }
        }
        let plan =
            Self { template: file.path.clone(), purpose: file.purpose, container: file.container.clone(), places };
        let whole = plan.copy(&vec![false; plan.places.len()], &[]).and_then(|copy| copy.check_chunks());
        whole.map_err(|fault| file.error(fault))?;
        Ok(plan)
    }

    /// The same with the pictures of other views of the same template; they are given in this order.
    ///
    /// # Errors
    /// [`Error::Output`]: plans of different templates, or two pictures for one channel.
    pub fn and(mut self, other: OutputPlan) -> Result<Self, Error> {
        let taken = |target: &Target| {
            self.places
                .iter()
                .flat_map(|(place, _)| &place.targets)
                .any(|t| (t.part, &t.name) == (target.part, &target.name))
        };
        let is_taken = other.places.iter().flat_map(|(place, _)| &place.targets).any(taken);
        if self.template != other.template || is_taken {
            return Err(Error::Output {
                path: other.template,
                expected: "pictures for different channels of one file".into(),
                found: other.places.iter().map(|(place, _)| place.name.as_str()).collect::<Vec<_>>().join(", "),
            });
        }
        for (mut place, placing) in other.places {
            place.targets.iter_mut().for_each(|target| target.picture = self.places.len());
            self.places.push((place, placing));
        }
        Ok(self)
    }

    /// A picture as it will be read from the file.
    ///
    /// # Panics
    /// When there is no such picture.
    pub fn as_stored(&self, at: usize, picture: &Image) -> Image {
        let storage =
            if self.places[at].0.were_half && half_can_hold(picture) { Storage::Half } else { Storage::Float };
        let mut stored = picture.clone();
        stored.for_each_row(|_, _, row| row.iter_mut().for_each(|v| *v = storage.round(f64::from(*v))));
        stored
    }

    /// The channels that the pictures take, for messages.
    pub fn channels(&self) -> Vec<String> {
        self.places.iter().map(|(place, _)| place.name.clone()).collect()
    }

    /// Writes the pictures (`[3, H, W]` each, scene-referred) to `path` inside a copy of the template, with each pair of
    /// `provenance` as a text attribute of the parts that hold them.
    ///
    /// # Errors
    /// What reading the template or [`atomic_write_checked`] can raise; the template and `inputs` are never overwritten.
    ///
    /// # Panics
    /// When there are not as many pictures as planned, or of other sizes.
    pub fn write(
        &self,
        path: &Path,
        inputs: &[PathBuf],
        pictures: &[&Image],
        provenance: &[(String, String)],
    ) -> Result<(), Error> {
        assert_eq!(pictures.len(), self.places.len(), "pictures");
        let placed: Vec<Placed> =
            pictures.iter().zip(&self.places).map(|(image, (_, at))| Placed { image, window: at.window }).collect();
        for Placed { image, window } in &placed {
            assert_eq!((image.width(), image.height()), window.size(), "size of a picture");
        }
        let half: Vec<bool> = self
            .places
            .iter()
            .zip(pictures)
            .map(|((place, _), image)| place.were_half && half_can_hold(image))
            .collect();
        let readable = |fault: Fault| self.error(fault);
        let copy = self.copy(&half, provenance).map_err(readable)?;
        let protected: Vec<PathBuf> = inputs.iter().cloned().chain([self.template.clone()]).collect();
        let mut unreadable = None;
        let written = atomic_write_checked(
            path,
            &protected,
            |out| match copy.write(out, &placed) {
                Ok(()) => Ok(()),
                Err(CopyError::Write(error)) => Err(error),
                Err(CopyError::Read(fault)) => {
                    unreadable = Some(fault);
                    Err(std::io::Error::other("the template could not be read"))
                }
            },
            |temporary| check_written(temporary, &copy, &placed),
        );
        match unreadable {
            Some(fault) => Err(readable(fault)),
            None => written,
        }
    }

    fn copy(&self, half: &[bool], provenance: &[(String, String)]) -> Result<Copy<'_>, Fault> {
        let mut targets = Vec::new();
        for ((place, _), half) in self.places.iter().zip(half) {
            let kind = if *half { SampleType::F16 } else { SampleType::F32 };
            targets.extend(place.targets.iter().cloned().map(|target| Target { kind, ..target }));
        }
        let texts: Vec<(String, String)> = provenance.iter().map(attribute_text).collect();
        Copy::new(&self.container, targets, &texts)
    }

    fn error(&self, fault: Fault) -> Error {
        crate::exr_file::error_of(&self.template, self.purpose, fault)
    }
}

/// Reads back what was written: headers, every chunk's place, and the pictures' channels.
fn check_written(path: &Path, copy: &Copy, pictures: &[Placed]) -> Result<(), String> {
    let fault = |fault: Fault| format!("{fault:?}");
    let preamble = copy.preamble();
    let mut start = vec![0; preamble.len()];
    let read = File::open(path).and_then(|mut file| file.read_exact(&mut start));
    if read.is_err() || start != preamble {
        return Err("other headers".into());
    }
    let written = Container::open(path).map_err(fault)?;
    let mut reader = ChunkReader::open(&written).map_err(fault)?;
    for (number, part) in written.parts.iter().enumerate() {
        (0..part.chunks).try_for_each(|at| reader.check(number, at)).map_err(fault)?;
    }
    let height = pictures.iter().map(|picture| picture.window.height).max().unwrap_or(0);
    // All channels together: their part is decompressed once.
    let tops: Vec<usize> = (0..height).step_by(CHECKED_ROWS).collect();
    let bytes = |target: &Target| {
        let part = &written.parts[target.part];
        CHECKED_ROWS * part.window.width * part.bytes_per_pixel()
    };
    let most = copy.targets().iter().map(bytes).max().unwrap_or(1);
    tops.chunks((COPIED_BYTES / most.max(1)).max(1))
        .try_for_each(|tops| tops.par_iter().try_for_each(|top| check_rows(&written, copy.targets(), pictures, *top)))
}

/// Compares the rows of all pictures from `top` on with what is in the file.
fn check_rows(written: &Container, targets: &[Target], pictures: &[Placed], top: usize) -> Result<(), String> {
    let mut found: Vec<(&Target, usize, Window, Vec<f32>)> = Vec::new();
    for target in targets {
        let (part, window) = (&written.parts[target.part], pictures[target.picture].window);
        let named = |channel: &ChannelEntry| channel.name == target.name;
        let index = part.channels.iter().position(named).ok_or("a channel is missing")?;
        if top < window.height {
            let rows = window.rows(top..(top + CHECKED_ROWS).min(window.height));
            let inside = rows.overlap(&part.window);
            found.extend(inside.map(|inside| (target, index, inside, vec![0.0; inside.width * inside.height])));
        }
    }
    let wanted = found.iter_mut().map(|(target, channel, window, plane)| Wanted {
        part: target.part,
        channel: *channel,
        window: *window,
        plane,
    });
    read_planes(written, &mut wanted.collect::<Vec<_>>()).map_err(|fault| format!("{fault:?}"))?;
    found
        .iter()
        .try_for_each(|(target, _, inside, plane)| check_plane(target, &pictures[target.picture], inside, plane))
}

fn check_plane(target: &Target, picture: &Placed, inside: &Window, plane: &[f32]) -> Result<(), String> {
    let (image, window) = (picture.image, picture.window);
    let (left, top) = ((inside.left - window.left) as usize, (inside.top - window.top) as usize);
    let (mut expected, mut stored) = (vec![0.0; inside.width], Vec::new());
    for (y, row) in plane.chunks_exact(inside.width).enumerate() {
        let planes: Vec<&[f32]> =
            target.planes.iter().map(|&c| &image.row(c, top + y)[left..left + inside.width]).collect();
        mean_row(&planes, &mut expected);
        stored.clear();
        store_line(&expected, target.kind, &mut stored);
        convert_line(&stored, target.kind, &mut expected);
        for (found, expected) in row.iter().zip(&expected) {
            if found.to_bits() != expected.to_bits() && !(found.is_nan() && expected.is_nan()) {
                return Err(format!("{found} instead of {expected} in row {}", top + y));
            }
        }
    }
    Ok(())
}

/// Whether half floats hold every value without overflow and the picture as a whole without losing precision.
fn half_can_hold(picture: &Image) -> bool {
    let of_run = |values: &[f32]| {
        let finite = values.iter().filter(|value| value.is_finite()).map(|value| value.abs());
        finite.fold((0.0f64, 0u64, 0.0f32), |(sum, count, largest), v| (sum + f64::from(v), count + 1, largest.max(v)))
    };
    let runs: Vec<_> = picture.data().par_chunks(VALUES_PER_JOB).map(of_run).collect();
    let of_both = |(a, n, p): (f64, u64, f32), (b, m, q): (f64, u64, f32)| (a + b, n + m, p.max(q));
    let (sum, count, largest) = runs.into_iter().fold((0.0, 0, 0.0), of_both);
    largest <= HALF_MAX && (sum == 0.0 || sum >= HALF_COARSE * count as f64)
}

/// Name and value of a text attribute: a name that the format allows, and a value that is not empty.
fn attribute_text((name, value): &(String, String)) -> (String, String) {
    let mut end = name.len().min(LONGEST_NAME);
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    (name[..end].to_string(), if value.is_empty() { "-".to_string() } else { value.clone() })
}
