//! Contacts that cannot become active: islands in which nothing closes, and contacts out of reach of all the others.
//!
//! # Islands in which nothing closes
//!
//! Without impulses u = −B. Where every −B_n ≥ 0 (for the convex law: every −B_n ≥ μ‖B_t‖) this satisfies Signorini's
//! condition and any law of friction with p = 0, so that p = 0 is a solution; the solvers, which begin there, find the same
//! one. One contact alone that separates proves nothing: the impulses of its neighbours may push it shut.
//!
//! # Contacts out of reach
//!
//! How far impulses can push it shut is bounded by energy. Let w = Ĵᵀ p be what the impulses of a solution add to the
//! whitened velocities, so that u = Ĵ w − B, and let c be any change of velocity that opens every contact:
//!
//! ```text
//! s_i = Ĵ_i c − B_i ∈ K*_i,     that is  s_n ≥ μ‖s_t‖,  or s_n ≥ 0 without friction.
//! ```
//!
//! *Theorem*: ‖w − c/2‖ ≤ ‖c‖/2, for the frictionless, the convex and Coulomb's law, whatever gaps and elasticity are in B.
//! *Proof*: by the law p·u = 0, or for Coulomb's p·u = −Σ μ p_n‖u_t‖ ≤ 0; hence ‖w‖² = p·A p = p·(u + B) ≤ p·B. Every p_i is
//! in its cone K_i and every s_i in the dual one, hence p·s ≥ 0 and p·B ≤ p·Ĵ c = w·c. So ‖w‖² ≤ w·c, which is the ball. ∎
//! (With c = −v of the bodies, a stop, the ball says that no impulse adds to their kinetic energy.)
//!
//! In that ball contact i opens with at least
//!
//! ```text
//! u_n ≥ ½ Ĵ_n c − B_n − ½‖Ĵ_n‖‖c‖.
//! ```
//!
//! *Theorem*: contacts at which this is positive (for the convex law: above μ times the bound ‖½ Ĵ_t c − B_t‖ + ½‖Ĵ_t‖‖c‖
//! on ‖u_t‖) may be left out. *Proof*: in every solution u_n > 0 (u in the interior of K*) there, hence p = 0, and the rest of
//! p solves the rest. Conversely c opens the contacts of the rest too, so that a solution of the rest lies in the same
//! ball, keeps the contacts left out apart and becomes a solution with p = 0 there. The solutions are the same. ∎
//! Energies of islands add up, so that each island has its own ball; one that falls apart without a contact left out is
//! tried again with smaller ones.
//!
//! Two changes c are proposed, and put to s ∈ K* as they are: a stop of all bodies where their velocities are known, which
//! opens all that touches without rebound; and else Ĵᵀ q of the impulses q that would do for each contact alone. Either is
//! multiplied by the least factor that opens all normals. Where none of this opens every contact, nothing is left out.

use crate::exact::Law;

use super::lift::{dot, size, within};
use super::local_bodies::LocalBodies;
use super::{Form, FreeMotion, ROUNDING, View};

/// Of what is reached, the part by which a contact must be beyond it: far above what rounding adds to the ball.
const BEYOND: f64 = 1e-9;

/// Whether no impulse solves these contacts.
pub fn nothing_closes(view: &View, contacts: &[u32]) -> bool {
    contacts.iter().all(|&contact| {
        let target = view.target(contact);
        let sliding = match view.law {
            Law::Cone => view.friction[contact as usize] * size(&target[1..]),
            Law::Normal | Law::Coulomb => 0.0,
        };
        -target[0] >= sliding
    })
}

/// A change of velocity c, seen from the contacts.
pub struct Reach {
    /// Ĵ c.
    opening: Vec<f64>,
    /// ‖c‖² of each body; where A is all there is, the share of each contact in it.
    squares: Vec<f64>,
}

impl Reach {
    /// A proposal for the whole system; None where no contact is apart by more than rounding, or where it cannot be made.
    pub fn of(view: &View) -> Option<Self> {
        let apart = -ROUNDING * view.largest;
        if !(0..view.contacts() as u32).any(|contact| view.target(contact)[0] < apart) {
            return None;
        }
        match view.form {
            Form::Impulse => Self::push_on_contacts(view),
            Form::Velocity => {
                let stop = view.free.and_then(|free| Self::stop(view, free));
                Some(stop.unwrap_or_else(|| Self::push_on_bodies(view)))
            }
        }
    }

