//! The figures of a shot as a table for people.

use crate::evaluate_shot::{ShotDenoised, ShotEvaluation};

/// One line for each frame, one for the shot, and what is to be known of them.
pub fn table(shot: &ShotEvaluation) -> String {
    let viewing = &shot.viewing;
    let mut text = format!(
        "JOD: {}, {}, {} frames per second, exposure {:.4}; 10: no visible difference\n",
        viewing.metric, viewing.display, viewing.frames_per_second, viewing.exposure
    );
    text += &row("frame", ["relL2", "ratio", "temporal", "ratio", "JOD", "denoised", "SSIM", "FLIP"].map(String::from));
    for frame in &shot.frames {
        let figures = &frame.evaluation.figures;
        let own = frame.evaluation.denoised.as_ref().map(|denoised| denoised.rel_l2_ratio);
        let step = frame.temporal.as_ref();
        let cells = [
            number(Some(figures.rel_l2), 6),
            number(own, 3),
            number(step.map(|step| step.picture), 6),
            number(step.and_then(|step| step.denoised.map(|denoised| step.picture / denoised)), 3),
            number(frame.jod.map(|jod| jod.picture), 3),
            number(frame.jod.and_then(|jod| jod.denoised), 3),
            number(Some(figures.ssim), 4),
            number(Some(figures.flip), 4),
        ];
        text += &row(&frame.frame.to_string(), cells);
    }
    let of_shot = |value: fn(&ShotDenoised) -> f64| number(shot.denoised.as_ref().map(value), 3);
    let cells = [
        number(Some(shot.rel_l2), 6),
        of_shot(|denoised| denoised.rel_l2_ratio),
        number(Some(shot.temporal), 6),
        of_shot(|denoised| denoised.temporal_ratio),
        number(Some(shot.jod), 3),
        of_shot(|denoised| denoised.jod),
        String::new(),
        String::new(),
    ];
    text += &row("shot", cells);
    for left_out in &shot.left_out {
        text += &format!("frame {} without {}: {}\n", left_out.frame, left_out.figure, left_out.why);
    }
    text
}

/// A figure, or a dash where there is none.
fn number(value: Option<f64>, digits: usize) -> String {
    value.filter(|value| value.is_finite()).map_or("-".to_string(), |value| format!("{value:.digits$}"))
}

fn row(name: &str, cells: [String; 8]) -> String {
    let [rel_l2, ratio, temporal, of_step, jod, denoised, ssim, flip] = cells;
    let line = format!(
        "{name:<8} {rel_l2:>10} {ratio:>7} {temporal:>10} {of_step:>7} {jod:>7} {denoised:>8} {ssim:>7} {flip:>7}"
    );
    line.trim_end().to_string() + "\n"
}
