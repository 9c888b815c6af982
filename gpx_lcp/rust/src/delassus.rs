//! The Delassus matrix A as a sweep needs it: one contact's velocity A_i p, and the effect of changing one impulse.
//!
//! `Explicit` holds A itself in block rows. `Factored` holds the whitened Jacobian Ĵ (A = Ĵ Ĵᵀ) in block rows, one block
//! for each body that a contact touches, and keeps the body state w = Ĵᵀ p up to date: one row then costs the same
//! however many contacts the bodies have, and A is never formed.

use crate::lanes::{Lanes, Pair};
use crate::small_matrix::{Matrix, Vector, dot};

/// Block rows: row i owns blocks `start[i]..start[i + 1]`, each with R rows and C columns.
#[derive(Clone, Debug)]
pub struct BlockRows<const R: usize, const C: usize> {
    start: Vec<usize>,
    blocks: Vec<Block<R, C>>,
}

/// One block and its block column, side by side because they are always read together.
#[derive(Clone, Copy, Debug)]
struct Block<const R: usize, const C: usize> {
    values: [[f64; C]; R],
    column: usize,
}

/// The blocks of one row: from `first` to before `end`.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    first: usize,
    end: usize,
}

/// Why an array triple is no block matrix.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StructureError {
    #[error(
        "indptr must rise from 0 to the number of blocks {blocks}, but indptr[{at}] is {value}"
    )]
    Start {
        at: usize,
        value: i64,
        blocks: usize,
    },
    #[error("indices[{at}] is {value}, but there are {columns} block columns")]
    Column {
        at: usize,
        value: i64,
        columns: usize,
    },
    #[error("data holds {length} numbers, but {blocks} blocks of {rows} x {columns} need {needed}")]
    Data {
        length: usize,
        blocks: usize,
        rows: usize,
        columns: usize,
        needed: usize,
    },
}

impl<const R: usize, const C: usize> BlockRows<R, C> {
    /// Make block rows from the three arrays of SciPy's BSR format.
    pub fn new(
        start: &[i64],
        indices: &[i64],
        data: &[f64],
        columns: usize,
    ) -> Result<Self, StructureError> {
        let count = indices.len();
        if data.len() != count * R * C {
            return Err(StructureError::Data {
                length: data.len(),
                blocks: count,
                rows: R,
                columns: C,
                needed: count * R * C,
            });
        }
        let mut previous = 0;
        for (at, &value) in start.iter().enumerate() {
            let ends_right = at + 1 < start.len() || value == count as i64;
            if value < previous || value > count as i64 || (at == 0 && value != 0) || !ends_right {
                return Err(StructureError::Start {
                    at,
                    value,
                    blocks: count,
                });
            }
            previous = value;
        }
        let mut blocks = Vec::with_capacity(count);
        for (at, (&column, block)) in indices.iter().zip(data.chunks_exact(R * C)).enumerate() {
            if column < 0 || column >= columns as i64 {
                return Err(StructureError::Column {
                    at,
                    value: column,
                    columns,
                });
            }
            let values = std::array::from_fn(|r| std::array::from_fn(|c| block[r * C + c]));
            blocks.push(Block {
                values,
                column: column as usize,
            });
        }
        Ok(Self {
            start: start.iter().map(|&value| value as usize).collect(),
            blocks,
        })
    }

    pub fn len(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn span(&self, i: usize) -> Span {
        Span {
            first: self.start[i],
            end: self.start[i + 1],
        }
    }

    fn row(&self, i: usize) -> &[Block<R, C>] {
        &self.blocks[self.start[i]..self.start[i + 1]]
    }
}

/// Sum of the entries in the order that two-wide registers add them: odd and even entries apart.
#[inline(always)]
fn sum_in_pairs<const N: usize>(x: &[f64; N]) -> f64 {
    let mut lanes = [0.0; 2];
    for (k, value) in x.iter().enumerate() {
        lanes[k % 2] += value;
    }
    lanes[0] + lanes[1]
}

/// What a sweep asks of A. The impulse it refers to is the one last set, with every change since.
pub trait Delassus<const R: usize> {
    fn len(&self) -> usize;

    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A_ii, as given.
    fn diagonal_block(&self, i: usize) -> Matrix<R>;

    /// Where the blocks of a contact lie.
    type Place: Copy;

    fn place(&self, i: usize) -> Self::Place;

    fn set<V: Lanes>(&mut self, impulse: &[Vector<R>]);

    /// A_i p + `free`, m/s, each entry in all lanes.
    fn velocity<V: Lanes>(&self, place: Self::Place, free: &Vector<R>) -> [V; R];

