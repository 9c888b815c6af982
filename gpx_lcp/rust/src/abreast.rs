//! Sweeps over contacts eight abreast, colour after colour.
//!
//! The states w = Ĵᵀ p of the bodies of eight groups (see `factored`; of rigid bodies, their velocities: see `arms`) are
//! read and written once for the whole groups. Where registers hold four lanes the halves of a batch take turns. Threads
//! share the batches of a colour, and are waited for before the next colour begins. Who visits a batch changes nothing in
//! it, so the bits do not depend on the number of threads.

use std::marker::PhantomData;
use std::mem::MaybeUninit;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::colouring::NONE;
use crate::contact::{Contact, Law};
use crate::delassus::Sweeper;
#[cfg(target_arch = "x86_64")]
use crate::lanes::x86_64::{Quad, Wide, has_quads};
use crate::lanes::{LANES, Oct, OctLanes, Portable};
use crate::small_matrix::Vector;
use crate::team::{Team, front};

/// Visits of a piece of work, at least: two microseconds, so that taking it costs little.
const PIECE: usize = 16;

/// w of one body, √kg m/s, filled up with zeros.
type State = Oct;

/// Where the rows of a visit begin: those that it may share with the visits before it, and its own.
#[derive(Clone, Copy)]
pub struct Place {
    pub shared: u32,
    pub own: u32,
}

/// What stands for Ĵ: numbers of the contacts of a visit, and what they do with the states of the bodies.
pub trait Rows<const R: usize, const D: usize> {
    /// Of a visit, at most.
    const LINES: usize;

    /// Ĵ w + `free`, m/s, of a visit's contacts.
    ///
    /// # Safety
    /// Rows of this kind lie at the place.
    unsafe fn velocity<V: OctLanes>(
        rows: &[MaybeUninit<Oct>],
        place: Place,
        free: &[Oct; R],
        states: &[[V; D]; 2],
    ) -> [V; R];

    /// Add Ĵᵀ times a change of a visit's impulses to the states.
    ///
    /// # Safety
    /// Rows of this kind lie at the place.
    unsafe fn add<V: OctLanes>(
        rows: &[MaybeUninit<Oct>],
        place: Place,
        change: &[V; R],
        states: &mut [[V; D]; 2],
    );
}

/// A number of a visit's rows, for all lanes.
///
/// # Safety
/// The line was written.
#[inline(always)]
pub unsafe fn line<V: OctLanes>(rows: &[MaybeUninit<Oct>], at: usize) -> V {
    // SAFETY: the caller's promise.
    V::load(unsafe { rows.get_unchecked(at).assume_init_ref() })
}

/// Eight groups: the states that their lanes work on, and their visits.
pub struct Batch {
    pub bodies: [[u32; LANES]; 2],
    pub visits: Range<usize>,
    /// One in the lanes whose bodies no batch before has.
    pub fresh: [Oct; 2],
}

/// Where visits are written side by side, by several threads. Rows that visits share leave some of theirs unused.
pub struct Room<'a, const R: usize> {
    /// Rows for each visit, at most.
    lines: usize,
    /// The number of the first row among all.
    first: u32,
    /// Rows and visits written here.
    taken: usize,
    rows: &'a mut [MaybeUninit<Oct>],
    places: &'a mut [MaybeUninit<Place>],
    visits: &'a mut [MaybeUninit<Contact<Oct, R>>],
    contacts: &'a mut [MaybeUninit<[u32; LANES]>],
    /// Visits written in all rooms.
    filled: &'a AtomicUsize,
}

impl<'a, const R: usize> Room<'a, R> {
    /// Take room for so many visits off the front.
    pub fn take(&mut self, visits: usize) -> Self {
        let rows = self.lines * visits;
        let room = Room {
            lines: self.lines,
            first: self.first,
            taken: 0,
            rows: front(&mut self.rows, rows),
            places: front(&mut self.places, visits),
            visits: front(&mut self.visits, visits),
            contacts: front(&mut self.contacts, visits),
            filled: self.filled,
        };
        self.first += rows as u32;
        room
    }

