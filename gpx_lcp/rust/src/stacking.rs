//! From contacts to the factors of the stacked system A F dt = B: J in blocks, M⁻¹ in blocks, and B.
//!
//! Row r of contact k reads f·(v_b + ω_b × r_b) - f·(v_a + ω_a × r_a) with f the r-th row of the contact frame and r_a,
//! r_b the arms from the centres of mass to the contact point. With v_free the velocities after every force but contact,
//!
//! ```text
//! B_n = -(J v_free)_n - gap/dt                    for an open gap: it may close, and no more
//! B_n = -(J v_free)_n                             for bodies that touch or overlap
//! B_n = -(J v_free)_n - (e - 1) (J v)_n           for an impact of elasticity e, v from before the step
//! B_t = -(J v_free)_t                             and - (e_t - 1) (J v)_t more for an impact of tangential elasticity e_t
//! ```
//!
//! so that the normal velocity after the step, J v_free + A p, is at least -gap/dt, 0 or the rebound speed, and the
//! tangential one is what friction brings to zero (Moreau's law on velocities; Newton's law of impact).
//!
//! A contact is an impact where the free motion would close its gap within the step and the closing speed (J v)_n is
//! above the world's impact speed. Gravity gives resting bodies g dt, so that above 2 g dt they never bounce.

use parry3d_f64::math::{Matrix, Pose, Vector};

use crate::bodies::{Bodies, Twist};
use crate::collision::Contact;
use crate::exact::BlockMatrix;

/// The system: the blocks of J and of Ĵ = J L by rows of contacts (block compressed sparse rows), B and the friction.
#[derive(Clone, Default)]
pub struct Stack {
    pub layout: Layout,
    /// Ĵ.
    pub whitened: BlockMatrix,
    /// The blocks of J, in the same places.
    pub blocks: Vec<f64>,
    pub b: Vec<f64>,
    /// The velocities of the bodies after every force but contact.
    pub free: Vec<Twist>,
    pub friction: Vec<f64>,
    /// e - 1 of each contact's pair, along the normal and along the tangents, and whether the contact is an impact.
    pub restitution: Vec<[f64; 2]>,
    pub impacts: Vec<bool>,
    /// d_i = max diag A_ii of each contact, 1/kg.
    pub scale: Vec<f64>,
    /// L of each moving body.
    pub roots: Vec<MassRoot>,
}

/// L with M⁻¹ = L Lᵀ of one body: 1/√m, and R L_I with L_I L_Iᵀ the inverse inertia in the body's frame.
#[derive(Clone, Copy)]
pub struct MassRoot {
    linear: f64,
    angular: Matrix,
}

/// How many rows each contact has (1 without friction, or 3) and how many velocities each body has (3 or 6).
#[derive(Clone, Copy, Default)]
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
    /// Closing speed above which a contact is an impact, m/s.
    pub impact_speed: f64,
}

impl Stack {
    pub fn contacts(&self) -> usize {
        self.friction.len()
    }

    pub fn has_friction(&self) -> bool {
        self.friction.iter().any(|friction| *friction != 0.0)
    }

    /// What the impulses, rows per contact, add to the velocities of the bodies: M⁻¹ Jᵀ p = L Ĵᵀ p.
    pub fn velocity_change(&self, impulse: &[f64], change: &mut Vec<Twist>) {
        let mut states = Vec::new();
        self.whitened.gather(impulse, &mut states);
        let twist = |(root, state): (&MassRoot, &[f64])| Twist {
            linear: Vector::from_slice(&state[..3]) * root.linear,
            angular: match state.get(3..6) {
                Some(state) => root.angular * Vector::from_slice(state),
                None => Vector::ZERO,
            },
        };
        let states = states.chunks_exact(self.layout.columns);
        change.clear();
        change.extend(self.roots.iter().zip(states).map(twist));
    }

    /// The contact velocities u = A p - B after the impulses, rows per contact.
    pub fn velocity(&self, impulse: &[f64]) -> Vec<f64> {
        let (mut states, mut velocity) = (Vec::new(), Vec::new());
        self.whitened.gather(impulse, &mut states);
        self.whitened.spread(&states, &self.b, &mut velocity);
        velocity
    }

    /// M⁻¹ body by body, world frame, as blocks of columns × columns.
    pub fn inverse_mass(&self) -> Vec<f64> {
        let columns = self.layout.columns;
        let blocks = self.roots.iter().map(|root| root.inverse_mass(columns));
        blocks
            .flat_map(|block| block.into_iter().take(columns * columns))
            .collect()
    }
}

