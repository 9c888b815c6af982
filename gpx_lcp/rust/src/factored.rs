//! The whitened Jacobian Ĵ, A = Ĵ Ĵᵀ, of contacts that touch at most two bodies, laid out for sweeps (see `abreast`).
//!
//! A group is the contacts of two bodies (see `colouring`). Eight groups of one colour share no body: their contacts are
//! visited side by side in the lanes of a register. What a sweep reads lies in the order in which it is read: blocks of Ĵ
//! whatever they are, or what `arms` needs of contacts between rigid bodies.

use std::mem::{MaybeUninit, replace};
use std::ops::Range;

use crate::abreast::{Abreast, Batch, Place, Room, Rows, line};
use crate::colouring::{self, NONE, coloured};
use crate::contact::{Contact, Law};
use crate::delassus::{self, Delassus, Sweeper};
use crate::exact::BlockMatrix;
use crate::gauss_seidel::Problem;
use crate::lanes::{LANES, Oct, OctLanes};
use crate::small_matrix::{Matrix, Vector, dot};
use crate::team::Team;

/// Contacts, or visits of eight, of a piece of work: some ten microseconds.
const CONTACTS: usize = 512;
const VISITS: usize = 32;

/// The blocks of one contact, zero where there is no body.
pub type Sides<const R: usize, const D: usize> = [[[f64; D]; R]; 2];

/// One contact in each lane that has one: its number, its bodies and its blocks.
pub struct Visit<const R: usize, const D: usize> {
    pub numbers: [u32; LANES],
    pub bodies: [[u32; 2]; LANES],
    pub sides: [Sides<R, D>; LANES],
}

/// What the rows of a visit are made of.
pub trait Source<const R: usize, const D: usize>: Sync {
    type Rows: Rows<R, D>;

    /// Write the rows of a visit, but for those that the visit before has `shared`, if they are the same.
    fn write(
        &self,
        whitened: &BlockMatrix,
        visit: &Visit<R, D>,
        shared: Option<u32>,
        room: &mut Room<R>,
    ) -> Place;
}

/// Ĵ contact by contact, of which the first R rows count.
pub struct Factored<'a, const R: usize, const D: usize, S> {
    whitened: &'a BlockMatrix,
    source: S,
    /// The two bodies of each contact, the smaller number first.
    pairs: Vec<[u32; 2]>,
}

impl<'a, const R: usize, const D: usize, S: Source<R, D>> Factored<'a, R, D, S> {
    /// Take Ĵ, in blocks of D columns and at least R rows; None where a contact touches more than two bodies.
    pub fn new(whitened: &'a BlockMatrix, source: S) -> Option<Self> {
        // A state is one register.
        const { assert!(D <= LANES) };
        assert!(whitened.width == D && whitened.height >= R);
        let pair = |range: &[usize]| {
            let mut pair = [NONE; 2];
            for &body in &whitened.columns[range[0]..range[1]] {
                let side = (0..2).find(|&side| pair[side] == body || pair[side] == NONE)?;
                pair[side] = body;
            }
            pair.sort_unstable();
            Some(pair)
        };
        let pairs = whitened.starts.windows(2).map(pair);
        Some(Self {
            whitened,
            source,
            pairs: pairs.collect::<Option<_>>()?,
        })
    }

    /// Add N rows of the blocks of contact i, from the first one on; a body named twice adds those of both.
    fn add_rows<const N: usize>(&self, i: usize, first: usize, sides: &mut Sides<N, D>) {
        for (body, values) in self.whitened.row(i) {
            let side = usize::from(self.pairs[i][0] as usize != body);
            let rows = &values.as_chunks::<D>().0[first..first + N];
            for (sum, values) in sides[side].iter_mut().zip(rows) {
                for (sum, value) in sum.iter_mut().zip(values) {
                    *sum += value;
                }
            }
        }
    }

    /// Whether an impulse moves contact i at all: whether a diagonal entry of A_ii is not zero. Nearly always the first
    /// tells, and no other is worked out.
    fn can_move(&self, i: usize) -> bool {
        (0..R).any(|r| {
            let mut row = [[[0.0; D]]; 2];
            self.add_rows(i, r, &mut row);
            block(&row)[0][0] > 0.0
        })
    }
}

