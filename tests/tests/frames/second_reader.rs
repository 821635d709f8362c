//! What is written opens in a second, independent reader, OpenEXR's own: every kind of file that it can write is the
//! template of an output, and everything but the picture is in it byte for byte.
//!
//! Needs a Python with OpenEXR, which `SSPC_PYTHON_VENV` names; without it the test says aloud that it is skipped.

use sspc_frames::resolve::views;
use sspc_frames::{FrameFiles, OpenFrame, OutputPlan, RoleOverrides};
use sspc_image::{Buffer, Image, Role};
use sspc_testkit::frames::read_frame;
use std::path::{Path, PathBuf};
use std::process::Command;

fn run_python(python: &Path, what: &str, folder: &Path) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/frames/second_reader.py");
    let output = Command::new(python).arg(script).arg(what).arg(folder).output().expect("python runs");
    let said = [output.stdout, output.stderr].concat();
    assert!(output.status.success(), "{what}:\n{}", String::from_utf8_lossy(&said));
}

/// Every view of a frame, 0.125 brighter than denoised, written into a copy of half a.
fn write_output(case: &Path) {
    let file = |name: &str| case.join(name).with_extension("exr");
    let halves = FrameFiles::halves(file("a"), file("b"));
    let roles = std::fs::read_to_string(case.join("roles")).expect("roles");
    let all_views = roles == "view=all";
    let overrides = match roles.is_empty() || all_views {
        true => RoleOverrides::none(),
        false => roles.parse().expect("roles"),
    };
    let (files, each) = match all_views {
        true => {
            let views = views(&halves).expect("views").into_iter();
            (halves, views.map(|view| overrides.clone().of_each_view(view)).collect())
        }
        false => {
            let denoised = [(Buffer::A, "denoised-a"), (Buffer::B, "denoised-b"), (Buffer::Full, "denoised")];
            let given = |files: FrameFiles, (buffer, name)| files.with_role(Role::Denoised, buffer, file(name));
            (denoised.into_iter().fold(halves, given), vec![overrides])
        }
    };
    let (mut plan, mut pictures): (Option<OutputPlan>, Vec<Image>) = (None, Vec::new());
    for overrides in each {
        let open = OpenFrame::open(&files, &overrides).unwrap_or_else(|error| panic!("{}: {error}", case.display()));
        let own = open.output().expect("a possible output");
        let read = read_frame(&files, &overrides).unwrap_or_else(|error| panic!("{}: {error}", case.display()));
        let frame = read.frame;
        let mut picture = frame.denoised.unwrap_or(frame.a.denoised);
        picture.data_mut().iter_mut().for_each(|value| *value += 0.125);
        pictures.push(picture);
        plan = Some(match plan {
            Some(plan) => plan.and(own).expect("other channels"),
            None => own,
        });
    }
    let provenance = [("sspc.tool".to_string(), "a test".to_string())];
    let plan = plan.expect("at least one view");
    plan.write(&file("out"), &files.all(), &pictures.iter().collect::<Vec<_>>(), &provenance).expect("written");
}

#[test]
fn every_kind_of_output_opens_in_openexr_and_keeps_what_is_not_ours() {
    let Some(python) = std::env::var_os("SSPC_PYTHON_VENV").map(PathBuf::from) else {
        eprintln!("skipped: no SSPC_PYTHON_VENV, so no second reader");
        return;
    };
    let folder = tempfile::tempdir().expect("folder");
    run_python(&python, "make", folder.path());
    let mut cases: Vec<PathBuf> =
        std::fs::read_dir(folder.path()).expect("cases").map(|e| e.expect("case").path()).collect();
    cases.sort();
    assert!(cases.len() > 30, "{} cases", cases.len());
    cases.iter().for_each(|case| write_output(case));
    run_python(&python, "check", folder.path());
}
