//! One contact alone, also what is left of the collision of two bodies: solved by hand.
//!
//! u = A p − B with A of at most three rows has three cases, and the first that holds is the answer: open, p = 0; sticking,
//! p = A⁻¹ B; sliding, p on the cone with u_t against it, one equation for the angle (see `friction_cone`), solved to
//! rounding by a safeguarded Newton method. Without friction that is (1.2) of the founding paper, p = B_n / A_nn.

use crate::contact::{Contact, Law as Answer};
use crate::exact::Law;
use crate::friction_cone::{ConvexCone, Coulomb};
use crate::small_matrix::{Matrix, Vector, dot};

use super::Form;
use super::lift::Part;

/// What the closed form may leave of the residual; more, as for a block that is singular, is for the solvers.
const LEAVES: f64 = 1e-14;

/// The impulse of a part that is one contact, None where the closed form is not exact.
pub fn solve(part: &Part, law: Law) -> Option<Vec<f64>> {
    if part.friction.len() != 1 {
        return None;
    }
    match (part.rows, law) {
        (1, _) => answer::<1, _>(part, &ConvexCone, 0.0),
        (2, Law::Coulomb) => answer::<2, _>(part, &Coulomb, part.friction[0]),
        (2, _) => answer::<2, _>(part, &ConvexCone, part.friction[0]),
        (_, Law::Coulomb) => answer::<3, _>(part, &Coulomb, part.friction[0]),
        (_, _) => answer::<3, _>(part, &ConvexCone, part.friction[0]),
    }
}

fn answer<const R: usize, L: Answer<R>>(part: &Part, law: &L, friction: f64) -> Option<Vec<f64>> {
    let mut block: Matrix<R> = [[0.0; R]; R];
    let width = part.matrix.width;
    for values in part.matrix.values.chunks_exact(R * width) {
        for r in 0..R {
            for c in 0..R {
                let line = |row: usize| &values[row * width..][..width];
                block[r][c] += match part.form {
                    Form::Velocity => super::lift::dot(line(r), line(c)),
                    Form::Impulse => line(r)[c],
                };
            }
        }
    }
    let target: Vector<R> = part.b.as_slice().try_into().ok()?;
    let scale = (0..R).map(|r| block[r][r]).fold(0.0, f64::max);
    if scale == 0.0 {
        return None;
    }
    let mut contact = Contact::new(&block, target, friction, scale);
    let at =
        |p: &Vector<R>| -> Vector<R> { std::array::from_fn(|r| dot(&block[r], p) - target[r]) };
    let size = dot(&target, &target).sqrt();
    // The second visit takes out the rounding of the first.
    for _ in 0..2 {
        let velocity = at(&contact.impulse);
        contact.visit::<L, f64>(law, &mut [L::Local::default()], &velocity, 1.0);
    }
    let impulse = contact.impulse;
    let map = law.natural_map(friction, scale, &impulse, &at(&impulse));
    let residual = dot(&map, &map).sqrt() / size;
    (residual <= LEAVES).then(|| impulse.to_vec())
}
