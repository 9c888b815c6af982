//! The Delassus matrix A as a sweep needs it: one contact's velocity A_i p, and the effect of changing one impulse.
//!
//! `Explicit` holds A itself in block rows. `Factored` holds the whitened Jacobian Ĵ (A = Ĵ Ĵᵀ) in block rows, one block
//! for each body that a contact touches, and keeps the body state w = Ĵᵀ p up to date: one row then costs the same
//! however many contacts the bodies have, and A is never formed.

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

    #[inline(always)]
    fn row(&self, i: usize) -> &[Block<R, C>] {
        &self.blocks[self.start[i]..self.start[i + 1]]
    }

    /// Σ over the blocks of row i of block · state[column].
    #[inline(always)]
    fn times_row(&self, i: usize, state: &[[f64; C]]) -> Vector<R> {
        let mut sum = [[0.0; C]; R];
        for block in self.row(i) {
            let x = &state[block.column];
            for r in 0..R {
                for c in 0..C {
                    sum[r][c] += block.values[r][c] * x[c];
                }
            }
        }
        std::array::from_fn(|r| sum_in_pairs(&sum[r]))
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

    fn set(&mut self, impulse: &[Vector<R>]);

    /// A_i p, m/s.
    fn row(&self, i: usize) -> Vector<R>;

    /// Add `change` to the impulse of contact i.
    fn add(&mut self, i: usize, change: &Vector<R>);
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

    fn set(&mut self, impulse: &[Vector<R>]) {
        self.impulse.copy_from_slice(impulse);
    }

    #[inline(always)]
    fn row(&self, i: usize) -> Vector<R> {
        self.rows.times_row(i, &self.impulse)
    }

    #[inline(always)]
    fn add(&mut self, i: usize, change: &Vector<R>) {
        for (value, step) in self.impulse[i].iter_mut().zip(change) {
            *value += step;
        }
    }
}

pub struct Factored<const R: usize, const D: usize> {
    rows: BlockRows<R, D>,
    /// w = Ĵᵀ p, body by body, √kg m/s.
    state: Vec<[f64; D]>,
}

impl<const R: usize, const D: usize> Factored<R, D> {
    pub fn new(rows: BlockRows<R, D>, bodies: usize) -> Self {
        Self {
            rows,
            state: vec![[0.0; D]; bodies],
        }
    }
}

impl<const R: usize, const D: usize> Delassus<R> for Factored<R, D> {
    fn len(&self) -> usize {
        self.rows.len()
    }

    fn diagonal_block(&self, i: usize) -> Matrix<R> {
        let mut sum = [[0.0; R]; R];
        // A body named twice in one row adds its blocks before they are squared.
        for block in self.rows.row(i) {
            for other in self
                .rows
                .row(i)
                .iter()
                .filter(|other| other.column == block.column)
            {
                for r in 0..R {
                    for c in 0..R {
                        sum[r][c] += dot(&block.values[r], &other.values[c]);
                    }
                }
            }
        }
        sum
    }

    fn set(&mut self, impulse: &[Vector<R>]) {
        self.state.fill([0.0; D]);
        for (i, p) in impulse.iter().enumerate() {
            self.add(i, p);
        }
    }

    #[inline(always)]
    fn row(&self, i: usize) -> Vector<R> {
        self.rows.times_row(i, &self.state)
    }

    #[inline(always)]
    fn add(&mut self, i: usize, change: &Vector<R>) {
        let Self { rows, state } = self;
        for block in rows.row(i) {
            let mut sum = [0.0; D];
            for r in 0..R {
                for c in 0..D {
                    sum[c] += block.values[r][c] * change[r];
                }
            }
            for (entry, value) in state[block.column].iter_mut().zip(&sum) {
                *entry += value;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two contacts of one row: one on body 0 alone, one between bodies 0 and 1.
    fn factored() -> Factored<1, 1> {
        let rows = BlockRows::new(&[0, 1, 3], &[0, 0, 1], &[1.0, -1.0, 2.0], 2).unwrap();
        Factored::new(rows, 2)
    }

    #[test]
    fn factored_rows_are_those_of_the_product() {
        let mut system = factored();
        system.set(&[[3.0], [5.0]]);
        // A = [1, -1; -1, 5]
        assert_eq!((system.row(0), system.row(1)), ([-2.0], [22.0]));
        assert_eq!(
            (system.diagonal_block(0), system.diagonal_block(1)),
            ([[1.0]], [[5.0]])
        );
        system.add(1, &[1.0]);
        assert_eq!((system.row(0), system.row(1)), ([-3.0], [27.0]));
    }

    #[test]
    fn explicit_rows_are_those_of_the_matrix() {
        let rows = BlockRows::new(&[0, 2, 4], &[0, 1, 0, 1], &[1.0, -1.0, -1.0, 5.0], 2).unwrap();
        let mut system = Explicit::<1>::new(rows);
        system.set(&[[3.0], [5.0]]);
        assert_eq!((system.row(0), system.row(1)), ([-2.0], [22.0]));
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