    /// Write rows, and return the number of the first.
    pub fn add_rows(&mut self, rows: impl Iterator<Item = Oct>) -> u32 {
        let begin = self.first + self.taken as u32;
        for row in rows {
            self.rows[self.taken].write(row);
            self.taken += 1;
        }
        begin
    }

    /// Rows that were written here.
    pub fn rows(&self, begin: u32, count: usize) -> &[Oct] {
        let begin = (begin - self.first) as usize;
        let rows = &self.rows[..self.taken][begin..begin + count];
        // SAFETY: they were written, and MaybeUninit changes no layout.
        unsafe { std::slice::from_raw_parts(rows.as_ptr().cast(), count) }
    }

    /// Write the next visit.
    pub fn add(&mut self, visit: Contact<Oct, R>, contacts: [u32; LANES], place: Place) {
        front(&mut self.places, 1)[0].write(place);
        front(&mut self.visits, 1)[0].write(visit);
        front(&mut self.contacts, 1)[0].write(contacts);
        self.filled.fetch_add(1, Ordering::Relaxed);
    }
}

pub struct Abreast<'a, const R: usize, const D: usize, L: Law<R>, S: Rows<R, D>> {
    law: &'a L,
    kind: PhantomData<S>,
    /// Contacts of the system.
    length: usize,
    /// What the contacts that no impulse moves add to the square of the residual.
    locked: f64,
    /// Where the places of the visits tell.
    rows: Vec<MaybeUninit<Oct>>,
    places: Vec<Place>,
    /// In the order of a sweep, one contact of each of eight groups.
    visits: Vec<Contact<Oct, R>>,
    /// The numbers in the system of a visit's contacts.
    contacts: Vec<[u32; LANES]>,
    pub batches: Vec<Batch>,
    /// Eight to a visit.
    locals: Vec<L::Local>,
    /// Batches of one colour in pieces, one colour after the other.
    colours: Vec<Vec<Range<usize>>>,
    states: Vec<State>,
    /// w = Ĵᵀ x; empty before the first sweep with momentum, as `before`.
    states_before: Vec<State>,
    /// Numbers that each batch is asked for, so that their sum does not depend on who found them.
    numbers: Vec<Oct>,
    /// x, the impulses before the last sweep, visit by visit.
    before: Vec<[Oct; R]>,
}

/// What a team does with all visits.
#[derive(Clone, Copy)]
enum Task {
    /// Take the steps from y = p + β (p - x), with w + β (w - Ĵᵀ x), and find d (p' - y)·(p' - p), p' being where they lead.
    Sweep {
        relaxation: f64,
        momentum: Option<f64>,
    },
    /// Add Ĵᵀ p to the states, and Ĵᵀ x to those before, where there are any.
    Gather,
    /// Find the squares of the natural map.
    Judge,
}

/// What lanes carry from visit to visit of a batch.
struct Carried<V, const D: usize> {
    /// Of the two bodies of each lane.
    states: [[V; D]; 2],
    /// d (p' - y)·(p' - p) so far; with momentum only.
    agreement: V,
}

/// What the threads of a team write to: each its own visits, and in one colour its own bodies.
struct Work<'a, const R: usize, const D: usize, L: Law<R>, S: Rows<R, D>> {
    law: &'a L,
    kind: PhantomData<S>,
    rows: &'a [MaybeUninit<Oct>],
    places: &'a [Place],
    batches: &'a [Batch],
    contacts: &'a [[u32; LANES]],
    visits: *mut Contact<Oct, R>,
    locals: *mut L::Local,
    states: *mut State,
    numbers: *mut Oct,
    /// Whether x and its states are kept.
    keeps: bool,
    states_before: *mut State,
    before: *mut [Oct; R],
}

