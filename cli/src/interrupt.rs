//! Ctrl-C and SIGTERM as a flag that loops poll between steps; a second one ends the process at once.

use crate::failure::{Code, Failure};
use std::sync::atomic::{AtomicBool, Ordering};

static ASKED: AtomicBool = AtomicBool::new(false);

/// Starts listening; call once, from `main`.
pub fn listen() {
    let heard = ctrlc::set_handler(|| {
        if ASKED.swap(true, Ordering::SeqCst) {
            sspc_frames::temporary::abandon();
            std::process::exit(Code::Interrupted as i32);
        }
    });
    if let Err(error) = heard {
        crate::print::print_line(&format!("warning: Ctrl-C will end the run without cleaning up: {error}"));
    }
}

/// Whether the run was asked to stop.
pub fn asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}

/// Ends the run here if it was asked to stop.
///
/// # Errors
/// [`Failure::interrupted`].
pub fn check() -> Result<(), Failure> {
    if asked() { Err(Failure::interrupted()) } else { Ok(()) }
}
