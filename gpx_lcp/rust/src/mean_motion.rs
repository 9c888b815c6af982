//! How far bodies move in a step: by the mean of the velocities before and after it, where nothing speaks against it.
//!
//! A velocity that changes steadily, by gravity or by sliding friction, moves a body by dt (v + v⁺)/2, exactly: a thrown
//! body keeps to its parabola, and a sliding one stops where it should. With dt v⁺ alone, Euler's semi-implicit way, both
//! are off by half a step's travel. But dt v⁺ is what the contacts were solved for, and it stays
//!
//! * where a body would be driven into another: an impact stops it at the surface, the mean would take it below;
//! * where the user's forces act. They may be springs, worked out anew for each step, and with the mean of velocities a
//!   spring gains energy (by a factor 1 + dt² k/4m in amplitude a step), which Euler's way keeps.
//!
//! Bodies that are in contact, or may come to it, must agree on the way: it is chosen for each island of them.

use crate::bodies::{Bodies, State, Twist};
use crate::collision::Contact;
use crate::stacking::relative_velocity;

/// How far the mean may take a contact below what the velocities after the step do, as a share of the smaller body's
/// bounding radius: above what solvers leave of velocities that ought to be zero, and a thousandth of the overlap that
/// is left alone.
const ROUNDING: f64 = 1e-7;

/// The velocities at which poses move in a step: from `state`, `free` before contact and `after` at its end.
///
/// Only contacts and gravity are averaged: the gyroscopic part of a spin keeps its angular momentum as it is.
pub fn mean_motion(
    bodies: &Bodies,
    contacts: &[Contact],
    state: &State,
    forces: &[Twist],
    free: &[Twist],
    after: &[Twist],
    time_step: f64,
) -> Vec<Twist> {
    let mut motion: Vec<Twist> = (0..bodies.moving)
        .map(|body| Twist {
            linear: 0.5 * (state.velocities[body].linear + after[body].linear),
            angular: 0.5 * (free[body].angular + after[body].angular),
        })
        .collect();
    let mut islands = Islands::new(bodies.moving);
    for pair in of_pairs(contacts) {
        let [a, b] = pair[0].bodies.map(|body| body as usize);
        if a.max(b) < bodies.moving {
            islands.join(a, b);
        }
    }
    let mut steady = vec![true; bodies.moving];
    for (body, force) in forces.iter().enumerate() {
        if *force != Twist::default() {
            steady[islands.of(body)] = false;
        }
    }
    // How far apart the mean and the velocities after the step take each body, and how far they turn it.
    let apart = motion.iter().zip(after).map(|(mean, after)| {
        let linear = time_step * mean.linear.distance(after.linear);
        [linear, time_step * mean.angular.distance(after.angular)]
    });
    let apart: Vec<[f64; 2]> = apart.collect();
    for pair in of_pairs(contacts) {
        let [a, b] = pair[0].bodies;
        let island = islands.of(a.min(b) as usize);
        if steady[island] {
            let rounding = ROUNDING * bodies.size([a, b]);
            // A point of contact is within a body's bound and half the gap of its centre. What is far less apart there
            // than counts, as it is at rest, need not be looked at.
            let (mut shift, mut turn) = (0.0, 0.0);
            for body in [a as usize, b as usize] {
                if let Some([linear, angular]) = apart.get(body) {
                    shift += linear + angular * bodies.bound(body);
                    turn += angular;
                }
            }
            let counts = |contact: &Contact| shift + turn * contact.gap.abs() > 0.5 * rounding;
            let end = |contact: &Contact, twists: &[Twist]| {
                let velocity = relative_velocity(bodies, contact, &state.poses, twists);
                contact.gap + time_step * velocity.dot(contact.frame[0])
            };
            // The mean ends in overlap that the velocities after the step do not make.
            let is_driven_in = |contact: &Contact| {
                counts(contact) && end(contact, &motion) < end(contact, after).min(0.0) - rounding
            };
            steady[island] = !pair.iter().any(is_driven_in);
        }
    }
    for body in 0..bodies.moving {
        if !steady[islands.of(body)] {
            motion[body] = after[body];
        }
    }
    motion
}

/// The contacts of each pair of bodies, which stand together.
fn of_pairs(contacts: &[Contact]) -> impl Iterator<Item = &[Contact]> {
    contacts.chunk_by(|one, other| one.bodies == other.bodies)
}

/// Sets of bodies that contacts join.
struct Islands(Vec<usize>);

impl Islands {
    fn new(bodies: usize) -> Self {
        Self((0..bodies).collect())
    }

    /// The body that stands for the island of this one.
    fn of(&mut self, mut body: usize) -> usize {
        while self.0[body] != body {
            self.0[body] = self.0[self.0[body]];
            body = self.0[body];
        }
        body
    }

    fn join(&mut self, one: usize, other: usize) {
        let (one, other) = (self.of(one), self.of(other));
        self.0[one.max(other)] = one.min(other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn islands_are_what_contacts_join() {
        let mut islands = Islands::new(7);
        for (one, other) in [(0, 1), (5, 6), (2, 3), (6, 2), (3, 5)] {
            islands.join(one, other);
        }
        let of: Vec<usize> = (0..7).map(|body| islands.of(body)).collect();
        assert_eq!(of, [0, 0, 2, 2, 4, 2, 2]);
    }
}
