//! Threads that share the work of one colour after the other.
//!
//! A colour of some thousand contacts takes ten microseconds: less than it takes to wake a sleeping thread, so that the
//! helpers of a team stay awake and look for work. Each thread has a share of its own, the same stretch of pieces in
//! every job, so that what it works on stays in its cache; whoever is done with that takes from the others. A helper that
//! the system has put aside for a while is then not waited for, unless it has a piece in hand.

use std::cell::{Cell, UnsafeCell};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::thread;

/// Turns of waiting before a thread lets others run.
const SPINS: usize = 20_000;

type Job<'a> = dyn Fn(usize) + Sync + 'a;

/// The threads that share a piece of work after the other, this one included.
pub struct Team<'scope, 'env> {
    board: &'env Board,
    /// Where helpers are started when there is work for them; None for a thread alone.
    scope: Option<&'scope thread::Scope<'scope, 'env>>,
    started: Cell<bool>,
}

/// What threads need to know of each other.
struct Board {
    /// How many threads there are.
    size: usize,
    /// One for each thread.
    shares: Vec<Share>,
    /// Pieces of the present job.
    pieces: AtomicUsize,
    job: UnsafeCell<Option<*const Job<'static>>>,
    /// Jobs so far: what who waits for one looks at, and nobody writes to meanwhile.
    jobs: Jobs,
    /// There will be no more jobs.
    over: AtomicBool,
    /// A piece of the present job has panicked.
    broken: AtomicBool,
}

/// On a cache line of its own.
#[derive(Default)]
#[repr(align(128))]
struct Jobs(AtomicUsize);

/// What a thread takes first, and what it has done: on cache lines of its own, which no other needs before it is idle.
#[derive(Default)]
#[repr(align(128))]
struct Share {
    /// The number of its pieces in the high half, and of those that have been taken in the low half.
    pieces: AtomicU64,
    /// Pieces of the present job that this thread has done, from whichever share. Nobody else counts them.
    done: AtomicUsize,
}

// SAFETY: `job` is written only while no piece is left to take or in hand, and read only by who has taken one.
unsafe impl Sync for Board {}

impl Team<'_, '_> {
    /// Call `body` with a team of `size` threads, which are gone when it returns.
    pub fn with<T>(size: usize, body: impl FnOnce(&Team) -> T) -> T {
        let board = Board {
            size,
            shares: (0..size).map(|_| Share::default()).collect(),
            pieces: AtomicUsize::new(0),
            job: UnsafeCell::new(None),
            jobs: Jobs::default(),
            over: AtomicBool::new(false),
            broken: AtomicBool::new(false),
        };
        let (board, started) = (&board, Cell::new(false));
        if size == 1 {
            let scope = None;
            return body(&Team {
                board,
                scope,
                started,
            });
        }
        thread::scope(|scope| {
            let _end = Raised(&board.over);
            let scope = Some(scope);
            body(&Team {
                board,
                scope,
                started,
            })
        })
    }

    /// How many of these threads to make a team of, where each must have so much of the work to gain by it.
    pub fn worth(threads: usize, work: usize, each: usize) -> usize {
        threads.min(work / each).max(1)
    }

    /// Whether there is no other thread to share work with.
    pub fn is_alone(&self) -> bool {
        self.scope.is_none()
    }

    /// Call `task` once with each part, in any order and by any thread, and wait until all are done.
    pub fn each<T: Send>(&self, parts: &mut [T], task: impl Fn(&mut T) + Sync) {
        let first = Parts(parts.as_mut_ptr());
        self.run(parts.len(), &|piece| {
            let first = &first;
            // SAFETY: a piece is a part, and each is run once.
            task(unsafe { &mut *first.0.add(piece) });
        });
    }

    /// Call `job` once with each number below `pieces`, in any order and by any thread, and wait until all are done.
    pub fn run(&self, pieces: usize, job: &Job) {
        let board = self.board;
        let Some(scope) = self.scope.filter(|_| pieces > 1) else {
            return (0..pieces).for_each(job);
        };
        if !self.started.replace(true) {
            for thread in 1..board.size {
                scope.spawn(move || board.help(thread));
            }
        }
        // SAFETY: all pieces of the job before are done. This one is used only by who has taken a piece of it, and they
        // are waited for, so that it outlives its use.
        unsafe {
            *board.job.get() = Some(std::mem::transmute::<*const Job, *const Job<'static>>(job))
        };
        board.pieces.store(pieces, Ordering::Relaxed);
        // Before any piece is offered: whoever takes one may have done it at once.
        for share in &board.shares {
            share.done.store(0, Ordering::Relaxed);
        }
        for (thread, share) in board.shares.iter().enumerate() {
            let length = board.begin(thread + 1, pieces) - board.begin(thread, pieces);
            let offered = (length as u64) << 32;
            share.pieces.store(offered, Ordering::Release);
        }
        board.jobs.0.fetch_add(1, Ordering::Release);
        while board.take_piece(0) {}
        let mut waiting = Waiting::default();
        while board.done() < pieces {
            waiting.turn();
        }
        let broken = board.broken.swap(false, Ordering::Relaxed);
        assert!(!broken, "a piece of the work has panicked");
    }
}

impl Board {
    /// The first piece of a thread's share.
    fn begin(&self, thread: usize, pieces: usize) -> usize {
        thread * pieces / self.size
    }

