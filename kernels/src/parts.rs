//! Work on one tile in parts, for machines with more cores than a step has tiles.
//!
//! Every value is computed in the same order whatever the parts are, so that they do not show.

use std::ops::Range;

/// 0 .. `count` in at most `parts` ranges of nearly the same length, none of them empty.
pub fn in_parts(count: usize, parts: usize) -> Vec<Range<usize>> {
    let parts = parts.clamp(1, count.max(1));
    (0..parts).map(|i| count * i / parts..count * (i + 1) / parts).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_everything_once() {
        for (count, parts) in [(0, 3), (1, 1), (13, 8), (48, 5), (7, 7), (3, 9), (5, 0)] {
            let ranges = in_parts(count, parts);
            assert!(ranges.len() <= parts.max(1) && (count == 0 || ranges.iter().all(|range| !range.is_empty())));
            assert!(ranges.iter().cloned().flatten().eq(0..count), "{ranges:?}");
        }
    }
}