impl<const R: usize, const D: usize, S: Source<R, D>> Delassus<R> for Factored<'_, R, D, S> {
    fn len(&self) -> usize {
        self.pairs.len()
    }

    fn sweeper<'a, L: Law<R>>(
        &'a self,
        law: &'a L,
        problem: &'a Problem<'a, R>,
        start: &[Vector<R>],
        team: &Team,
    ) -> impl Sweeper<R> + 'a {
        let mut can_move = vec![false; self.len()];
        let mut parts: Vec<_> = can_move.chunks_mut(CONTACTS).enumerate().collect();
        team.each(&mut parts, |(part, can_move)| {
            for (i, can_move) in (CONTACTS * *part..).zip(can_move.iter_mut()) {
                *can_move = self.can_move(i);
            }
        });
        let (mut movable, mut pairs, mut locked) = (Vec::new(), Vec::new(), 0.0);
        for (i, can_move) in can_move.into_iter().enumerate() {
            if can_move {
                movable.push(i as u32);
                pairs.push(self.pairs[i]);
            } else {
                let velocity = problem.target[i].map(|value| -value);
                let map =
                    law.natural_map(problem.friction[i], problem.scale[i], &[0.0; R], &velocity);
                locked += dot(&map, &map);
            }
        }
        let mut sweeper = Abreast::<R, D, L, S::Rows>::new(law, self.len(), locked);
        let colours = coloured(&pairs);
        let mut slots = self.whitened.block_columns;
        let mut visits = 0;
        let mut seen = vec![false; slots];
        for colour in &colours {
            let first = sweeper.batches.len();
            for batch in colour {
                let begin = visits;
                visits += batch.contacts.len();
                let mut bodies = batch.bodies;
                let fresh = bodies.map(|side| {
                    Oct(side.map(|body| {
                        let seen = seen.get_mut(body as usize).map(|seen| replace(seen, true));
                        f64::from(u8::from(seen == Some(false)))
                    }))
                });
                // What stands still has a state of its own in every lane, which stays zero.
                for body in bodies.iter_mut().flatten().filter(|body| **body == NONE) {
                    *body = slots as u32;
                    slots += 1;
                }
                sweeper.batches.push(Batch {
                    bodies,
                    visits: begin..visits,
                    fresh,
                });
            }
            sweeper.end_colour(first);
        }
        let batches: Vec<colouring::Batch> = colours.into_iter().flatten().collect();
        sweeper.lay_out(visits, slots, |mut room| {
            let mut parts = Vec::new();
            let (mut begin, mut visits) = (0, 0);
            for (at, batch) in batches.iter().enumerate() {
                visits += batch.contacts.len();
                if visits >= VISITS || at + 1 == batches.len() {
                    parts.push((&batches[begin..=at], room.take(visits)));
                    (begin, visits) = (at + 1, 0);
                }
            }
            team.each(&mut parts, |(batches, room)| {
                for batch in *batches {
                    lay_out(self, batch, &movable, (law, problem, start), room);
                }
            });
        });
        sweeper
    }
}

/// A_ii.
#[inline(always)]
fn block<const R: usize, const D: usize>([a, b]: &Sides<R, D>) -> Matrix<R> {
    let mut block = [[0.0; R]; R];
    for r in 0..R {
        for c in 0..=r {
            block[r][c] = dot(&a[r], &a[c]) + dot(&b[r], &b[c]);
            block[c][r] = block[r][c];
        }
    }
    block
}

/// Lay a batch out in its room; `movable` gives the numbers of its contacts in the system.
fn lay_out<const R: usize, const D: usize, L: Law<R>, S: Source<R, D>>(
    factored: &Factored<R, D, S>,
    batch: &colouring::Batch,
    movable: &[u32],
    (law, problem, start): (&L, &Problem<R>, &[Vector<R>]),
    room: &mut Room<R>,
) {
    let mut shared = None;
    for lanes in &batch.contacts {
        let mut contacts = Contact::idle();
        let mut visit = Visit {
            numbers: [NONE; LANES],
            bodies: [[NONE; 2]; LANES],
            sides: [[[[0.0; D]; R]; 2]; LANES],
        };
        for lane in (0..LANES).filter(|&lane| lanes[lane] != NONE) {
            let number = movable[lanes[lane] as usize];
            let i = number as usize;
            visit.numbers[lane] = number;
            visit.bodies[lane] = factored.pairs[i];
            factored.add_rows(i, 0, &mut visit.sides[lane]);
            let block = block(&visit.sides[lane]);
            let contact = delassus::contact(i, &block, law, problem, &start[i]);
            contacts.set(lane, &contact);
        }
        let Factored {
            source, whitened, ..
        } = factored;
        let place = source.write(whitened, &visit, shared, room);
        shared = Some(place.shared);
        room.add(contacts, visit.numbers, place);
    }
}

