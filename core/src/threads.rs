//! How finely work is divided: a finer division costs more and does not show.

use std::thread::available_parallelism;

/// How many threads can run at once: those of the pool, but no more than the machine lets this process have.
pub fn at_once() -> usize {
    let threads = rayon::current_num_threads();
    available_parallelism().map_or(threads, |cores| threads.min(cores.get()))
}
