//! A frame as files, models, and the program's picture.

use clap::Parser;
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_frames::read_picture;
use sspc_image::Image;
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model, write_network};
use sspc_testkit::small_frame::SmallFrame;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

pub const WIDTH: usize = 75;
pub const HEIGHT: usize = 50;

/// A frame as files, with every feature, and two denoised pictures of each half.
pub struct Files {
    pub folder: TempDir,
    pub small: SmallFrame,
    /// Arguments of `--role`.
    pub features: Vec<String>,
    /// Of half a and half b: each other's, so that they differ from the first.
    pub more: [PathBuf; 2],
}

impl Files {
    pub fn write() -> Self {
        let folder = tempfile::tempdir().expect("folder");
        let small = SmallFrame::write(folder.path(), WIDTH, HEIGHT);
        let features = small.write_features(folder.path(), WIDTH, HEIGHT);
        let more = [&small.denoised_b, &small.denoised_a].map(PathBuf::clone);
        Self { folder, small, features, more }
    }

    /// A picture of the folder.
    pub fn read(&self, name: &str) -> Image {
        read(&self.folder.path().join(name).with_extension("exr"))
    }

    /// Writes a model.
    pub fn model(&self, model: &Model) -> PathBuf {
        let path = self.folder.path().join("model.onnx");
        fs::write(&path, write_network(model)).expect("model");
        path
    }

    /// What `sspc-infer run` makes of the frame, and its sidecar.
    pub fn run(&self, model: &Path, more: &[String]) -> (Image, String) {
        let out = self.folder.path().join("out.exr");
        let mut arguments: Vec<String> = ["sspc-infer", "run", "--quiet", "--json"].map(String::from).to_vec();
        arguments.extend([String::from("--model"), model.display().to_string()]);
        arguments.extend(self.small.arguments().map(|path| path.display().to_string()));
        arguments.extend(more.iter().cloned());
        arguments.extend([String::from("-o"), out.display().to_string()]);
        let arguments = sspc_infer::cli::Arguments::try_parse_from(arguments).expect("arguments");
        sspc_infer::cli::run(arguments).expect("a picture");
        let sidecar = fs::read_to_string(out.with_extension("json")).expect("a sidecar");
        (read(&out), sidecar)
    }

    /// The features as arguments.
    pub fn roles(&self) -> Vec<String> {
        self.features.iter().flat_map(|role| [String::from("--role"), role.clone()]).collect()
    }
}

fn read(path: &Path) -> Image {
    read_picture(path, None).expect("a picture")
}

/// A model of so many networks that is of use without training.
pub fn model(form: Form, networks: usize) -> Model {
    let mut contract = Contract::new(form);
    contract.networks = networks;
    contract.shape.layers = 3;
    let seeds = 1..=networks as u64;
    let weights = seeds.flat_map(|seed| start::analytic(contract.shape, 0.7, &mut Rng::new(seed)).weights);
    Model::new(contract.clone(), weights.collect()).expect("a model")
}
