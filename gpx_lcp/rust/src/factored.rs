//! Sweeps on the whitened Jacobian Ĵ, A = Ĵ Ĵᵀ: contacts of at most two bodies, four groups abreast, colour after colour.
//!
//! A group is the contacts of two bodies (see `colouring`). Four groups of one colour share no body: their contacts are
//! visited side by side in the lanes of a register, the states w = Ĵᵀ p of their eight bodies being read and written once
//! for the whole group. Threads share the batches of a colour, and are waited for before the next colour begins. Who
//! visits a batch changes nothing in it, so the bits do not depend on the number of threads.

use std::ops::Range;

use crate::colouring::{NONE, coloured};
use crate::contact::{Contact, Law};
use crate::delassus::{BlockRows, Delassus, Sweeper, allowed};
use crate::gauss_seidel::Problem;
#[cfg(target_arch = "x86_64")]
use crate::lanes::Fused;
use crate::lanes::{FourLanes, Portable, Quad};
use crate::small_matrix::{Matrix, Vector, dot};
use crate::team::Team;

/// Visits of a piece of work, at least: two microseconds, so that taking it costs little.
const PIECE: usize = 32;

/// Ĵ contact by contact: its two blocks of D columns, zero where there is no body.
pub struct Factored<const R: usize, const D: usize> {
    blocks: Vec<[[[f64; D]; R]; 2]>,
    /// The bodies of the blocks, the smaller number first.
    pairs: Vec<[u32; 2]>,
    bodies: usize,
}

impl<const R: usize, const D: usize> Factored<R, D> {
    /// Take the block rows of Ĵ; None where a contact touches more than two bodies.
    pub fn new(rows: &BlockRows<R, D>, bodies: usize) -> Option<Self> {
        // A state is two registers of four.
        const { assert!(D <= 8) };
        let mut blocks = Vec::with_capacity(rows.len());
        let mut pairs = Vec::with_capacity(rows.len());
        for i in 0..rows.len() {
            let mut sides = [[[0.0; D]; R]; 2];
            let mut pair = [NONE; 2];
            for block in rows.row(i) {
                let body = block.column as u32;
                // A body named twice adds its blocks.
                let side = (0..2).find(|&side| pair[side] == body || pair[side] == NONE)?;
                pair[side] = body;
                for r in 0..R {
                    for d in 0..D {
                        sides[side][r][d] += block.values[r][d];
                    }
                }
            }
            if pair[0] > pair[1] {
                pair.swap(0, 1);
                sides.swap(0, 1);
            }
            blocks.push(sides);
            pairs.push(pair);
        }
        Some(Self {
            blocks,
            pairs,
            bodies,
        })
    }
}

impl<const R: usize, const D: usize> Delassus<R> for Factored<R, D> {
    fn len(&self) -> usize {
        self.blocks.len()
    }

    fn diagonal_block(&self, i: usize) -> Matrix<R> {
        let [a, b] = &self.blocks[i];
        std::array::from_fn(|r| std::array::from_fn(|c| dot(&a[r], &a[c]) + dot(&b[r], &b[c])))
    }

