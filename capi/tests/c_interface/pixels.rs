//! The pictures of the C interface are those of `sspc-infer run`, bit for bit, however the buffers lie.

use crate::buffers::{Laid, Layout};
use crate::files::{Files, HEIGHT, WIDTH, model};
use crate::frame::{InMemory, Loaded, correct, corrected, options, picture};
use half::f16;
use sspc::types::{SSPC_OK, SspcOptions};
use sspc_cli::shot::settings::ShotSettings;
use sspc_image::Image;
use sspc_kernels::parameters::Form;
use sspc_onnx::Model;
use std::thread;

const PACKED: Layout = Layout { planar: false, gaps: [0; 3], upwards: false, leftwards: false, half: false };
const PLANAR: Layout = Layout { planar: true, ..PACKED };

/// A model that was fitted with neighbouring frames.
fn of_shot() -> Model {
    let mut model = model(Form::Gated, 1);
    let settings = ShotSettings { extra_frames: 1, motion: [None; 2] };
    model.contract.extra_frames = 1;
    model.contract.extra.extend(settings.to_model());
    model
}

#[test]
fn the_picture_is_that_of_the_program() {
    let files = Files::write();
    let more = files.more.each_ref().map(|path| path.display().to_string()).join(",");
    let more = [String::from("--denoised-more"), more];
    let models = [model(Form::Gated, 1), model(Form::Paper, 1), model(Form::Gated, 2), of_shot()];
    for model in models {
        let several = model.contract.networks > 1;
        let arguments = [files.roles(), if several { more.to_vec() } else { Vec::new() }].concat();
        let (expected, sidecar) = files.run(&files.model(&model), &arguments);
        let in_memory = InMemory::read(&files, &[PACKED, PLANAR], |image| image);
        let in_memory = if several { in_memory.with_more() } else { in_memory };
        let (found, told, report) = corrected(&Loaded::of(&model), &in_memory, PACKED);
        let version = model.contract.version();
        assert!(found == expected, "contract {version}");
        // Something was corrected, or the test says little.
        assert!(told.is_denoised == 0 && told.mean_share > 0.01, "contract {version}: {told:?}");
        let [report, sidecar] = [&report, &sidecar].map(|text| {
            let json: serde_json::Value = serde_json::from_str(text).expect("JSON");
            json
        });
        let keys = [
            "estimate",
            "loss",
            "model_loss",
            "mean_share",
            "active_share",
            "network_weights",
            "exposure",
            "independence",
        ];
        for key in keys {
            assert_eq!(report[key], sidecar[key], "{key}");
        }
        // What is read from text may differ in the last digit.
        let (of_text, error) = (report["estimate"]["corrected"]["value"].as_f64(), told.error_corrected.value);
        assert!(of_text.is_some_and(|value| (value / error - 1.0).abs() < 1e-12), "{of_text:?}, {error}");
        let warnings = |json: &serde_json::Value| json["warnings"].as_array().expect("warnings").len();
        assert_eq!(warnings(&report), told.warnings as usize);
        assert_eq!(warnings(&report), warnings(&sidecar) + usize::from(version == 3), "{report}");
    }
}

#[test]
fn halves_weigh_what_they_hold() {
    let files = Files::write();
    let model = model(Form::Gated, 1);
    let options_of_samples = ["--samples-a", "32", "--samples-b", "8"].map(String::from);
    let arguments = [files.roles(), options_of_samples.to_vec()].concat();
    let (expected, _) = files.run(&files.model(&model), &arguments);
    let in_memory = InMemory::read(&files, &[PACKED], |image| image);
    let (mut frame, mut room) = (in_memory.frame(), Laid::room(Layout::default(), 3, HEIGHT, WIDTH));
    let mut picture_by = |samples: [f64; 2]| {
        [frame.samples_a, frame.samples_b] = samples;
        assert_eq!(correct(&Loaded::of(&model), &frame, &options(), &mut picture(room.output())), SSPC_OK);
        room.image()
    };
    assert!(picture_by([32.0, 8.0]) == expected);
    assert!(picture_by([0.0, 0.0]) != expected);
}

