//! One buffer of a frame, from memory or from files.

use crate::denoising::DenoiserReport;
use rayon::join;
use sspc_core::prepare::baseline;
use sspc_frames::OpenFrame;
use sspc_frames::align::Placing;
use sspc_frames::error::Error;
use sspc_image::{Buffer, Frame, HalfBuffer, Image, Role};
use sspc_shots::camera::{Camera, Screen, Unusable};
use sspc_shots::flow::Matchable;
use sspc_shots::light::{brightness, flicker};
use sspc_shots::validity::Guides;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

const HALVES: [Buffer; 2] = [Buffer::A, Buffer::B];

/// Where in the world the pixels of a half lie, and the camera that sees them.
#[derive(Clone)]
pub struct Seen {
    /// World positions `[3, H, W]`.
    pub position: Image,
    /// The frame's camera.
    pub camera: Camera,
}

impl Seen {
    /// Reads a half's; `None` where the files hold no positions.
    fn read(open: &OpenFrame, half: Buffer) -> Result<Option<Result<Self, Unusable>>, Error> {
        if !open.has_position() {
            return Ok(None);
        }
        let cameras = open.cameras(half);
        if cameras.is_empty() {
            return Ok(Some(Err(Unusable::NoMatrix)));
        }
        let Some(position) = open.role_rows(Role::Position, half, 0..open.height())? else { return Ok(None) };
        let Placing { window, display } = open.placing();
        let from = |first: i32, own: i32| f64::from(first) - f64::from(own);
        let screen = Screen {
            left: from(display.left, window.left),
            top: from(display.top, window.top),
            width: display.width as f64,
            height: display.height as f64,
        };
        Ok(Some(Camera::of(&position, &cameras, &screen).map(|camera| Self { position, camera })))
    }
}

/// A frame that was decoded whole.
pub struct Decoded {
    /// As read.
    pub frame: Frame,
    /// Motion of half a and of half b.
    pub motion: Option<[Image; 2]>,
    /// World positions of half a and of half b.
    seen: [Option<Result<Seen, Unusable>>; 2],
    /// Which denoised pictures were made, where the files do not hold them.
    pub denoiser: Option<DenoiserReport>,
    matchable: [OnceLock<Arc<Matchable>>; 2],
    brightness: [OnceLock<Arc<Image>>; 2],
    flicker: OnceLock<Arc<Image>>,
}

impl Decoded {
    /// Decodes a frame whose roles were found and whose denoised pictures were made.
    ///
    /// # Errors
    /// What reading can raise.
    pub fn read(open: &OpenFrame, denoiser: Option<DenoiserReport>) -> Result<Self, Error> {
        let all = 0..open.height();
        let motion = || HALVES.map(|half| open.role_rows(Role::Motion, half, all.clone()));
        let seen = || HALVES.map(|half| Seen::read(open, half));
        let (frame, ([a, b], [seen_a, seen_b])) = join(|| open.rows(all.clone()), || (motion(), seen()));
        let motion = a?.zip(b?).map(|(a, b)| [a, b]);
        Ok(Self {
            frame: frame?,
            motion,
            seen: [seen_a?, seen_b?],
            denoiser,
            matchable: Default::default(),
            brightness: Default::default(),
            flicker: OnceLock::new(),
        })
    }

    /// One half.
    pub fn half(&self, half: usize) -> &HalfBuffer {
        if half == 0 { &self.frame.a } else { &self.frame.b }
    }
}

/// Where the buffers of a frame come from.
pub enum Sides {
    /// Memory.
    Decoded(Arc<Decoded>),
    /// Files, each time again.
    Files(Box<OpenFrame>),
}

/// What motion between one half and its neighbour's is found from, and how far it is valid.
pub struct Side<'a> {
    /// z, `[3, H, W]`.
    pub denoised: Cow<'a, Image>,
    albedo: Option<Cow<'a, Image>>,
    normal: Option<Cow<'a, Image>>,
    /// The motion pass, two to four components.
    pub motion: Option<Cow<'a, Image>>,
    /// World positions and their camera, or why they are of no use.
    pub seen: Option<Cow<'a, Result<Seen, Unusable>>>,
    matchable: Option<&'a OnceLock<Arc<Matchable>>>,
    brightness: Option<&'a OnceLock<Arc<Image>>>,
}

impl Side<'_> {
    /// Its features.
    pub fn guides(&self) -> Guides<'_> {
        Guides { albedo: self.albedo.as_deref(), normal: self.normal.as_deref() }
    }

    /// What motion is estimated from.
    pub fn matchable(&self) -> Arc<Matchable> {
        let make = || Arc::new(Matchable::of(&self.denoised, &self.guides()));
        match self.matchable {
            Some(known) => known.get_or_init(make).clone(),
            None => make(),
        }
    }

    /// Its brightness, `[1, H, W]`.
    pub fn brightness(&self) -> Arc<Image> {
        let make = || Arc::new(brightness(&self.denoised));
        match self.brightness {
            Some(known) => known.get_or_init(make).clone(),
            None => make(),
        }
    }
}

