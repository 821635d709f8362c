//! Files whose writer did not come to its table of chunks are read as far as their chunks are there.

use sspc_frames::error::Error;
use sspc_frames::read_picture;
use sspc_image::Image;
use sspc_testkit::exr_parts::{write_over, write_picture};

const SIZE: (usize, usize) = (40, 50);

#[test]
fn a_table_of_zeros_is_made_again_from_the_chunks() {
    let folder = tempfile::tempdir().expect("folder");
    let (whole, bare, out) = (folder.path().join("a.exr"), folder.path().join("b.exr"), folder.path().join("out.exr"));
    let picture = Image::from_fn(3, SIZE.1, SIZE.0, |c, y, x| (c * 10_000 + y * 100 + x) as f32);
    write_picture(&whole, &picture);
    let mut bytes = std::fs::read(&whole).expect("read");
    // Four chunks of 16 rows, whose table lies before the first of them: its first offset says where that is.
    let offset = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"));
    let table = (0..bytes.len() - 8).find(|&at| offset(at) == at as u64 + 32).expect("a table");
    bytes[table..table + 32].fill(0);
    std::fs::write(&bare, &bytes).expect("written");
    assert_eq!(read_picture(&bare, None).expect("all chunks are there"), picture);
    write_over(&out, &bare, &picture, &[]).expect("written");
    assert_eq!(read_picture(&out, None).expect("an output with a table"), picture);

    // One that is still being written.
    std::fs::write(&bare, &bytes[..bytes.len() - 100]).expect("written");
    assert!(matches!(read_picture(&bare, None), Err(Error::Damaged { .. })));
    assert!(matches!(write_over(&out, &bare, &picture, &[]), Err(Error::Damaged { .. })), "found before any work");
}