    fn sweeper<'a, L: Law<R>>(
        &'a self,
        law: &'a L,
        problem: &'a Problem<'a, R>,
        start: &[Vector<R>],
    ) -> impl Sweeper<R> + 'a {
        let (mut movable, mut contacts) = (Vec::new(), Vec::new());
        let mut locked = 0.0;
        for (i, start) in start.iter().enumerate() {
            if let Some(contact) = self.contact(i, law, problem, start) {
                movable.push(i);
                contacts.push(contact);
            } else {
                let velocity = problem.target[i].map(|value| -value);
                let map =
                    law.natural_map(problem.friction[i], problem.scale[i], &[0.0; R], &velocity);
                locked += dot(&map, &map);
            }
        }
        let pairs: Vec<[u32; 2]> = movable.iter().map(|&i| self.pairs[i]).collect();
        let mut sweeper = Abreast {
            law,
            length: self.len(),
            locked,
            visits: Vec::new(),
            locals: Vec::new(),
            contacts: Vec::new(),
            batches: Vec::new(),
            colours: Vec::new(),
            states: Vec::new(),
            squares: Vec::new(),
            before: Vec::new(),
            start: Vec::new(),
        };
        let mut slots = self.bodies;
        for colour in coloured(&pairs) {
            let first = sweeper.batches.len();
            for batch in colour {
                let start = sweeper.visits.len();
                let mut bodies = batch.bodies;
                // What stands still has a state of its own in every lane, which stays zero.
                for body in bodies.iter_mut().flatten().filter(|body| **body == NONE) {
                    *body = slots as u32;
                    slots += 1;
                }
                for lanes in batch.contacts {
                    let mut visit = Visit::<R, D>::idle();
                    let mut numbers = [NONE; 4];
                    for lane in (0..4).filter(|&lane| lanes[lane] != NONE) {
                        let contact = lanes[lane] as usize;
                        numbers[lane] = movable[contact] as u32;
                        visit.set(lane, &self.blocks[movable[contact]], &contacts[contact]);
                    }
                    sweeper.visits.push(visit);
                    sweeper.contacts.push(numbers);
                }
                sweeper.batches.push(Batch {
                    bodies,
                    visits: start..sweeper.visits.len(),
                });
            }
            sweeper.colours.push(pieces(&sweeper.batches, first));
        }
        let lanes = 4 * sweeper.visits.len();
        sweeper.locals.resize_with(lanes, L::Local::default);
        sweeper.states.resize(slots, State::default());
        sweeper.squares.resize(sweeper.visits.len(), 0.0);
        let impulses = sweeper.visits.iter().map(|visit| visit.contact.impulse);
        sweeper.before = impulses.collect();
        sweeper.start = sweeper.before.clone();
        sweeper
    }
}

/// The batches from `first` on, cut where PIECE visits are full.
fn pieces(batches: &[Batch], first: usize) -> Vec<Range<usize>> {
    let mut pieces = Vec::new();
    let (mut begin, mut visits) = (first, 0);
    for (at, batch) in batches.iter().enumerate().skip(first) {
        visits += batch.visits.len();
        if visits >= PIECE || at + 1 == batches.len() {
            pieces.push(begin..at + 1);
            (begin, visits) = (at + 1, 0);
        }
    }
    pieces
}

/// w of one body, √kg m/s, filled up with zeros.
type State = [Quad; 2];

/// One contact of each of four groups, with its rows of Ĵ.
#[derive(Clone, Copy)]
#[repr(C)]
struct Visit<const R: usize, const D: usize> {
    rows: [[[Quad; D]; R]; 2],
    contact: Contact<Quad, R>,
}

impl<const R: usize, const D: usize> Visit<R, D> {
    fn idle() -> Self {
        Self {
            rows: [[[Quad::default(); D]; R]; 2],
            contact: Contact::idle(),
        }
    }

    fn set(&mut self, lane: usize, blocks: &[[[f64; D]; R]; 2], contact: &Contact<f64, R>) {
        self.contact.set(lane, contact);
        for (side, block) in self.rows.iter_mut().zip(blocks) {
            for (row, values) in side.iter_mut().zip(block) {
                for (quad, value) in row.iter_mut().zip(values) {
                    quad.0[lane] = *value;
                }
            }
        }
    }

    /// Ĵ w + `free`, m/s, of the four contacts.
    #[inline(always)]
    fn velocity<V: FourLanes>(&self, states: &[[V; D]; 2]) -> [V; R] {
        let mut velocity = [V::splat(0.0); R];
        for r in 0..R {
            // Two chains, because each waits for itself.
            let mut chains = [V::load(&self.contact.free[r]), V::splat(0.0)];
            for side in 0..2 {
                for d in 0..D {
                    let row = V::load(&self.rows[side][r][d]);
                    chains[side] = chains[side].plus_product(row, states[side][d]);
                }
            }
            velocity[r] = chains[0] + chains[1];
        }
        velocity
    }

