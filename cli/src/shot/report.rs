//! What was done with each neighbour of a frame.

use serde::Serialize;

/// One neighbour of a frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NeighbourReport {
    /// Its number.
    pub frame: i32,
    /// Where its motion comes from: a reading of the motion pass, `position`, or `estimated`, with why positions that are
    /// there are not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<String>,
    /// Mean validity over the frame's pixels and halves, 0..1.
    pub validity: f64,
    /// Why it was left out, if it was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub left_out: Option<String>,
}

impl NeighbourReport {
    /// In words, for a log.
    pub fn line(&self) -> String {
        let motion = self.motion.as_deref().unwrap_or("unknown");
        match &self.left_out {
            Some(why) => format!("  neighbour {}: left out, {why}", self.frame),
            None => format!("  neighbour {}: motion {motion}, mean validity {:.2}", self.frame, self.validity),
        }
    }
}
