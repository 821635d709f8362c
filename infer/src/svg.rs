//! A plain SVG: panels with linear axes, lines with points, and their legend.

use std::ops::Range;

/// Width of a plot, and the margins of its panels; the legend stands in the right one.
const WIDTH: f64 = 1080.0;
const LEFT: f64 = 80.0;
const RIGHT: f64 = 250.0;
const TOP: f64 = 70.0;
const BOTTOM: f64 = 60.0;
/// Height of a panel, and between two.
const PANEL: f64 = 300.0;
const GAP: f64 = 60.0;
/// Ticks of an axis, at most, and a round step between them.
const TICKS: f64 = 10.0;
const STEPS: [f64; 4] = [1.0, 2.0, 5.0, 10.0];
/// Share of an axis that is left free beyond the outermost values.
const MARGIN: f64 = 0.08;

/// A line through points `(x, y)`; one that has no value in its place is left out.
#[derive(Clone, Debug)]
pub struct Line {
    /// What it is.
    pub name: String,
    /// Its colour, as SVG has it.
    pub colour: &'static str,
    /// From left to right.
    pub points: Vec<(f64, f64)>,
    /// A value for the whole, drawn as a dashed line and written into the legend.
    pub mean: Option<f64>,
}

/// Lines over one pair of axes.
#[derive(Clone, Debug)]
pub struct Panel {
    /// What the vertical axis has.
    pub label: String,
    /// The lines.
    pub lines: Vec<Line>,
    /// A value to be compared with, and its name: a grey line.
    pub level: (f64, &'static str),
}

/// The text of a plot: its panels below each other over one horizontal axis of whole numbers.
pub fn plot(title: &str, subtitle: &str, below: &str, panels: &[Panel]) -> String {
    let xs = panels.iter().flat_map(|panel| &panel.lines).flat_map(|line| &line.points).map(|point| point.0);
    let x = Axis::over(xs, LEFT..WIDTH - RIGHT);
    let height = TOP + panels.len() as f64 * (PANEL + GAP) - GAP + BOTTOM;
    let mut body = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    body += &text((LEFT, 28.0), title, "start", "#222", "font-size=\"17\"");
    body += &text((LEFT, 48.0), subtitle, "start", "#555", "font-size=\"12\"");
    for (index, panel) in panels.iter().enumerate() {
        let top = TOP + index as f64 * (PANEL + GAP);
        body += &drawn(panel, &x, top..top + PANEL);
    }
    body += &text((0.5 * (LEFT + WIDTH - RIGHT), height - 18.0), below, "middle", "#222", "");
    body + "</svg>\n"
}

fn drawn(panel: &Panel, x: &Axis, rows: Range<f64>) -> String {
    let (level, level_name) = panel.level;
    let ys = panel.lines.iter().flat_map(|line| line.points.iter().map(|point| point.1).chain(line.mean));
    let y = Axis::over(ys.chain([level]), rows.end..rows.start);
    let (left, right) = (LEFT, WIDTH - RIGHT);
    let mut body = String::new();
    for (value, words) in x.ticks(1.0) {
        let at = x.at(value);
        body += &stroke((at, rows.start), (at, rows.end), "#e5e5e5", 1, "");
        body += &text((at, rows.end + 18.0), &words, "middle", "#222", "");
    }
    for (value, words) in y.ticks(0.0) {
        let at = y.at(value);
        body += &stroke((left, at), (right, at), "#e5e5e5", 1, "");
        body += &text((left - 8.0, at + 4.0), &words, "end", "#222", "");
    }
    let (width, height) = (right - left, rows.end - rows.start);
    body += &format!(
        "<rect x=\"{left}\" y=\"{}\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#888\"/>\n",
        rows.start
    );
    let middle = 0.5 * (rows.start + rows.end);
    body += &text((22.0, middle), &panel.label, "middle", "#222", &format!("transform=\"rotate(-90 22 {middle})\""));
    let mut entries = vec![(level_name.to_string(), "#666", "8 4")];
    body += &stroke((left, y.at(level)), (right, y.at(level)), "#666", 2, "8 4");
    for line in &panel.lines {
        let places: Vec<_> = line.points.iter().map(|point| (x.at(point.0), y.at(point.1))).collect();
        let path: Vec<_> = places.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        body += &format!(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\"/>\n",
            path.join(" "),
            line.colour
        );
        for (at_x, at_y) in places {
            body += &format!("<circle cx=\"{at_x:.1}\" cy=\"{at_y:.1}\" r=\"4\" fill=\"{}\"/>\n", line.colour);
        }
        entries.push((line.name.clone(), line.colour, ""));
        if let Some(mean) = line.mean {
            body += &stroke((left, y.at(mean)), (right, y.at(mean)), line.colour, 2, "2 4");
            entries.push((format!("of the shot: {mean:.3}"), line.colour, "2 4"));
        }
    }
    for (index, (name, colour, dashes)) in entries.iter().enumerate() {
        let at = rows.start + 14.0 + 20.0 * index as f64;
        body += &stroke((right + 14.0, at - 4.0), (right + 40.0, at - 4.0), colour, 2, dashes);
        body += &text((right + 47.0, at), name, "start", colour, "");
    }
    body
}

fn text((x, y): (f64, f64), words: &str, anchor: &str, colour: &str, more: &str) -> String {
    let words = words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{colour}\" {more}>{words}</text>\n")
}