impl<const R: usize, const D: usize> Visit<R, D> {
    /// Whether these lines hold the given entries in all lanes that have a contact.
    pub fn are_in(&self, stored: &[Oct], entries: impl Iterator<Item = Oct>) -> bool {
        stored.iter().zip(entries).all(|(stored, entry)| {
            (0..LANES).all(|lane| self.numbers[lane] == NONE || stored.0[lane] == entry.0[lane])
        })
    }
}

/// Blocks of Ĵ side by side, row by row: the columns where forces act, and the others.
///
/// The first three columns of a block, where forces act, are the same for all contacts of a patch, which share their
/// frame: they are stored once for visits that follow each other.
pub struct Blocks;

/// How many of the columns of a block are those where forces act.
const fn forces(columns: usize) -> usize {
    if columns < 3 { columns } else { 3 }
}

impl<const R: usize, const D: usize> Source<R, D> for Blocks {
    type Rows = Blocks;

    fn write(
        &self,
        _whitened: &BlockMatrix,
        visit: &Visit<R, D>,
        shared: Option<u32>,
        room: &mut Room<R>,
    ) -> Place {
        let (split, sides) = (forces(D), &visit.sides);
        let holds = |&begin: &u32| {
            let stored = room.rows(begin, 2 * R * split);
            visit.are_in(stored, entries(sides, 0..split))
        };
        let shared = shared.filter(holds);
        let shared = shared.unwrap_or_else(|| room.add_rows(entries(sides, 0..split)));
        let own = room.add_rows(entries(sides, split..D));
        Place { shared, own }
    }
}

/// Some columns of all blocks, row by row, a contact in each lane.
fn entries<const R: usize, const D: usize>(
    sides: &[Sides<R, D>; LANES],
    columns: Range<usize>,
) -> impl Iterator<Item = Oct> {
    (0..2 * R).flat_map(move |line| {
        columns.clone().map(move |column| {
            Oct(std::array::from_fn(|lane| {
                sides[lane].as_flattened()[line][column]
            }))
        })
    })
}

impl<const R: usize, const D: usize> Rows<R, D> for Blocks {
    const LINES: usize = 2 * R * D;

    #[inline(always)]
    unsafe fn velocity<V: OctLanes>(
        rows: &[MaybeUninit<Oct>],
        place: Place,
        free: &[Oct; R],
        states: &[[V; D]; 2],
    ) -> [V; R] {
        let (forces, moments) = (forces(D), D - forces(D));
        let mut velocity = [V::splat(0.0); R];
        for r in 0..R {
            // Short sums, because each waits for itself.
            let mut sums = [V::load(&free[r]), V::splat(0.0)];
            for side in 0..2 {
                for d in 0..forces {
                    // SAFETY: the caller's promise, here and below.
                    let row =
                        unsafe { line(rows, place.shared as usize + (side * R + r) * forces + d) };
                    sums[side] = sums[side].plus_product(row, states[side][d]);
                }
            }
            velocity[r] = sums[0] + sums[1];
            if moments > 0 {
                let mut sums = [V::splat(0.0); 2];
                for side in 0..2 {
                    for d in 0..moments {
                        let row = unsafe {
                            line(rows, place.own as usize + (side * R + r) * moments + d)
                        };
                        sums[side] = sums[side].plus_product(row, states[side][forces + d]);
                    }
                }
                velocity[r] = velocity[r] + (sums[0] + sums[1]);
            }
        }
        velocity
    }

    #[inline(always)]
    unsafe fn add<V: OctLanes>(
        rows: &[MaybeUninit<Oct>],
        place: Place,
        change: &[V; R],
        states: &mut [[V; D]; 2],
    ) {
        let (forces, moments) = (forces(D), D - forces(D));
        for side in 0..2 {
            for r in 0..R {
                for d in 0..forces {
                    // SAFETY: the caller's promise, here and below.
                    let row =
                        unsafe { line(rows, place.shared as usize + (side * R + r) * forces + d) };
                    states[side][d] = states[side][d].plus_product(row, change[r]);
                }
                for d in 0..moments {
                    let row =
                        unsafe { line(rows, place.own as usize + (side * R + r) * moments + d) };
                    let state = &mut states[side][forces + d];
                    *state = state.plus_product(row, change[r]);
                }
            }
        }
    }
}
