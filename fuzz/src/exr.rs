//! OpenEXR files: as half a of a frame, as a file of both halves, as a reference, as a picture, as the template
//! of an output.

use super::assert_one_line;
use sspc_frames::error::{Error, ErrorKind};
use sspc_frames::{FrameFiles, OpenFrame, RoleOverrides, read_picture, read_reference};
use sspc_image::{Frame, Image};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// A half buffer of the size of the seeds, so that a file that is little damaged gets past the check of sizes.
const OTHER_HALF: &[u8] = include_bytes!("../seeds/other-half.exr");

/// Where the files lie that are read.
pub struct Desk {
    folder: PathBuf,
    outputs: AtomicU64,
}

impl Desk {
    /// Puts the other half into `folder`.
    ///
    /// # Panics
    /// When it cannot be written to.
    pub fn new(folder: &Path) -> Self {
        std::fs::write(folder.join("b.exr"), OTHER_HALF).expect("the folder can be written to");
        Self { folder: folder.to_path_buf(), outputs: AtomicU64::new(0) }
    }

    /// How many outputs were written so far.
    pub fn outputs(&self) -> u64 {
        self.outputs.load(Ordering::Relaxed)
    }

    /// Reads the bytes in every way that the programs do; whether any of them gave pixels.
    pub fn read(&self, bytes: &[u8]) -> bool {
        let path = self.folder.join("a.exr");
        std::fs::write(&path, bytes).expect("the folder can be written to");
        let halves = FrameFiles::halves(&path, self.folder.join("b.exr"));
        let both = FrameFiles::both_in_one(&path);
        let frames = [&halves, &both].map(|files| {
            let frame = checked(read_frame(files));
            frame.inspect(|frame| {
                assert_complete(frame);
                assert_bands_agree(files, frame);
            })
        });
        let reference = checked(read_reference(&path, None));
        if let Some(reference) = &reference {
            let all = reference.halves.iter().flatten().chain([&reference.mean]);
            all.for_each(|image| assert!(image.same_size(&reference.mean) && image.channels() == 3));
        }
        let picture = checked(read_picture(&path, None));
        if let Some(picture) = &picture {
            self.write_over(&path, picture);
        }
        picture.is_some() || reference.is_some() || frames.iter().any(Option::is_some)
    }

    /// What can be read as a picture is the template of an output, or refused; the template stays as it was.
    fn write_over(&self, template: &Path, picture: &Image) {
        let out = self.folder.join("out.exr");
        // More is not worth the time: what is written is as large as what was read.
        const MOST_PIXELS: usize = 1 << 16;
        if picture.pixels() > MOST_PIXELS {
            return;
        }
        let Some(open) = checked(OpenFrame::open(&as_halves(template), &RoleOverrides::none())) else { return };
        if (open.width(), open.height()) != (picture.width(), picture.height()) {
            // The noisy colour is not what a viewer shows.
            return;
        }
        let plan = match open.output() {
            Ok(plan) => plan,
            Err(error) => {
                assert_one_line(&error);
                return assert_eq!(error.kind(), ErrorKind::Input, "refused before any work: {error}");
            }
        };
        match plan.write(&out, &[], &[picture], &[("sspc.tool".into(), "fuzz".into())]) {
            Ok(()) => {
                let written =
                    OpenFrame::open(&as_halves(&out), &RoleOverrides::none()).expect("what was written opens");
                let rows = 0..open.height();
                assert!(written.rows(rows.clone()).is_ok() || open.rows(rows).is_err(), "what was written can be read");
                assert_attributes_kept(template, &out);
                self.outputs.fetch_add(1, Ordering::Relaxed);
            }
            // Pixels of other channels may be damaged, which no header tells.
            Err(error) => {
                assert_one_line(&error);
                assert_eq!(error.kind(), ErrorKind::Input, "{error}");
            }
        }
    }
}

/// One file as both halves, noisy and denoised.
fn as_halves(path: &Path) -> FrameFiles {
    FrameFiles::halves(path, path).with_denoised(Some(path.into()), Some(path.into()), None)
}

