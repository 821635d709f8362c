//! When the program began: what its first tile is timed from.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

static START: OnceLock<Instant> = OnceLock::new();

/// Called first of all.
pub fn start() {
    START.get_or_init(Instant::now);
}

/// From the start of the program to `moment`; `None` where [`start`] was never called.
pub fn since_start(moment: Instant) -> Option<Duration> {
    START.get().map(|start| moment.saturating_duration_since(*start))
}
