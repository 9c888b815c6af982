//! One contact, or eight side by side: the own block of A, made safe to divide by, and what a law must answer about it.
//!
//! Block Gauss-Seidel changes one contact's impulse at a time. With the others held, its velocity is u = A_ii p + b, and
//! the law (which impulses are allowed, and when) makes that a problem of one to three unknowns, solved exactly.

use crate::lanes::{Lanes, Memory};
use crate::small_matrix::{Matrix, Vector, cholesky, dot, lower_inverse, times, transposed};

/// Smallest pivot of a diagonal block that is divided by, as a share of its largest diagonal entry.
const LEAST_PIVOT: f64 = 1e-9;

/// What a visit reads and writes of one contact (T = f64), or of eight.
///
/// In the order of use: a contact that sticks needs nothing from `stiffness` on.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Contact<T, const R: usize> {
    pub impulse: [T; R],
    /// -B_i, m/s: the velocity where no impulse acts.
    pub free: [T; R],
    /// Two symmetric matrices: `response` from the diagonal on, and A_ii below it.
    halves: [[T; R]; R],
    pub friction: T,
    /// The diagonal of A_ii.
    stiffness: [T; R],
    /// Unit vector along the friction of the last slide; zero before the first.
    pub heading: [T; 2],
    /// d_i, the largest diagonal entry of the whole A_ii (also of rows that a frictionless program leaves out), 1/kg.
    pub scale: T,
}

impl<const R: usize> Contact<f64, R> {
    /// Prepare a contact whose block has a positive diagonal entry; the largest is a below.
    ///
    /// The block is made symmetric and, where a pivot of its factorisation is below 1e-9 a, lifted by the smallest
    /// s a of s = 1e-8, 1e-7, ... that mends it. Neither moves a solution: a sweep only ever uses
    /// b = u - A_ii p with the true velocity u, so at a solution of the local problem that no longer changes p, u
    /// itself satisfies the law. What a lift does is turn the exact local step into a proximal one along the
    /// directions in which this contact alone cannot move anything.
    pub fn new(block: &Matrix<R>, target: Vector<R>, friction: f64, scale: f64) -> Self {
        let mut block: Matrix<R> =
            std::array::from_fn(|r| std::array::from_fn(|c| 0.5 * (block[r][c] + block[c][r])));
        let given = block;
        let largest = (0..R).map(|r| block[r][r]).fold(0.0, f64::max);
        let mut lift = 1e-8;
        let lower = loop {
            if let Some(lower) = cholesky(&block, LEAST_PIVOT * largest) {
                break lower;
            }
            // Ends: once the lift exceeds a row's sum every pivot is large, and no entry is infinite.
            for r in 0..R {
                block[r][r] = given[r][r] + lift * largest;
            }
            lift *= 10.0;
        };
        let half = transposed(&lower_inverse(&lower));
        let response: Matrix<R> =
            std::array::from_fn(|r| std::array::from_fn(|c| -dot(&half[r], &half[c])));
        let mut halves: Matrix<R> = response;
        for r in 0..R {
            halves[r][..r].copy_from_slice(&block[r][..r]);
        }
        Self {
            impulse: [0.0; R],
            free: target.map(|value| -value),
            halves,
            friction,
            stiffness: std::array::from_fn(|r| block[r][r]),
            heading: [0.0; 2],
            scale,
        }
    }

    /// A_ii, symmetric and positive definite, 1/kg.
    pub fn block(&self) -> Matrix<R> {
        std::array::from_fn(|r| std::array::from_fn(|c| *self.block_at(r, c)))
    }

    /// The impulse on the boundary of the allowed set that solves u = A_ii p + b, u being the velocity now.
    #[inline(never)]
    fn leave<L: Law<R>>(
        &mut self,
        law: &L,
        local: &mut L::Local,
        velocity: &Vector<R>,
    ) -> Vector<R> {
        let own = times(&self.block(), &self.impulse);
        let b: Vector<R> = std::array::from_fn(|r| velocity[r] - own[r]);
        let found = if R == 1 || self.friction == 0.0 {
            // What this contact alone needs to have no normal velocity, sliding without friction.
            let mut impulse = [0.0; R];
            impulse[0] = -b[0] / self.stiffness[0];
            Some(impulse)
        } else {
            law.slide(self, local, &b)
        };
        if let Some(found) = found
            && found.iter().all(|value| value.is_finite())
        {
            self.heading = direction(&found);
            return found;
        }
        let map = law.natural_map(self.friction, self.scale, &self.impulse, velocity);
        law.project(
            self.friction,
            &std::array::from_fn(|r| self.impulse[r] - map[r] / self.scale),
        )
    }
}

