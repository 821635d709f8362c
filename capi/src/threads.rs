//! Threads of a call's own, which have ended when it returns: a host may unload the library, or fork, between calls.

use crate::outcome::nonsense;
use rayon::{ThreadPool, ThreadPoolBuilder};
use sspc_cli::{Code, Failure};
use std::thread::{Builder, JoinHandle};

/// Most threads that can be asked for.
const MAX_THREADS: u32 = 1024;

/// A pool; when it goes, its threads have ended.
pub struct Threads {
    pool: Option<ThreadPool>,
    /// Rayon's own end of a pool, and that of a scope of threads, does not wait for the system's.
    handles: Vec<JoinHandle<()>>,
}

impl Threads {
    /// So many threads, or one on each core for 0.
    ///
    /// # Errors
    /// More than can be asked for, or than the system gives.
    pub fn start(count: u32) -> Result<Self, Failure> {
        if count > MAX_THREADS {
            return Err(nonsense("threads", &format!("0 to {MAX_THREADS}"), count, "0 asks for one on each core"));
        }
        let mut threads = Self { pool: None, handles: Vec::new() };
        let pool = ThreadPoolBuilder::new().num_threads(count as usize).spawn_handler(|thread| {
            let named = Builder::new().name(format!("sspc-{}", thread.index()));
            threads.handles.push(named.spawn(|| thread.run())?);
            Ok(())
        });
        match pool.build() {
            Ok(pool) => {
                threads.pool = Some(pool);
                Ok(threads)
            }
            Err(error) => {
                let asked = if count == 0 { "threads".to_string() } else { format!("{count} threads") };
                Err(Failure::new(Code::Run, format!("cannot start {asked}: {error}"), "ask for fewer"))
            }
        }
    }

    /// The pool.
    pub fn pool(&self) -> Option<&ThreadPool> {
        self.pool.as_ref()
    }
}

impl Drop for Threads {
    fn drop(&mut self) {
        drop(self.pool.take());
        // A thread that panicked has told the work that it was for.
        self.handles.drain(..).for_each(|handle| drop(handle.join()));
    }
}
