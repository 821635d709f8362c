//! How many bytes the pictures of a frame may take, so that a page stays one that can be mailed and opened.

/// Bytes of the pictures of one frame up to [`FULL_HD`] pixels, as text of the page: with scripts and figures the page
/// stays below 5 MB.
pub const FRAME_BYTES: usize = 4_600_000;
/// Pixels of a frame from which on the bytes grow with the frame.
pub const FULL_HD: usize = 1920 * 1080;
/// Bytes of all pictures of a shot, as text of the page; frames share them.
pub const SHOT_BYTES: usize = 40_000_000;

/// Bytes, as text of the page, for the pictures of one of `frames` frames of so many pixels.
pub fn of_frame(pixels: usize, frames: usize) -> usize {
    let alone = FRAME_BYTES as f64 * (pixels as f64 / FULL_HD as f64).max(1.0);
    (alone as usize).min(SHOT_BYTES / frames.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_frame_stays_below_five_megabytes_and_a_shot_below_its_own_limit() {
        assert_eq!(of_frame(640 * 360, 1), FRAME_BYTES);
        assert_eq!(of_frame(FULL_HD, 1), FRAME_BYTES);
        assert_eq!(of_frame(4 * FULL_HD, 1), 4 * FRAME_BYTES);
        assert_eq!(of_frame(4 * FULL_HD, 100), SHOT_BYTES / 100);
        assert_eq!(of_frame(0, 0), FRAME_BYTES);
    }
}