    /// Add `change`, whose entries stand in all lanes, to the impulse of a contact.
    fn add<V: Lanes>(&mut self, place: Self::Place, change: &[V; R]);
}

pub struct Explicit<const R: usize> {
    rows: BlockRows<R, R>,
    impulse: Vec<Vector<R>>,
}

impl<const R: usize> Explicit<R> {
    pub fn new(rows: BlockRows<R, R>) -> Self {
        let impulse = vec![[0.0; R]; rows.len()];
        Self { rows, impulse }
    }
}

impl<const R: usize> Delassus<R> for Explicit<R> {
    fn len(&self) -> usize {
        self.rows.len()
    }

    fn diagonal_block(&self, i: usize) -> Matrix<R> {
        let mut sum = [[0.0; R]; R];
        for block in self.rows.row(i).iter().filter(|block| block.column == i) {
            for r in 0..R {
                for c in 0..R {
                    sum[r][c] += block.values[r][c];
                }
            }
        }
        sum
    }

    type Place = (usize, Span);

    fn place(&self, i: usize) -> (usize, Span) {
        (i, self.rows.span(i))
    }

    #[inline(always)]
    fn set<V: Lanes>(&mut self, impulse: &[Vector<R>]) {
        self.impulse.copy_from_slice(impulse);
    }

    #[inline(always)]
    fn velocity<V: Lanes>(&self, (_, span): (usize, Span), free: &Vector<R>) -> [V; R] {
        let mut sum = [[0.0; R]; R];
        for block in &self.rows.blocks[span.first..span.end] {
            let x = &self.impulse[block.column];
            for r in 0..R {
                for c in 0..R {
                    sum[r][c] += block.values[r][c] * x[c];
                }
            }
        }
        let mut velocity = [V::splat(0.0); R];
        for r in 0..R {
            velocity[r] = V::splat(sum_in_pairs(&sum[r]) + free[r]);
        }
        velocity
    }

    #[inline(always)]
    fn add<V: Lanes>(&mut self, (i, _): (usize, Span), change: &[V; R]) {
        for (value, step) in self.impulse[i].iter_mut().zip(change) {
            *value += step.first();
        }
    }
}

/// Ĵ and w, each row of a block and each body's state filled up with zeros to Q pairs.
pub struct Factored<const R: usize, const Q: usize> {
    start: Vec<usize>,
    blocks: Vec<PairBlock<R, Q>>,
    /// w = Ĵᵀ p, body by body, √kg m/s.
    state: Vec<[Pair; Q]>,
}

#[derive(Clone, Copy)]
struct PairBlock<const R: usize, const Q: usize> {
    values: [[Pair; Q]; R],
    column: usize,
}

impl<const R: usize, const Q: usize> Factored<R, Q> {
    /// Take the block rows of Ĵ, of bodies with at most 2 Q degrees of freedom.
    pub fn new<const D: usize>(rows: BlockRows<R, D>, bodies: usize) -> Self {
        const { assert!(D <= 2 * Q) };
        let padded = |block: &Block<R, D>| {
            let mut values = [[Pair::default(); Q]; R];
            for r in 0..R {
                for c in 0..D {
                    values[r][c / 2].0[c % 2] = block.values[r][c];
                }
            }
            PairBlock {
                values,
                column: block.column,
            }
        };
        Self {
            blocks: rows.blocks.iter().map(padded).collect(),
            start: rows.start,
            state: vec![[Pair::default(); Q]; bodies],
        }
    }
}

impl<const R: usize, const Q: usize> Delassus<R> for Factored<R, Q> {
    type Place = Span;

