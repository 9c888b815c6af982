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
use crate::team::{Team, front};

/// Contacts of a piece of work: some ten microseconds.
const PIECE: usize = 128;

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

/// L with M⁻¹ = L Lᵀ of one body: 1/√m, and R L_I with L_I L_Iᵀ the inverse inertia in the body's frame; zero in a system
/// that turns no body.
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

    /// The velocities L w of the bodies; of w = Ĵᵀ p, what the impulses p add to them.
    pub fn unwhitened(&self, states: &[f64], velocities: &mut Vec<Twist>) {
        let states = states.chunks_exact(self.layout.columns);
        let each = self.roots.iter().zip(states);
        velocities.clear();
        velocities.extend(each.map(|(root, state)| root.twist(state)));
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
    /// The velocities L w of a state w of the body, of three entries or six.
    pub fn twist(&self, state: &[f64]) -> Twist {
        Twist {
            linear: Vector::from_slice(&state[..3]) * self.linear,
            angular: match state.get(3..6) {
                Some(state) => self.angular * Vector::from_slice(state),
                None => Vector::ZERO,
            },
        }
    }

    /// The part 1/m of M⁻¹ = L Lᵀ.
    pub fn of_translation(&self) -> f64 {
        self.linear * self.linear
    }

    /// The part I⁻¹, world frame.
    pub fn of_rotation(&self) -> Matrix {
        self.angular * self.angular.transpose()
    }

    /// M⁻¹ as a block of columns × columns, world frame.
    pub fn inverse_mass(&self, columns: usize) -> [f64; 36] {
        let mut block = [0.0; 36];
        for axis in 0..3 {
            block[axis * columns + axis] = self.of_translation();
        }
        if columns == 6 {
            let inverse = self.of_rotation();
            for row in 0..3 {
                for column in 0..3 {
                    block[(3 + row) * 6 + 3 + column] = inverse.col(column)[row];
                }
            }
        }
        block
    }
}

/// Stack the contacts into `result`, whose memory is used again; the team takes part.
pub fn stack(
    bodies: &Bodies,
    contacts: &[Contact],
    motion: &Motion,
    layout: Layout,
    result: &mut Stack,
    team: &Team,
) {
    let Layout { rows, columns } = layout;
    result.layout = layout;
    result.free.clear();
    result.free.extend_from_slice(motion.free);
    result.roots.clear();
    let moving = motion.poses.iter().enumerate();
    result.roots.extend(moving.map(|(body, pose)| MassRoot {
        linear: 1.0 / bodies.masses[body].sqrt(),
        angular: if columns == 6 {
            Matrix::from_quat(pose.rotation) * bodies.inverse_inertia_roots[body]
        } else {
            Matrix::ZERO
        },
    }));
    let BlockMatrix {
        starts,
        columns: touched,
        values,
        height,
        width,
        block_columns,
    } = &mut result.whitened;
    (*height, *width, *block_columns) = (rows, columns, motion.poses.len());
    starts.clear();
    starts.push(0);
    touched.clear();
    for contact in contacts {
        let moving = |body: &u32| (*body as usize) < bodies.moving;
        touched.extend(contact.bodies.into_iter().filter(moving));
        starts.push(touched.len());
    }
    let (count, area) = (contacts.len(), rows * columns);
    values.resize(area * touched.len(), 0.0);
    result.blocks.resize(area * touched.len(), 0.0);
    result.b.resize(rows * count, 0.0);
    result.friction.resize(count, 0.0);
    result.restitution.resize(count, [0.0; 2]);
    result.impacts.resize(count, false);
    result.scale.resize(count, 0.0);

    let (mut white, mut blocks) = (values.as_mut_slice(), result.blocks.as_mut_slice());
    let numbers = result.b.chunks_mut(rows * PIECE);
    let pairs = result
        .friction
        .chunks_mut(PIECE)
        .zip(result.restitution.chunks_mut(PIECE));
    let own = result
        .impacts
        .chunks_mut(PIECE)
        .zip(result.scale.chunks_mut(PIECE));
    let parts = contacts.chunks(PIECE).zip(starts.chunks(PIECE));
    let mut parts: Vec<Part> = parts
        .zip(starts[1..].chunks(PIECE))
        .zip(numbers.zip(pairs.zip(own)))
        .map(
            |(((contacts, begins), ends), (b, ((friction, restitution), (impacts, scale))))| {
                let length = area * (ends[ends.len() - 1] - begins[0]);
                Part {
                    contacts,
                    white: front(&mut white, length),
                    blocks: front(&mut blocks, length),
                    b,
                    friction,
                    restitution,
                    impacts,
                    scale,
                }
            },
        )
        .collect();
    let roots = &result.roots;
    team.each(&mut parts, |part| match (rows, columns) {
        (3, 6) => part.fill::<3, 6>(bodies, roots, motion),
        (3, _) => part.fill::<3, 3>(bodies, roots, motion),
        (_, 6) => part.fill::<1, 6>(bodies, roots, motion),
        _ => part.fill::<1, 3>(bodies, roots, motion),
    });
}