    /// Add Ĵᵀ times a change of the impulses to the states.
    #[inline(always)]
    fn add<V: FourLanes>(&self, change: &[V; R], states: &mut [[V; D]; 2]) {
        for side in 0..2 {
            for d in 0..D {
                for r in 0..R {
                    let row = V::load(&self.rows[side][r][d]);
                    states[side][d] = states[side][d].plus_product(row, change[r]);
                }
            }
        }
    }
}

/// Four groups: the states that their lanes work on, and their visits.
struct Batch {
    bodies: [[u32; 4]; 2],
    visits: Range<usize>,
}

struct Abreast<'a, const R: usize, const D: usize, L: Law<R>> {
    law: &'a L,
    /// Contacts of the system.
    length: usize,
    /// What the contacts that no impulse moves add to the square of the residual.
    locked: f64,
    /// In the order of a sweep.
    visits: Vec<Visit<R, D>>,
    /// Four to a visit.
    locals: Vec<L::Local>,
    /// The numbers in the system of a visit's contacts.
    contacts: Vec<[u32; 4]>,
    batches: Vec<Batch>,
    /// Batches of one colour in pieces, one colour after the other.
    colours: Vec<Vec<Range<usize>>>,
    states: Vec<State>,
    /// Of the natural map, visit by visit, so that their sum does not depend on who found them.
    squares: Vec<f64>,
    /// x and y of `Sweeper::agreement`, visit by visit.
    before: Vec<[Quad; R]>,
    start: Vec<[Quad; R]>,
}

/// What a team does with all visits.
#[derive(Clone, Copy)]
enum Task {
    Sweep {
        relaxation: f64,
    },
    /// Add Ĵᵀ p to the states.
    Gather,
    /// Go on from p + β (p - x), and add Ĵᵀ times that to the states.
    Extrapolate {
        beta: f64,
    },
    /// Find the squares of the natural map.
    Judge,
}

/// What the threads of a team write to: each its own visits, and in one colour its own bodies.
struct Work<'a, const R: usize, const D: usize, L: Law<R>> {
    law: &'a L,
    batches: &'a [Batch],
    contacts: &'a [[u32; 4]],
    visits: *mut Visit<R, D>,
    locals: *mut L::Local,
    states: *mut State,
    squares: *mut f64,
    before: *mut [Quad; R],
    start: *mut [Quad; R],
}

// SAFETY: no batch is in two pieces, batches of one colour share no body (colouring) and no other slot, and a team is done
// with one colour before the next begins.
unsafe impl<const R: usize, const D: usize, L: Law<R>> Sync for Work<'_, R, D, L> {}