    fn len(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    fn place(&self, i: usize) -> Span {
        Span {
            first: self.start[i],
            end: self.start[i + 1],
        }
    }

    fn diagonal_block(&self, i: usize) -> Matrix<R> {
        let mut sum = [[0.0; R]; R];
        let own = &self.blocks[self.start[i]..self.start[i + 1]];
        // A body named twice in one row adds its blocks before they are squared.
        for block in own {
            for other in own.iter().filter(|other| other.column == block.column) {
                for r in 0..R {
                    for c in 0..R {
                        for (x, y) in block.values[r].iter().zip(&other.values[c]) {
                            sum[r][c] += dot(&x.0, &y.0);
                        }
                    }
                }
            }
        }
        sum
    }

    #[inline(always)]
    fn set<V: Lanes>(&mut self, impulse: &[Vector<R>]) {
        self.state.fill([Pair::default(); Q]);
        for (i, p) in impulse.iter().enumerate() {
            let mut change = [V::splat(0.0); R];
            for r in 0..R {
                change[r] = V::splat(p[r]);
            }
            self.add(self.place(i), &change);
        }
    }

    #[inline(always)]
    fn velocity<V: Lanes>(&self, span: Span, free: &Vector<R>) -> [V; R] {
        let mut sums = [[V::splat(0.0); Q]; R];
        for r in 0..R {
            sums[r][0] = V::lone(free[r]);
        }
        for block in &self.blocks[span.first..span.end] {
            let state = &self.state[block.column];
            for q in 0..Q {
                let x = V::load(&state[q]);
                for r in 0..R {
                    sums[r][q] = sums[r][q].plus_product(V::load(&block.values[r][q]), x);
                }
            }
        }
        let mut velocity = [V::splat(0.0); R];
        for r in 0..R {
            let mut total = sums[r][0];
            for q in 1..Q {
                total = total.plus(sums[r][q]);
            }
            velocity[r] = total.sum();
        }
        velocity
    }

    #[inline(always)]
    fn add<V: Lanes>(&mut self, span: Span, change: &[V; R]) {
        for block in &self.blocks[span.first..span.end] {
            let state = &mut self.state[block.column];
            for q in 0..Q {
                let mut x = V::load(&state[q]);
                for r in 0..R {
                    x = x.plus_product(V::load(&block.values[r][q]), change[r]);
                }
                x.store(&mut state[q]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Portable;

    /// Two contacts of one row: one on body 0 alone, one between bodies 0 and 1.
    fn factored() -> Factored<1, 1> {
        let rows = BlockRows::<1, 1>::new(&[0, 1, 3], &[0, 0, 1], &[1.0, -1.0, 2.0], 2).unwrap();
        Factored::new(rows, 2)
    }

    fn row(system: &impl Delassus<1>, i: usize) -> Vector<1> {
        let [velocity] = system.velocity::<Portable>(system.place(i), &[0.0]);
        [velocity.first()]
    }

    #[test]
    fn factored_rows_are_those_of_the_product() {
        let mut system = factored();
        system.set::<Portable>(&[[3.0], [5.0]]);
        // A = [1, -1; -1, 5]
        assert_eq!((row(&system, 0), row(&system, 1)), ([-2.0], [22.0]));
        assert_eq!(
            (system.diagonal_block(0), system.diagonal_block(1)),
            ([[1.0]], [[5.0]])
        );
        system.add(system.place(1), &[Portable::splat(1.0)]);
        assert_eq!((row(&system, 0), row(&system, 1)), ([-3.0], [27.0]));
    }

    #[test]
    fn explicit_rows_are_those_of_the_matrix() {
        let rows = BlockRows::new(&[0, 2, 4], &[0, 1, 0, 1], &[1.0, -1.0, -1.0, 5.0], 2).unwrap();
        let mut system = Explicit::<1>::new(rows);
        system.set::<Portable>(&[[3.0], [5.0]]);
        assert_eq!((row(&system, 0), row(&system, 1)), ([-2.0], [22.0]));
        assert_eq!(system.diagonal_block(1), [[5.0]]);
    }

    #[test]
    fn wrong_structure_is_refused() {
        let error = |start: &[i64], indices: &[i64], data: &[f64]| {
            BlockRows::<1, 1>::new(start, indices, data, 2).err()
        };
        assert_eq!(
            error(&[0, 1], &[2], &[1.0]),
            Some(StructureError::Column {
                at: 0,
                value: 2,
                columns: 2
            })
        );
        assert_eq!(
            error(&[0, 1], &[-1], &[1.0]),
            Some(StructureError::Column {
                at: 0,
                value: -1,
                columns: 2
            })
        );
        assert_eq!(
            error(&[0, 2], &[0], &[1.0]),
            Some(StructureError::Start {
                at: 1,
                value: 2,
                blocks: 1
            })
        );
        assert_eq!(
            error(&[1, 1], &[0], &[1.0]),
            Some(StructureError::Start {
                at: 0,
                value: 1,
                blocks: 1
            })
        );
        assert_eq!(
            error(&[0, 0], &[0], &[1.0]),
            Some(StructureError::Start {
                at: 1,
                value: 0,
                blocks: 1
            })
        );
        let short = Some(StructureError::Data {
            length: 1,
            blocks: 2,
            rows: 1,
            columns: 1,
            needed: 2,
        });
        assert_eq!(error(&[0, 2], &[0, 1], &[1.0]), short);
        assert!(BlockRows::<1, 1>::new(&[], &[], &[], 0).unwrap().is_empty());
    }
}
