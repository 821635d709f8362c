//! What is written opens in second, independent readers, OpenEXR's own and OpenImageIO: every kind of file that OpenEXR
//! can write is the template of an output, and everything but the picture, or the passes that were corrected with it, is
//! in it byte for byte.
//!
//! Needs a Python with OpenEXR, which `SSPC_PYTHON_VENV` names; without it the test says aloud that it is skipped.

use clap::Parser;
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_frames::resolve::views;
use sspc_frames::{FrameFiles, OpenFrame, OutputPlan, RoleOverrides};
use sspc_image::{Buffer, Image, Role};
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model, write_network};
use sspc_testkit::frames::read_frame;
use sspc_testkit::skips;
use std::path::{Path, PathBuf};
use std::process::Command;

fn run_python(python: &Path, what: &str, folder: &Path) -> String {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/frames/second_reader.py");
    let output = Command::new(python).arg(script).arg(what).arg(folder).output().expect("python runs");
    let said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert!(output.status.success(), "{what}:\n{said}");
    said
}

/// What `sspc-infer run` makes of a case, with these further arguments.
fn run_program(case: &Path, arguments: &str) {
    let file = |name: &str| case.join(name).with_extension("exr").display().to_string();
    let model = case.join("model.onnx");
    let contract = Contract::new(Form::Gated);
    let weights = start::analytic(contract.shape, 0.7, &mut Rng::new(1)).weights;
    let bytes = write_network(&Model::new(contract, weights).expect("a model"));
    std::fs::write(&model, bytes).expect("model");
    let model = model.display().to_string();
    let mut words = ["sspc-infer", "run", "--quiet", "--model", &model].map(String::from).to_vec();
    words.extend([file("a"), file("b"), "-o".into(), file("out")]);
    words.extend(arguments.split(' ').map(String::from));
    if !arguments.contains("--view") {
        let denoised = [("--denoised-a", "denoised-a"), ("--denoised-b", "denoised-b"), ("--denoised", "denoised")];
        words.extend(denoised.into_iter().flat_map(|(option, name)| [option.into(), file(name)]));
    }
    let arguments = sspc_infer::cli::Arguments::try_parse_from(words).expect("arguments");
    sspc_infer::cli::run(arguments).unwrap_or_else(|failure| panic!("{}: {failure:?}", case.display()));
}

/// What the program makes of a case, or every view of a frame, 0.125 brighter than denoised, written into a copy of half a.
fn write_output(case: &Path) {
    let file = |name: &str| case.join(name).with_extension("exr");
    let halves = FrameFiles::halves(file("a"), file("b"));
    let roles = std::fs::read_to_string(case.join("roles")).expect("roles");
    if let Some(arguments) = roles.strip_prefix("run ") {
        return run_program(case, arguments);
    }
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
fn every_kind_of_output_opens_elsewhere_and_keeps_what_is_not_ours() {
    let Some(python) = skips::python("a second reader") else { return };
    let folder = tempfile::tempdir().expect("folder");
    run_python(&python, "make", folder.path());
    let mut cases: Vec<PathBuf> =
        std::fs::read_dir(folder.path()).expect("cases").map(|e| e.expect("case").path()).collect();
    cases.sort();
    assert!(cases.len() > 40, "{} cases", cases.len());
    cases.iter().for_each(|case| write_output(case));
    if run_python(&python, "check", folder.path()).contains("without OpenImageIO") {
        skips::skipped("OpenImageIO as a reader", "the environment of the tests has no such package");
    }
}
