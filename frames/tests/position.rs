//! World positions and camera matrices: read of shots only, and never in the way of anything else.

use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer};
use exr::meta::attribute::{AttributeValue, Text};
use exr::meta::header::LayerAttributes;
use exr::prelude::WritableImage;
use sspc_frames::{FrameFiles, OpenFrame, RoleOverrides};
use sspc_image::{Buffer, Role};
use std::path::{Path, PathBuf};

const SIZE: (usize, usize) = (6, 4);
const MATRIX: [f32; 16] = [1.0, 0.5, 0.0, -2.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

fn write(path: PathBuf, channels: &[&str], size: (usize, usize), camera: &[(&str, AttributeValue)]) -> PathBuf {
    let channel = |name: &&str| AnyChannel::new(*name, FlatSamples::F32(vec![0.5; size.0 * size.1]));
    let mut attributes = LayerAttributes::default();
    attributes.other.extend(camera.iter().map(|(name, value)| (Text::from(*name), value.clone())));
    let list = AnyChannels::sort(channels.iter().map(channel).collect());
    let layer = Layer::new(size, attributes, Encoding::FAST_LOSSLESS, list);
    Image::from_layer(layer).write().to_file(&path).expect("a test file");
    path
}

const HALF: [&str; 6] = ["R", "G", "B", "denoised.R", "denoised.G", "denoised.B"];
const SEEN: [&str; 9] = ["R", "G", "B", "denoised.R", "denoised.G", "denoised.B", "P.X", "P.Y", "P.Z"];

fn pair(folder: &Path, a: &[&str], b: &[&str], camera: &[(&str, AttributeValue)]) -> FrameFiles {
    FrameFiles::halves(write(folder.join("a.exr"), a, SIZE, camera), write(folder.join("b.exr"), b, SIZE, &[]))
}

fn of_shot(files: &FrameFiles) -> OpenFrame {
    OpenFrame::open(files, &RoleOverrides::none().with_motion()).expect("a frame")
}

fn positions(frame: &OpenFrame) -> usize {
    frame.sources().iter().filter(|source| source.role == Role::Position).count()
}

#[test]
fn positions_are_of_shots() {
    let folder = tempfile::tempdir().expect("folder");
    let files = pair(folder.path(), &SEEN, &SEEN, &[]);
    let frame = of_shot(&files);
    assert_eq!(positions(&frame), 2);
    assert!(frame.role_rows(Role::Position, Buffer::B, 1..3).expect("rows").is_some());
    let alone = OpenFrame::open(&files, &RoleOverrides::none()).expect("a frame");
    assert_eq!((positions(&alone), alone.notes().len()), (0, 0));
    let named = RoleOverrides::parse(["position=none"]).expect("an override").with_motion();
    assert_eq!(positions(&OpenFrame::open(&files, &named).expect("a frame")), 0);
}

#[test]
fn positions_that_cannot_be_used_are_named_and_left_out() {
    let folder = tempfile::tempdir().expect("folder");
    let lonely = of_shot(&pair(folder.path(), &SEEN, &HALF, &[]));
    assert_eq!(positions(&lonely), 0);
    assert!(lonely.notes()[0].contains("world position: only half a"), "{:?}", lonely.notes());
    // Of another size, in files of their own.
    let elsewhere = write(folder.path().join("p.exr"), &["P.X", "P.Y", "P.Z"], (3, 9), &[]);
    let files = [Buffer::A, Buffer::B]
        .iter()
        .fold(pair(folder.path(), &HALF, &HALF, &[]), |files, half| files.with_role(Role::Position, *half, &elsewhere));
    let frame = of_shot(&files);
    assert_eq!(positions(&frame), 0);
    assert!(frame.notes()[0].contains("world position is not used"), "{:?}", frame.notes());
}

#[test]
fn matrices_are_found_by_name_and_type() {
    let folder = tempfile::tempdir().expect("folder");
    let matrix = |first: f32| {
        let mut matrix = MATRIX;
        matrix[0] = first;
        matrix
    };
    let as_matrix = |first| AttributeValue::Matrix4x4(matrix(first));
    let text = AttributeValue::Text(Text::from("1 0 0 0"));
    for (camera, expected) in [
        (vec![("NP", as_matrix(3.0)), ("worldToScreen", as_matrix(2.0)), ("other", as_matrix(5.0))], vec![2.0, 3.0]),
        (vec![("worldToScreen", text), ("NP", AttributeValue::Matrix3x3([1.0; 9]))], vec![]),
    ] {
        let frame = of_shot(&pair(folder.path(), &SEEN, &SEEN, &camera));
        let expected: Vec<[f32; 16]> = expected.into_iter().map(matrix).collect();
        assert_eq!(frame.cameras(Buffer::A), expected);
        // Half b's file has none.
        assert_eq!(frame.cameras(Buffer::B), expected);
    }
}
