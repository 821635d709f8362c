//! Pictures laid out as hosts keep them.

use half::f16;
use sspc::types::{SSPC_FLOAT16, SSPC_FLOAT32, SspcInput, SspcLayout, SspcOutput};
use sspc_image::Image;
use std::ptr;

/// How a picture lies in memory.
#[derive(Clone, Copy, Debug, Default)]
pub struct Layout {
    /// Channel after channel, else pixel after pixel.
    pub planar: bool,
    /// Bytes that lie before the first value, after each pixel, and after each row.
    pub gaps: [usize; 3],
    /// The bottom row first.
    pub upwards: bool,
    /// The rightmost pixel first.
    pub leftwards: bool,
    /// Half floats.
    pub half: bool,
}

/// What lies between values.
const CANARY: u8 = 0xA5;

/// A picture in memory.
pub struct Laid {
    bytes: Vec<u8>,
    layout: Layout,
    size: [usize; 3],
}

impl Laid {
    /// Memory for `[channels, height, width]`.
    pub fn room(layout: Layout, channels: usize, height: usize, width: usize) -> Self {
        let mut laid = Self { bytes: Vec::new(), layout, size: [channels, height, width] };
        let ([pixel, row, channel], planes) = (laid.steps(), if layout.planar { channels } else { 1 });
        let plane = row * height;
        laid.bytes = vec![CANARY; layout.gaps[0] + planes * plane];
        assert!(pixel >= laid.value() && (layout.planar || channel == laid.value()));
        laid
    }

    /// The image in memory.
    pub fn of(layout: Layout, image: &Image) -> Self {
        let mut laid = Self::room(layout, image.channels(), image.height(), image.width());
        for (at, (c, y, x)) in laid.places() {
            let value = image.at(c, y, x);
            match layout.half {
                true => laid.bytes[at..at + 2].copy_from_slice(&f16::from_f32(value).to_ne_bytes()),
                false => laid.bytes[at..at + 4].copy_from_slice(&value.to_ne_bytes()),
            }
        }
        laid
    }

    /// The memory as an image; what lies between the values must be as it was.
    pub fn image(&self) -> Image {
        let [channels, height, width] = self.size;
        let mut image = Image::zeros(channels, height, width);
        let mut between = vec![true; self.bytes.len()];
        for (at, (c, y, x)) in self.places() {
            let bytes = &self.bytes[at..at + self.value()];
            between[at..at + self.value()].fill(false);
            image.set(
                c,
                y,
                x,
                match self.layout.half {
                    true => f16::from_ne_bytes([bytes[0], bytes[1]]).to_f32(),
                    false => f32::from_ne_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
                },
            );
        }
        let touched = self.bytes.iter().zip(between).filter(|(byte, between)| *between && **byte != CANARY);
        assert_eq!(touched.count(), 0, "bytes between values were written");
        image
    }

    pub fn untouched(&self) -> bool {
        self.bytes.iter().all(|byte| *byte == CANARY)
    }

    pub fn input(&self) -> SspcInput {
        SspcInput { data: self.bytes[self.first()..].as_ptr().cast(), layout: self.layout() }
    }

    pub fn output(&mut self) -> SspcOutput {
        let (first, layout) = (self.first(), self.layout());
        SspcOutput { data: ptr::from_mut(&mut self.bytes[first]).cast(), layout }
    }

    fn value(&self) -> usize {
        if self.layout.half { 2 } else { 4 }
    }

    fn layout(&self) -> SspcLayout {
        let [pixel_stride, row_stride, channel_stride] = self.strides();
        let value_type = if self.layout.half { SSPC_FLOAT16 } else { SSPC_FLOAT32 };
        SspcLayout { pixel_stride, row_stride, channel_stride, value_type, reserved: 0 }
    }

    /// Bytes from a pixel, row, channel to the next, upwards in memory.
    fn steps(&self) -> [usize; 3] {
        let ([channels, height, width], [_, after_pixel, after_row]) = (self.size, self.layout.gaps);
        let values = if self.layout.planar { 1 } else { channels };
        let pixel = values * self.value() + after_pixel;
        let row = width * pixel + after_row;
        [pixel, row, if self.layout.planar { height * row } else { self.value() }]
    }

    /// Where the picture's top left pixel begins.
    fn first(&self) -> usize {
        let ([_, height, width], [pixel, row, _]) = (self.size, self.steps());
        let Layout { gaps, upwards, leftwards, .. } = self.layout;
        gaps[0] + if upwards { (height - 1) * row } else { 0 } + if leftwards { (width - 1) * pixel } else { 0 }
    }

    fn strides(&self) -> [isize; 3] {
        let [pixel, row, channel] = self.steps().map(|step| step as isize);
        let turned = |step: isize, turned| if turned { -step } else { step };
        [turned(pixel, self.layout.leftwards), turned(row, self.layout.upwards), channel]
    }

    /// Where every value lies: byte, and channel, row, column.
    fn places(&self) -> Vec<(usize, (usize, usize, usize))> {
        let ([channels, height, width], [pixel, row, channel]) = (self.size, self.strides());
        let all = (0..channels).flat_map(|c| (0..height).flat_map(move |y| (0..width).map(move |x| (c, y, x))));
        let place = |(c, y, x)| {
            let at = self.first() as isize + x as isize * pixel + y as isize * row + c as isize * channel;
            (at as usize, (c, y, x))
        };
        all.map(place).collect()
    }
}