fn stroke(from: (f64, f64), to: (f64, f64), colour: &str, width: u32, dashes: &str) -> String {
    let dashed = if dashes.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dashes}\"") };
    format!(
        "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{colour}\" stroke-width=\"{width}\"{dashed}/>\n",
        from.0, from.1, to.0, to.1
    )
}

/// Linear, from values to places.
struct Axis {
    values: Range<f64>,
    places: Range<f64>,
}

impl Axis {
    /// Over all values with a margin, over 0..1 without any.
    fn over(values: impl Iterator<Item = f64>, places: Range<f64>) -> Self {
        let outermost = |(low, high): (f64, f64), value: f64| (low.min(value), high.max(value));
        let (low, high) = values.map(|v| (v, v)).reduce(|all, (v, _)| outermost(all, v)).unwrap_or((0.0, 1.0));
        let span = if high > low { high - low } else { 1.0 };
        Self { values: low - MARGIN * span..high + MARGIN * span, places }
    }

    fn at(&self, value: f64) -> f64 {
        let share = (value - self.values.start) / (self.values.end - self.values.start);
        self.places.start + share * (self.places.end - self.places.start)
    }

    /// Round values, at least this far apart, and their texts.
    fn ticks(&self, least: f64) -> Vec<(f64, String)> {
        let rough = (self.values.end - self.values.start) / TICKS;
        let decade = 10f64.powf(rough.log10().floor());
        let step =
            STEPS.map(|factor| factor * decade).into_iter().find(|step| *step >= rough).unwrap_or(rough).max(least);
        let digits = (-step.log10().floor()).max(0.0) as usize;
        let [first, last] = [(self.values.start / step).ceil(), (self.values.end / step).floor()];
        (first as i64..=last as i64)
            .map(|i| i as f64 * step)
            .map(|value| (value, format!("{value:.digits$}")))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let ticks = |values: &[f64], least| -> Vec<String> {
            Axis::over(values.iter().copied(), 0.0..1.0).ticks(least).into_iter().map(|(_, text)| text).collect()
        };
        assert_eq!(ticks(&[0.61, 1.0], 0.0), ["0.60", "0.65", "0.70", "0.75", "0.80", "0.85", "0.90", "0.95", "1.00"]);
        assert_eq!(ticks(&[1001.0, 1003.0], 1.0), ["1001", "1002", "1003"]);
        assert_eq!(ticks(&[7.0], 1.0), ["7"]);
        assert_eq!(ticks(&[-20.0, 25.0], 0.0), ["-20", "-10", "0", "10", "20"]);
        assert_eq!(ticks(&[], 0.0).len(), 6);
    }

    #[test]
    fn text_is_no_markup() {
        assert!(text((0.0, 0.0), "a < b & c", "end", "#222", "").contains(">a &lt; b &amp; c<"));
    }
}
