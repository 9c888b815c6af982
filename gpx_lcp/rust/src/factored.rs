//! The whitened Jacobian Ĵ, A = Ĵ Ĵᵀ, of contacts that touch at most two bodies, laid out for sweeps (see `abreast`).
//!
//! A group is the contacts of two bodies (see `colouring`). Eight groups of one colour share no body: their contacts are
//! visited side by side in the lanes of a register. What a sweep reads of Ĵ lies in the order in which it is read. The
//! first three columns of a block, where forces act, are the same for all contacts of a patch, which share their frame:
//! they are stored once for visits that follow each other.

use std::ops::Range;

use crate::abreast::{Abreast, Batch, Place};
use crate::colouring::{NONE, coloured};
use crate::contact::Law;
use crate::delassus::{Delassus, Sweeper};
use crate::exact::BlockMatrix;
use crate::gauss_seidel::Problem;
use crate::lanes::{LANES, Oct};
use crate::small_matrix::{Matrix, Vector, dot};

/// The blocks of one contact, zero where there is no body.
type Sides<const R: usize, const D: usize> = [[[f64; D]; R]; 2];

/// Ĵ contact by contact, of which the first R rows count.
pub struct Factored<'a, const R: usize, const D: usize> {
    whitened: &'a BlockMatrix,
    /// The two bodies of each contact, the smaller number first.
    pairs: Vec<[u32; 2]>,
}

impl<'a, const R: usize, const D: usize> Factored<'a, R, D> {
    /// Take Ĵ, in blocks of D columns and at least R rows; None where a contact touches more than two bodies.
    pub fn new(whitened: &'a BlockMatrix) -> Option<Self> {
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
            pairs: pairs.collect::<Option<_>>()?,
        })
    }

    /// The blocks of contact i; a body named twice adds its blocks.
    fn sides(&self, i: usize) -> Sides<R, D> {
        let mut sides = [[[0.0; D]; R]; 2];
        for (body, values) in self.whitened.row(i) {
            let side = usize::from(self.pairs[i][0] as usize != body);
            for (sum, values) in sides[side].iter_mut().zip(values.as_chunks::<D>().0) {
                for (sum, value) in sum.iter_mut().zip(values) {
                    *sum += value;
                }
            }
        }
        sides
    }
}

impl<const R: usize, const D: usize> Delassus<R> for Factored<'_, R, D> {
    fn len(&self) -> usize {
        self.pairs.len()
    }

    fn diagonal_block(&self, i: usize) -> Matrix<R> {
        let [a, b] = &self.sides(i);
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
                movable.push(i as u32);
                contacts.push(contact);
            } else {
                let velocity = problem.target[i].map(|value| -value);
                let map =
                    law.natural_map(problem.friction[i], problem.scale[i], &[0.0; R], &velocity);
                locked += dot(&map, &map);
            }
        }
        let pairs: Vec<[u32; 2]> = movable.iter().map(|&i| self.pairs[i as usize]).collect();
        let mut sweeper = Abreast::<R, D, L>::new(law, self.len(), locked);
        let colours = coloured(&pairs);
        let visits = colours.iter().flatten().map(|batch| batch.contacts.len());
        sweeper.make_room(visits.sum());
        let mut slots = self.whitened.block_columns;
        for colour in colours {
            let first = sweeper.batches.len();
            for batch in colour {
                let start = sweeper.places.len();
                let mut bodies = batch.bodies;
                // What stands still has a state of its own in every lane, which stays zero.
                for body in bodies.iter_mut().flatten().filter(|body| **body == NONE) {
                    *body = slots as u32;
                    slots += 1;
                }
                for lanes in batch.contacts {
                    let visit = &mut sweeper.visits[sweeper.places.len()];
                    let mut numbers = [NONE; LANES];
                    let mut sides = [[[[0.0; D]; R]; 2]; LANES];
                    for lane in (0..LANES).filter(|&lane| lanes[lane] != NONE) {
                        let contact = lanes[lane] as usize;
                        numbers[lane] = movable[contact];
                        sides[lane] = self.sides(movable[contact] as usize);
                        visit.set(lane, &contacts[contact]);
                    }
                    let before = sweeper.places[start..].last().copied();
                    let place = laid_out(&mut sweeper.rows, &sides, &numbers, before);
                    sweeper.places.push(place);
                    sweeper.contacts.push(numbers);
                }
                sweeper.batches.push(Batch {
                    bodies,
                    visits: start..sweeper.places.len(),
                });
            }
            sweeper.end_colour(first);
        }
        sweeper.end(slots);
        sweeper
    }
}

/// Append the rows of a visit's contacts, `numbers` telling in which lanes there are any; `before` is the visit before in
/// the same groups.
fn laid_out<const R: usize, const D: usize>(
    rows: &mut Vec<Oct>,
    sides: &[Sides<R, D>; LANES],
    numbers: &[u32; LANES],
    before: Option<Place>,
) -> Place {
    let split = Place::forces(D);
    let shared = before.filter(|place| {
        let stored = &rows[place.forces as usize..][..2 * R * split];
        holds(stored, sides, numbers, split)
    });
    let forces = shared.map_or(rows.len() as u32, |place| place.forces);
    if shared.is_none() {
        append(rows, sides, numbers, 0..split);
    }
    let moments = rows.len() as u32;
    append(rows, sides, numbers, split..D);
    Place { forces, moments }
}

/// Whether the first columns of all blocks are what is stored.
fn holds<const R: usize, const D: usize>(
    stored: &[Oct],
    sides: &[Sides<R, D>; LANES],
    numbers: &[u32; LANES],
    columns: usize,
) -> bool {
    for lane in 0..LANES {
        if numbers[lane] == NONE {
            continue;
        }
        let lines = sides[lane].as_flattened().iter();
        for (line, octs) in lines.zip(stored.chunks_exact(columns)) {
            if octs
                .iter()
                .zip(line)
                .any(|(oct, value)| oct.0[lane] != *value)
            {
                return false;
            }
        }
    }
    true
}

/// Append some columns of all blocks.
fn append<const R: usize, const D: usize>(
    rows: &mut Vec<Oct>,
    sides: &[Sides<R, D>; LANES],
    numbers: &[u32; LANES],
    columns: Range<usize>,
) {
    let (begin, width) = (rows.len(), columns.len());
    rows.resize(begin + 2 * R * width, Oct::default());
    for lane in 0..LANES {
        if numbers[lane] == NONE {
            continue;
        }
        let entries = sides[lane]
            .as_flattened()
            .iter()
            .flat_map(|line| &line[columns.clone()]);
        for (oct, value) in rows[begin..].iter_mut().zip(entries) {
            oct.0[lane] = *value;
        }
    }
}
