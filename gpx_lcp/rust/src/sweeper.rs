//! The contacts as block Gauss-Seidel visits them: each with all that a visit reads and writes, side by side.

use std::marker::PhantomData;

use crate::contact::{Contact, Law, Step, local_step};
use crate::delassus::Delassus;
use crate::gauss_seidel::Problem;
use crate::lanes::Lanes;
use crate::small_matrix::{Vector, dot};

/// What acceleration remembers.
pub struct Momentum<const R: usize> {
    /// Where the last two sweeps started.
    before: Vec<Vector<R>>,
    direction: Vec<Vector<R>>,
    /// Σ d_i ‖g_i‖² of the last gradient; zero at the start.
    square: f64,
}

impl<const R: usize> Momentum<R> {
    pub fn new(start: &[Vector<R>]) -> Self {
        Self {
            before: start.to_vec(),
            direction: vec![[0.0; R]; start.len()],
            square: 0.0,
        }
    }
}

/// All that a sweep reads and writes of one contact, side by side.
struct Visited<const R: usize, Place, Local> {
    place: Place,
    impulse: Vector<R>,
    contact: Contact<R>,
    local: Local,
    /// Its number in the system.
    index: usize,
}

impl<const R: usize, Place: Copy, Local> Visited<R, Place, Local> {
    #[inline(always)]
    fn solve<A, L, V: Lanes, const RELAXED: bool>(
        &mut self,
        delassus: &mut A,
        law: &L,
        relaxation: f64,
    ) where
        A: Delassus<R, Place = Place>,
        L: Law<R, Local = Local>,
    {
        let Self {
            place,
            impulse,
            contact,
            local,
            ..
        } = self;
        let velocity = delassus.velocity::<V>(*place, &contact.free);
        let mut step = local_step(law, contact, local, impulse, &velocity);
        if RELAXED {
            let mut relaxed = *impulse;
            for r in 0..R {
                relaxed[r] += relaxation * step.change[r].first();
            }
            step = Step::to(law.project(contact.friction, &relaxed), impulse);
        }
        *impulse = step.impulse;
        delassus.add(*place, &step.change);
    }
}

/// One sweep, one residual, one extrapolation of block Gauss-Seidel, over contacts laid out for it.
pub struct Sweeper<'a, const R: usize, A: Delassus<R>, L: Law<R>, V> {
    delassus: &'a mut A,
    law: &'a L,
    problem: &'a Problem<'a, R>,
    /// The contacts that an impulse can move.
    contacts: Vec<Visited<R, A::Place, L::Local>>,
    /// Indices of the others; their impulses are zero.
    locked: Vec<usize>,
    lanes: PhantomData<V>,
}

impl<'a, const R: usize, A: Delassus<R>, L: Law<R>, V: Lanes> Sweeper<'a, R, A, L, V> {
    pub fn new(
        delassus: &'a mut A,
        law: &'a L,
        problem: &'a Problem<'a, R>,
        start: &[Vector<R>],
    ) -> Self {
        let mut contacts = Vec::with_capacity(start.len());
        let mut locked = Vec::new();
        for (index, p) in start.iter().enumerate() {
            let block = delassus.diagonal_block(index);
            if !(0..R).any(|r| block[r][r] > 0.0) {
                locked.push(index);
                continue;
            }
            let friction = problem.friction[index];
            let contact = Contact::new(
                &block,
                problem.target[index],
                friction,
                problem.scale[index],
            );
            contacts.push(Visited {
                place: delassus.place(index),
                impulse: if law.contains(friction, p) {
                    *p
                } else {
                    law.project(friction, p)
                },
                local: law.prepare(&contact),
                contact,
                index,
            });
        }
        Self {
            delassus,
            law,
            problem,
            contacts,
            locked,
            lanes: PhantomData,
        }
    }

    /// The impulses in the order of the system.
    pub fn impulse(&self) -> Vec<Vector<R>> {
        let mut impulse = vec![[0.0; R]; self.delassus.len()];
        for visited in &self.contacts {
            impulse[visited.index] = visited.impulse;
        }
        impulse
    }

    #[inline(always)]
    pub fn sweep<const RELAXED: bool>(&mut self, backward: bool, relaxation: f64) {
        if backward {
            for visited in self.contacts.iter_mut().rev() {
                visited.solve::<A, L, V, RELAXED>(self.delassus, self.law, relaxation);
            }
        } else {
            for visited in &mut self.contacts {
                visited.solve::<A, L, V, RELAXED>(self.delassus, self.law, relaxation);
            }
        }
    }

    /// Start the next two sweeps further along; the iterate may leave the cones until they have visited it.
    #[inline(always)]
    pub fn extrapolate(&mut self, momentum: &mut Momentum<R>) {
        let Momentum {
            before,
            direction,
            square,
        } = momentum;
        let mut length = 0.0;
        for visited in &self.contacts {
            let (p, start) = (&visited.impulse, &before[visited.index]);
            let gradient: Vector<R> = std::array::from_fn(|r| p[r] - start[r]);
            length += visited.contact.scale * dot(&gradient, &gradient);
        }
        let beta = if length <= *square && *square > 0.0 {
            length / *square
        } else {
            0.0
        };
        *square = length;
        for Visited {
            impulse: p, index, ..
        } in &mut self.contacts
        {
            let (start, d) = (&mut before[*index], &mut direction[*index]);
            for r in 0..R {
                let gradient = p[r] - start[r];
                let step = beta * d[r];
                p[r] += step;
                start[r] = p[r];
                d[r] = step + gradient;
            }
        }
        self.delassus.set::<V>(before);
    }

    #[inline(always)]
    fn velocity(&self, place: A::Place, free: &Vector<R>) -> Vector<R> {
        let lanes = self.delassus.velocity::<V>(place, free);
        let mut velocity = [0.0; R];
        for r in 0..R {
            velocity[r] = lanes[r].first();
        }
        velocity
    }

    /// The residual of the whole problem; also clears the rounding that the changes have left in w = Ĵᵀ p.
    #[inline(always)]
    pub fn residual(&mut self) -> f64 {
        self.delassus.set::<V>(&self.impulse());
        let law = self.law;
        let mut square = 0.0;
        for Visited {
            place,
            contact,
            impulse,
            ..
        } in &self.contacts
        {
            let velocity = self.velocity(*place, &contact.free);
            let map = law.natural_map(contact.friction, contact.scale, impulse, &velocity);
            square += dot(&map, &map);
        }
        let Problem {
            target,
            friction,
            scale,
            target_norm,
        } = *self.problem;
        for &i in &self.locked {
            let velocity = self.velocity(self.delassus.place(i), &target[i].map(|value| -value));
            let map = law.natural_map(friction[i], scale[i], &[0.0; R], &velocity);
            square += dot(&map, &map);
        }
        if square == 0.0 {
            0.0
        } else {
            square.sqrt() / target_norm
        }
    }
}
