//! How a call ends: a code, and texts that the thread keeps until its next call. No panic leaves the library.

use sspc_cli::{Code, Failure};
use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char, c_int};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;

use crate::types::SSPC_OK;

/// What the last call on this thread said.
#[derive(Default)]
struct Said {
    message: CString,
    advice: CString,
    report: CString,
}

thread_local! {
    static SAID: RefCell<Said> = RefCell::default();
}

/// Does the work of a call that gives a report, or an empty text where it has none.
pub fn outcome(work: impl FnOnce() -> Result<String, Failure>) -> c_int {
    let done = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(fault(&*panic)));
    let (code, said) = match done {
        Ok(report) => (SSPC_OK, Said { report: text(report), ..Said::default() }),
        Err(Failure { code, message, advice }) => {
            (code as c_int, Said { message: text(message), advice: text(advice), ..Said::default() })
        }
    };
    // A thread that is ending keeps nothing any more.
    let _ = SAID.try_with(|kept| kept.replace(said));
    code
}

/// A failure of arguments, which names one of them.
pub fn nonsense(argument: &str, expected: &str, found: impl ToString, advice: &str) -> Failure {
    Failure::new(Code::Arguments, format!("{argument}: expected {expected}, found {}", found.to_string()), advice)
}

fn fault(panic: &(dyn Any + Send)) -> Failure {
    let what = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    let message = format!("a fault of the library: {}", what.unwrap_or("it says nothing"));
    Failure::new(Code::Run, message, "report it with the frame that leads to it")
}

fn text(text: String) -> CString {
    CString::new(text.replace('\0', "\u{fffd}")).unwrap_or_default()
}

fn said(which: impl FnOnce(&Said) -> &CString) -> *const c_char {
    SAID.try_with(|said| which(&said.borrow()).as_ptr()).unwrap_or(ptr::null())
}

/// What went wrong in this thread's last call that returned a code, one line in the programs' words, UTF-8; empty after
/// SSPC_OK. Kept until the thread's next such call.
#[unsafe(no_mangle)]
pub extern "C" fn sspc_message() -> *const c_char {
    said(|said| &said.message)
}

/// One line of advice beside `sspc_message`; may be empty.
#[unsafe(no_mangle)]
pub extern "C" fn sspc_advice() -> *const c_char {
    said(|said| &said.advice)
}

/// After `sspc_correct` returned SSPC_OK: every figure of the picture as JSON, by the keys of `sspc-infer run --json`,
/// `warnings` (what a person should know) and `fallback` among them; UTF-8, else empty. Kept as `sspc_message`.
#[unsafe(no_mangle)]
pub extern "C" fn sspc_report() -> *const c_char {
    said(|said| &said.report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    fn read(text: *const c_char) -> String {
        // SAFETY: the thread's texts are strings of C, kept until its next call.
        unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
    }

    #[test]
    fn texts_are_those_of_the_last_call() {
        assert_eq!(outcome(|| Err(nonsense("threads", "0 to 1024", 5000, "ask for fewer"))), 2);
        assert_eq!(read(sspc_message()), "threads: expected 0 to 1024, found 5000");
        assert_eq!((read(sspc_advice()), read(sspc_report())), ("ask for fewer".into(), String::new()));
        assert_eq!(outcome(|| Ok("{\"a\": \"\0\"}".to_string())), 0);
        assert_eq!((read(sspc_message()), read(sspc_report())), (String::new(), "{\"a\": \"\u{fffd}\"}".into()));
    }

    #[test]
    fn a_panic_is_a_failed_run() {
        assert_eq!(outcome(|| panic!("of {} rows", 7)), 4);
        assert_eq!(read(sspc_message()), "a fault of the library: of 7 rows");
    }
}
