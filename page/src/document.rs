//! The page: its data as JSON, put with style and scripts into the template.

use crate::budget;
use crate::encode::{EncodeError, encode, thumbnail};
use crate::picture::{Picture, Scale};
use serde::Serialize;
use serde_json::Value;
use sspc_core::LARGEST_SHARE;
use sspc_frames::preview::{ERROR_MAP_HIGH, ERROR_MAP_LOW, magma};

/// Label of the picture that stands for a frame in the strip of a shot.
const IN_STRIP: &str = "corrected";
/// Colours of a map that the page's legend is drawn with.
const LEGEND_STOPS: usize = 17;

const TEMPLATE: &str = include_str!("../template/page.html");
const STYLE: &str = include_str!("../template/page.css");
const SCRIPT: &str = include_str!("../template/page.js");
const CURVES: &str = include_str!("../template/curves.js");
const TABLES: &str = include_str!("../template/tables.js");
const VIEWER: &str = include_str!("../template/viewer.js");

/// Components of others, each with its licence (`vendor/README.md` says where they come from).
const COMPONENTS: [(&str, &str); 3] = [
    (include_str!("../vendor/img-comparison-slider.LICENSE"), include_str!("../vendor/img-comparison-slider.js")),
    (include_str!("../vendor/panzoom.LICENSE"), include_str!("../vendor/panzoom.js")),
    (include_str!("../vendor/uplot.LICENSE"), include_str!("../vendor/uplot.js")),
];
const COMPONENT_STYLES: [&str; 2] =
    [include_str!("../vendor/img-comparison-slider.css"), include_str!("../vendor/uplot.css")];

/// A page of one frame or of a shot.
#[derive(Clone, Debug, Serialize)]
pub struct Page {
    /// Its heading: what was corrected.
    pub title: String,
    /// Program and version that wrote it.
    pub tool: String,
    /// Self-supervised loss of each training step, where the page is of a fit.
    pub losses: Vec<f64>,
    /// Learning rate of each training step.
    pub rates: Vec<f64>,
    /// The frames, at least one.
    pub frames: Vec<PageFrame>,
    /// Frames that were not corrected.
    pub failed: Vec<FailedFrame>,
}

/// A frame that is missing on the page, and why.
#[derive(Clone, Debug, Serialize)]
pub struct FailedFrame {
    /// What messages call it.
    pub name: String,
    /// The message.
    pub message: String,
}

/// One frame, its pictures encoded.
#[derive(Clone, Debug, Serialize)]
pub struct PageFrame {
    /// What messages call it.
    name: String,
    /// Columns of the frame; its pictures may have fewer.
    width: usize,
    /// Rows.
    height: usize,
    /// How the pictures are stored.
    stored: String,
    pictures: Vec<StoredPicture>,
    thumbnail: String,
    /// What report.json says of it, without its training steps.
    report: Value,
}

#[derive(Clone, Debug, Serialize)]
struct StoredPicture {
    label: &'static str,
    scale: Scale,
    uri: String,
}

impl PageFrame {
    /// One of `frames` frames of a page. `report` is what stands in report.json; its `history` belongs to the page
    /// ([`Page::losses`]) and is dropped.
    ///
    /// # Errors
    /// [`EncodeError`].
    pub fn new(name: String, pictures: &[Picture], mut report: Value, frames: usize) -> Result<Self, EncodeError> {
        let (width, height) = pictures.first().map_or((0, 0), |p| (p.pixels.width, p.pixels.height));
        let encoded = encode(pictures, budget::of_frame(width * height, frames))?;
        let in_strip = pictures.iter().find(|picture| picture.label == IN_STRIP);
        let thumbnail = match in_strip {
            Some(picture) if frames > 1 => thumbnail(&picture.pixels)?,
            _ => String::new(),
        };
        if let Value::Object(entries) = &mut report {
            entries.remove("history");
        }
        let stored = pictures.iter().zip(encoded.uris);
        let pictures = stored.map(|(p, uri)| StoredPicture { label: p.label, scale: p.scale, uri }).collect();
        Ok(Self { name, width, height, stored: encoded.how, pictures, thumbnail, report })
    }
}

/// How the colours of maps are read.
#[derive(Serialize)]
struct Legend {
    /// Colours from the lowest value to the highest.
    colours: Vec<[u8; 3]>,
    /// Errors of the first and last colour; logarithmic between them.
    error: [f32; 2],
    /// Share of the last colour; 0 is that of the first, linear between them.
    share: f32,
}

#[derive(Serialize)]
struct Data<'a> {
    #[serde(flatten)]
    page: &'a Page,
    legend: Legend,
}

