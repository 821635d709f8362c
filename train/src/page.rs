//! report.html: a fit on one page.

use crate::inputs::Input;
use crate::outcome::Outcome;
use crate::report::FitReport;
use crate::write::Written;
use sspc_cli::{Code, Failure};
use sspc_metrics::relative::rel_l2_map;
use sspc_page::{FramePictures, Page, PageFrame, Picture};
use std::fmt::Display;

/// Name of the page's file.
pub const FILE: &str = "report.html";

/// The page of a fit: its frames, each with its own report, and the training that they share.
///
/// # Errors
/// When a picture or a report cannot be encoded.
pub fn html(&Written { inputs, fitted, outcomes, .. }: &Written, reports: &[FitReport]) -> Result<String, Failure> {
    let mut frames = Vec::new();
    for ((input, outcome), report) in inputs.iter().zip(outcomes).zip(reports) {
        let report = serde_json::to_value(report).map_err(refused)?;
        let pictures = pictures(input, outcome);
        frames.push(PageFrame::new(name(input), &pictures, report, inputs.len()).map_err(refused)?);
    }
    let title = match inputs {
        [one] => name(one),
        several => format!("{} frames, from {}", several.len(), several[0].name),
    };
    let page = Page {
        title,
        tool: concat!("sspc-train ", env!("CARGO_PKG_VERSION"), " fit").into(),
        losses: fitted.history.iter().map(|step| step.loss).collect(),
        rates: fitted.history.iter().map(|step| step.rate).collect(),
        frames,
        failed: Vec::new(),
    };
    Ok(page.html())
}

fn refused(error: impl Display) -> Failure {
    Failure::new(Code::Run, format!("cannot write {FILE}: {error}"), "leave --report out")
}

/// What the page calls a frame.
fn name(input: &Input) -> String {
    let frame = input.frame_number.map_or_else(|| input.name.clone(), |number| format!("frame {number}"));
    match &input.view {
        Some(view) => format!("{frame}, view {view}"),
        None => frame,
    }
}

fn pictures(input: &Input, outcome: &Outcome) -> Vec<Picture> {
    let reference = input.reference.as_ref().map(|reference| &reference.mean);
    let pictures = FramePictures {
        noisy: input.shown_noisy.clone(),
        denoised: &input.denoised,
        corrected: &outcome.corrected,
        reference,
        errors: reference.map(|r| [&input.denoised, &outcome.corrected].map(|picture| rel_l2_map(picture, r))),
        share: outcome.share.as_ref(),
        different: input.shown_different.clone(),
        exposure: input.shown_exposure,
    };
    pictures.pictures()
}
