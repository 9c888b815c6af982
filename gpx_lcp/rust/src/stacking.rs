//! From contacts to the factors of the stacked system A F dt = B: J in blocks, M⁻¹ in blocks, and B.
//!
//! Row r of contact k reads f·(v_b + ω_b × r_b) - f·(v_a + ω_a × r_a) with f the r-th row of the contact frame and r_a,
//! r_b the arms from the centres of mass to the contact point. With v_free the velocities after every force but contact,
//!
//! ```text
//! B_n = -(J v_free)_n - gap/dt                    for an open gap: it may close, and no more
//! B_n = -(J v_free)_n                             for bodies that touch or overlap
//! B_n = -(J v_free)_n - (e - 1) (J v)_n           for an impact of elasticity e, v from before the step
//! B_t = -(J v_free)_t
//! ```
//!
//! so that the normal velocity after the step, J v_free + A p, is at least -gap/dt, 0 or the rebound speed, and the
//! tangential one is what friction brings to zero (Moreau's law on velocities; Newton's law of impact).
//!
//! A contact is an impact where the free motion would close its gap within the step and the closing speed (J v)_n is
//! above 2 g dt, which gravity alone gives to resting bodies: they never bounce.

use parry3d_f64::math::{Matrix, Pose, Vector};

use crate::bodies::{Bodies, Twist, turned};
use crate::collision::Contact;

/// The blocks of J by rows of contacts (block compressed sparse rows), and B.
pub struct Stack {
    pub row_starts: Vec<i32>,
    pub columns: Vec<i32>,
    /// Blocks of rows × columns, row by row.
    pub blocks: Vec<f64>,
    pub b: Vec<f64>,
}

/// How many rows each contact has (1 without friction, or 3) and how many velocities each body has (3 or 6).
#[derive(Clone, Copy)]
pub struct Layout {
    pub rows: usize,
    pub columns: usize,
}

pub struct Motion<'a> {
    pub poses: &'a [Pose],
    /// Before the step.
    pub velocities: &'a [Twist],
    /// After every force but contact.
    pub free: &'a [Twist],
    pub time_step: f64,
    /// |g|, m/s².
    pub gravity: f64,
}

pub fn stack(bodies: &Bodies, contacts: &[Contact], motion: &Motion, layout: Layout) -> Stack {
    let Layout { rows, columns } = layout;
    let mut result = Stack {
        row_starts: vec![0],
        columns: Vec::with_capacity(2 * contacts.len()),
        blocks: Vec::with_capacity(2 * contacts.len() * rows * columns),
        b: Vec::with_capacity(contacts.len() * rows),
    };
    for contact in contacts {
        for (body, sign) in [(contact.bodies[0], -1.0), (contact.bodies[1], 1.0)] {
            let body = body as usize;
            if body >= bodies.moving {
                continue;
            }
            let arm = contact.point - motion.poses[body].translation;
            result.columns.push(body as i32);
            for direction in &contact.frame[..rows] {
                let linear = *direction * sign;
                result.blocks.extend(linear.to_array());
                if columns == 6 {
                    result.blocks.extend(arm.cross(linear).to_array());
                }
            }
        }
        result.row_starts.push(result.columns.len() as i32);

        let free = relative_velocity(bodies, contact, motion.poses, motion.free);
        let closing = relative_velocity(bodies, contact, motion.poses, motion.velocities)
            .dot(contact.frame[0]);
        let normal = free.dot(contact.frame[0]);
        let restitution = bodies.restitution(contact.bodies);
        let impact = restitution > 0.0
            && contact.gap + motion.time_step * normal < 0.0
            && closing < -2.0 * motion.gravity * motion.time_step;
        result.b.push(if impact {
            -normal - restitution * closing
        } else {
            -normal - contact.gap.max(0.0) / motion.time_step
        });
        let tangents = &contact.frame[1..rows];
        result.b.extend(tangents.iter().map(|t| -free.dot(*t)));
    }
    result
}

/// Velocity of b relative to a at the contact point, world frame.
fn relative_velocity(
    bodies: &Bodies,
    contact: &Contact,
    poses: &[Pose],
    twists: &[Twist],
) -> Vector {
    let [a, b] = contact.bodies.map(|body| {
        let body = body as usize;
        if body >= bodies.moving {
            return Vector::ZERO;
        }
        let arm = contact.point - poses[body].translation;
        twists[body].linear + twists[body].angular.cross(arm)
    });
    b - a
}

/// M⁻¹ body by body, world frame, as blocks of columns × columns.
pub fn inverse_mass(bodies: &Bodies, poses: &[Pose], columns: usize) -> Vec<f64> {
    let mut blocks = vec![0.0; bodies.moving * columns * columns];
    for (body, block) in blocks.chunks_exact_mut(columns * columns).enumerate() {
        for axis in 0..3 {
            block[axis * columns + axis] = 1.0 / bodies.masses[body];
        }
        if columns == 6 {
            let inverse: Matrix = turned(&bodies.inverse_inertias[body], &poses[body].rotation);
            for row in 0..3 {
                for column in 0..3 {
                    // The product with the rotations is symmetric only up to rounding.
                    let entry = 0.5 * (inverse.col(column)[row] + inverse.col(row)[column]);
                    block[(3 + row) * 6 + 3 + column] = entry;
                }
            }
        }
    }
    blocks
}
