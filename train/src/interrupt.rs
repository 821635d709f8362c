//! Ctrl-C and SIGTERM as a flag that the loops poll.

use std::sync::atomic::{AtomicBool, Ordering};

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Catches the signals from now on. A second one ends the process at once; files half-written go, whole ones stay.
pub fn install() {
    let outcome = ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            sspc_frames::temporary::abandon();
            std::process::exit(130);
        }
    });
    debug_assert!(outcome.is_ok(), "one handler a process");
}

/// Whether a signal has come.
pub fn interrupted() -> bool {
    INTERRUPTED.load(Ordering::SeqCst)
}
