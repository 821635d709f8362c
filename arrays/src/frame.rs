//! From named pictures to a frame that was looked over.

use sspc_cli::reading::InspectedFrame;
use sspc_cli::{Code, Failure};
use sspc_core::frame_stats::Exposure;
use sspc_frames::samples::implausible;
use sspc_image::{Buffer, DenoisedVariant, Frame, HalfBuffer, HalfWeights, Image, Role, RoleSource};
use std::collections::BTreeMap;

/// What interfaces and messages call the picture of a role: `a`, `denoised_b`, `denoised`.
pub fn name(role: Role, buffer: Buffer) -> String {
    match (role, buffer) {
        (Role::Radiance, half) => half.name().to_string(),
        (role, Buffer::Full) => role.name().to_string(),
        (role, half) => format!("{}_{}", role.name(), half.name()),
    }
}

/// Every picture that a frame can have, beside further denoised ones.
pub const PICTURES: [(Role, Buffer); 11] = [
    (Role::Radiance, Buffer::A),
    (Role::Radiance, Buffer::B),
    (Role::Denoised, Buffer::A),
    (Role::Denoised, Buffer::B),
    (Role::Denoised, Buffer::Full),
    (Role::Albedo, Buffer::A),
    (Role::Albedo, Buffer::B),
    (Role::Normal, Buffer::A),
    (Role::Normal, Buffer::B),
    (Role::Visibility, Buffer::A),
    (Role::Visibility, Buffer::B),
];

/// Differences of y that a gradient-domain renderer gives: to the pixel on the right (dx) and below (dy), of each half.
pub const DIFFERENCES: [(Role, Buffer); 4] =
    [(Role::Dx, Buffer::A), (Role::Dx, Buffer::B), (Role::Dy, Buffer::A), (Role::Dy, Buffer::B)];

/// A frame's pictures as they were given, all of one size.
#[derive(Clone, Debug, Default)]
pub struct GivenFrame {
    pictures: BTreeMap<(Role, Buffer), Image>,
    /// Further denoised pictures of the same samples, as `--denoised-more` gives them.
    further: Vec<DenoisedVariant>,
    weights: HalfWeights,
}

impl GivenFrame {
    /// Adds a picture `[channels of the role, H, W]`.
    pub fn put(&mut self, role: Role, buffer: Buffer, picture: Image) {
        self.pictures.insert((role, buffer), picture);
    }

    /// Adds a further denoised picture of both halves, and of the full buffer.
    pub fn put_denoised(&mut self, further: DenoisedVariant) {
        self.further.push(further);
    }

    /// Says how many samples per pixel half a and half b have: their weights in means of both, as `--samples-a` and
    /// `--samples-b` are.
    ///
    /// # Errors
    /// Counts that no two halves have.
    pub fn weigh(&mut self, samples: [f64; 2]) -> Result<(), Failure> {
        if let Some(why) = implausible(samples) {
            return Err(Failure::new(
                Code::Arguments,
                format!("samples: {why}"),
                "give the samples per pixel of each half",
            ));
        }
        self.weights = HalfWeights::of_samples(samples);
        Ok(())
    }

    /// The frame, looked over as the programs do with files.
    ///
    /// # Errors
    /// No noisy or denoised half; halves that cannot be used.
    ///
    /// # Panics
    /// When the pictures differ in size.
    pub fn inspect(mut self, exposure: Exposure) -> Result<InspectedFrame, Failure> {
        let mut notes = self.leave_out_of_one_half();
        let source = |role: Role, buffer: Buffer| {
            let channels = ["R", "G", "B"].map(String::from).to_vec();
            Some(RoleSource { role, buffer, path: name(role, buffer).into(), channels, variant: 0 })
        };
        let inspected = InspectedFrame::of(self.frame()?, exposure, |inspection| inspection.verdict(&source))?;
        notes.extend(inspected.warnings);
        Ok(InspectedFrame { warnings: notes, ..inspected })
    }

    /// Takes out each feature that only one half has, as it cannot be used; a note for each.
    fn leave_out_of_one_half(&mut self) -> Vec<String> {
        let mut notes = Vec::new();
        for role in Role::FEATURES {
            for (half, other) in [(Buffer::A, Buffer::B), (Buffer::B, Buffer::A)] {
                if !self.pictures.contains_key(&(role, other)) && self.pictures.remove(&(role, half)).is_some() {
                    notes.push(format!("{role}: only {half} has it ({}), so it is not used", name(role, half)));
                }
            }
        }
        let given = DIFFERENCES.iter().filter(|key| self.pictures.contains_key(key)).count();
        if (1..DIFFERENCES.len()).contains(&given) {
            DIFFERENCES.iter().for_each(|key| drop(self.pictures.remove(key)));
            notes.push("differences of y: expected dx_a, dx_b, dy_a and dy_b, so they are not used".to_string());
        }
        notes
    }

    fn frame(mut self) -> Result<Frame, Failure> {
        let (a, b) = (self.half(Buffer::A)?, self.half(Buffer::B)?);
        let denoised = self.pictures.remove(&(Role::Denoised, Buffer::Full));
        let mut variants = self.further;
        if !variants.is_empty() {
            let first = [&a.denoised, &b.denoised].map(Image::clone);
            variants.insert(0, DenoisedVariant { halves: first, full: denoised.clone() });
        }
        let mut of_half =
            |half| Some([self.pictures.remove(&(Role::Dx, half))?, self.pictures.remove(&(Role::Dy, half))?]);
        let differences = of_half(Buffer::A).zip(of_half(Buffer::B)).map(|(a, b)| [a, b]);
        Ok(Frame { a, b, denoised, variants, composite: None, weights: self.weights, differences })
    }

    fn half(&mut self, half: Buffer) -> Result<HalfBuffer, Failure> {
        let mut take = |role: Role| self.pictures.remove(&(role, half));
        let missing = |role: Role| {
            let message = format!("{}: expected the {role} of {half}, found nothing", name(role, half));
            Failure::new(Code::Input, message, "give both noisy halves, and what a denoiser made of each")
        };
        Ok(HalfBuffer {
            radiance: take(Role::Radiance).ok_or_else(|| missing(Role::Radiance))?,
            denoised: take(Role::Denoised).ok_or_else(|| missing(Role::Denoised))?,
            albedo: take(Role::Albedo),
            normal: take(Role::Normal),
            visibility: take(Role::Visibility),
        })
    }
}
