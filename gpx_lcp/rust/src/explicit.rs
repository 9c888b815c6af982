//! Sweeps on A itself: every contact reads its row of A, one contact after the other in the order of the system.

use crate::contact::{Contact, Law};
use crate::delassus::{BlockRows, Delassus, Sweeper, contact};
use crate::gauss_seidel::Problem;
use crate::small_matrix::{Matrix, Vector, dot};
use crate::team::Team;

pub struct Explicit<const R: usize> {
    rows: BlockRows<R, R>,
}

impl<const R: usize> Explicit<R> {
    pub fn new(rows: BlockRows<R, R>) -> Self {
        Self { rows }
    }

    /// A_ii, as given.
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
}

impl<const R: usize> Delassus<R> for Explicit<R> {
    fn len(&self) -> usize {
        self.rows.len()
    }

    fn sweeper<'a, L: Law<R>>(
        &'a self,
        law: &'a L,
        problem: &'a Problem<'a, R>,
        start: &[Vector<R>],
        _team: &Team,
    ) -> impl Sweeper<R> + 'a {
        let mut impulse = vec![[0.0; R]; self.len()];
        let mut contacts = Vec::with_capacity(self.len());
        for (i, start) in start.iter().enumerate() {
            let block = self.diagonal_block(i);
            // An impulse that moves nothing is zero.
            if (0..R).any(|r| block[r][r] > 0.0) {
                let contact = contact(i, &block, law, problem, start);
                impulse[i] = contact.impulse;
                contacts.push(Row {
                    index: i,
                    contact,
                    local: L::Local::default(),
                });
            }
        }
        Rows {
            rows: &self.rows,
            law,
            problem,
            contacts,
            before: Vec::new(),
            impulse,
        }
    }
}

/// A contact that an impulse can move.
struct Row<const R: usize, Local> {
    index: usize,
    contact: Contact<f64, R>,
    local: Local,
}

struct Rows<'a, const R: usize, L: Law<R>> {
    rows: &'a BlockRows<R, R>,
    law: &'a L,
    problem: &'a Problem<'a, R>,
    contacts: Vec<Row<R, L::Local>>,
    /// By number in the system; zero where no impulse moves anything.
    impulse: Vec<Vector<R>>,
    /// p of the last sweep; empty before the first one with momentum.
    before: Vec<Vector<R>>,
}

impl<const R: usize, L: Law<R>> Rows<'_, R, L> {
    /// Returns d (p' - y)·(p' - p), of `Sweeper::sweep`; zero where p is not kept.
    #[inline(always)]
    fn visit(&mut self, k: usize, relaxation: f64) -> f64 {
        let Row {
            index,
            contact,
            local,
        } = &mut self.contacts[k];
        let velocity = velocity(self.rows, &self.impulse, *index, &contact.free);
        let local = std::slice::from_mut(local);
        let change = contact.visit::<L, f64>(self.law, local, &velocity, relaxation);
        self.impulse[*index] = contact.impulse;
        let Some(before) = self.before.get(*index) else {
            return 0.0;
        };
        let way = std::array::from_fn(|r| contact.impulse[r] - before[r]);
        contact.scale * dot(&change, &way)
    }
}

/// A_i p + `free`, m/s.
#[inline(always)]
fn velocity<const R: usize>(
    rows: &BlockRows<R, R>,
    impulse: &[Vector<R>],
    i: usize,
    free: &Vector<R>,
) -> Vector<R> {
    let mut sum = [[0.0; R]; R];
    for block in rows.row(i) {
        let x = &impulse[block.column];
        for r in 0..R {
            for c in 0..R {
                sum[r][c] += block.values[r][c] * x[c];
            }
        }
    }
    let mut velocity = *free;
    for r in 0..R {
        let mut total = sum[r][0];
        for c in 1..R {
            total += sum[r][c];
        }
        velocity[r] += total;
    }
    velocity
}

impl<const R: usize, L: Law<R>> Sweeper<R> for Rows<'_, R, L> {
    fn sweep(&mut self, _team: &Team, relaxation: f64, momentum: Option<f64>) -> f64 {
        if let Some(beta) = momentum {
            if self.before.is_empty() {
                self.before.clone_from(&self.impulse);
            }
            for Row { index, contact, .. } in &mut self.contacts {
                let (p, x) = (self.impulse[*index], &mut self.before[*index]);
                contact.impulse = std::array::from_fn(|r| p[r] + beta * (p[r] - x[r]));
                self.impulse[*index] = contact.impulse;
                *x = p;
            }
        }
        let mut sum = 0.0;
        for k in 0..self.contacts.len() {
            sum += self.visit(k, relaxation);
        }
        sum
    }

    fn residual(&mut self, _team: &Team) -> f64 {
        let Problem {
            target,
            friction,
            scale,
            ..
        } = *self.problem;
        let square = |i: usize| {
            let free = target[i].map(|value| -value);
            let velocity = velocity(self.rows, &self.impulse, i, &free);
            let map = self
                .law
                .natural_map(friction[i], scale[i], &self.impulse[i], &velocity);
            dot(&map, &map)
        };
        (0..self.rows.len()).map(square).sum::<f64>().sqrt()
    }

    fn impulse(&self) -> Vec<Vector<R>> {
        self.impulse.clone()
    }
}