    /// c = −L⁻¹ v: Ĵ c = −J v, and ‖c‖² = v·M v.
    fn stop(view: &View, free: &FreeMotion) -> Option<Self> {
        let View { rows, width, .. } = *view;
        let jacobian = view.jacobian?;
        let velocity = |body: u32| &free.velocity[body as usize * width..][..width];
        let mut opening = vec![0.0; view.b.len()];
        for contact in 0..view.contacts() as u32 {
            let places = view.places(contact);
            let lines = &mut opening[contact as usize * rows..][..rows];
            for (place, &body) in places.clone().zip(view.bodies_of(contact)) {
                for (row, value) in lines.iter_mut().enumerate() {
                    let line = &jacobian[(place * rows + row) * width..][..width];
                    *value -= dot(line, velocity(body));
                }
            }
        }
        let mut squares = Vec::with_capacity(view.bodies);
        let mut scratch = Vec::new();
        for (velocity, block) in free
            .velocity
            .chunks_exact(width)
            .zip(free.inverse_mass.chunks_exact(width * width))
        {
            squares.push(twice_kinetic_energy(block, velocity, &mut scratch)?);
        }
        Some(Self { opening, squares })
    }

    /// c = Ĵᵀ q.
    fn push_on_bodies(view: &View) -> Self {
        let View { rows, width, .. } = *view;
        let mut change = vec![0.0; view.bodies * width];
        for contact in 0..view.contacts() as u32 {
            let push = alone(view.target(contact)[0], squared_normal(view, contact));
            for (place, &body) in view.places(contact).zip(view.bodies_of(contact)) {
                let moved = &mut change[body as usize * width..][..width];
                for (sum, value) in moved.iter_mut().zip(view.row(place, 0)) {
                    *sum += push * value;
                }
            }
        }
        let mut opening = vec![0.0; view.b.len()];
        for contact in 0..view.contacts() as u32 {
            for (place, &body) in view.places(contact).zip(view.bodies_of(contact)) {
                let moved = &change[body as usize * width..][..width];
                for (row, value) in opening[contact as usize * rows..][..rows]
                    .iter_mut()
                    .enumerate()
                {
                    *value += dot(view.row(place, row), moved);
                }
            }
        }
        let squares = change.chunks_exact(width).map(|moved| dot(moved, moved));
        Self {
            opening,
            squares: squares.collect(),
        }
    }

    /// The same from A: Ĵ c = A q and ‖c‖² = q·A q; None where A is not symmetric, and energy means nothing.
    fn push_on_contacts(view: &View) -> Option<Self> {
        let rows = view.rows;
        let push = |contact: u32| alone(view.target(contact)[0], squared_normal(view, contact));
        let mut opening = vec![0.0; view.b.len()];
        let mut squares = vec![0.0; view.contacts()];
        for contact in 0..view.contacts() as u32 {
            for (place, &other) in view.places(contact).zip(view.bodies_of(contact)) {
                let mirrored = view.places(other).start
                    + view.bodies_of(other).binary_search(&contact).ok()?;
                for row in 0..rows {
                    for column in 0..rows {
                        let (one, two) = (
                            view.row(place, row)[column],
                            view.row(mirrored, column)[row],
                        );
                        if !within((one - two).abs(), ROUNDING * one.abs().max(two.abs())) {
                            return None;
                        }
                    }
                    opening[contact as usize * rows + row] += view.row(place, row)[0] * push(other);
                }
            }
            squares[contact as usize] = push(contact) * opening[contact as usize * rows];
        }
        Some(Self { opening, squares })
    }

    /// Leaves out the contacts of an island that are out of reach; `local` numbers its bodies.
    pub fn leave_out(&self, view: &View, contacts: &mut Vec<u32>, local: &LocalBodies) {
        let square: f64 = match view.form {
            Form::Velocity => local
                .bodies()
                .iter()
                .map(|&b| self.squares[b as usize])
                .sum(),
            Form::Impulse => contacts.iter().map(|&c| self.squares[c as usize]).sum(),
        };
        let Some(factor) = self.factor(view, contacts) else {
            return;
        };
        let radius = 0.5 * factor * square.max(0.0).sqrt();
        contacts.retain(|&contact| {
            let (target, opening) = (view.target(contact), self.opening(view, contact));
            let reached = (1.0 + BEYOND) * radius * squared_normal(view, contact).sqrt();
            let normal = 0.5 * factor * opening[0] - target[0] - reached;
            let sliding = if view.law == Law::Cone && view.has_friction(contact) {
                let middle = opening[1..].iter().zip(&target[1..]);
                let middle = middle
                    .map(|(r, b)| (0.5 * factor * r - b).powi(2))
                    .sum::<f64>();
                let reached = (1.0 + BEYOND) * radius * squared_tangents(view, contact).sqrt();
                view.friction[contact as usize] * (middle.sqrt() + reached)
            } else {
                0.0
            };
            normal.is_nan() || normal <= sliding + BEYOND * (target[0].abs() + reached)
        });
    }