// SAFETY: no batch is in two pieces, batches of one colour share no body (colouring) and no other slot, and a team is done
// with one colour before the next begins.
unsafe impl<const R: usize, const D: usize, L: Law<R>, S: Rows<R, D>> Sync
    for Work<'_, R, D, L, S>
{
}

impl<'a, const R: usize, const D: usize, L: Law<R>, S: Rows<R, D>> Abreast<'a, R, D, L, S> {
    /// Without visits: they come colour by colour.
    pub fn new(law: &'a L, length: usize, locked: f64) -> Self {
        Self {
            law,
            kind: PhantomData,
            length,
            locked,
            rows: Vec::new(),
            places: Vec::new(),
            visits: Vec::new(),
            contacts: Vec::new(),
            batches: Vec::new(),
            locals: Vec::new(),
            colours: Vec::new(),
            states: Vec::new(),
            states_before: Vec::new(),
            numbers: Vec::new(),
            before: Vec::new(),
        }
    }

    /// Make the batches from `first` on a colour, in a power of two of pieces of much the same size: of which each thread has
    /// as many. Who takes a piece from another thread waits for the cache lines that it was written in.
    pub fn end_colour(&mut self, first: usize) {
        let batches = &self.batches[first..];
        let visits: usize = batches.iter().map(|batch| batch.visits.len()).sum();
        let count = 1 << (visits / PIECE).max(1).ilog2();
        let (mut pieces, mut begin, mut done) = (Vec::with_capacity(count), first, 0);
        for (at, batch) in batches.iter().enumerate() {
            done += batch.visits.len();
            if done * count >= (pieces.len() + 1) * visits {
                pieces.push(begin..first + at + 1);
                begin = first + at + 1;
            }
        }
        self.colours.push(pieces);
    }

    /// Make ready to sweep over so many visits, with so many states; `fill` fills the room for the visits.
    pub fn lay_out(&mut self, visits: usize, states: usize, fill: impl FnOnce(Room<R>)) {
        let lines = S::LINES;
        self.rows.reserve_exact(lines * visits);
        // SAFETY: nothing is what such rows must hold.
        unsafe { self.rows.set_len(lines * visits) };
        self.places.reserve_exact(visits);
        self.visits.reserve_exact(visits);
        self.contacts.reserve_exact(visits);
        let filled = AtomicUsize::new(0);
        fill(Room {
            lines,
            first: 0,
            taken: 0,
            rows: &mut self.rows,
            places: &mut self.places.spare_capacity_mut()[..visits],
            visits: &mut self.visits.spare_capacity_mut()[..visits],
            contacts: &mut self.contacts.spare_capacity_mut()[..visits],
            filled: &filled,
        });
        assert_eq!(filled.into_inner(), visits, "a visit is missing");
        // SAFETY: every visit has been written.
        unsafe {
            self.places.set_len(visits);
            self.visits.set_len(visits);
            self.contacts.set_len(visits);
        }
        self.locals.resize_with(LANES * visits, L::Local::default);
        self.states.resize(states, State::default());
        self.numbers.resize(self.batches.len(), Oct::default());
    }

    fn perform(&mut self, task: Task, team: &Team) {
        let work = Work::<R, D, L, S> {
            law: self.law,
            kind: PhantomData,
            rows: &self.rows,
            places: &self.places,
            batches: &self.batches,
            contacts: &self.contacts,
            visits: self.visits.as_mut_ptr(),
            locals: self.locals.as_mut_ptr(),
            states: self.states.as_mut_ptr(),
            numbers: self.numbers.as_mut_ptr(),
            keeps: !self.before.is_empty(),
            states_before: self.states_before.as_mut_ptr(),
            before: self.before.as_mut_ptr(),
        };
        for pieces in &self.colours {
            team.run(pieces.len(), &|piece| work.run(task, pieces[piece].clone()));
        }
    }