    /// Pieces of the present job that are done.
    fn done(&self) -> usize {
        let done = |share: &Share| share.done.load(Ordering::Acquire);
        self.shares.iter().map(done).sum()
    }

    fn help(&self, thread: usize) {
        let (mut seen, mut waiting) = (0, Waiting::default());
        while !self.over.load(Ordering::Acquire) {
            let jobs = self.jobs.0.load(Ordering::Acquire);
            if jobs == seen {
                waiting.turn();
                continue;
            }
            (seen, waiting) = (jobs, Waiting::default());
            while self.take_piece(thread) {}
        }
    }

    /// Do one piece, of this thread's share or else of the next one that has any left.
    fn take_piece(&self, thread: usize) -> bool {
        (0..self.size).any(|turn| self.take_piece_of((thread + turn) % self.size, thread))
    }

    /// Let a thread do one piece of the share of `owner`.
    fn take_piece_of(&self, owner: usize, thread: usize) -> bool {
        let share = &self.shares[owner].pieces;
        if !left(share.load(Ordering::Relaxed)) {
            return false;
        }
        // Read and counted at once: the piece belongs to the job whose number of pieces was read.
        let before = share.fetch_add(1, Ordering::AcqRel);
        if !left(before) {
            return false;
        }
        // The number of all pieces was set before those of the share, and stays until this piece is done.
        let begin = self.begin(owner, self.pieces.load(Ordering::Relaxed));
        let number = begin + (before & u64::from(u32::MAX)) as usize;
        // SAFETY: the job was set before its pieces were offered, and is kept until this one is done.
        let job = unsafe { &*(*self.job.get()).expect("set before its pieces were offered") };
        // Who leads the team panics in the end, when nobody looks at the job any more.
        if catch_unwind(AssertUnwindSafe(|| job(number))).is_err() {
            self.broken.store(true, Ordering::Relaxed);
        }
        let done = &self.shares[thread].done;
        done.store(done.load(Ordering::Relaxed) + 1, Ordering::Release);
        true
    }
}

/// Take so many entries off the front of a slice.
///
/// # Panics
/// Where there are fewer.
pub fn front<'a, T>(slice: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    slice.split_off_mut(..count).expect("the slice is as long")
}

/// Where the parts of a job begin.
struct Parts<T>(*mut T);

// SAFETY: no two threads get the same part.
unsafe impl<T: Send> Sync for Parts<T> {}

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
        // Without a pause: a hypervisor sees those, and takes the processor away for longer than a colour takes.
        if self.0 >= SPINS {
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
    fn every_part_is_changed_once_by_whichever_thread() {
        for size in [1, 2, 3] {
            let mut numbers: Vec<usize> = (0..1000).collect();
            Team::with(size, |team| {
                let mut parts: Vec<&mut [usize]> = numbers.chunks_mut(7).collect();
                team.each(&mut parts, |part| part.iter_mut().for_each(|x| *x += 1));
                team.each(&mut parts[..0], |_| unreachable!());
            });
            assert!(numbers.iter().enumerate().all(|(k, x)| *x == k + 1));
        }
    }

    #[test]
    fn a_panic_in_one_piece_is_told_when_all_are_done() {
        for bad in 0..4 {
            Team::with(3, |team| {
                let done = AtomicUsize::new(0);
                let job = |piece| {
                    assert!(piece != bad, "on purpose");
                    done.fetch_add(1, Ordering::Relaxed);
                };
                assert!(catch_unwind(AssertUnwindSafe(|| team.run(4, &job))).is_err());
                assert_eq!(done.load(Ordering::Relaxed), 3);
                team.run(4, &|_| {
                    done.fetch_add(1, Ordering::Relaxed);
                });
                assert_eq!(done.load(Ordering::Relaxed), 7);
            });
        }
    }
}