/// A stretch of the contacts, and what is stacked of them.
struct Part<'a> {
    contacts: &'a [Contact],
    white: &'a mut [f64],
    blocks: &'a mut [f64],
    b: &'a mut [f64],
    friction: &'a mut [f64],
    restitution: &'a mut [[f64; 2]],
    impacts: &'a mut [bool],
    scale: &'a mut [f64],
}

impl Part<'_> {
    /// Stack contacts of R rows on bodies of D velocities.
    fn fill<const R: usize, const D: usize>(
        &mut self,
        bodies: &Bodies,
        roots: &[MassRoot],
        motion: &Motion,
    ) {
        let mut blocks = self.blocks.as_chunks_mut::<D>().0;
        let mut whites = self.white.as_chunks_mut::<D>().0;
        let numbers = self.b.as_chunks_mut::<R>().0;
        let (mut pair, mut friction, mut restitution) = ([u32::MAX; 2], 0.0, [0.0; 2]);
        for (at, (contact, b)) in self.contacts.iter().zip(numbers).enumerate() {
            let mut diagonal = [0.0; R];
            for (body, sign) in [(contact.bodies[0], -1.0), (contact.bodies[1], 1.0)] {
                let body = body as usize;
                if body >= bodies.moving {
                    continue;
                }
                let arm = contact.point - motion.poses[body].translation;
                let MassRoot { linear, angular } = &roots[body];
                let lines = front(&mut blocks, R).iter_mut();
                let lines = lines.zip(front(&mut whites, R));
                for (r, (line, white)) in lines.enumerate() {
                    let force = contact.frame[r] * sign;
                    let whitened = force * *linear;
                    let mut square = whitened.length_squared();
                    line[..3].copy_from_slice(&force.to_array());
                    white[..3].copy_from_slice(&whitened.to_array());
                    if D == 6 {
                        let moment = arm.cross(force);
                        let entries = angular.mul_transpose_vec3(moment).to_array();
                        // One after another: d_i is then the same number, to the last bit, as in Python.
                        square = entries.iter().fold(square, |sum, x| sum + x * x);
                        line[3..].copy_from_slice(&moment.to_array());
                        white[3..].copy_from_slice(&entries);
                    }
                    diagonal[r] += square;
                }
            }
            if pair != contact.bodies {
                pair = contact.bodies;
                (friction, restitution) = (bodies.friction(pair), bodies.restitution(pair));
            }
            self.friction[at] = friction;
            self.restitution[at] = restitution;
            self.scale[at] = diagonal.into_iter().fold(0.0, f64::max);

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
            self.impacts[at] = impact;
            b[0] = if impact && bounce > 0.0 {
                -normal - bounce * closing
            } else {
                -normal - contact.gap.max(0.0) / motion.time_step
            };
            for r in 1..R {
                let tangent = contact.frame[r];
                b[r] = if impact && reversal > 0.0 {
                    -free.dot(tangent) - reversal * before.dot(tangent)
                } else {
                    -free.dot(tangent)
                };
            }
        }
    }
}

/// Velocity of b relative to a at the contact point, world frame.
#[inline]
pub fn relative_velocity(
    bodies: &Bodies,
    contact: &Contact,
    poses: &[Pose],
    twists: &[Twist],
) -> Vector {
    let velocity = |body: u32| {
        let body = body as usize;
        if body >= bodies.moving {
            return Vector::ZERO;
        }
        let arm = contact.point - poses[body].translation;
        twists[body].linear + twists[body].angular.cross(arm)
    };
    velocity(contact.bodies[1]) - velocity(contact.bodies[0])
}
