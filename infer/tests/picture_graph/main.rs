//! The picture graph in onnxruntime against our own programs, in standard operators and with our own. Needs the virtual environment of the PyTorch reference,
//! whose interpreter `SSPC_PYTHON_VENV` names; without it the tests say aloud that they are skipped.

mod made;

use made::{damaged, fireflies, frame, gated, model_of, mostly_still, opposite, scaled};
use sspc_core::composition::Composition;
use sspc_core::correct::{Corrected, CorrectionSettings};
use sspc_core::frame_stats::FrameStats;
use sspc_core::prepare::{Exposure, baseline};
use sspc_core::trust::Trust;
use sspc_frames::{FrameFiles, RoleOverrides};
use sspc_image::{DenoisedVariant, Frame, HalfBuffer, Image};
use sspc_infer::engine::{Engine, Kernels};
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_onnx::{Model, load_model, write_image, write_operators, write_picture};
use sspc_testkit::case::Array;
use sspc_testkit::closeness::{Relative, assert_images_close, compare};
use sspc_testkit::frames::{read_frame, sample_folder, whole_sample};
use sspc_testkit::golden;
use sspc_testkit::method::{correct, settings};
use sspc_testkit::skips::python;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Of a value, or of its plane's mean where that is larger: float32 sums in another order. (Measured: 5e-5.)
const TOLERANCE: f64 = 3e-4;
/// The same of a file in half floats.
const FILE_TOLERANCE: f64 = 1e-3;

/// What is left out without that environment.
const WHAT: &str = "the picture graph in onnxruntime";

/// A frame, a model, and what is asked for.
struct Case {
    name: &'static str,
    frame: Frame,
    model: Model,
    strength: f32,
}

impl Case {
    fn new(name: &'static str, frame: Frame, model: Model) -> Self {
        Self { name, frame, model, strength: 1.0 }
    }

    fn stats(&self) -> FrameStats {
        let contract = &self.model.contract;
        FrameStats::of(&self.frame, contract.exposure).with_features_of(contract.features)
    }

    /// What `sspc-infer run` computes.
    fn ours(&self) -> Corrected {
        let engine = Engine::new(self.model.clone(), Kernels::Fused(Isa::best()), 128);
        let how = CorrectionSettings { strength: self.strength, ..settings(&self.model.contract) };
        correct(&self.frame, self.stats(), &engine, &how)
    }

    /// Writes graph and inputs.
    fn write(&self, folder: &Path) {
        std::fs::create_dir(folder).expect("folder");
        std::fs::write(folder.join("picture.onnx"), write_picture(&self.model)).expect("model");
        std::fs::write(folder.join("operators.onnx"), write_operators(&self.model)).expect("model");
        let Frame { a, b, variants, .. } = &self.frame;
        let (height, width) = (self.frame.height(), self.frame.width());
        let mut shapes = serde_json::Map::new();
        let mut put = |name: &str, shape: &[usize], values: Vec<f32>| {
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            std::fs::write(folder.join(format!("{name}.f32")), bytes).expect("array");
            shapes.insert(name.into(), serde_json::json!(shape));
        };
        let none = |channels: usize| Image::zeros(channels, height, width);
        type Part = fn(&HalfBuffer) -> Option<&Image>;
        let parts: [(&str, usize, Part); 5] = [
            ("radiance", 3, |half| Some(&half.radiance)),
            ("denoised", 3, |half| Some(&half.denoised)),
            ("albedo", 3, |half| half.albedo.as_ref()),
            ("normal", 3, |half| half.normal.as_ref()),
            ("visibility", 1, |half| half.visibility.as_ref()),
        ];
        for (name, channels, part) in parts {
            let of = |half| part(half).cloned().unwrap_or_else(|| none(channels)).data().to_vec();
            put(name, &[2, channels, height, width], [of(a), of(b)].concat());
        }
        put("denoised_full", &[1, 3, height, width], baseline(&self.frame).data().to_vec());
        let in_shot = self.model.contract.extra_frames > 0;
        for (k, DenoisedVariant { halves, full }) in variants.iter().enumerate().filter(|(k, _)| in_shot || *k > 0) {
            let stem = if k == 0 { String::new() } else { format!("z{}_", k + 1) };
            let stem = if in_shot { format!("{stem}mean") } else { format!("{stem}denoised") };
            put(&stem, &[2, 3, height, width], halves.iter().flat_map(|z| z.data()).copied().collect());
            let full = full.clone().unwrap_or_else(|| Image::mean_of(&halves[0], &halves[1]));
            put(&format!("{stem}_full"), &[1, 3, height, width], full.data().to_vec());
        }
        let stats = self.stats();
        put("exposure", &[1], vec![stats.exposure]);
        // The caller decides whether the halves are what they claim to be.
        let strength = if matches!(stats.trust(), Trust::None(_)) { 0.0 } else { self.strength };
        put("strength", &[1], vec![strength]);
        std::fs::write(folder.join("arrays.json"), serde_json::Value::Object(shapes).to_string()).expect("shapes");
    }
}