/// The unit vector along the friction; zero where there is none, or only one direction of it.
fn direction<const R: usize>(impulse: &Vector<R>) -> [f64; 2] {
    if R != 3 {
        return [0.0; 2];
    }
    let (x, y) = (impulse[1], impulse[2]);
    let length = (x * x + y * y).sqrt();
    if length > 0.0 {
        [x / length, y / length]
    } else {
        [0.0; 2]
    }
}

impl<T: Memory, const R: usize> Contact<T, R> {
    /// A contact that does nothing, in every lane.
    pub fn idle() -> Self {
        let zero = T::filled(0.0);
        Self {
            impulse: [zero; R],
            free: [zero; R],
            halves: [[zero; R]; R],
            friction: zero,
            stiffness: [T::filled(1.0); R],
            heading: [zero; 2],
            scale: T::filled(1.0),
        }
    }

    /// An entry of -A_ii⁻¹, kg: the change of impulse that a velocity asks for.
    #[inline(always)]
    fn response_at(&self, r: usize, c: usize) -> &T {
        &self.halves[r.min(c)][r.max(c)]
    }

    /// An entry of A_ii.
    #[inline(always)]
    pub fn block_at(&self, r: usize, c: usize) -> &T {
        if r == c {
            &self.stiffness[r]
        } else {
            &self.halves[r.max(c)][r.min(c)]
        }
    }

    pub fn set(&mut self, lane: usize, contact: &Contact<f64, R>) {
        for r in 0..R {
            self.impulse[r].set(lane, contact.impulse[r]);
            self.free[r].set(lane, contact.free[r]);
            for c in 0..R {
                self.halves[r][c].set(lane, contact.halves[r][c]);
            }
            self.stiffness[r].set(lane, contact.stiffness[r]);
        }
        self.friction.set(lane, contact.friction);
        self.heading[0].set(lane, contact.heading[0]);
        self.heading[1].set(lane, contact.heading[1]);
        self.scale.set(lane, contact.scale);
    }

    pub fn get(&self, lane: usize) -> Contact<f64, R> {
        let vector = |x: &[T; R]| -> Vector<R> { std::array::from_fn(|r| x[r].get(lane)) };
        Contact {
            impulse: vector(&self.impulse),
            free: vector(&self.free),
            halves: self.halves.map(|row| vector(&row)),
            friction: self.friction.get(lane),
            stiffness: vector(&self.stiffness),
            heading: self.heading.map(|entry| entry.get(lane)),
            scale: self.scale.get(lane),
        }
    }

    pub fn impulse_in(&self, lane: usize) -> Vector<R> {
        std::array::from_fn(|r| self.impulse[r].get(lane))
    }

    /// Solve the contact's problem where its velocity is `velocity` now, and take `relaxation` times the step; returns the
    /// change of the impulse.
    #[inline(always)]
    pub fn visit<L: Law<R>, V: Lanes<Memory = T>>(
        &mut self,
        law: &L,
        locals: &mut [L::Local],
        velocity: &[V; R],
        relaxation: f64,
    ) -> [V; R] {
        // A change of the old impulse rather than -A_ii⁻¹ b: near the solution u is small, and so is its rounding.
        let mut change = [V::splat(0.0); R];
        let mut impulse = change;
        for r in 0..R {
            change[r] = V::load(self.response_at(r, 0)) * velocity[0];
            for c in 1..R {
                let response = V::load(self.response_at(r, c));
                change[r] = change[r].plus_product(response, velocity[c]);
            }
            impulse[r] = V::load(&self.impulse[r]) + change[r];
        }
        let sticks = law.contains(V::load(&self.friction), &impulse);
        if !V::all(sticks) {
            self.leave_where(law, locals, velocity, sticks, &mut impulse, &mut change);
        }
        if relaxation != 1.0 {
            self.relax(law, relaxation, &mut impulse, &mut change);
        }
        for r in 0..R {
            impulse[r].store(&mut self.impulse[r]);
        }
        change
    }