    fn sum(&self) -> f64 {
        self.numbers.iter().flat_map(|numbers| numbers.0).sum()
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn perform_by_quads<const R: usize, const D: usize, L: Law<R>, S: Rows<R, D>>(
    work: &Work<R, D, L, S>,
    task: Task,
    part: Range<usize>,
) {
    if let Task::Sweep {
        relaxation,
        momentum,
    } = task
    {
        for number in part {
            work.visit_by_turns::<Quad<0>, Quad<4>>(number, relaxation, momentum);
        }
        return;
    }
    for number in part {
        work.perform::<Quad<0>>(task, number);
        work.perform::<Quad<4>>(task, number);
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq")]
fn perform_wide<const R: usize, const D: usize, L: Law<R>, S: Rows<R, D>>(
    work: &Work<R, D, L, S>,
    task: Task,
    part: Range<usize>,
) {
    for number in part {
        work.perform::<Wide>(task, number);
    }
}

/// Inlined, with all it calls in a sweep, so that it is compiled for the processor of the function around it.
impl<const R: usize, const D: usize, L: Law<R>, S: Rows<R, D>> Work<'_, R, D, L, S> {
    /// Do a task for some batches, with what this processor has.
    fn run(&self, task: Task, part: Range<usize>) {
        // SAFETY: the processor has just said that it has what the function is compiled for.
        #[cfg(target_arch = "x86_64")]
        if Wide::available() {
            return unsafe { perform_wide(self, task, part) };
        } else if has_quads() {
            return unsafe { perform_by_quads(self, task, part) };
        }
        for number in part {
            self.perform::<Portable>(task, number);
        }
    }

    /// Do a task for the lanes of a batch.
    #[inline(always)]
    fn perform<V: OctLanes>(&self, task: Task, number: usize) {
        match task {
            Task::Sweep {
                relaxation,
                momentum,
            } => self.visit::<V>(number, relaxation, momentum),
            Task::Gather => self.gather::<V>(number),
            Task::Judge => self.judge::<V>(number),
        }
    }

    #[inline(always)]
    fn visit<V: OctLanes>(&self, number: usize, relaxation: f64, momentum: Option<f64>) {
        let mut all = self.begin::<V>(number, momentum);
        for at in self.batches[number].visits.clone() {
            self.visit_one(at, relaxation, momentum, &mut all);
        }
        self.end(number, momentum, &all);
    }

    /// The same for two parts of the lanes, in turns: while one waits for its own results the other goes on.
    #[inline(always)]
    fn visit_by_turns<V: OctLanes, W: OctLanes>(
        &self,
        number: usize,
        relaxation: f64,
        momentum: Option<f64>,
    ) {
        let mut one = self.begin::<V>(number, momentum);
        let mut other = self.begin::<W>(number, momentum);
        for at in self.batches[number].visits.clone() {
            self.visit_one(at, relaxation, momentum, &mut one);
            self.visit_one(at, relaxation, momentum, &mut other);
        }
        self.end(number, momentum, &one);
        self.end(number, momentum, &other);
    }

    #[inline(always)]
    fn begin<V: OctLanes>(&self, number: usize, momentum: Option<f64>) -> Carried<V, D> {
        let batch = &self.batches[number];
        let mut states = self.load(self.states, batch);
        if let Some(beta) = momentum {
            for side in 0..2 {
                self.carry(batch, side, beta, &mut states[side]);
            }
        }
        Carried {
            states,
            agreement: V::splat(0.0),
        }
    }

    /// Go on from w + β (w - Ĵᵀ x) with the bodies on one side that this sweep has not come to yet, and keep their w.
    #[inline(always)]
    fn carry<V: OctLanes>(&self, batch: &Batch, side: usize, beta: f64, states: &mut [V; D]) {
        let fresh = V::load(&batch.fresh[side]).at_least(V::splat(1.0));
        if V::bits(fresh) == 0 {
            return;
        }
        let places = places(self.states_before, &batch.bodies[side]);
        // SAFETY: in this colour the bodies are this batch's.
        let mut before = unsafe { V::gathered(&places) };
        for d in 0..D {
            let (now, last) = (states[d], before[d]);
            let ahead = now.plus_product(V::splat(beta), now - last);
            states[d] = now.replaced(fresh, ahead);
            before[d] = last.replaced(fresh, now);
        }
        // SAFETY: as above.
        unsafe { V::scatter(&before, &places) };
    }

    #[inline(always)]
    fn end<V: OctLanes>(&self, number: usize, momentum: Option<f64>, carried: &Carried<V, D>) {
        self.store(self.states, &self.batches[number], &carried.states);
        if momentum.is_some() {
            // SAFETY: the number of this batch is this thread's.
            let agreement = unsafe { &mut *self.numbers.add(number) };
            carried.agreement.store(agreement);
        }
    }

    #[inline(always)]
    fn visit_one<V: OctLanes>(
        &self,
        at: usize,
        relaxation: f64,
        momentum: Option<f64>,
        carried: &mut Carried<V, D>,
    ) {
        let Carried { states, agreement } = carried;
        // SAFETY: visits, locals and `before` of this batch are this thread's.
        let visit = unsafe { &mut *self.visits.add(at) };
        let locals = unsafe { std::slice::from_raw_parts_mut(self.locals.add(LANES * at), LANES) };
        let velocity = self.velocity(at, visit, states);
        let last = visit.impulse;
        if let Some(beta) = momentum {
            let before = unsafe { &mut *self.before.add(at) };
            for r in 0..R {
                let (p, x) = (V::load(&last[r]), V::load(&before[r]));
                p.plus_product(V::splat(beta), p - x)
                    .store(&mut visit.impulse[r]);
                // Lane by lane: the others may not have read theirs.
                p.store(&mut before[r]);
            }
        }
        let change = visit.visit::<L, V>(self.law, locals, &velocity, relaxation);
        self.add(at, &change, states);
        if momentum.is_some() {
            let mut sum = V::splat(0.0);
            for r in 0..R {
                let way = V::load(&visit.impulse[r]) - V::load(&last[r]);
                sum = sum.plus_product(change[r], way);
            }
            *agreement = agreement.plus_product(V::load(&visit.scale), sum);
        }
    }

    #[inline(always)]
    fn gather<V: OctLanes>(&self, number: usize) {
        let batch = &self.batches[number];
        // SAFETY: the visits of this batch are this thread's.
        self.gather_of::<V>(batch, self.states, |at| unsafe {
            &(*self.visits.add(at)).impulse
        });
        if self.keeps {
            // SAFETY: as above.
            self.gather_of::<V>(batch, self.states_before, |at| unsafe {
                &*self.before.add(at)
            });
        }
    }

    /// Add Ĵᵀ times some impulses, by visit, to some states.
    #[inline(always)]
    fn gather_of<'s, V: OctLanes>(
        &'s self,
        batch: &Batch,
        states: *mut State,
        impulse: impl Fn(usize) -> &'s [Oct; R],
    ) {
        let mut sums = self.load::<V>(states, batch);
        for at in batch.visits.clone() {
            let memory = impulse(at);
            let mut impulse = [V::splat(0.0); R];
            for r in 0..R {
                impulse[r] = V::load(&memory[r]);
            }
            self.add(at, &impulse, &mut sums);
        }
        self.store(states, batch, &sums);
    }

    #[inline(always)]
    fn judge<V: OctLanes>(&self, number: usize) {
        let batch = &self.batches[number];
        let states = self.load::<V>(self.states, batch);
        // SAFETY: this batch is this thread's.
        let sums = unsafe { &mut *self.numbers.add(number) };
        V::splat(0.0).store(sums);
        for at in batch.visits.clone() {
            // SAFETY: as above; nobody writes to a state meanwhile.
            let visit = unsafe { &*self.visits.add(at) };
            let velocity = self.velocity(at, visit, &states);
            let mut impulse = velocity;
            for r in 0..R {
                impulse[r] = V::load(&visit.impulse[r]);
            }
            let (friction, scale) = (V::load(&visit.friction), V::load(&visit.scale));
            let map = self.law.natural_map(friction, scale, &impulse, &velocity);
            let mut square = map[0] * map[0];
            for r in 1..R {
                square = square.plus_product(map[r], map[r]);
            }
            let mut squares = Oct::default();
            square.store(&mut squares);
            for lane in V::HELD {
                // Rows that are shared move in lanes without a contact, too.
                if self.contacts[at][lane] != NONE {
                    sums.0[lane] += squares.0[lane];
                }
            }
        }
    }

    #[inline(always)]
    fn velocity<V: OctLanes>(
        &self,
        at: usize,
        visit: &Contact<Oct, R>,
        states: &[[V; D]; 2],
    ) -> [V; R] {
        // SAFETY: places tell where rows are.
        unsafe { S::velocity(self.rows, self.places[at], &visit.free, states) }
    }

    #[inline(always)]
    fn add<V: OctLanes>(&self, at: usize, change: &[V; R], states: &mut [[V; D]; 2]) {
        // SAFETY: places tell where rows are.
        unsafe { S::add(self.rows, self.places[at], change, states) }
    }

    /// The states of a batch's bodies, entry by entry, a body in each lane.
    #[inline(always)]
    fn load<V: OctLanes>(&self, from: *mut State, batch: &Batch) -> [[V; D]; 2] {
        let mut states = [[V::splat(0.0); D]; 2];
        for side in 0..2 {
            // SAFETY: in this colour the bodies are this batch's.
            let entries = unsafe { V::gathered(&places(from, &batch.bodies[side])) };
            states[side].copy_from_slice(&entries[..D]);
        }
        states
    }

    #[inline(always)]
    fn store<V: OctLanes>(&self, to: *mut State, batch: &Batch, states: &[[V; D]; 2]) {
        for side in 0..2 {
            let mut entries = [V::splat(0.0); LANES];
            entries[..D].copy_from_slice(&states[side]);
            // SAFETY: as above.
            unsafe { V::scatter(&entries, &places(to, &batch.bodies[side])) };
        }
    }
}

#[inline(always)]
fn places(states: *mut State, bodies: &[u32; LANES]) -> [*mut State; LANES] {
    let mut places = [states; LANES];
    for lane in 0..LANES {
        places[lane] = states.wrapping_add(bodies[lane] as usize);
    }
    places
}

impl<const R: usize, const D: usize, L: Law<R>, S: Rows<R, D>> Sweeper<R>
    for Abreast<'_, R, D, L, S>
{
    fn sweep(&mut self, team: &Team, relaxation: f64, momentum: Option<f64>) -> f64 {
        if momentum.is_some() && self.before.is_empty() {
            self.before = self.visits.iter().map(|visit| visit.impulse).collect();
            self.states_before.clone_from(&self.states);
        }
        let task = Task::Sweep {
            relaxation,
            momentum,
        };
        self.perform(task, team);
        if momentum.is_some() { self.sum() } else { 0.0 }
    }

    fn residual(&mut self, team: &Team) -> f64 {
        // Both, or what rounding has left in one would grow with the momentum.
        self.states.fill(State::default());
        self.states_before.fill(State::default());
        self.perform(Task::Gather, team);
        self.perform(Task::Judge, team);
        (self.locked + self.sum()).sqrt()
    }

    fn impulse(&self) -> Vec<Vector<R>> {
        let mut impulse = vec![[0.0; R]; self.length];
        for (visit, contacts) in self.visits.iter().zip(&self.contacts) {
            for lane in (0..LANES).filter(|&lane| contacts[lane] != NONE) {
                impulse[contacts[lane] as usize] = visit.impulse_in(lane);
            }
        }
        impulse
    }
}
