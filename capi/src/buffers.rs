//! The caller's buffers to planar images, and back.

use crate::outcome::nonsense;
use crate::types::{
    SSPC_FLOAT16, SSPC_FLOAT32, SSPC_MAX_PIXELS, SSPC_MAX_SIDE, SspcFrame, SspcInput, SspcLayout, SspcOutput,
};
use half::f16;
use sspc_cli::Failure;
use sspc_image::Image;

/// Height and width in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    height: usize,
    width: usize,
}

impl Size {
    /// Of a frame.
    ///
    /// # Errors
    /// No pixels, or too many.
    pub fn of(frame: &SspcFrame) -> Result<Self, Failure> {
        let &SspcFrame { height, width, .. } = frame;
        let sides = 1..=SSPC_MAX_SIDE;
        if sides.contains(&height) && sides.contains(&width) && u64::from(height) * u64::from(width) <= SSPC_MAX_PIXELS
        {
            return Ok(Self { height: height as usize, width: width as usize });
        }
        let expected = format!("1 to {SSPC_MAX_SIDE} pixels a side and at most {SSPC_MAX_PIXELS} in all");
        Err(nonsense("frame", &expected, format!("{width} x {height}"), "set width and height"))
    }

    /// Pixels.
    pub fn pixels(self) -> usize {
        self.height * self.width
    }
}

/// Where the values of a picture lie: checked strides, so that no offset overflows.
#[derive(Clone, Copy, Debug)]
struct Layout {
    channels: usize,
    size: Size,
    /// Bytes from a pixel, row, channel to the next.
    strides: [isize; 3],
    is_half: bool,
}

impl Layout {
    fn new(name: &str, channels: usize, size: Size, given: &SspcLayout) -> Result<Self, Failure> {
        let of = |field: &str| format!("{name}.layout.{field}");
        let value = match given.value_type {
            SSPC_FLOAT32 => size_of::<f32>(),
            SSPC_FLOAT16 => size_of::<f16>(),
            other => return Err(nonsense(&of("value_type"), "SSPC_FLOAT32 or SSPC_FLOAT16", other, "")),
        };
        if given.reserved != 0 {
            return Err(nonsense(&of("reserved"), "0", given.reserved, "set what is not used to zero"));
        }
        let or = |stride: isize, packed: i128| if stride == 0 { packed } else { stride as i128 };
        let channel = or(given.channel_stride, value as i128);
        let pixel = or(given.pixel_stride, (channels * value) as i128);
        let row = or(given.row_stride, size.width as i128 * pixel);
        let strides = [pixel, row, channel];
        let steps = [size.width, size.height, channels].map(|count| count as i128 - 1);
        // No sum of some of these can be farther away.
        let reach: i128 = strides.iter().zip(steps).map(|(stride, steps)| stride.abs() * steps).sum();
        let expected = "values within the memory of a process";
        let too_far = || nonsense(&of("row_stride"), expected, format!("{reach} bytes between two of them"), "");
        if reach > isize::MAX as i128 / 2 {
            return Err(too_far());
        }
        // Where there is one row, or one pixel, its stride is of no use and may be anything.
        let [pixel, row, channel] = strides.map(|stride| isize::try_from(stride).unwrap_or(0));
        Ok(Self { channels, size, strides: [pixel, row, channel], is_half: value == size_of::<f16>() })
    }

    /// Bytes from the first value to that of a channel of a pixel.
    fn offset(&self, c: usize, y: usize, x: usize) -> isize {
        let [pixel, row, channel] = self.strides;
        // Checked: none of the products leaves isize.
        x as isize * pixel + y as isize * row + c as isize * channel
    }
}

/// A picture that the caller gives.
pub struct Given {
    data: *const u8,
    layout: Layout,
}

// SAFETY: nobody writes to the caller's pictures while they are read.
unsafe impl Send for Given {}
// SAFETY: the same.
unsafe impl Sync for Given {}

impl Given {
    /// A picture of so many channels, where there is one.
    ///
    /// # Errors
    /// Types and strides that make no sense.
    pub fn of(name: &str, channels: usize, size: Size, input: &SspcInput) -> Result<Option<Self>, Failure> {
        let layout = Layout::new(name, channels, size, &input.layout)?;
        Ok((!input.data.is_null()).then(|| Self { data: input.data.cast(), layout }))
    }

    /// Its values, `[channels, H, W]`.
    ///
    /// # Safety
    /// All of them lie in memory that nobody writes to meanwhile.
    pub unsafe fn read(&self) -> Image {
        let Layout { channels, size, .. } = self.layout;
        Image::from_rows(channels, size.height, size.width, |c, y, row| {
            for (x, value) in row.iter_mut().enumerate() {
                // SAFETY: the caller's promise; `offset` was checked not to overflow, and values need no alignment.
                *value = unsafe {
                    let at = self.data.offset(self.layout.offset(c, y, x));
                    if self.layout.is_half {
                        at.cast::<f16>().read_unaligned().to_f32()
                    } else {
                        at.cast::<f32>().read_unaligned()
                    }
                };
            }
        })
    }

    /// How many values it has for each pixel.
    pub fn channels(&self) -> usize {
        self.layout.channels
    }
}

/// A picture that the caller wants.
pub struct Wanted {
    data: *mut u8,
    layout: Layout,
}

// SAFETY: one thread writes, and nobody reads meanwhile.
unsafe impl Send for Wanted {}
// SAFETY: the same.
unsafe impl Sync for Wanted {}

impl Wanted {
    /// A picture of so many channels, where it is wanted.
    ///
    /// # Errors
    /// Types and strides that make no sense.
    pub fn of(name: &str, channels: usize, size: Size, output: &SspcOutput) -> Result<Option<Self>, Failure> {
        let layout = Layout::new(name, channels, size, &output.layout)?;
        Ok((!output.data.is_null()).then(|| Self { data: output.data.cast(), layout }))
    }

    /// Writes the values of an image `[channels, H, W]`.
    ///
    /// # Safety
    /// All places of the picture lie in memory that nobody else uses meanwhile.
    pub unsafe fn write(&self, image: &Image) {
        let Layout { channels, size, .. } = self.layout;
        for y in 0..size.height {
            for c in 0..channels {
                for (x, value) in image.row(c, y).iter().enumerate() {
                    // SAFETY: as in `Given::read`.
                    unsafe {
                        let at = self.data.offset(self.layout.offset(c, y, x));
                        if self.layout.is_half {
                            at.cast::<f16>().write_unaligned(f16::from_f32(*value));
                        } else {
                            at.cast::<f32>().write_unaligned(*value);
                        }
                    }
                }
            }
        }
    }
}
