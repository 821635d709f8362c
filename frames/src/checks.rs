//! Whether a frame's halves can be what they claim to be, by their files: identical, filtered, lossy, incomplete. (Whether
//! their noise is independent, `sspc_core::independence` measures.)

use crate::error::{Error, Purpose};
use crate::place::place_of;
use crate::resolve::{Filled, Resolution};
use exr::meta::attribute::LevelMode;
use sspc_image::{Buffer, Frame, Image, Role, RoleSource};
use std::f64::consts::FRAC_PI_2;
use std::ops::Range;
use std::path::PathBuf;

/// Correlation of neighbouring pixels' noise above which the user is warned. Filters that splat give 0.25 (a tent of
/// radius 1) or 0.37 (a Gaussian of 0.5 pixels); renders without splatting were seen to reach 0.18 on fur and glass.
pub const NEIGHBOURS_CORRELATED: f64 = 0.22;
/// Rows are skipped evenly so that about this many pixels are looked at: correlations to a hundredth need no more.
const MOST_PIXELS: usize = 1 << 17;
/// Pixels with noise that a correlation needs to mean anything.
const FEWEST_SAMPLES: u64 = 256;

/// Refuses a noisy half that is given a second time as the other; `path_of` a file's number is its path.
///
/// # Errors
/// [`Error::IdenticalHalves`].
pub fn refuse_one_half(filled: &[Filled], path_of: impl Fn(usize) -> PathBuf) -> Result<(), Error> {
    let half = |buffer| filled.iter().find(|known| (known.role, known.buffer) == (Role::Radiance, buffer));
    match (half(Buffer::A), half(Buffer::B)) {
        (Some(a), Some(b)) if (a.file, &a.channels) == (b.file, &b.channels) => {
            let (a, b, purpose) = (path_of(a.file), path_of(b.file), Purpose::Role(Role::Radiance, Buffer::B));
            Err(Error::IdenticalHalves { a, b, purpose })
        }
        _ => Ok(()),
    }
}

/// Takes out features that only one half has, which cannot be used, and says so.
pub fn drop_lonely_features(filled: &mut Vec<Filled>, path_of: impl Fn(usize) -> PathBuf) -> Vec<String> {
    let mut said = Vec::new();
    for role in Role::FEATURES.into_iter().chain([Role::Motion, Role::Position]).chain(Role::DIFFERENCES) {
        let of_role: Vec<&Filled> = filled.iter().filter(|filled| filled.role == role).collect();
        if let [lonely] = of_role.as_slice() {
            let path = path_of(lonely.file);
            said.push(format!("{role}: only {} has it ({}), so it is not used", lonely.buffer, path.display()));
            filled.retain(|filled| filled.role != role);
        }
    }
    said
}

/// What is found in a frame's rows, in any number of bands from top to bottom.
pub struct Inspection {
    /// Rows that are passed over for each one whose correlations are looked at.
    step: usize,
    /// Which channels of radiance a, b and denoised a, b, full hold anything finite.
    finite: [[bool; 3]; COLOURS.len()],
    has_full_denoised: bool,
    /// Radiance, denoised: the same in both halves, and black, so far.
    equal: [bool; 2],
    black: [bool; 2],
    /// Features that are there, and that are finite anywhere, as [`Role::FEATURES`].
    present: [bool; Role::FEATURES.len()],
    usable: [bool; Role::FEATURES.len()],
    neighbours: SignCorrelation,
}

/// The colours without which there is nothing to correct, or to start from.
const COLOURS: [(Role, Buffer); 5] = [
    (Role::Radiance, Buffer::A),
    (Role::Radiance, Buffer::B),
    (Role::Denoised, Buffer::A),
    (Role::Denoised, Buffer::B),
    (Role::Denoised, Buffer::Full),
];

impl Inspection {
    /// An inspection of a picture of this size that has looked at nothing yet.
    pub fn new(height: usize, width: usize) -> Self {
        Self {
            step: row_step(height, width),
            finite: Default::default(),
            has_full_denoised: false,
            equal: [true; 2],
            black: [true; 2],
            present: Default::default(),
            usable: Default::default(),
            neighbours: SignCorrelation::default(),
        }
    }

