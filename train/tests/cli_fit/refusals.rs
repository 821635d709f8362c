//! What cannot be used is refused in one line, and nothing is left.

use crate::{command, fit, folder, sample};
use std::path::PathBuf;

#[test]
fn samples_that_no_halves_can_have_are_refused() {
    let folder = folder();
    let out = folder.path().join("fit");
    for (arguments, said) in [
        (&["--samples-a", "0", "--samples-b", "8"][..], "--samples-a"),
        (&["--samples-a", "8"], "--samples-b"),
        (&["--samples-b", "8"], "--samples-a"),
        (&["--samples-a", "many", "--samples-b", "8"], "--samples-a"),
        (&["--samples-a", "99999999", "--samples-b", "99999999"], "--samples-a"),
        (&["--samples-a", "4096", "--samples-b", "8"], "at most 256 times as many"),
    ] {
        let output = fit(&out, arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && message.contains(said), "{arguments:?}: {message}");
    }
    assert!(!out.exists());
}

#[test]
fn bad_input_is_one_line_and_leaves_nothing() {
    let folder = folder();
    let text = folder.path().join("text.exr");
    std::fs::write(&text, "not a picture").expect("written");
    let truncated = folder.path().join("truncated.exr");
    let whole = std::fs::read(sample("a.exr")).expect("the sample");
    std::fs::write(&truncated, &whole[..whole.len() / 3]).expect("written");
    let a = sample("a.exr");
    let cases: [(&str, PathBuf, PathBuf, &str); 5] = [
        ("a missing file", "missing.exr".into(), sample("b.exr"), "missing.exr"),
        ("text", text, sample("b.exr"), "not an OpenEXR file"),
        ("a truncated file", truncated, sample("b.exr"), "truncated"),
        ("identical halves", a.clone(), a.clone(), "same value in every pixel"),
        ("no denoised role", sample("denoised.exr"), sample("ref.exr"), "denoised colour of half a"),
    ];
    for (what, a, b, expected) in cases {
        let out = folder.path().join("out");
        // A machine with Open Image Denoise would make what is missing.
        let mut command = command();
        command.env("OIDN_DIR", folder.path()).arg("fit").args([a, b]).arg("-o").arg(&out);
        let output = command.output().expect("sspc-train starts");
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{what}: {message}");
        let errors: Vec<&str> = message.lines().filter(|line| line.contains("error:")).collect();
        assert!(errors.len() == 1 && errors[0].contains(expected), "{what}: {message}");
        assert!(!out.exists(), "{what} leaves a folder");
    }
}

#[test]
fn a_file_of_another_size_is_named_with_both_sizes() {
    let folder = folder();
    let out = folder.path().join("out");
    let small = sample("../blender/denoised.exr");
    let output = fit(&out, &["--denoised", small.to_str().expect("UTF-8")]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{message}");
    assert!(message.contains("256x192") && message.contains("96x64"), "{message}");
    assert!(!out.exists());
}

#[test]
fn an_output_that_cannot_be_written_is_said_before_training() {
    let folder = folder();
    let file = folder.path().join("file");
    std::fs::write(&file, "in the way").expect("written");
    for out in [file.join("below"), file.clone(), folder.path().join("no/such/parent")] {
        let output = fit(&out, &[]);
        assert_eq!(output.status.code(), Some(4), "{}", out.display());
        assert!(!String::from_utf8_lossy(&output.stderr).contains("training"), "{} is found late", out.display());
    }
    assert_eq!(std::fs::read_to_string(&file).expect("the file"), "in the way");
}

#[test]
fn arguments_without_meaning_end_with_2() {
    let folder = folder();
    let out = folder.path().join("out");
    for bad in [["--preset", "best"], ["--time-limit", "-1"], ["--role", "radiance"], ["--frames", "1-2"]] {
        assert_eq!(fit(&out, &bad).status.code(), Some(2), "{bad:?}");
    }
    assert!(!out.exists());
}
