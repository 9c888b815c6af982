//! Threads that share the work of one colour after the other.
//!
//! A colour of some thousand contacts takes ten microseconds: less than it takes to wake a sleeping thread, so that the
//! helpers of a solve stay awake and look for work. Each thread has a share of its own, the same stretch of pieces in
//! every job, so that what it works on stays in its cache; whoever is done with that takes from the others. A helper that
//! the system has put aside for a while is then not waited for, unless it has a piece in hand.

use std::cell::UnsafeCell;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread;

/// Turns of waiting before a thread lets others run.
const SPINS: usize = 2000;

type Job<'a> = dyn Fn(usize) + Sync + 'a;

/// The threads of one solve, this one included.
pub struct Team {
    size: usize,
    /// One for each thread.
    shares: Vec<Share>,
    /// Pieces of the present job.
    pieces: AtomicUsize,
    done: AtomicUsize,
    job: UnsafeCell<Option<*const Job<'static>>>,
    /// There will be no more jobs.
    over: AtomicBool,
    broken: AtomicBool,
}

/// The number of pieces of a share in the high half, and of those that have been taken in the low half. Each on cache
/// lines of its own.
#[derive(Default)]
#[repr(align(128))]
struct Share(AtomicU64);

// SAFETY: `job` is written only while no piece is left to take or in hand, and read only by who has taken one.
unsafe impl Sync for Team {}

impl Team {
    /// Call `body` with a team of `size` threads, which are gone when it returns.
    pub fn with<T>(size: usize, body: impl FnOnce(&Team) -> T) -> T {
        let team = Team {
            size,
            shares: (0..size).map(|_| Share::default()).collect(),
            pieces: AtomicUsize::new(0),
            done: AtomicUsize::new(0),
            job: UnsafeCell::new(None),
            over: AtomicBool::new(false),
            broken: AtomicBool::new(false),
        };
        if size == 1 {
            return body(&team);
        }
        thread::scope(|scope| {
            let team = &team;
            for thread in 1..size {
                scope.spawn(move || team.help(thread));
            }
            let _end = Raised(&team.over);
            body(team)
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
        self.pieces.store(pieces, Ordering::Relaxed);
        for (thread, share) in self.shares.iter().enumerate() {
            let length = self.begin(thread + 1, pieces) - self.begin(thread, pieces);
            share.0.store((length as u64) << 32, Ordering::Release);
        }
        while self.take_piece(0) {}
        let mut waiting = Waiting::default();
        while self.done.load(Ordering::Acquire) < pieces {
            assert!(
                !self.broken.load(Ordering::Acquire),
                "a thread of the team has panicked"
            );
            waiting.turn();
        }
    }

    /// The first piece of a thread's share.
    fn begin(&self, thread: usize, pieces: usize) -> usize {
        thread * pieces / self.size
    }

    fn help(&self, thread: usize) {
        let mut waiting = Waiting::default();
        while !self.over.load(Ordering::Acquire) {
            if self.take_piece(thread) {
                waiting = Waiting::default();
            } else {
                waiting.turn();
            }
        }
    }

    /// Do one piece, of this thread's share or else of the next one that has any left.
    fn take_piece(&self, thread: usize) -> bool {
        (0..self.size).any(|turn| self.take_piece_of((thread + turn) % self.size))
    }

    fn take_piece_of(&self, thread: usize) -> bool {
        let share = &self.shares[thread].0;
        if !left(share.load(Ordering::Relaxed)) {
            return false;
        }
        // Read and counted at once: the piece belongs to the job whose number of pieces was read.
        let before = share.fetch_add(1, Ordering::AcqRel);
        if !left(before) {
            return false;
        }
        // The number of all pieces was set before those of the share, and stays until this piece is done.
        let begin = self.begin(thread, self.pieces.load(Ordering::Relaxed));
        let number = begin + (before & u64::from(u32::MAX)) as usize;
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