    /// Looks at `rows` of the picture in a band that begins at row `first` and has the rows above and below them,
    /// where the picture has.
    pub fn look(&mut self, band: &Frame, first: usize, rows: Range<usize>) {
        let inner = rows.start - first..rows.end - first;
        let colours = [
            Some(&band.a.radiance),
            Some(&band.b.radiance),
            Some(&band.a.denoised),
            Some(&band.b.denoised),
            band.denoised.as_ref(),
        ];
        for (finite, image) in self.finite.iter_mut().zip(colours) {
            for (c, finite) in finite.iter_mut().enumerate() {
                *finite = *finite || image.is_none_or(|image| values(image, c..c + 1, &inner).any(f32::is_finite));
            }
        }
        self.has_full_denoised |= band.denoised.is_some();
        for (at, feature) in Role::FEATURES.into_iter().enumerate() {
            self.present[at] |= band.has(feature);
            self.usable[at] |= band.has_finite(feature);
        }
        let pairs = [(&band.a.radiance, &band.b.radiance), (&band.a.denoised, &band.b.denoised)];
        for (at, (a, b)) in pairs.into_iter().enumerate() {
            let mut both = values(a, 0..3, &inner).zip(values(b, 0..3, &inner));
            self.equal[at] = self.equal[at] && both.all(|(a, b)| a.to_bits() == b.to_bits());
            self.black[at] = self.black[at] && values(a, 0..3, &inner).all(|value| value == 0.0);
        }
        for y in rows {
            if y % self.step == 0 {
                add_neighbours(&mut self.neighbours, &band.a.radiance, &band.b.radiance, y - first);
            }
        }
    }

    /// Warnings of a frame that was looked at from top to bottom; `source` says where a role came from.
    ///
    /// # Errors
    /// Halves that cannot be used: identical, or without any finite value.
    pub fn verdict(&self, source: &dyn Fn(Role, Buffer) -> Option<RoleSource>) -> Result<Vec<String>, Error> {
        self.check_finite(source)?;
        self.check_identical(source)?;
        let mut warnings = self.absent_roles();
        warnings.extend(self.unusable_roles());
        warnings.extend(self.correlated());
        Ok(warnings)
    }

    fn check_finite(&self, source: &dyn Fn(Role, Buffer) -> Option<RoleSource>) -> Result<(), Error> {
        for (finite, (role, buffer)) in self.finite.iter().zip(COLOURS) {
            if let Some(c) = (0..3).find(|&c| !finite[c]) {
                let (path, channels) = source(role, buffer).map(|s| (s.path, s.channels)).unwrap_or_default();
                let channel = channels.get(c).cloned().unwrap_or_default();
                return Err(Error::NothingFinite { path, purpose: Purpose::Role(role, buffer), channel });
            }
        }
        Ok(())
    }

    /// Optional features that count as absent because they are nowhere finite.
    fn unusable_roles(&self) -> Vec<String> {
        let unusable = (0..Role::FEATURES.len()).filter(|&at| self.present[at] && !self.usable[at]);
        unusable
            .map(|at| format!("no pixel of the {} is finite in both halves: it counts as absent", Role::FEATURES[at]))
            .collect()
    }

    /// Equal halves carry no information about the noise. A wholly black frame of two files is left alone: it is equal
    /// because there is no light, and sequences fade to black.
    fn check_identical(&self, source: &dyn Fn(Role, Buffer) -> Option<RoleSource>) -> Result<(), Error> {
        let from = |role, buffer| source(role, buffer).map(|source| (source.path, source.channels));
        for (at, role) in [Role::Radiance, Role::Denoised].into_iter().enumerate() {
            let (a, b) = (from(role, Buffer::A), from(role, Buffer::B));
            let is_once = a.is_some() && a == b;
            if self.equal[at] && (!self.black[at] || is_once) {
                let [a, b] = [a, b].map(|from| from.map(|(path, _)| path).unwrap_or_default());
                return Err(Error::IdenticalHalves { a, b, purpose: Purpose::Role(role, Buffer::B) });
            }
        }
        Ok(())
    }