#[test]
fn layouts_do_not_show() {
    let files = Files::write();
    let model = Loaded::of(&model(Form::Gated, 1));
    let of = |layout: &[Layout], to| corrected(&model, &InMemory::read(&files, layout, |image| image), to).0;
    let expected = of(&[PACKED], PACKED);
    let layouts = [
        PLANAR,
        Layout { gaps: [0, 4, 0], ..PACKED },
        Layout { upwards: true, ..PACKED },
        Layout { leftwards: true, upwards: true, ..PLANAR },
        // Nothing is aligned.
        Layout { gaps: [1, 1, 3], leftwards: true, ..PACKED },
        Layout { gaps: [3, 5, 7], upwards: true, ..PLANAR },
    ];
    for layout in layouts {
        assert!(of(&[layout], layout) == expected, "{layout:?}");
    }
    assert!(of(&layouts, PLANAR) == expected);
}

#[test]
fn half_floats_are_rounded_once() {
    let files = Files::write();
    let model = Loaded::of(&model(Form::Gated, 1));
    let rounded = |mut image: Image| {
        image.data_mut().iter_mut().for_each(|value| *value = f16::from_f32(*value).to_f32());
        image
    };
    let half = Layout { half: true, ..PACKED };
    let expected = corrected(&model, &InMemory::read(&files, &[PACKED], rounded), PACKED).0;
    let in_halves = InMemory::read(&files, &[half, Layout { half: true, ..PLANAR }], |image| image);
    assert!(corrected(&model, &in_halves, PACKED).0 == expected);
    assert!(corrected(&model, &in_halves, Layout { gaps: [1, 1, 1], ..half }).0 == rounded(expected));
}

#[test]
fn the_picture_may_take_the_place_of_an_input() {
    let files = Files::write();
    let model = Loaded::of(&model(Form::Gated, 1));
    let mut in_memory = InMemory::read(&files, &[PACKED], |image| image);
    let expected = corrected(&model, &in_memory, PACKED).0;
    let frame = in_memory.frame();
    let mut told = picture(in_memory.pictures[0].output());
    assert_eq!(correct(&model, &frame, &options(), &mut told), SSPC_OK);
    assert!(in_memory.pictures[0].image() == expected);
}

#[test]
fn threads_do_not_show() {
    let files = Files::write();
    let model = Loaded::of(&model(Form::Gated, 1));
    let in_memory = InMemory::read(&files, &[PACKED], |image| image);
    let (expected, told, _) = corrected(&model, &in_memory, PACKED);
    for threads in [1, 2, 7] {
        let mut room = [Laid::room(PACKED, 3, HEIGHT, WIDTH), Laid::room(PLANAR, 1, HEIGHT, WIDTH)];
        let mut picture = picture(room[0].output());
        picture.share = room[1].output();
        let options = SspcOptions { threads, ..options() };
        assert_eq!(correct(&model, &in_memory.frame(), &options, &mut picture), SSPC_OK);
        assert!(room[0].image() == expected, "{threads} threads");
        let share = room[1].image();
        let mean = share.data().iter().map(|&share| f64::from(share)).sum::<f64>() / share.pixels() as f64;
        assert!((mean - told.mean_share).abs() < 1e-9 && told.mean_share > 0.0, "{mean} {}", told.mean_share);
    }
}

#[test]
fn calls_at_the_same_time_do_not_meet() {
    let files = Files::write();
    let bytes = model(Form::Gated, 1);
    let expected = corrected(&Loaded::of(&bytes), &InMemory::read(&files, &[PACKED], |image| image), PACKED).0;
    thread::scope(|scope| {
        let work = || corrected(&Loaded::of(&bytes), &InMemory::read(&files, &[PLANAR], |image| image), PACKED).0;
        let all: Vec<_> = (0..3).map(|_| scope.spawn(work)).collect();
        all.into_iter().for_each(|work| assert!(work.join().expect("a picture") == expected));
    });
}
