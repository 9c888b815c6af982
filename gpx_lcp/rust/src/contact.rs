//! One contact: its own block of A, made safe to divide by, and what a law of contact must answer about it.
//!
//! Block Gauss-Seidel changes one contact's impulse at a time. With the others held, its velocity is u = A_ii p + b, and
//! the law (which impulses are allowed, and when) makes that a problem of one to three unknowns, solved exactly.

use crate::lanes::Lanes;
use crate::small_matrix::{Matrix, Vector, cholesky, dot, lower_inverse, times, transposed};

/// Smallest pivot of a diagonal block that is divided by, as a share of its largest diagonal entry.
const LEAST_PIVOT: f64 = 1e-9;

/// What stays the same of one contact during all sweeps.
#[derive(Clone, Copy, Debug)]
pub struct Contact<const R: usize> {
    /// -B_i, m/s: the velocity where no impulse acts.
    pub free: Vector<R>,
    pub friction: f64,
    /// d_i, the largest diagonal entry of the whole A_ii (also of rows that a frictionless program leaves out), 1/kg.
    pub scale: f64,
    /// A_ii, symmetric and positive definite, 1/kg.
    pub block: Matrix<R>,
    /// -A_ii⁻¹, kg: the change of impulse that a velocity asks for.
    pub response: Matrix<R>,
}

impl<const R: usize> Contact<R> {
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
        let response = std::array::from_fn(|r| std::array::from_fn(|c| -dot(&half[r], &half[c])));
        Self {
            free: target.map(|value| -value),
            friction,
            scale,
            block,
            response,
        }
    }

    /// b = u - A_ii p, the velocity that the contact would have without its impulse.
    #[inline(always)]
    pub fn velocity_without(&self, impulse: &Vector<R>, velocity: &Vector<R>) -> Vector<R> {
        let own = times(&self.block, impulse);
        std::array::from_fn(|r| velocity[r] - own[r])
    }

    /// b_n of it.
    #[inline(always)]
    pub fn normal_velocity_without(&self, impulse: &Vector<R>, velocity: &Vector<R>) -> f64 {
        velocity[0] - dot(&self.block[0], impulse)
    }

    /// The impulse that this contact alone needs to have no normal velocity, sliding without friction.
    #[inline]
    pub fn frictionless(&self, b: &Vector<R>) -> Vector<R> {
        let mut impulse = [0.0; R];
        impulse[0] = -b[0] / self.block[0][0];
        impulse
    }
}

/// A law of contact: which impulses a contact may exert, and which velocities go with them.
pub trait Law<const R: usize>: Sync {
    /// What the law precomputes of each contact for its sliding case, and where its last root was found: from one sweep
    /// to the next a root moves little.
    type Local: Send;

    fn prepare(&self, contact: &Contact<R>) -> Self::Local;

    /// Whether p = 0 solves the problem of a contact that has this impulse and this velocity now.
    fn separates(&self, contact: &Contact<R>, impulse: &Vector<R>, velocity: &Vector<R>) -> bool;

    /// Whether the law allows an impulse.
    fn contains(&self, friction: f64, impulse: &Vector<R>) -> bool;

    /// The impulse on the boundary of the allowed set that solves u = A_ii p + b; None where rounding or overflow
    /// leaves none. Called only where neither p = 0 nor u = 0 is a solution, and the friction is positive.
    fn slide(
        &self,
        contact: &Contact<R>,
        local: &mut Self::Local,
        b: &Vector<R>,
    ) -> Option<Vector<R>>;

    /// What `slide` finds, if it is near what it found last for this contact; None where that is not certain.
    ///
    /// One step towards it is enough: from sweep to sweep it moves ever less, and this step leaves the square of that.
    fn slide_on(
        &self,
        contact: &Contact<R>,
        local: &mut Self::Local,
        b: &Vector<R>,
    ) -> Option<Vector<R>>;

    /// The nearest allowed impulse (for polygons: an allowed one with the same normal part, as near as can be).
    fn project(&self, friction: f64, impulse: &Vector<R>) -> Vector<R>;

    /// d p - P(d p - û), m/s: zero exactly where the impulse p and the velocity u satisfy the law.
    fn natural_map(
        &self,
        friction: f64,
        scale: f64,
        impulse: &Vector<R>,
        velocity: &Vector<R>,
    ) -> Vector<R>;
}

/// A contact's impulse after a step, and its change: both, because neither follows from the other without rounding.
pub struct Step<const R: usize, V> {
    pub impulse: Vector<R>,
    /// Each entry in all lanes.
    pub change: [V; R],
}

impl<const R: usize, V: Lanes> Step<R, V> {
    #[inline(always)]
    pub fn to(impulse: Vector<R>, old: &Vector<R>) -> Self {
        let mut change = [V::splat(0.0); R];
        for r in 0..R {
            change[r] = V::splat(impulse[r] - old[r]);
        }
        Self { impulse, change }
    }
}

