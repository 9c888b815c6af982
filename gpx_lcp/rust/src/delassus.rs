//! The Delassus matrix A as it is given, in block rows, and what a way of holding it must offer: sweeps.
//!
//! `Explicit` holds A itself. `Factored` holds the whitened Jacobian Ĵ (A = Ĵ Ĵᵀ) and keeps the body state w = Ĵᵀ p up to
//! date: a contact then costs the same however many others its bodies have, and A is never formed.

use crate::contact::{Contact, Law};
use crate::exact::BlockMatrix;
use crate::gauss_seidel::Problem;
use crate::small_matrix::{Matrix, Vector};
use crate::team::Team;

/// Block rows: row i owns blocks `start[i]..start[i + 1]`, each with R rows and C columns.
#[derive(Clone, Debug)]
pub struct BlockRows<const R: usize, const C: usize> {
    start: Vec<usize>,
    pub blocks: Vec<Block<R, C>>,
}

/// One block and its block column, side by side because they are always read together.
#[derive(Clone, Copy, Debug)]
pub struct Block<const R: usize, const C: usize> {
    pub values: [[f64; C]; R],
    pub column: usize,
}

impl<const R: usize, const C: usize> BlockRows<R, C> {
    /// The first R rows and C columns of each block of a matrix.
    pub fn of(matrix: &BlockMatrix) -> Self {
        let (width, area) = (matrix.width, matrix.height * matrix.width);
        let columns = matrix.columns.iter().map(|&column| column as usize);
        let blocks = columns.zip(matrix.values.chunks_exact(area));
        Self {
            start: matrix.starts.clone(),
            blocks: blocks
                .map(|(column, block)| Block {
                    values: std::array::from_fn(|r| std::array::from_fn(|c| block[r * width + c])),
                    column,
                })
                .collect(),
        }
    }

    pub fn len(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub fn row(&self, i: usize) -> &[Block<R, C>] {
        &self.blocks[self.start[i]..self.start[i + 1]]
    }
}

/// A way to hold A.
pub trait Delassus<const R: usize>: Sync {
    fn len(&self) -> usize;

    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Lay the contacts out for sweeps that start from the impulses `start`; the team takes part.
    fn sweeper<'a, L: Law<R>>(
        &'a self,
        law: &'a L,
        problem: &'a Problem<'a, R>,
        start: &[Vector<R>],
        team: &Team,
    ) -> impl Sweeper<R> + 'a;
}

/// A movable contact i of this block A_ii with its start impulse, brought to the law.
pub fn contact<const R: usize, L: Law<R>>(
    i: usize,
    block: &Matrix<R>,
    law: &L,
    problem: &Problem<R>,
    start: &Vector<R>,
) -> Contact<f64, R> {
    let friction = problem.friction[i];
    let mut contact = Contact::new(block, problem.target[i], friction, problem.scale[i]);
    contact.impulse = allowed(law, friction, start);
    contact
}

/// The impulse itself where the law allows it, or the nearest one that it allows.
pub fn allowed<const R: usize, L: Law<R>>(
    law: &L,
    friction: f64,
    impulse: &Vector<R>,
) -> Vector<R> {
    if law.contains(friction, impulse) {
        *impulse
    } else {
        law.project(friction, impulse)
    }
}

/// Contacts laid out for sweeps; a sweep visits each once.
pub trait Sweeper<const R: usize> {
    /// Take `relaxation` times the exact step at every contact, from y = p + β (p - x) with β the `momentum`, p the
    /// impulses now and x those before the last sweep with momentum, or p where this is the first; returns
    /// Σ d_i (p' - y)_i · (p' - p)_i, p' being those after it. Without momentum x is not kept, and nothing is summed.
    ///
    /// The law need not allow y: where the exact step leads does not depend on where the contact's own impulse was.
    fn sweep(&mut self, team: &Team, relaxation: f64, momentum: Option<f64>) -> f64;

    /// ‖d p - P(d p - û)‖, m/s, of the whole problem; also clears the rounding that the changes have left in w = Ĵᵀ p.
    fn residual(&mut self, team: &Team) -> f64;

    /// The impulses in the order of the system.
    fn impulse(&self) -> Vec<Vector<R>>;
}