impl Sides {
    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Sides::Decoded(decoded) => (decoded.frame.height(), decoded.frame.width()),
            Sides::Files(open) => (open.height(), open.width()),
        }
    }

    /// One half.
    ///
    /// # Errors
    /// What reading can raise.
    pub fn half(&self, half: usize) -> Result<Side<'_>, Error> {
        match self {
            Sides::Decoded(decoded) => {
                let own = decoded.half(half);
                Ok(Side {
                    denoised: Cow::Borrowed(&own.denoised),
                    albedo: own.albedo.as_ref().map(Cow::Borrowed),
                    normal: own.normal.as_ref().map(Cow::Borrowed),
                    motion: decoded.motion.as_ref().map(|motion| Cow::Borrowed(&motion[half])),
                    seen: decoded.seen[half].as_ref().map(Cow::Borrowed),
                    matchable: Some(&decoded.matchable[half]),
                    brightness: Some(&decoded.brightness[half]),
                })
            }
            Sides::Files(open) => {
                let (buffer, all) = (HALVES[half], 0..open.height());
                let role = |role| Ok::<_, Error>(open.role_rows(role, buffer, all.clone())?.map(Cow::Owned));
                Ok(Side {
                    // The first is z itself.
                    denoised: Cow::Owned(open.denoised_rows(buffer, all.clone())?.swap_remove(0)),
                    albedo: role(Role::Albedo)?,
                    normal: role(Role::Normal)?,
                    motion: role(Role::Motion)?,
                    seen: Seen::read(open, buffer)?.map(Cow::Owned),
                    matchable: None,
                    brightness: None,
                })
            }
        }
    }

    /// How much the brightness of its halves differs ([`flicker`]).
    ///
    /// # Errors
    /// What reading can raise.
    pub fn flicker(&self) -> Result<Arc<Image>, Error> {
        match self {
            Sides::Decoded(decoded) => {
                let make = |half: usize| Arc::new(brightness(&decoded.half(half).denoised));
                let of = |half: usize| decoded.brightness[half].get_or_init(|| make(half));
                Ok(decoded.flicker.get_or_init(|| Arc::new(flicker(Image::clone(of(0)), of(1)))).clone())
            }
            Sides::Files(open) => {
                // The first is z itself. One half is in memory at a time.
                let of = |half| Ok::<_, Error>(brightness(&open.denoised_rows(half, 0..open.height())?[0]));
                Ok(Arc::new(flicker(of(HALVES[0])?, &of(HALVES[1])?)))
            }
        }
    }

    /// The pictures of a half that are averaged: its variants of z, or z alone, `[3, H, W]` each.
    ///
    /// # Errors
    /// What reading can raise.
    pub fn pictures(&self, half: usize) -> Result<Vec<Cow<'_, Image>>, Error> {
        match self {
            Sides::Decoded(decoded) => {
                let variants = decoded.frame.variants.iter().map(|variant| Cow::Borrowed(&variant.halves[half]));
                Ok(or_itself(variants.collect(), || Cow::Borrowed(&decoded.half(half).denoised)))
            }
            Sides::Files(open) => {
                let pictures = open.denoised_rows(HALVES[half], 0..open.height())?;
                Ok(pictures.into_iter().map(Cow::Owned).collect())
            }
        }
    }

    /// How many pictures of each buffer are averaged.
    pub fn count(&self) -> usize {
        match self {
            Sides::Decoded(decoded) => decoded.frame.variants.len().max(1),
            Sides::Files(open) => open.variants().max(1),
        }
    }

    /// The pictures of the full buffer that are averaged.
    ///
    /// # Errors
    /// What reading can raise.
    pub fn full(&self) -> Result<Vec<Cow<'_, Image>>, Error> {
        match self {
            Sides::Decoded(decoded) => {
                let variants = decoded.frame.variants.iter().map(|variant| match &variant.full {
                    Some(full) => Cow::Borrowed(full),
                    None => Cow::Owned(decoded.frame.weights.mean_of(&variant.halves[0], &variant.halves[1])),
                });
                Ok(or_itself(variants.collect(), || baseline(&decoded.frame)))
            }
            Sides::Files(open) => {
                let pictures = open.denoised_rows(Buffer::Full, 0..open.height())?;
                Ok(pictures.into_iter().map(Cow::Owned).collect())
            }
        }
    }

    /// Noisy and denoised picture of some rows of a half.
    ///
    /// # Errors
    /// What reading can raise.
    pub fn noisy_rows(&self, half: usize, rows: Range<usize>) -> Result<[Image; 2], Error> {
        match self {
            Sides::Decoded(decoded) => {
                let own = decoded.half(half);
                Ok([&own.radiance, &own.denoised].map(|image| image.crop(rows.start, 0, rows.len(), image.width())))
            }
            Sides::Files(open) => {
                let denoised = open.denoised_rows(HALVES[half], rows.clone())?.swap_remove(0);
                match open.role_rows(Role::Radiance, HALVES[half], rows)? {
                    Some(radiance) => Ok([radiance, denoised]),
                    None => unreachable!("every frame has colour"),
                }
            }
        }
    }
}

fn or_itself<'a>(variants: Vec<Cow<'a, Image>>, own: impl Fn() -> Cow<'a, Image>) -> Vec<Cow<'a, Image>> {
    if variants.is_empty() { vec![own()] } else { variants }
}