    /// Replace the sticking impulse and its change in all lanes that do not stick.
    #[inline(always)]
    fn leave_where<L: Law<R>, V: Lanes<Memory = T>>(
        &mut self,
        law: &L,
        locals: &mut [L::Local],
        velocity: &[V; R],
        sticks: V::Mask,
        impulse: &mut [V; R],
        change: &mut [V; R],
    ) {
        let mut b = *velocity;
        let mut old = *velocity;
        for r in 0..R {
            old[r] = V::load(&self.impulse[r]);
        }
        for r in 0..R {
            for c in 0..R {
                b[r] = b[r].minus_product(V::load(self.block_at(r, c)), old[c]);
            }
        }
        let opens = law.separates(V::load(&self.friction), &b);
        let settled = V::bits(sticks) | V::bits(opens);
        let (mut found, follows) = law.slide_on(self, locals, &b, V::ALL & !settled);
        for r in 0..R {
            found[r] = found[r].replaced(opens, V::splat(0.0));
            found[r] = found[r].replaced(sticks, impulse[r]);
        }
        let known = settled | V::bits(follows);
        if known != V::ALL {
            let mut memory = [T::filled(0.0); R];
            let mut speeds = memory;
            for r in 0..R {
                found[r].store(&mut memory[r]);
                velocity[r].store(&mut speeds[r]);
            }
            for lane in V::HELD {
                if known >> lane & 1 == 0 {
                    self.leave_in(lane, law, &mut locals[lane], &speeds, &mut memory);
                }
            }
            for r in 0..R {
                found[r] = V::load(&memory[r]);
            }
        }
        for r in 0..R {
            change[r] = (found[r] - old[r]).replaced(sticks, change[r]);
            impulse[r] = found[r];
        }
    }

    #[inline(never)]
    fn leave_in<L: Law<R>>(
        &mut self,
        lane: usize,
        law: &L,
        local: &mut L::Local,
        velocity: &[T; R],
        found: &mut [T; R],
    ) {
        let mut contact = self.get(lane);
        let velocity = std::array::from_fn(|r| velocity[r].get(lane));
        let impulse = contact.leave(law, local, &velocity);
        for r in 0..R {
            found[r].set(lane, impulse[r]);
        }
        for k in 0..2 {
            self.heading[k].set(lane, contact.heading[k]);
        }
    }

    #[inline(always)]
    fn relax<L: Law<R>, V: Lanes<Memory = T>>(
        &self,
        law: &L,
        relaxation: f64,
        impulse: &mut [V; R],
        change: &mut [V; R],
    ) {
        let mut relaxed = self.impulse;
        for r in 0..R {
            let old = V::load(&self.impulse[r]);
            old.plus_product(V::splat(relaxation), change[r])
                .store(&mut relaxed[r]);
        }
        for lane in V::HELD {
            let inside = law.project(
                self.friction.get(lane),
                &std::array::from_fn(|r| relaxed[r].get(lane)),
            );
            for r in 0..R {
                relaxed[r].set(lane, inside[r]);
            }
        }
        for r in 0..R {
            impulse[r] = V::load(&relaxed[r]);
            change[r] = impulse[r] - V::load(&self.impulse[r]);
        }
    }
}

/// A law of contact: which impulses a contact may exert, and which velocities go with them.
pub trait Law<const R: usize>: Sync {
    /// What the law keeps of each contact for its sliding case: from one sweep to the next a root moves little.
    type Local: Default + Send;

    /// Whether the law allows an impulse.
    fn contains<V: Lanes>(&self, friction: V, impulse: &[V; R]) -> V::Mask;

    /// Whether p = 0 solves u = A_ii p + b.
    fn separates<V: Lanes>(&self, friction: V, b: &[V; R]) -> V::Mask;

    /// The impulse on the boundary of the allowed set that solves u = A_ii p + b; None where rounding or overflow
    /// leaves none. Called only where neither p = 0 nor u = 0 is a solution, and the friction is positive.
    fn slide(
        &self,
        contact: &Contact<f64, R>,
        local: &mut Self::Local,
        b: &Vector<R>,
    ) -> Option<Vector<R>>;

    /// What `slide` finds, or comes near, on the way from what was found last for this contact; and where that is certain.
    /// Of lanes that are not wanted, bit by bit, nothing is asked.
    ///
    /// As a rule one step is enough: from sweep to sweep a slide moves ever less, and this step leaves the square of that.
    fn slide_on<V: Lanes>(
        &self,
        contact: &mut Contact<V::Memory, R>,
        locals: &[Self::Local],
        b: &[V; R],
        wanted: u32,
    ) -> ([V; R], V::Mask);

    /// The nearest allowed impulse (for polygons: an allowed one with the same normal part, as near as can be).
    fn project(&self, friction: f64, impulse: &Vector<R>) -> Vector<R>;

    /// d p - P(d p - û), m/s: zero exactly where the impulse p and the velocity u satisfy the law.
    fn natural_map<V: Lanes>(
        &self,
        friction: V,
        scale: V,
        impulse: &[V; R],
        velocity: &[V; R],
    ) -> [V; R];
}

/// Random contacts for the tests of the laws.
#[cfg(test)]
pub mod samples {
    use super::{Contact, Law};
    use crate::small_matrix::{Matrix, Vector, dot};