impl MassRoot {
    /// M⁻¹ = L Lᵀ, world frame, as a block of columns × columns.
    pub fn inverse_mass(&self, columns: usize) -> [f64; 36] {
        let mut block = [0.0; 36];
        for axis in 0..3 {
            block[axis * columns + axis] = self.linear * self.linear;
        }
        if columns == 6 {
            let inverse = self.angular * self.angular.transpose();
            for row in 0..3 {
                for column in 0..3 {
                    block[(3 + row) * 6 + 3 + column] = inverse.col(column)[row];
                }
            }
        }
        block
    }
}

/// Stack the contacts into `result`, whose memory is used again.
pub fn stack(
    bodies: &Bodies,
    contacts: &[Contact],
    motion: &Motion,
    layout: Layout,
    result: &mut Stack,
) {
    let Layout { rows, columns } = layout;
    result.layout = layout;
    result.blocks.clear();
    let whitened_jacobian = &mut result.whitened;
    whitened_jacobian.starts.clear();
    whitened_jacobian.starts.push(0);
    whitened_jacobian.columns.clear();
    whitened_jacobian.values.clear();
    (whitened_jacobian.height, whitened_jacobian.width) = (rows, columns);
    whitened_jacobian.block_columns = motion.poses.len();
    result.b.clear();
    result.free.clear();
    result.free.extend_from_slice(motion.free);
    result.friction.clear();
    result.restitution.clear();
    result.impacts.clear();
    result.scale.clear();
    result.roots.clear();
    let moving = motion.poses.iter().enumerate();
    result.roots.extend(moving.map(|(body, pose)| MassRoot {
        linear: 1.0 / bodies.masses[body].sqrt(),
        angular: Matrix::from_quat(pose.rotation) * bodies.inverse_inertia_roots[body],
    }));
    let size = 2 * contacts.len() * rows * columns;
    result.blocks.reserve(size);
    result.whitened.values.reserve(size);
    let (mut pair, mut friction, mut restitution) = ([u32::MAX; 2], 0.0, [0.0; 2]);
    for contact in contacts {
        let mut diagonal = [0.0; 3];
        for (body, sign) in [(contact.bodies[0], -1.0), (contact.bodies[1], 1.0)] {
            let body = body as usize;
            if body >= bodies.moving {
                continue;
            }
            let arm = contact.point - motion.poses[body].translation;
            let MassRoot { linear, angular } = result.roots[body];
            let to_root = angular.transpose();
            result.whitened.columns.push(body as u32);
            let (mut block, mut white) = ([0.0; 18], [0.0; 18]);
            for (r, sum) in diagonal[..rows].iter_mut().enumerate() {
                let force = contact.frame[r] * sign;
                let whitened = force * linear;
                let mut square = whitened.length_squared();
                let at = r * columns;
                block[at..at + 3].copy_from_slice(&force.to_array());
                white[at..at + 3].copy_from_slice(&whitened.to_array());
                if columns == 6 {
                    let moment = arm.cross(force);
                    let entries = (to_root * moment).to_array();
                    // One after another: d_i is then the same number, to the last bit, as in Python.
                    square = entries.iter().fold(square, |sum, x| sum + x * x);
                    block[at + 3..at + 6].copy_from_slice(&moment.to_array());
                    white[at + 3..at + 6].copy_from_slice(&entries);
                }
                *sum += square;
            }
            let values = &mut result.whitened.values;
            result.blocks.extend_from_slice(&block[..rows * columns]);
            values.extend_from_slice(&white[..rows * columns]);
        }
        let end = result.whitened.columns.len();
        result.whitened.starts.push(end);
        if pair != contact.bodies {
            pair = contact.bodies;
            (friction, restitution) = (bodies.friction(pair), bodies.restitution(pair));
        }
        result.friction.push(friction);
        result.restitution.push(restitution);
        result.scale.push(diagonal.into_iter().fold(0.0, f64::max));

        let free = relative_velocity(bodies, contact, motion.poses, motion.free);
        let normal = free.dot(contact.frame[0]);
        let [bounce, reversal] = restitution;
        let may_bounce =
            (bounce > 0.0 || reversal > 0.0) && contact.gap + motion.time_step * normal < 0.0;
        let before = if may_bounce {
            relative_velocity(bodies, contact, motion.poses, motion.velocities)
        } else {
            Vector::ZERO
        };
        let closing = before.dot(contact.frame[0]);
        let impact = may_bounce && closing < -motion.impact_speed;
        result.impacts.push(impact);
        result.b.push(if impact && bounce > 0.0 {
            -normal - bounce * closing
        } else {
            -normal - contact.gap.max(0.0) / motion.time_step
        });
        let tangents = contact.frame[1..rows].iter();
        if impact && reversal > 0.0 {
            result
                .b
                .extend(tangents.map(|t| -free.dot(*t) - reversal * before.dot(*t)));
        } else {
            result.b.extend(tangents.map(|t| -free.dot(*t)));
        }
    }
}

/// Velocity of b relative to a at the contact point, world frame.
pub fn relative_velocity(
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
