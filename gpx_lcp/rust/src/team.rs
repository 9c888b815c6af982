//! Threads that share the work of one colour after the other.
//!
//! A colour of some thousand contacts takes ten microseconds: less than it takes to wake a sleeping thread, so that the
//! helpers of a solve stay awake and look for work. Whoever is free takes the next piece. A helper that the system has
//! put aside for a while is then not waited for, unless it has a piece in hand.

use std::cell::UnsafeCell;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;

/// Turns of waiting before a thread lets others run.
const SPINS: usize = 2000;

type Job<'a> = dyn Fn(usize) + Sync + 'a;

/// The threads of one solve, this one included.
pub struct Team {
    size: usize,
    /// The number of pieces of the present job in the high half, and of those that have been taken in the low half.
    pieces: AtomicU64,
    done: AtomicU64,
    job: UnsafeCell<Option<*const Job<'static>>>,
    /// There will be no more jobs.
    over: AtomicBool,
    broken: AtomicBool,
}

// SAFETY: `job` is written only while no piece is left to take or in hand, and read only by who has taken one.
unsafe impl Sync for Team {}

impl Team {
    /// Call `body` with a team of `size` threads, which are gone when it returns.
    pub fn with<T>(size: usize, body: impl FnOnce(&Team) -> T) -> T {
        let team = Team {
            size,
            pieces: AtomicU64::new(0),
            done: AtomicU64::new(0),
            job: UnsafeCell::new(None),
            over: AtomicBool::new(false),
            broken: AtomicBool::new(false),
        };
        if size == 1 {
            return body(&team);
        }
        thread::scope(|scope| {
            for _ in 1..size {
                scope.spawn(|| team.help());
            }
            let _end = Raised(&team.over);
            body(&team)
        })
    }

    /// Call `job` once with each number below `pieces`, in any order and by any thread, and wait until all are done.
    pub fn run(&self, pieces: usize, job: &Job) {
        if self.size == 1 || pieces == 1 {
            return (0..pieces).for_each(job);
        }
        // SAFETY: all pieces of the job before are done. This one is used only by who has taken a piece of it, and they
        // are waited for, so that it outlives its use.
        unsafe {
            *self.job.get() = Some(std::mem::transmute::<*const Job, *const Job<'static>>(job))
        };
        self.done.store(0, Ordering::Relaxed);
        self.pieces.store((pieces as u64) << 32, Ordering::Release);
        while self.take_piece() {}
        let mut waiting = Waiting::default();
        while self.done.load(Ordering::Acquire) < pieces as u64 {
            assert!(
                !self.broken.load(Ordering::Acquire),
                "a thread of the team has panicked"
            );
            waiting.turn();
        }
    }

    fn help(&self) {
        let mut waiting = Waiting::default();
        while !self.over.load(Ordering::Acquire) {
            if left(self.pieces.load(Ordering::Relaxed)) && self.take_piece() {
                waiting = Waiting::default();
            } else {
                waiting.turn();
            }
        }
    }

    /// Do one piece, if any is left.
    fn take_piece(&self) -> bool {
        // Read and counted at once: the piece belongs to the job whose number of pieces was read.
        let before = self.pieces.fetch_add(1, Ordering::AcqRel);
        if !left(before) {
            return false;
        }
        let number = (before & u64::from(u32::MAX)) as usize;
        let guard = Breakage(&self.broken);
        // SAFETY: the job was set before its pieces were offered, and is kept until this one is done.
        unsafe {
            let job = (*self.job.get()).expect("set before its pieces were offered");
            (*job)(number);
        }
        drop(guard);
        self.done.fetch_add(1, Ordering::Release);
        true
    }
}

/// Whether pieces are left to take.
fn left(pieces: u64) -> bool {
    pieces & u64::from(u32::MAX) < pieces >> 32
}

/// Spins for a while, then lets others run.
#[derive(Default)]
struct Waiting(usize);

impl Waiting {
    fn turn(&mut self) {
        self.0 += 1;
        if self.0 < SPINS {
            std::hint::spin_loop();
        } else {
            thread::yield_now();
        }
    }
}

/// Raises a flag in the end, however it comes.
struct Raised<'a>(&'a AtomicBool);

impl Drop for Raised<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// A thread that panics with a piece in hand would leave the others waiting: they panic too.
struct Breakage<'a>(&'a AtomicBool);

impl Drop for Breakage<'_> {
    fn drop(&mut self) {
        if thread::panicking() {
            self.0.store(true, Ordering::Release);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;

    #[test]
    fn every_piece_is_done_once_and_sees_what_was_done_before() {
        for size in [1, 2, 3] {
            let done: Vec<AtomicUsize> = (0..7).map(|_| AtomicUsize::new(0)).collect();
            Team::with(size, |team| {
                for round in 0..500 {
                    team.run(done.len(), &|piece| {
                        let before = done[piece].fetch_add(1, Ordering::Relaxed);
                        assert_eq!(before, round);
                    });
                    assert!(
                        done.iter()
                            .all(|count| count.load(Ordering::Relaxed) == round + 1)
                    );
                }
            });
        }
    }

    #[test]
    fn a_panic_in_one_thread_ends_all() {
        for bad in 0..4 {
            let result = std::panic::catch_unwind(|| {
                Team::with(3, |team| {
                    team.run(4, &|piece| assert!(piece != bad, "on purpose"))
                });
            });
            assert!(result.is_err());
        }
    }
}