    fn absent_roles(&self) -> Vec<String> {
        let [albedo, normal, visibility] = self.present;
        let present = [
            (albedo, "no albedo: texture is told from noise by colour alone"),
            (normal, "no normal: edges of shape are told from noise by colour alone"),
            (visibility, "no visibility: shadow edges are told from noise by colour alone"),
            (
                self.has_full_denoised,
                "no denoised full buffer: the mean of both denoised halves is the baseline, which is noisier",
            ),
        ];
        present.iter().filter(|(is_there, _)| !is_there).map(|(_, line)| line.to_string()).collect()
    }

    fn correlated(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Some(r) = self.neighbours.correlation()
            && r > NEIGHBOURS_CORRELATED
        {
            warnings.push(format!(
                "the noise of neighbouring pixels is correlated ({r:.2}, expected about 0): the renderer's pixel filter spreads samples (a box filter corrects better), or the halves show different things"
            ));
        }
        warnings
    }
}

/// Values of some channels and rows.
fn values<'a>(image: &'a Image, channels: Range<usize>, rows: &Range<usize>) -> impl Iterator<Item = f32> + 'a {
    let part = rows.start * image.width()..rows.end * image.width();
    channels.flat_map(move |c| image.plane(c)[part.clone()].iter().copied())
}

/// Roles that were stored with lossy compression.
pub(crate) fn lossy_inputs(resolution: &Resolution) -> Vec<String> {
    let mut warnings: Vec<String> = Vec::new();
    for filled in &resolution.filled {
        let file = &resolution.files[filled.file];
        let method = filled.channels.iter().find_map(|&at| file.lossy(file.channels[at].part));
        if let Some(method) = method {
            let line = format!(
                "{}: {} was stored with lossy {method}, so its noise is no longer the renderer's",
                file.path.display(),
                Purpose::Role(filled.role, filled.buffer)
            );
            warnings.push(line);
        }
    }
    warnings
}

/// What the parts that take the picture lose in the output, because it would show another one.
pub(crate) fn left_out(resolution: &Resolution) -> Option<String> {
    let place = place_of(resolution).ok()?;
    let file = &resolution.files[resolution.radiance().file];
    let parts = || place.targets.iter().map(|target| &file.container.parts[target.part]);
    let has_levels = parts().any(|part| part.tiles.is_some_and(|tiles| tiles.level_mode != LevelMode::Singular));
    let has_thumbnail = parts().any(|part| part.header.get("preview", "preview").is_some());
    let what = match (has_levels, has_thumbnail) {
        (true, true) => "smaller levels of detail and thumbnail",
        (true, false) => "smaller levels of detail",
        (false, true) => "thumbnail",
        (false, false) => return None,
    };
    Some(format!("{what} of {} are not written: they show the picture as it was", place.name))
}

fn row_step(height: usize, width: usize) -> usize {
    (height * width / MOST_PIXELS).max(1)
}

/// Adds a row of `a - b` to the correlation between horizontally and vertically neighbouring pixels. The scene itself
/// cancels in the difference.
fn add_neighbours(signs: &mut SignCorrelation, a: &Image, b: &Image, y: usize) {
    let difference = |c, y, x| a.at(c, y, x) - b.at(c, y, x);
    for c in 0..a.channels() {
        for x in 0..a.width() {
            let here = difference(c, y, x);
            if x + 1 < a.width() {
                signs.add(here, difference(c, y, x + 1));
            }
            if y + 1 < a.height() {
                signs.add(here, difference(c, y + 1, x));
            }
        }
    }
}

/// Quadrant correlation, from signs so that no firefly decides it: for a bivariate normal,
/// P(same sign) = 1/2 + asin(r)/π (Sheppard 1899).
#[derive(Default)]
struct SignCorrelation {
    same: u64,
    total: u64,
}

impl SignCorrelation {
    fn add(&mut self, a: f32, b: f32) {
        let product = f64::from(a) * f64::from(b);
        if product.is_finite() && product != 0.0 {
            self.total += 1;
            self.same += u64::from(product > 0.0);
        }
    }

    fn correlation(&self) -> Option<f64> {
        let enough = self.total >= FEWEST_SAMPLES;
        enough.then(|| (FRAC_PI_2 * (2.0 * self.same as f64 / self.total as f64 - 1.0)).sin())
    }
}