/// Solve the problem of one contact, given its impulse and its velocity u = A_ii p + b now (each entry in all lanes).
#[inline(always)]
pub fn local_step<const R: usize, L: Law<R>, V: Lanes>(
    law: &L,
    contact: &Contact<R>,
    local: &mut L::Local,
    impulse: &Vector<R>,
    velocity: &[V; R],
) -> Step<R, V> {
    // A change of the old impulse rather than -A_ii⁻¹ b: near the solution u is small, and so is its rounding.
    let mut change = [V::splat(0.0); R];
    let (mut sticking, mut u) = (*impulse, [0.0; R]);
    for r in 0..R {
        change[r] = V::splat(contact.response[r][0]).times(velocity[0]);
        for c in 1..R {
            change[r] = change[r].plus_product(V::splat(contact.response[r][c]), velocity[c]);
        }
        sticking[r] += change[r].first();
        u[r] = velocity[r].first();
    }
    if law.separates(contact, impulse, &u) {
        return Step::to([0.0; R], impulse);
    }
    if law.contains(contact.friction, &sticking) {
        return Step {
            impulse: sticking,
            change,
        };
    }
    Step::to(
        leave_interior(law, contact, local, impulse, *velocity),
        impulse,
    )
}

/// Not inlined, and given the velocity by value, so that contacts which stick do not prepare for it.
#[inline(never)]
fn leave_interior<const R: usize, L: Law<R>, V: Lanes>(
    law: &L,
    contact: &Contact<R>,
    local: &mut L::Local,
    impulse: &Vector<R>,
    velocity: [V; R],
) -> Vector<R> {
    let velocity = velocity.map(V::first);
    let b = contact.velocity_without(impulse, &velocity);
    if R == 1 || contact.friction == 0.0 {
        let found = contact.frictionless(&b);
        if found[0].is_finite() {
            return found;
        }
    } else {
        if let Some(found) = law.slide_on(contact, local, &b) {
            return found;
        }
        if let Some(found) = law.slide(contact, local, &b)
            && found.iter().all(|value| value.is_finite())
        {
            return found;
        }
    }
    let map = law.natural_map(contact.friction, contact.scale, impulse, &velocity);
    law.project(
        contact.friction,
        &std::array::from_fn(|r| impulse[r] - map[r] / contact.scale),
    )
}

/// Random contacts for the tests of the laws.
#[cfg(test)]
pub mod samples {
    use super::{Contact, Law, local_step};
    use crate::lanes::{Lanes, Portable};
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
        let contact = Contact::new(block, [0.0; R], friction, scale);
        let (b, old) = (
            random.vector::<R>(),
            random.vector::<R>().map(|value| value / scale),
        );
        let at = |p: &Vector<R>| -> Vector<R> { std::array::from_fn(|r| b[r] + dot(&block[r], p)) };
        let velocity = at(&old).map(Portable::splat);
        let step = local_step(law, &contact, &mut law.prepare(&contact), &old, &velocity);
        let map = law.natural_map(friction, scale, &step.impulse, &at(&step.impulse));
        let size = |x: &Vector<R>| dot(x, x).sqrt();
        size(&map) / (size(&b) + scale * size(&old))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::friction_cone::{ConvexCone, Coulomb};
    use crate::lanes::Portable;
    use crate::polygon::Polygon;
    use crate::small_matrix::Matrix;

    /// Steps from awkward blocks, by every law: none may be NaN, and each must be allowed.
    fn assert_finite_steps(block: &Matrix<3>) {
        fn check<L: Law<3>>(law: &L, block: &Matrix<3>) {
            for friction in [0.0, 1e-300, 1e-9, 0.5, 1.0, 1e9] {
                let contact = Contact::new(block, [0.0; 3], friction, 1.0);
                let mut local = law.prepare(&contact);
                for velocity in [
                    [-1.0, 0.3, 0.2],
                    [0.0, 0.0, 0.0],
                    [-1e-300, 1e-300, 0.0],
                    [-1e150, 1e150, 1e100],
                ] {
                    let velocity = velocity.map(Portable::splat);
                    let step = local_step(law, &contact, &mut local, &[0.1, 0.0, 0.0], &velocity);
                    assert!(
                        step.impulse.iter().all(|value| value.is_finite()),
                        "{block:?} {friction}"
                    );
                    assert!(step.impulse[0] >= 0.0);
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
        let contact = Contact::new(&[[1.0, 1.0], [1.0, 1.0]], [0.0; 2], 2.0, 1.0);
        let step = local_step(
            &Coulomb,
            &contact,
            &mut Coulomb.prepare(&contact),
            &[0.0; 2],
            &[Portable::splat(-1.0); 2],
        );
        assert!((step.impulse[0] + step.impulse[1] - 1.0).abs() < 1e-7);
    }
}