/// What onnxruntime gives.
struct Theirs {
    picture: Image,
    share: Image,
    fallback: i64,
}

/// The operator library: it lies beside the tests of the crates that depend on it.
fn library() -> PathBuf {
    let test = std::env::current_exe().expect("a path");
    let name = format!("{}sspc_operators{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    test.parent().expect("a folder").join(name)
}

/// Both graphs.
const GRAPHS: [&str; 2] = ["picture", "operators"];

fn in_onnxruntime(python: &Path, graph: &str, cases: &[Case]) -> Vec<Theirs> {
    let folder = tempfile::tempdir().expect("folder");
    let of = |case: &Case| folder.path().join(case.name.replace([' ', ','], "-"));
    cases.iter().for_each(|case| case.write(&of(case)));
    let folders: Vec<PathBuf> = cases.iter().map(of).collect();
    std::fs::write(folder.path().join("cases.json"), serde_json::json!(folders).to_string()).expect("cases");
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/picture_graph/run_picture.py");
    let mut command = Command::new(python);
    command.current_dir(folder.path()).arg(script).arg(graph).args((graph == "operators").then(library));
    let output = command.output().expect("python runs");
    assert!(output.status.success(), "{graph}: {}", String::from_utf8_lossy(&output.stderr));
    let read = |case: &Case, name: &str, channels: usize| {
        let bytes = std::fs::read(of(case).join(name)).expect("array");
        let values = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        Image::from_planes(channels, case.frame.height(), case.frame.width(), values)
    };
    let theirs = |case: &Case| {
        let fallback: Vec<i64> =
            serde_json::from_slice(&std::fs::read(of(case).join("fallback.json")).expect("a file")).expect("JSON");
        Theirs { picture: read(case, "picture.f32", 3), share: read(case, "share.f32", 1), fallback: fallback[0] }
    };
    cases.iter().map(theirs).collect()
}

fn check(case: &Case, theirs: &Theirs) -> Corrected {
    let ours = case.ours();
    assert_eq!(theirs.fallback != 0, ours.verdict.fallback.is_some(), "{}: {:?}", case.name, ours.verdict.fallback);
    assert_images_close(&theirs.picture, &ours.picture, TOLERANCE, case.name);
    if let Some(maps) = &ours.maps {
        assert_images_close(&theirs.share, &maps.share, TOLERANCE, &format!("{}: share", case.name));
    }
    println!("{}: mean share {:.3}, {:?}", case.name, ours.mean_share, ours.verdict.fallback);
    ours
}

#[test]
fn onnxruntime_gives_our_picture_of_made_up_frames() {
    let Some(python) = python(WHAT) else { return };
    let still = {
        let mut frame = frame(20, 33, 5);
        frame.b.radiance = frame.a.radiance.clone();
        frame
    };
    let nothing = {
        let mut frame = frame(9, 12, 6);
        frame.a.denoised.data_mut().fill(f32::NAN);
        frame.a.radiance.data_mut().fill(f32::NAN);
        frame.b.denoised.data_mut().fill(f32::NAN);
        frame.b.radiance.data_mut().fill(f32::NAN);
        frame
    };
    let constant = {
        let mut frame = frame(24, 24, 7);
        frame.a.albedo = Some(Image::filled(3, 24, 24, 0.5));
        frame.b.albedo = frame.a.albedo.clone();
        (frame.a.normal, frame.b.normal) = (None, None);
        frame
    };
    let unfitted = {
        let mut model = gated(3);
        model.contract.features.visibility = false;
        model
    };
    let wide = frame(37, 50, 1);
    let cases = [
        Case::new("plain", wide.clone(), gated(9)),
        Case::new("damaged", damaged(), gated(6)),
        Case::new("fireflies", fireflies(), gated(6)),
        Case::new("one pixel", frame(1, 1, 2), gated(9)),
        Case::new("one row", frame(1, 40, 2), gated(12)),
        Case::new("one column", frame(67, 2, 2), gated(1)),
        Case::new("dim", scaled(wide.clone(), 1e-6), gated(6)),
        Case::new("bright", scaled(wide.clone(), 1e6), gated(6)),
        Case::new("bright and damaged", scaled(damaged(), 1e6), gated(2)),
        Case::new("opposite errors", opposite(), gated(6)),
        Case::new("still blocks", mostly_still(), gated(6)),
        Case::new("no noise", still, gated(6)),
        Case::new("no value at all", nothing, gated(4)),
        Case::new("constant and absent features", constant, gated(6)),
        Case::new("a feature that was not fitted", wide.clone(), unfitted),
        Case { strength: 0.4, ..Case::new("less strength", wide.clone(), gated(6)) },
        Case { strength: 0.0, ..Case::new("no strength", wide.clone(), gated(6)) },
        Case::new("the paper's form", wide, model_of(Form::Paper, 5, 0.0)),
    ];
    for graph in GRAPHS {
        let theirs = in_onnxruntime(&python, graph, &cases);
        let ours: Vec<Corrected> = cases.iter().zip(&theirs).map(|(case, theirs)| check(case, theirs)).collect();
        // Else the cases would show little of the blend.
        assert!((0.05..0.95).contains(&ours[0].mean_share), "{}", ours[0].mean_share);
        let fallbacks = |why: i64| theirs.iter().filter(|theirs| theirs.fallback == why).count();
        assert!([0, 1, 2].map(fallbacks).iter().all(|&count| count > 0), "{:?}", [0, 1, 2].map(fallbacks));
    }
}

/// What the mean of halves, no limit, another share or a mistaken exposure would give is told apart.
#[test]
fn another_picture_is_not_taken_for_ours() {
    let case = Case::new("plain", frame(37, 50, 1), gated(9));
    let ours = case.ours().picture;
    let differs = |other: &Image| {
        let expected = Array::of_image(&ours);
        compare("another", &expected, other.data(), Relative::ToPlanes, TOLERANCE).is_err()
    };
    assert!(!differs(&ours));
    assert!(differs(&Case { strength: 0.99, ..Case::new("plain", frame(37, 50, 1), gated(9)) }.ours().picture));
    assert!(differs(&Case::new("plain", frame(37, 50, 1), gated(8)).ours().picture));
    let mut mean_of_halves = gated(9);
    mean_of_halves.contract.composition = Composition::MeanOfHalves;
    assert!(differs(&Case::new("plain", frame(37, 50, 1), mean_of_halves).ours().picture));
    assert!(differs(&baseline(&case.frame)));
}

#[test]
fn onnxruntime_gives_our_picture_of_several_networks_and_of_shots() {
    let Some(python) = python(WHAT) else { return };
    let one = gated(4);
    let mut several = one.clone();
    several.contract.networks = 2;
    several.weights.extend(model_of(Form::Gated, 4, 0.4).weights);
    let mut of_shots = one.clone();
    of_shots.contract.extra_frames = 1;
    let mut several_of_shots = several.clone();
    several_of_shots.contract.extra_frames = 2;

    let own = frame(30, 44, 8);
    let z = [&own.a.denoised, &own.b.denoised].map(Clone::clone);
    let brighter = |by: f32| z.each_ref().map(|z| Image::from_fn(3, 30, 44, |c, y, x| by * z.at(c, y, x) + 0.01));
    let mut other = brighter(1.02);
    other[0].set(1, 7, 9, f32::NAN);
    let full = Some(Image::mean_of(&z[0], &z[1]));
    let with = |variants: Vec<DenoisedVariant>| Frame { denoised: full.clone(), variants, ..own.clone() };
    let variant = |halves: [Image; 2], full: Option<Image>| DenoisedVariant { halves, full };
    let pair = || vec![variant(z.clone(), full.clone()), variant(other.clone(), None)];
    let cases = [
        Case::new("several networks", with(pair()), several),
        Case::new("a shot", with(vec![variant(other.clone(), full.clone())]), of_shots),
        Case::new("several networks of a shot", with(pair()), several_of_shots),
    ];
    for graph in GRAPHS {
        let theirs = in_onnxruntime(&python, graph, &cases);
        cases.iter().zip(&theirs).for_each(|(case, theirs)| drop(check(case, theirs)));
    }
}

/// With a fitted model, whose parameters vary over the picture; the program's file is in half floats.
#[test]
fn onnxruntime_gives_what_sspc_infer_run_writes_of_the_sample() {
    let Some(python) = python(WHAT) else { return };
    let model = load_model(&golden::folder().join("gated.onnx")).expect("the fitted model");
    let case = Case::new("the sample", whole_sample(), model);
    let folder = tempfile::tempdir().expect("folder");
    let sample = |name: &str| sample_folder().join(name);
    for (name, bytes) in [("picture", write_picture(&case.model)), ("operators", write_operators(&case.model))] {
        let theirs = in_onnxruntime(&python, name, std::slice::from_ref(&case)).remove(0);
        let ours = check(&case, &theirs);
        assert!(ours.verdict.fallback.is_none() && ours.mean_share > 0.05, "nothing to see: {}", ours.mean_share);

        let graph = folder.path().join("graph.onnx");
        std::fs::write(&graph, bytes).expect("model");
        let written = folder.path().join(format!("{name}.exr"));
        let mut run = Command::new(env!("CARGO_BIN_EXE_sspc-infer"));
        run.arg("run").args([sample("a.exr"), sample("b.exr")]).arg("--denoised").arg(sample("denoised.exr"));
        let output =
            run.arg("--model").arg(&graph).args(["--quiet", "-o"]).arg(&written).output().expect("the program");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        // The picture stands in the place of half a's radiance.
        let files = FrameFiles::halves(written, sample("b.exr"));
        let read = read_frame(&files, &RoleOverrides::none()).expect("the picture").frame.a.radiance;
        assert_images_close(&theirs.picture, &read, FILE_TOLERANCE, "what the program wrote");
    }
}

/// Each line of refused.py says what it broke and what onnxruntime answered; its last ones are of odd values that are none.
#[test]
fn onnxruntime_refuses_in_words_what_does_not_fit() {
    let Some(python) = python(WHAT) else { return };
    let folder = tempfile::tempdir().expect("folder");
    std::fs::write(folder.path().join("operators.onnx"), write_operators(&gated(9))).expect("model");
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/picture_graph/refused.py");
    let mut command = Command::new(python);
    let other = library().with_file_name(format!("no{}", std::env::consts::DLL_SUFFIX));
    command.current_dir(folder.path()).arg(script).arg(library()).arg(other);
    let output = command.output().expect("python runs");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    for (what, words) in [
        ("no library", "sspc:PostCorrection(-1) is not a registered function/op"),
        ("a library that is not there", "no.so"),
        ("radius 13", "sspc: window_radius: expected 1 to 12, found 13"),
        ("no radius", "sspc: window_radius: "),
        ("instruction set", "sspc: SSPC_ISA: expected "),
        ("features", "sspc: features: expected [N, 13, H, W], found [1, 12, 4, 5]"),
        ("rank", "sspc: features: expected [N, 13, H, W], found [13, 4, 5]"),
        (
            "parameters",
            "sspc: parameters: expected [N, 15 or 16, H, W], found [1, 14, 4, 5] for features [1, 13, 4, 5]",
        ),
        ("valid", "sspc: valid: expected [1, 1, H, W], found [1, 1, 5, 4] for features [1, 13, 4, 5]"),
        ("doubles", "tensor(double)"),
    ] {
        let line = said.lines().find(|line| line.starts_with(&format!("{what}: "))).unwrap_or_default();
        assert!(line.contains(words), "{what}: expected {words:?}, found {line:?} in\n{said}");
    }
    for line in ["empty: (2, 3, 0, 5)", "NaN: kept z", "threads: the same"] {
        assert!(said.contains(line), "{line}: {said}");
    }
}

/// The model is another than that of the image graph's lines: its exposure rule is the one that `fit` writes.
#[test]
fn the_readmes_python_gives_our_picture_of_the_sample() {
    let Some(python) = python(WHAT) else { return };
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..");
    let readme = std::fs::read_to_string(root.join("onnx/README.md")).expect("README");
    let code: Vec<&str> = readme.split("```python\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    let [first, _, third, operators] = code[..] else { panic!("{} pieces of Python in the README", code.len()) };

    let mut model = gated(9);
    model.contract.exposure = Exposure::OfNoise;
    let folder = tempfile::tempdir().expect("folder");
    for name in ["a.exr", "b.exr", "denoised.exr"] {
        std::fs::copy(sample_folder().join(name), folder.path().join(name)).expect("sample");
    }
    std::fs::write(folder.path().join("image.onnx"), write_image(&model)).expect("model");
    std::fs::write(folder.path().join("picture.onnx"), write_picture(&model)).expect("model");
    std::fs::write(folder.path().join("operators.onnx"), write_operators(&model)).expect("model");
    std::fs::copy(library(), folder.path().join("libsspc_operators.so")).expect("the library");
    let script = folder.path().join("run.py");
    let same = "assert np.allclose(picture.ravel(), np.fromfile('picture.f32', np.float32), rtol=3e-4, atol=3e-5)";
    let lines = format!("{first}\n{third}\npicture.tofile('picture.f32')\n{operators}\n{same}\n");
    std::fs::write(&script, lines).expect("script");
    let output = Command::new(python).current_dir(folder.path()).arg(&script).output().expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));

    let case = Case::new("the README's picture", whole_sample(), model);
    let bytes = std::fs::read(folder.path().join("picture.f32")).expect("a picture");
    let values = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let theirs = Image::from_planes(3, case.frame.height(), case.frame.width(), values);
    assert_images_close(&theirs, &case.ours().picture, TOLERANCE, case.name);
}
