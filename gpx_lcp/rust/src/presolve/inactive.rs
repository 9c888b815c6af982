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

use std::borrow::Cow;

use crate::exact::Law;

use super::lift::{dot, size, within};
use super::local_bodies::LocalBodies;
use super::{Form, FreeMotion, ROUNDING, View};

/// Of what is reached, the part by which a contact must be beyond it: far above what rounding adds to the ball.
const BEYOND: f64 = 1e-9;

/// Whether any contact is apart by more than rounding: B, rows of it per contact, and its largest entry.
pub fn any_apart(b: &[f64], rows: usize, largest: f64) -> bool {
    b.iter().step_by(rows).any(|b| *b < -ROUNDING * largest)
}

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
pub struct Reach<'a> {
    view: &'a View<'a>,
    change: Change<'a>,
    /// ‖c‖² of each body; where A is all there is, the share of each contact in it.
    squares: Cow<'a, [f64]>,
}

/// Where c comes from.
enum Change<'a> {
    /// c = −L⁻¹ v: Ĵ c = −J v, and ‖c‖² = v·M v. Blocks of J, and v.
    Stop(&'a [f64], &'a [f64]),
    /// c itself.
    OfBodies(Vec<f64>),
    /// c = Ĵᵀ q, of which there is q alone: Ĵ c = A q.
    OfContacts(Vec<f64>),
}

impl<'a> Reach<'a> {
    /// A proposal for the whole system; None where no contact is apart by more than rounding, or where it cannot be made.
    pub fn of(view: &'a View<'a>) -> Option<Self> {
        if !any_apart(view.b, view.rows, view.largest) {
            return None;
        }
        let (change, squares) = match view.form {
            Form::Impulse => push_on_contacts(view)?,
            Form::Velocity => match (view.jacobian, view.free) {
                (Some(jacobian), Some(free)) => (
                    Change::Stop(jacobian, &free.velocity),
                    Cow::Borrowed(free.energies.as_slice()),
                ),
                _ => push_on_bodies(view),
            },
        };
        Some(Self {
            view,
            change,
            squares,
        })
    }

    /// A row of Ĵ c.
    #[inline(always)]
    fn opening(&self, contact: u32, row: usize) -> f64 {
        let View { rows, width, .. } = *self.view;
        let view = self.view;
        let places = view.places(contact).zip(view.bodies_of(contact));
        match &self.change {
            Change::Stop(jacobian, velocity) => places.fold(0.0, |sum, (place, &body)| {
                let line = &jacobian[(place * rows + row) * width..][..width];
                sum - dot(line, &velocity[body as usize * width..][..width])
            }),
            Change::OfBodies(change) => places.fold(0.0, |sum, (place, &body)| {
                let moved = &change[body as usize * width..][..width];
                sum + dot(view.row(place, row), moved)
            }),
            Change::OfContacts(pushes) => places.fold(0.0, |sum, (place, &other)| {
                sum + view.row(place, row)[0] * pushes[other as usize]
            }),
        }
    }

    /// Its tangential rows, each with the same one of B.
    fn sliding(&self, contact: u32) -> impl Iterator<Item = (f64, f64)> {
        let tangents = self.view.target(contact).iter().enumerate().skip(1);
        tangents.map(move |(row, b)| (self.opening(contact, row), *b))
    }