    /// Uniform numbers in (-1, 1), by a linear congruential generator.
    pub struct Uniform(pub u64);

    impl Uniform {
        pub fn draw(&mut self) -> f64 {
            self.0 = self
                .0
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }

        pub fn vector<const R: usize>(&mut self) -> Vector<R> {
            std::array::from_fn(|_| self.draw())
        }

        /// G Gᵀ of a random G, with weakly coupled rows when `coupling` is small, of any size.
        pub fn block<const R: usize>(&mut self, coupling: f64) -> Matrix<R> {
            let mut factor: Matrix<R> = std::array::from_fn(|_| self.vector());
            for (r, row) in factor.iter_mut().enumerate() {
                row.iter_mut().for_each(|value| *value *= coupling);
                row[r] = 1.0 + 0.5 * self.draw();
            }
            let size = 10f64.powf(6.0 * self.draw());
            std::array::from_fn(|r| std::array::from_fn(|c| size * dot(&factor[r], &factor[c])))
        }
    }

    /// What the law leaves of a contact's residual after one exact step from a random impulse, relative to its velocities.
    pub fn residual_after_step<const R: usize, L: Law<R>>(
        law: &L,
        block: &Matrix<R>,
        friction: f64,
        random: &mut Uniform,
    ) -> f64 {
        let scale = (0..R).map(|r| block[r][r]).fold(0.0, f64::max);
        let mut contact = Contact::new(block, [0.0; R], friction, scale);
        let (b, old) = (
            random.vector::<R>(),
            random.vector::<R>().map(|value| value / scale),
        );
        let at = |p: &Vector<R>| -> Vector<R> { std::array::from_fn(|r| b[r] + dot(&block[r], p)) };
        contact.impulse = old;
        contact.visit::<L, f64>(law, &mut [L::Local::default()], &at(&old), 1.0);
        let map = law.natural_map(friction, scale, &contact.impulse, &at(&contact.impulse));
        let size = |x: &Vector<R>| dot(x, x).sqrt();
        size(&map) / (size(&b) + scale * size(&old))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::friction_cone::{ConvexCone, Coulomb};
    use crate::polygon::Polygon;
    use crate::small_matrix::Matrix;

    /// Steps from awkward blocks, by every law: none may be NaN, and each must be allowed.
    fn assert_finite_steps(block: &Matrix<3>) {
        fn check<L: Law<3>>(law: &L, block: &Matrix<3>) {
            for friction in [0.0, 1e-300, 1e-9, 0.5, 1.0, 1e9] {
                let mut contact = Contact::new(block, [0.0; 3], friction, 1.0);
                let mut local = [L::Local::default()];
                for velocity in [
                    [-1.0, 0.3, 0.2],
                    [0.0, 0.0, 0.0],
                    [-1e-300, 1e-300, 0.0],
                    [-1e150, 1e150, 1e100],
                ] {
                    contact.impulse = [0.1, 0.0, 0.0];
                    contact.visit::<L, f64>(law, &mut local, &velocity, 1.0);
                    assert!(
                        contact.impulse.iter().all(|value| value.is_finite()),
                        "{block:?} {friction}"
                    );
                    assert!(contact.impulse[0] >= 0.0);
                }
            }
        }
        check(&Coulomb, block);
        check(&ConvexCone, block);
        check(
            &Polygon::new(vec![
                [0.0, 1.0, 1.0],
                [0.0, -1.0, 1.0],
                [0.0, -1.0, -1.0],
                [0.0, 1.0, -1.0],
            ]),
            block,
        );
    }

    #[test]
    fn steps_are_finite_on_singular_indefinite_and_asymmetric_blocks() {
        assert_finite_steps(&[[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]);
        assert_finite_steps(&[[1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]);
        assert_finite_steps(&[[1.0, 0.0, 0.0], [0.0, -1e-8, 0.0], [0.0, 0.0, 1.0]]);
        assert_finite_steps(&[[1.0, 5.0, 0.0], [5.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_finite_steps(&[[1.0, 0.2, 0.0], [0.201, 1.0, 0.0], [0.0, 1e-3, 1.0]]);
        assert_finite_steps(&[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    }

    #[test]
    fn singular_block_still_sticks_where_it_can() {
        let mut contact = Contact::new(&[[1.0, 1.0], [1.0, 1.0]], [0.0; 2], 2.0, 1.0);
        contact.visit::<_, f64>(&Coulomb, &mut [None], &[-1.0; 2], 1.0);
        assert!((contact.impulse[0] + contact.impulse[1] - 1.0).abs() < 1e-7);
    }
}
