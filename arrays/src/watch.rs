//! How far work has got, told on the thread that waits for it: callbacks of a host run where it called from, and never
//! two at once.

use rayon::{Scope, ThreadPool};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};

/// What work on other threads has of the one that waits.
pub struct Watch<'a> {
    to: SyncSender<f64>,
    stopped: &'a AtomicBool,
}

impl Watch<'_> {
    /// Tells which share of the work is done, 0..1. Waits until what was told before is answered: an answer is never more
    /// than one step behind the work.
    pub fn tell(&self, done: f64) {
        // Where the waiting thread has panicked nobody listens, and the work's end comes soon.
        let _ = self.to.send(done);
    }

    /// Whether the work is to end early.
    pub fn stops(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

/// Does `work` on the threads of `pool`, or of rayon's own. `tell` is called on this thread with the share that is done,
/// which never falls; where it answers `true`, the work is asked to stop and `tell` is not called again.
///
/// Not for threads of that pool: the work might wait for them.
///
/// # Panics
/// As `work` does.
pub fn watched<T: Send>(
    pool: Option<&ThreadPool>,
    mut tell: impl FnMut(f64) -> bool,
    work: impl FnOnce(&Watch) -> T + Send,
) -> T {
    let stopped = AtomicBool::new(false);
    let (to, told) = sync_channel(0);
    let mut result = None;
    in_scope(pool, |scope| {
        let (result, watch) = (&mut result, Watch { to, stopped: &stopped });
        scope.spawn(move |_| *result = Some(work(&watch)));
        let mut most = 0.0;
        // Ends with the work, which has the other end.
        for done in told {
            most = f64::max(most, done);
            if !stopped.load(Ordering::Relaxed) && tell(most) {
                stopped.store(true, Ordering::Relaxed);
            }
        }
    });
    result.expect("work that did not panic has a result")
}

fn in_scope<'scope>(pool: Option<&ThreadPool>, begin: impl FnOnce(&Scope<'scope>)) {
    match pool {
        Some(pool) => pool.in_place_scope(begin),
        None => rayon::in_place_scope(begin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::ThreadPoolBuilder;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::thread;
    use std::time::Duration;

    #[test]
    fn shares_are_told_here_and_never_fall() {
        let here = thread::current().id();
        let mut told = Vec::new();
        let pool = ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        let tell = |done| {
            assert_eq!(thread::current().id(), here);
            told.push(done);
            false
        };
        let there = watched(Some(&pool), tell, |watch| {
            [0.1, 0.5, 0.4, 1.0].iter().for_each(|done| watch.tell(*done));
            thread::current().id()
        });
        assert_ne!(there, here);
        assert_eq!(told, [0.1, 0.5, 0.5, 1.0]);
    }

    #[test]
    fn an_answer_stops_the_work_by_the_next_step() {
        let mut calls = 0;
        let tell = |_| {
            thread::sleep(Duration::from_millis(20));
            calls += 1;
            true
        };
        assert!(watched(None, tell, |watch| {
            watch.tell(0.0);
            watch.tell(0.5);
            watch.stops()
        }));
        assert_eq!(calls, 1);
    }

    #[test]
    fn a_panic_comes_through() {
        let work = AssertUnwindSafe(|| watched(None, |_| false, |watch| -> u8 { panic!("{}", watch.stops()) }));
        assert!(catch_unwind(work).is_err());
    }
}
