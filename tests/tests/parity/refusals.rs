//! Cases that are damaged, of another shape or not finite are errors that say so; so are results.

use sspc_testkit::case::{Array, Case, CaseError};
use sspc_testkit::closeness::{Relative, compare};

fn sample() -> Case {
    Case::named("gc-5x3")
}

#[test]
fn another_shape_is_an_error() {
    let case = sample();
    let error = case.array("features", &[13, 3, 5]).expect_err("another shape");
    assert!(matches!(error, CaseError::Shape { .. }));
    assert_eq!(error.to_string(), "case gc-5x3: features expected shape [13, 3, 5], found [13, 5, 3]");
}

#[test]
fn a_missing_array_is_an_error_that_lists_what_there_is() {
    let error = sample().array("feature", &[13, 5, 3]).expect_err("no such array").to_string();
    assert!(error.starts_with("case gc-5x3: no array feature; it has d_parameters, d_raw, features, "), "{error}");
}

#[test]
fn nan_and_infinity_are_errors() {
    let mut case = sample();
    case.arrays.get_mut("raw").expect("raw").values[7] = f64::NAN;
    case.arrays.get_mut("raw").expect("raw").values[9] = f64::INFINITY;
    let error = case.array("raw", &[15, 5, 3]).expect_err("not finite");
    assert_eq!(error.to_string(), "case gc-5x3: raw has 2 values that are not finite, the first at index 7");
}

#[test]
fn a_truncated_file_is_an_error_with_its_path() {
    let folder = tempfile::tempdir().expect("a folder");
    let from = sspc_testkit::case::root().join("gc-5x3");
    std::fs::copy(from.join("case.json"), folder.path().join("case.json")).expect("case.json");
    let bytes = std::fs::read(from.join("io.npz")).expect("io.npz");
    for keep in [0, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(folder.path().join("io.npz"), &bytes[..keep]).expect("io.npz");
        let error = Case::read(folder.path()).expect_err("truncated").to_string();
        assert!(error.contains("io.npz: "), "{error}");
    }
    std::fs::remove_file(folder.path().join("case.json")).expect("case.json");
    assert!(Case::read(folder.path()).expect_err("no facts").to_string().contains("case.json: "));
}

#[test]
fn a_result_that_is_not_finite_is_a_difference() {
    let expected = Array { shape: vec![1, 1, 2], values: vec![1.0, 2.0] };
    for bad in [f32::NAN, f32::INFINITY] {
        let mismatch =
            compare("refusal", &expected, &[1.0, bad], Relative::ToScale(1.0), 1e-5).expect_err("not finite");
        assert_eq!((mismatch.count, mismatch.worst.0), (1, vec![0, 0, 1]));
    }
    let zero = Array { shape: vec![1, 1, 1], values: vec![0.0] };
    assert!(compare("refusal", &zero, &[1e-30], Relative::ToScale(0.0), 1e-5).is_err(), "zero is expected exactly");
}

#[test]
#[should_panic(expected = "values found against expected")]
fn a_result_of_another_length_is_refused() {
    let expected = Array { shape: vec![1, 1, 2], values: vec![1.0, 2.0] };
    let _ = compare("refusal", &expected, &[1.0], Relative::ToScale(1.0), 1e-5);
}