/// All rows of a frame, looked over as the programs do.
fn read_frame(files: &FrameFiles) -> Result<Frame, Error> {
    let open = OpenFrame::open(files, &RoleOverrides::none())?;
    let frame = open.rows(0..open.height())?;
    let mut inspection = open.inspection();
    inspection.look(&frame, 0, 0..open.height());
    for text in open.warnings(&inspection)? {
        assert!(!text.chars().any(char::is_control), "control characters in {text:?}");
    }
    Ok(frame)
}

/// Every attribute of the template is in the output, byte for byte and in its order, but for what a picture changes; and
/// where another reader opens the template, it opens the output.
fn assert_attributes_kept(template: &Path, out: &Path) {
    const CHANGED: [&[u8]; 5] = [b"channels", b"compression", b"tiles", b"chunkCount", b"preview"];
    let [before, after] = [template, out].map(|path| attributes(&std::fs::read(path).expect("it was read before")));
    let ours = |name: &[u8]| CHANGED.contains(&name) || name.starts_with(b"sspc.");
    let kept = |list: &[Attribute]| list.iter().filter(|(name, ..)| !ours(name)).cloned().collect::<Vec<_>>();
    assert_eq!(kept(&before), kept(&after), "attributes");
    let opens = |path: &Path| exr::meta::MetaData::read_from_file(path, false).is_ok();
    assert!(!opens(template) || opens(out), "another reader");
}

/// Name, type and value.
type Attribute = (Vec<u8>, Vec<u8>, Vec<u8>);

/// The attributes of all headers of a file that is known to be sound, one part after another.
fn attributes(bytes: &[u8]) -> Vec<Attribute> {
    let (several, mut rest, mut all) = (bytes[5] & 0x10 != 0, &bytes[8..], Vec::new());
    let text = |rest: &mut &[u8]| {
        let end = rest.iter().position(|&byte| byte == 0).expect("a text ends");
        let (text, after) = rest.split_at(end);
        *rest = &after[1..];
        text.to_vec()
    };
    loop {
        let name = text(&mut rest);
        if name.is_empty() {
            if !several || rest[0] == 0 {
                return all;
            }
            continue;
        }
        let kind = text(&mut rest);
        let (length, after) = rest.split_first_chunk::<4>().expect("a length");
        let (value, after) = after.split_at(u32::from_le_bytes(*length) as usize);
        all.push((name, kind, value.to_vec()));
        rest = after;
    }
}

/// Rows read by themselves are those of the whole frame.
fn assert_bands_agree(files: &FrameFiles, frame: &Frame) {
    let open = OpenFrame::open(files, &RoleOverrides::none()).expect("it was read before");
    let height = frame.height();
    for rows in [0..1, height / 3..height / 2 + 1, height - 1..height] {
        let band = open.rows(rows.clone()).expect("it was read before");
        let of_whole = frame.rows(rows.start, rows.len());
        assert!(same_bits(&band.a.radiance, &of_whole.a.radiance), "rows {rows:?}");
        assert!(same_bits(&band.b.denoised, &of_whole.b.denoised), "rows {rows:?}");
    }
}

/// Equal, NaN included.
fn same_bits(x: &Image, y: &Image) -> bool {
    x.same_size(y) && x.data().iter().zip(y.data()).all(|(x, y)| x.to_bits() == y.to_bits())
}

fn checked<T>(outcome: Result<T, Error>) -> Option<T> {
    outcome
        .inspect_err(|error| {
            assert_one_line(error);
            assert_eq!(error.kind(), ErrorKind::Input, "{error}");
        })
        .ok()
}

/// All that a frame holds has one size and the right channels.
fn assert_complete(frame: &Frame) {
    let size = &frame.a.radiance;
    assert!(size.pixels() > 0);
    for half in [&frame.a, &frame.b] {
        let triples = [&half.radiance, &half.denoised].into_iter().chain(&half.albedo).chain(&half.normal);
        triples.for_each(|image| assert!(image.same_size(size) && image.channels() == 3));
        half.visibility.iter().for_each(|image| assert!(image.same_size(size) && image.channels() == 1));
    }
    frame.denoised.iter().for_each(|image| assert!(image.same_size(size) && image.channels() == 3));
}