    /// The factor by which c opens all contacts; None where there is none to be found.
    fn factor(&self, view: &View, contacts: &[u32]) -> Option<f64> {
        let least = contacts.iter().fold(0.0_f64, |least, &contact| {
            let closing = view.target(contact)[0];
            if closing > 0.0 {
                least.max(closing / self.opening(view, contact)[0].max(0.0))
            } else {
                least
            }
        });
        [least, 1.0].into_iter().find(|&factor| {
            factor.is_finite() && contacts.iter().all(|&c| self.opens(view, c, factor))
        })
    }

    /// Whether s = factor Ĵ c − B is in K*, to rounding.
    fn opens(&self, view: &View, contact: u32, factor: f64) -> bool {
        let (target, opening) = (view.target(contact), self.opening(view, contact));
        let left = opening.iter().zip(target).map(|(r, b)| factor * r - b);
        let mut left = left;
        let normal = left.next().expect("a contact has a normal");
        let sliding = if view.has_friction(contact) {
            view.friction[contact as usize] * left.map(|s| s * s).sum::<f64>().sqrt()
        } else {
            0.0
        };
        normal >= sliding - ROUNDING * view.largest
    }

    fn opening(&self, view: &View, contact: u32) -> &[f64] {
        &self.opening[contact as usize * view.rows..][..view.rows]
    }
}

/// The impulse that stops a contact on its own.
fn alone(closing: f64, square: f64) -> f64 {
    if closing > 0.0 && square > 0.0 {
        closing / square
    } else {
        0.0
    }
}

/// ‖Ĵ_n‖² = A_nn.
fn squared_normal(view: &View, contact: u32) -> f64 {
    squared_row(view, contact, 0)
}

/// At least ‖Ĵ_t‖².
fn squared_tangents(view: &View, contact: u32) -> f64 {
    (1..view.rows)
        .map(|row| squared_row(view, contact, row))
        .sum()
}

fn squared_row(view: &View, contact: u32, row: usize) -> f64 {
    let mut places = view.places(contact).zip(view.bodies_of(contact));
    match view.form {
        Form::Velocity => places
            .map(|(place, _)| dot(view.row(place, row), view.row(place, row)))
            .sum(),
        Form::Impulse => places
            .find(|&(_, &other)| other == contact)
            .map_or(0.0, |(place, _)| view.row(place, row)[row]),
    }
}

/// v·M v by factors M⁻¹ = L Lᵀ; None where M⁻¹ is singular and the body moves.
fn twice_kinetic_energy(
    inverse_mass: &[f64],
    velocity: &[f64],
    scratch: &mut Vec<f64>,
) -> Option<f64> {
    let n = velocity.len();
    if velocity.iter().all(|&v| v == 0.0) {
        return Some(0.0);
    }
    scratch.clear();
    scratch.extend_from_slice(inverse_mass);
    scratch.extend_from_slice(velocity);
    let (factor, solved) = scratch.split_at_mut(n * n);
    for i in 0..n {
        let (above, own) = factor.split_at_mut(i * n);
        let own = &mut own[..n];
        for j in 0..i {
            let row = &above[j * n..][..=j];
            own[j] = (own[j] - dot(&own[..j], &row[..j])) / row[j];
        }
        let entry = own[i] - dot(&own[..i], &own[..i]);
        if entry <= ROUNDING * inverse_mass[i * n + i] || entry.is_nan() {
            return None;
        }
        own[i] = entry.sqrt();
        solved[i] = (solved[i] - dot(&own[..i], &solved[..i])) / own[i];
    }
    Some(dot(solved, solved))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn energy_needs_every_direction_to_have_a_mass() {
        let free = twice_kinetic_energy(&[0.5, 0.0, 0.0, 0.25], &[3.0, 1.0], &mut Vec::new())
            .expect("regular");
        assert!((free - 22.0).abs() < 1e-14);
        assert_eq!(
            twice_kinetic_energy(&[0.5, 0.0, 0.0, 0.0], &[3.0, 1.0], &mut Vec::new()),
            None
        );
        assert_eq!(
            twice_kinetic_energy(&[0.0; 4], &[0.0; 2], &mut Vec::new()),
            Some(0.0)
        );
    }

    #[test]
    fn energy_follows_the_inverse_of_coupled_blocks() {
        // M = [[2, −1], [−1, 2]] / 3 is the inverse of [[2, 1], [1, 2]].
        let energy = twice_kinetic_energy(&[2.0, 1.0, 1.0, 2.0], &[1.0, 3.0], &mut Vec::new())
            .expect("regular");
        assert!((energy - 14.0 / 3.0).abs() < 1e-14);
    }
}