impl Page {
    /// The page's text: one HTML file that loads nothing.
    pub fn html(&self) -> String {
        let colours = (0..LEGEND_STOPS).map(|i| magma(i as f32 / (LEGEND_STOPS - 1) as f32)).collect();
        let legend = Legend { colours, error: [ERROR_MAP_LOW, ERROR_MAP_HIGH], share: LARGEST_SHARE };
        let data = Data { page: self, legend };
        // The data are maps with text keys, lists, texts and numbers: JSON has a form for each.
        let json = serde_json::to_string(&data).expect("JSON of plain data");
        let component = |(licence, script): &(&str, &str)| format!("/*!\n{}\n*/\n{script}", licence.trim());
        filled(TEMPLATE, |key| match key {
            "title" => escaped_markup(&self.title),
            "style" => [COMPONENT_STYLES.as_slice(), &[STYLE]].concat().join("\n"),
            "components" => COMPONENTS.iter().map(component).collect::<Vec<_>>().join("\n;\n"),
            "data" => escaped_json(&json),
            "script" => [TABLES, CURVES, VIEWER, SCRIPT].join("\n"),
            _ => unreachable!("the template has no other place: {key}"),
        })
    }
}

/// A template with each `{{key}}` replaced, in one pass: what is put in is not searched again.
fn filled(template: &str, value: impl Fn(&str) -> String) -> String {
    let mut out = String::new();
    let mut rest = template;
    while let Some((before, (key, after))) =
        rest.split_once("{{").and_then(|(before, after)| Some((before, after.split_once("}}")?)))
    {
        out.push_str(before);
        out.push_str(&value(key));
        rest = after;
    }
    out + rest
}

/// Text that is no markup.
fn escaped_markup(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// JSON that can stand inside a script element: nothing in it ends the element or opens a comment. Those characters occur
/// inside strings only.
fn escaped_json(json: &str) -> String {
    json.replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use sspc_frames::preview::Rgb8;

    const HOSTILE: &str = "</script><script>alert(1)</script><!-- {{data}} \u{2028} & \"";

    fn page(name: &str) -> Page {
        let pixels = Rgb8 { width: 2, height: 1, data: vec![9; 6] };
        let picture = |label| Picture { label, scale: Scale::Radiance, pixels: pixels.clone() };
        let report = json!({ "roles": [{ "file": name, "channels": [name] }], "history": [1], "warnings": [name] });
        let pictures = [picture("noisy"), picture("corrected")];
        Page {
            title: name.into(),
            tool: "test".into(),
            losses: vec![1.0],
            rates: vec![0.1],
            frames: vec![PageFrame::new(name.into(), &pictures, report, 1).expect("encoded")],
            failed: vec![FailedFrame { name: name.into(), message: name.into() }],
        }
    }

    /// The data that a browser would read from the page.
    fn data(html: &str) -> Value {
        let (_, rest) = html.split_once("<script type=\"application/json\" id=\"data\">").expect("data");
        serde_json::from_str(rest.split_once("</script>").expect("an end").0).expect("JSON")
    }

    #[test]
    fn text_from_files_is_never_markup() {
        let (plain, hostile) = (page("a").html(), page(HOSTILE).html());
        let read = data(&hostile);
        assert_eq!(read["frames"][0]["report"]["roles"][0]["channels"][0], HOSTILE);
        assert_eq!(read["failed"][0]["message"], HOSTILE);
        let count = |html: &str, what: &str| html.matches(what).count();
        for markup in ["<script", "</script", "<!--"] {
            assert_eq!(count(&plain, markup), count(&hostile, markup), "{markup}");
        }
    }

    #[test]
    fn the_page_names_no_other_place_to_load_from() {
        // Its own filter is the one thing that it refers to.
        let html = page("a").html().replace("url(#exposure-filter)", "");
        assert!(html.contains("default-src 'none'"));
        for loading in [" src=\"http", " href=\"http", "@import", "url(", "sourceMappingURL"] {
            assert!(!html.contains(loading), "{loading}");
        }
    }

    #[test]
    fn components_bring_their_licences() {
        let html = page("a").html();
        for owner in ["Dmitry Snisarenko", "Timmy Willison", "Leon Sorokin"] {
            assert!(html.contains(owner), "{owner}");
        }
    }

    #[test]
    fn training_steps_stand_once() {
        let read = data(&page("a").html());
        assert!(read["frames"][0]["report"].get("history").is_none());
        assert_eq!(read["losses"], json!([1.0]));
    }
}