impl<const R: usize, const D: usize, L: Law<R>> Abreast<'_, R, D, L> {
    fn perform(&mut self, task: Task, team: &Team) {
        let work = Work {
            law: self.law,
            batches: &self.batches,
            contacts: &self.contacts,
            visits: self.visits.as_mut_ptr(),
            locals: self.locals.as_mut_ptr(),
            states: self.states.as_mut_ptr(),
            squares: self.squares.as_mut_ptr(),
            before: self.before.as_mut_ptr(),
            start: self.start.as_mut_ptr(),
        };
        for pieces in &self.colours {
            team.run(pieces.len(), &|piece| {
                let batches = pieces[piece].clone();
                #[cfg(target_arch = "x86_64")]
                if Fused::available() {
                    // SAFETY: the processor has just said that it has what `perform_fused` is compiled for.
                    return unsafe { perform_fused(&work, task, batches) };
                }
                work.perform::<Portable>(task, batches);
            });
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn perform_fused<const R: usize, const D: usize, L: Law<R>>(
    work: &Work<R, D, L>,
    task: Task,
    batches: Range<usize>,
) {
    work.perform::<Fused>(task, batches);
}

/// Inlined, with all it calls in a sweep, so that it is compiled for the processor of the function around it.
impl<const R: usize, const D: usize, L: Law<R>> Work<'_, R, D, L> {
    #[inline(always)]
    fn perform<V: FourLanes>(&self, task: Task, batches: Range<usize>) {
        let batches = &self.batches[batches];
        match task {
            Task::Sweep { relaxation } => {
                for batch in batches {
                    self.visit::<V>(batch, relaxation);
                }
            }
            Task::Gather => {
                for batch in batches {
                    self.gather::<V>(batch);
                }
            }
            Task::Extrapolate { beta } => {
                for batch in batches {
                    self.extrapolate::<V>(batch, beta);
                }
            }
            Task::Judge => {
                for batch in batches {
                    self.judge::<V>(batch);
                }
            }
        }
    }

    #[inline(always)]
    fn visit<V: FourLanes>(&self, batch: &Batch, relaxation: f64) {
        let mut states = self.load::<V>(batch);
        for at in batch.visits.clone() {
            // SAFETY: visits and locals of this batch are this thread's.
            let visit = unsafe { &mut *self.visits.add(at) };
            let locals = unsafe { std::slice::from_raw_parts_mut(self.locals.add(4 * at), 4) };
            let velocity = visit.velocity(&states);
            let change = visit
                .contact
                .visit::<L, V>(self.law, locals, &velocity, relaxation);
            visit.add(&change, &mut states);
        }
        self.store(batch, &states);
    }

    #[inline(always)]
    fn gather<V: FourLanes>(&self, batch: &Batch) {
        let mut states = self.load::<V>(batch);
        for at in batch.visits.clone() {
            // SAFETY: as above.
            let visit = unsafe { &*self.visits.add(at) };
            let mut impulse = [V::splat(0.0); R];
            for r in 0..R {
                impulse[r] = V::load(&visit.contact.impulse[r]);
            }
            visit.add(&impulse, &mut states);
        }
        self.store(batch, &states);
    }

    #[inline(always)]
    fn extrapolate<V: FourLanes>(&self, batch: &Batch, beta: f64) {
        let mut states = self.load::<V>(batch);
        for at in batch.visits.clone() {
            // SAFETY: as above, and so are the entries of `before` and `start`.
            let visit = unsafe { &mut *self.visits.add(at) };
            let before = unsafe { &mut *self.before.add(at) };
            let contact = &mut visit.contact;
            let mut further = [V::splat(0.0); R];
            for r in 0..R {
                let p = V::load(&contact.impulse[r]);
                further[r] = p.plus_product(V::splat(beta), p - V::load(&before[r]));
            }
            *before = contact.impulse;
            for r in 0..R {
                further[r].store(&mut contact.impulse[r]);
            }
            let inside = self.law.contains(V::load(&contact.friction), &further);
            if !V::all(inside) {
                for lane in 0..4 {
                    let friction = contact.friction.0[lane];
                    let impulse = allowed(self.law, friction, &contact.impulse_in(lane));
                    for r in 0..R {
                        contact.impulse[r].0[lane] = impulse[r];
                    }
                }
                for r in 0..R {
                    further[r] = V::load(&contact.impulse[r]);
                }
            }
            unsafe { *self.start.add(at) = contact.impulse };
            visit.add(&further, &mut states);
        }
        self.store(batch, &states);
    }

    #[inline(always)]
    fn judge<V: FourLanes>(&self, batch: &Batch) {
        let states = self.load::<V>(batch);
        for at in batch.visits.clone() {
            // SAFETY: as above; nobody writes to a state meanwhile.
            let visit = unsafe { &*self.visits.add(at) };
            let velocity = visit.velocity(&states);
            let mut memory = [Quad::default(); R];
            for r in 0..R {
                velocity[r].store(&mut memory[r]);
            }
            let mut square = 0.0;
            for lane in (0..4).filter(|&lane| self.contacts[at][lane] != NONE) {
                let map = self.law.natural_map(
                    visit.contact.friction.0[lane],
                    visit.contact.scale.0[lane],
                    &visit.contact.impulse_in(lane),
                    &std::array::from_fn(|r| memory[r].0[lane]),
                );
                square += dot(&map, &map);
            }
            unsafe { *self.squares.add(at) = square };
        }
    }

    /// The states of a batch's bodies, entry by entry, a body in each lane.
    #[inline(always)]
    fn load<V: FourLanes>(&self, batch: &Batch) -> [[V; D]; 2] {
        let mut states = [[V::splat(0.0); D]; 2];
        for side in 0..2 {
            for half in 0..D.div_ceil(4) {
                let mut lanes = [V::splat(0.0); 4];
                for lane in 0..4 {
                    // SAFETY: in this colour the body is this batch's.
                    let state = unsafe { &*self.states.add(batch.bodies[side][lane] as usize) };
                    lanes[lane] = V::load(&state[half]);
                }
                let entries = V::transposed(lanes);
                for d in 4 * half..D.min(4 * half + 4) {
                    states[side][d] = entries[d - 4 * half];
                }
            }
        }
        states
    }

    #[inline(always)]
    fn store<V: FourLanes>(&self, batch: &Batch, states: &[[V; D]; 2]) {
        for side in 0..2 {
            for half in 0..D.div_ceil(4) {
                let mut entries = [V::splat(0.0); 4];
                for d in 4 * half..D.min(4 * half + 4) {
                    entries[d - 4 * half] = states[side][d];
                }
                let lanes = V::transposed(entries);
                for lane in 0..4 {
                    // SAFETY: as above.
                    let state = unsafe { &mut *self.states.add(batch.bodies[side][lane] as usize) };
                    lanes[lane].store(&mut state[half]);
                }
            }
        }
    }
}

impl<const R: usize, const D: usize, L: Law<R>> Sweeper<R> for Abreast<'_, R, D, L> {
    fn threads(&self) -> usize {
        self.colours.iter().map(Vec::len).max().unwrap_or(1)
    }

    fn sweep(&mut self, team: &Team, relaxation: f64) {
        self.perform(Task::Sweep { relaxation }, team);
    }

    fn residual(&mut self, team: &Team) -> f64 {
        self.states.fill(State::default());
        self.perform(Task::Gather, team);
        self.perform(Task::Judge, team);
        (self.locked + self.squares.iter().sum::<f64>()).sqrt()
    }

    fn impulse(&self) -> Vec<Vector<R>> {
        let mut impulse = vec![[0.0; R]; self.length];
        for (visit, contacts) in self.visits.iter().zip(&self.contacts) {
            for lane in (0..4).filter(|&lane| contacts[lane] != NONE) {
                impulse[contacts[lane] as usize] = visit.contact.impulse_in(lane);
            }
        }
        impulse
    }

    fn agreement(&self) -> f64 {
        let mut sums = [0.0; 4];
        let starts = self.before.iter().zip(&self.start);
        for (visit, (before, start)) in self.visits.iter().zip(starts) {
            let contact = &visit.contact;
            for r in 0..R {
                for lane in 0..4 {
                    let p = contact.impulse[r].0[lane];
                    let (step, way) = (p - start[r].0[lane], p - before[r].0[lane]);
                    sums[lane] += contact.scale.0[lane] * step * way;
                }
            }
        }
        sums.iter().sum()
    }

    fn extrapolate(&mut self, team: &Team, beta: f64) {
        self.states.fill(State::default());
        self.perform(Task::Extrapolate { beta }, team);
    }
}
