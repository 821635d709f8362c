//! The most memory that a piece of work held at once.
//!
//! A test that measures declares the counting allocator, and is a program of its own or counts alone: the allocator
//! counts whatever runs at the same time.
//!
//! ```
//! use sspc_testkit::peak::{PeakAlloc, peak_of};
//!
//! #[global_allocator]
//! static ALLOCATOR: PeakAlloc = PeakAlloc;
//!
//! let (_, held) = peak_of(&ALLOCATOR, || drop(std::hint::black_box(vec![0u8; 1 << 20])));
//! assert!(held >= 1 << 20);
//! ```

pub use peak_alloc::PeakAlloc;

/// What `work` gives, and the most bytes that it held at once beside what was there before.
pub fn peak_of<T>(allocator: &PeakAlloc, work: impl FnOnce() -> T) -> (T, usize) {
    let before = allocator.current_usage();
    allocator.reset_peak_usage();
    let result = work();
    (result, allocator.peak_usage().saturating_sub(before))
}