    /// Leaves out the contacts of an island that are out of reach; `local` numbers its bodies.
    pub fn leave_out(&self, contacts: &mut Vec<u32>, local: &LocalBodies) {
        let view = self.view;
        let members = match view.form {
            Form::Velocity => local.bodies(),
            Form::Impulse => contacts.as_slice(),
        };
        let square: f64 = members.iter().map(|&k| self.squares[k as usize]).sum();
        let radius = 0.5 * square.max(0.0).sqrt();
        // How far a contact is beyond what the impulses reach, and that, by the normal alone.
        let beyond = |contact: u32, normal: f64, factor: f64| {
            let reached = (1.0 + BEYOND) * factor * radius * squared_normal(view, contact).sqrt();
            let middle = 0.5 * factor * normal;
            (middle - view.target(contact)[0] - reached, reached)
        };
        // A ball that is larger reaches further: what is within reach of the smallest is within that of any other, and the
        // one that opens the contact that closes fastest is no larger than the one that opens all.
        let apart = |contact: u32, factor: f64| {
            let normal = || self.opening(contact, 0);
            view.target(contact)[0] < 0.0 && !within(beyond(contact, normal(), factor).0, 0.0)
        };
        let closing = |&contact: &u32| view.target(contact)[0];
        let fastest = contacts.iter().copied();
        let fastest = fastest.max_by(|one, other| closing(one).total_cmp(&closing(other)));
        let least = fastest.map_or(0.0, |contact| {
            self.least_of(contact, self.opening(contact, 0))
        });
        if !contacts.iter().any(|&contact| apart(contact, least)) {
            return;
        }
        let normals: Vec<f64> = contacts.iter().map(|&k| self.opening(k, 0)).collect();
        let each = || contacts.iter().copied().zip(normals.iter().copied());
        let least = each().fold(0.0_f64, |least, (contact, normal)| {
            least.max(self.least_of(contact, normal))
        });
        if !contacts.iter().any(|&contact| apart(contact, least)) {
            return;
        }
        let opens_all = |&factor: &f64| {
            factor.is_finite()
                && each().all(|(contact, normal)| self.opens(contact, normal, factor))
        };
        let Some(factor) = [least, 1.0].into_iter().find(opens_all) else {
            return;
        };
        let mut normals = normals.into_iter();
        contacts.retain(|&contact| {
            let normal = normals.next().expect("one of each contact");
            // ½ Ĵ_n c is within what is reached.
            if view.target(contact)[0] >= 0.0 {
                return true;
            }
            let (normal, reached) = beyond(contact, normal, factor);
            let sliding = if view.law == Law::Cone && view.has_friction(contact) {
                let middle = self.sliding(contact);
                let middle = middle
                    .map(|(r, b)| (0.5 * factor * r - b).powi(2))
                    .sum::<f64>();
                let reached =
                    (1.0 + BEYOND) * factor * radius * squared_tangents(view, contact).sqrt();
                view.friction[contact as usize] * (middle.sqrt() + reached)
            } else {
                0.0
            };
            let target = view.target(contact)[0].abs();
            normal.is_nan() || normal <= sliding + BEYOND * (target + reached)
        });
    }

    /// The least factor by which c opens the normal of a contact, whose row of Ĵ c it gets; infinity where there is none.
    fn least_of(&self, contact: u32, normal: f64) -> f64 {
        let closing = self.view.target(contact)[0];
        if closing > 0.0 {
            closing / normal.max(0.0)
        } else {
            0.0
        }
    }

    /// Whether s = factor Ĵ c − B is in K*, to rounding.
    fn opens(&self, contact: u32, normal: f64, factor: f64) -> bool {
        let view = self.view;
        let normal = factor * normal - view.target(contact)[0];
        let sliding = if view.has_friction(contact) {
            let left = self.sliding(contact).map(|(r, b)| factor * r - b);
            view.friction[contact as usize] * left.map(|s| s * s).sum::<f64>().sqrt()
        } else {
            0.0
        };
        normal >= sliding - ROUNDING * view.largest
    }
}

/// c = Ĵᵀ q, and ‖c‖² body by body.
fn push_on_bodies<'a>(view: &View) -> (Change<'a>, Cow<'a, [f64]>) {
    let width = view.width;
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
    let squares = change.chunks_exact(width).map(|moved| dot(moved, moved));
    let squares = squares.collect();
    (Change::OfBodies(change), Cow::Owned(squares))
}

/// The same from A: ‖c‖² = q·A q; None where A is not symmetric, and energy means nothing.
fn push_on_contacts<'a>(view: &View) -> Option<(Change<'a>, Cow<'a, [f64]>)> {
    let rows = view.rows;
    let push = |contact: u32| alone(view.target(contact)[0], squared_normal(view, contact));
    let pushes: Vec<f64> = (0..view.contacts() as u32).map(push).collect();
    let mut squares = vec![0.0; view.contacts()];
    for contact in 0..view.contacts() as u32 {
        let mut opening = 0.0;
        for (place, &other) in view.places(contact).zip(view.bodies_of(contact)) {
            let mirrored =
                view.places(other).start + view.bodies_of(other).binary_search(&contact).ok()?;
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
            }
            opening += view.row(place, 0)[0] * pushes[other as usize];
        }
        squares[contact as usize] = pushes[contact as usize] * opening;
    }
    Some((Change::OfContacts(pushes), Cow::Owned(squares)))
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

