//! A frame corrected in bands is the frame corrected whole, with the network's tiles and the rows
//! around a band as `run` cuts them.

mod common;

use common::assert_close;
use sspc_core::io::{FrameFiles, RoleOverrides, read_frame};
use sspc_core::network::start;
use sspc_core::parameters::Form;
use sspc_core::rng::Rng;
use sspc_core::simd::Isa;
use sspc_infer::engine::{Engine, Kernels};
use sspc_infer::run::correct::{CorrectError, correct};
use sspc_infer::run::report::Seconds;
use sspc_onnx::{Contract, Model};
use std::path::PathBuf;

/// The judge's box means add f32 values in another order.
const TOLERANCE: f64 = 1e-5;

fn sample() -> sspc_core::frame::Frame {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data/sample");
    let files = FrameFiles::halves(folder.join("a.exr"), folder.join("b.exr"));
    read_frame(&files, &RoleOverrides::none()).unwrap()
}

fn engine() -> Engine {
    let contract = Contract::new(Form::Gated);
    let weights = start::analytic(contract.shape, 0.7, &mut Rng::new(1)).weights;
    Engine::new(Model::new(contract, weights).unwrap(), Kernels::Fused(Isa::best()), 50)
}

#[test]
fn bands_do_not_show() {
    let (mut frame, engine) = (sample(), engine());
    frame.a.radiance.set(1, 50, 60, f32::NAN);
    let run = |rows| correct(&engine, Isa::best(), &frame, Some(rows), &mut Seconds::default(), &|| false).unwrap();
    let whole = run(1000);
    assert!(whole.fallback.is_none(), "a fallback would leave nothing to compare");
    for rows in [16, 48, 100] {
        let banded = run(rows);
        assert_close(&banded.picture, &whole.picture, TOLERANCE, &format!("bands of {rows}"));
        assert!((banded.mean_share - whole.mean_share).abs() < TOLERANCE);
        assert!((banded.active_share - whole.active_share).abs() < TOLERANCE);
        assert!((banded.estimate.corrected.value / whole.estimate.corrected.value - 1.0).abs() < 1e-4);
        assert_eq!(banded.survey, whole.survey);
    }
}

#[test]
fn a_request_to_stop_is_heard() {
    let stopped = correct(&engine(), Isa::best(), &sample(), None, &mut Seconds::default(), &|| true);
    assert!(matches!(stopped, Err(CorrectError::Interrupted)));
}
