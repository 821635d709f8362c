//! How many neighbours, and what the motion pass means: kept in the model, so that every frame is read alike.

use sspc_image::Image;
use sspc_shots::convention::{Alignment, Convention, ConventionSearch, Evidence};
use std::collections::BTreeMap;

/// Keys of a model's entries.
const MOTION: [&str; 2] = ["motion.previous", "motion.next"];
const RULE: &str = "temporal_mean";
/// What [`MOTION`] says where there is no pass, or none that can be used.
const ESTIMATED: &str = "estimated";
/// How an engine makes the inputs; a reader that does not know this rule must not run the model.
const MEAN_RULE: &str = "in the place of z of each half and of the full buffer: (z + sum v Wz) / (1 + sum v) over the \
neighbours; W: Catmull-Rom (a = -1/2) along the motion, edge pixels repeated; v: exp(-0.3 (8 |albedo - W albedo|^2 + 2 \
|normal - W normal|^2)) with bilinear W, 0 outside 0..size-1 or where a tap of z is not finite; full buffer: mean of the \
halves' motion where it agrees within 1 pixel, else the more valid half's; mean of the halves' v";

/// What a shot is read by.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShotSettings {
    /// Neighbours on each side.
    pub extra_frames: usize,
    /// What a motion pass means that leads to the previous frame and to the next; `None` where motion is estimated.
    pub motion: [Option<Convention>; 2],
}

impl ShotSettings {
    /// What a model of so many `extra_frames` says in its further entries.
    ///
    /// # Errors
    /// One line, when they cannot be understood.
    pub fn of_model(extra_frames: usize, extra: &BTreeMap<String, String>) -> Result<Self, String> {
        if extra_frames > 0 && extra.get(RULE).map(String::as_str) != Some(MEAN_RULE) {
            return Err(format!("{RULE}: expected the rule that this program knows, found another"));
        }
        let mut motion = [None; 2];
        for (motion, key) in motion.iter_mut().zip(MOTION) {
            *motion = match extra.get(key).map(String::as_str) {
                None | Some(ESTIMATED) => None,
                Some(text) => Some(text.parse().map_err(|error| format!("{key}: {error}"))?),
            };
        }
        Ok(Self { extra_frames, motion })
    }

    /// The further entries of a model that was fitted so.
    pub fn to_model(&self) -> Vec<(String, String)> {
        let motion = MOTION.iter().zip(self.motion).map(|(key, convention)| {
            (key.to_string(), convention.map_or(ESTIMATED.to_string(), |convention| convention.to_string()))
        });
        motion.chain([(RULE.to_string(), MEAN_RULE.to_string())]).collect()
    }
}

/// The search for what a shot's motion pass means.
#[derive(Clone, Debug, Default)]
pub struct MotionSearch {
    searches: [ConventionSearch; 2],
    silent: bool,
}

impl MotionSearch {
    pub(crate) fn look(&mut self, motion: &Image, offset: i32, alignment: &Alignment) {
        if sspc_shots::convention::says_nothing(motion) {
            self.silent = true;
        } else {
            self.searches[usize::from(offset > 0)].look(motion, alignment);
        }
    }

    /// What the pass means to the previous frame and to the next, and lines that say on what evidence.
    pub fn finish(&self) -> ([Option<Convention>; 2], Vec<String>) {
        let mut said = Vec::new();
        let found = [("previous", &self.searches[0]), ("next", &self.searches[1])].map(|(name, search)| {
            let evidence: Evidence = search.finish()?;
            let taken = evidence.is_decisive().then_some(evidence.best);
            said.push(match taken {
                Some(_) => format!("motion to the {name} frame: {evidence}"),
                None => format!("motion to the {name} frame: no reading of the pass is clearly better than none ({evidence}), so it is estimated"),
            });
            taken
        });
        if self.silent {
            said.push("motion: the pass has one value at every pixel and says nothing, so motion is estimated".into());
        }
        (found, said)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sspc_shots::convention::Unit;

    #[test]
    fn what_a_model_says_is_read_back() {
        let previous = Convention { first: 0, unit: Unit::Pixel, right: 1, down: -1 };
        let next = Convention { first: 2, unit: Unit::Colour(11.5), right: -1, down: 1 };
        for motion in [[None, None], [Some(previous), None], [Some(previous), Some(next)]] {
            let settings = ShotSettings { extra_frames: 2, motion };
            let entries: BTreeMap<String, String> = settings.to_model().into_iter().collect();
            assert_eq!(ShotSettings::of_model(2, &entries), Ok(settings));
        }
        assert_eq!(ShotSettings::of_model(0, &BTreeMap::new()), Ok(ShotSettings::default()));
    }

    #[test]
    fn what_cannot_be_understood_is_refused() {
        let good = ShotSettings { extra_frames: 1, motion: [None; 2] }.to_model();
        for (key, value) in [(RULE, "mine"), (MOTION[0], "left"), (MOTION[1], "+X -Z pixels")] {
            let mut entries: BTreeMap<String, String> = good.clone().into_iter().collect();
            entries.insert(key.into(), value.into());
            let error = ShotSettings::of_model(1, &entries).expect_err(value);
            assert!(error.contains(key), "{error}");
        }
    }
}