impl FreeMotion {
    /// Of bodies with these velocities, width numbers each, and these M⁻¹, in blocks of width × width; None where one is
    /// singular and its body moves.
    pub fn of<Block: AsRef<[f64]>>(
        velocity: Vec<f64>,
        width: usize,
        inverse_masses: impl Iterator<Item = Block>,
    ) -> Option<Self> {
        let bodies = velocity.chunks_exact(width).zip(inverse_masses);
        let energies = bodies
            .map(|(velocity, inverse_mass)| twice_kinetic_energy(inverse_mass.as_ref(), velocity));
        Some(Self {
            energies: energies.collect::<Option<_>>()?,
            velocity,
        })
    }
}

/// v·M v; None where M⁻¹ is singular and the body moves.
fn twice_kinetic_energy(inverse_mass: &[f64], velocity: &[f64]) -> Option<f64> {
    let width = velocity.len();
    let entry = |row: usize, column: usize| inverse_mass[row * width + column];
    if velocity.iter().all(|&v| v == 0.0) {
        return Some(0.0);
    }
    if width == 6 && (3..6).all(|row| (0..3).all(|column| entry(row, column) == 0.0)) {
        // Translation and rotation, each for itself.
        let (linear, angular) = velocity.split_at(3);
        let translation = by_factors(3, entry, linear, &mut [0.0; 12])?;
        if angular.iter().all(|&w| w == 0.0) {
            return Some(translation);
        }
        let turn = |row: usize, column: usize| entry(row + 3, column + 3);
        return Some(translation + by_factors(3, turn, angular, &mut [0.0; 12])?);
    }
    let mut scratch = vec![0.0; width * (width + 1)];
    by_factors(width, entry, velocity, &mut scratch)
}

/// v·A⁻¹ v by factors A = L D Lᵀ of n rows, in a scratch of n (n + 1) zeros.
#[inline(always)]
fn by_factors(
    n: usize,
    entry: impl Fn(usize, usize) -> f64,
    velocity: &[f64],
    scratch: &mut [f64],
) -> Option<f64> {
    // L, and L⁻¹ v divided by D.
    let (factor, solved) = scratch.split_at_mut(n * n);
    let mut square = 0.0;
    for i in 0..n {
        let (above, own) = factor.split_at_mut(i * n);
        let own = &mut own[..n];
        let (mut pivot, mut left) = (entry(i, i), velocity[i]);
        for j in 0..i {
            own[j] = entry(i, j) - dot(&own[..j], &above[j * n..][..j]);
        }
        for j in 0..i {
            left -= own[j] * solved[j];
            // 1/D lies on the diagonal.
            let product = own[j];
            own[j] *= above[j * n + j];
            pivot -= product * own[j];
        }
        if pivot <= ROUNDING * entry(i, i) || pivot.is_nan() {
            return None;
        }
        own[i] = 1.0 / pivot;
        solved[i] = left * own[i];
        square += left * solved[i];
    }
    Some(square)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn energy_needs_every_direction_to_have_a_mass() {
        let free = twice_kinetic_energy(&[0.5, 0.0, 0.0, 0.25], &[3.0, 1.0]).expect("regular");
        assert!((free - 22.0).abs() < 1e-14);
        assert_eq!(
            twice_kinetic_energy(&[0.5, 0.0, 0.0, 0.0], &[3.0, 1.0]),
            None
        );
        assert_eq!(twice_kinetic_energy(&[0.0; 4], &[0.0; 2]), Some(0.0));
    }

    #[test]
    fn energy_follows_the_inverse_of_coupled_blocks() {
        // M = [[2, −1], [−1, 2]] / 3 is the inverse of [[2, 1], [1, 2]].
        let energy = twice_kinetic_energy(&[2.0, 1.0, 1.0, 2.0], &[1.0, 3.0]).expect("regular");
        assert!((energy - 14.0 / 3.0).abs() < 1e-14);
    }
}
