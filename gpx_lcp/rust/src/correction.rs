//! Overlap is taken out of positions, never of velocities: a projection that moves the bodies as little as can be,
//!
//! ```text
//! min ½ Δxᵀ M Δx    over J_n Δx ≥ a,
//! ```
//!
//! with a_k a share of what contact k overlaps by at the end of the step, and minus the gap where it has one. It is the
//! frictionless program with a/dt for B; what its sweeps leave, the next step takes out.

use parry3d_f64::math::Pose;

use crate::bodies::{Bodies, Twist};
use crate::collision::Contact;
use crate::gauss_seidel::Settings;
use crate::program::Program;
use crate::solving::Effort;
use crate::stacking::{Stack, relative_velocity};
use crate::sweeping::sweep;

/// Overlap that is left alone, as a share of the smaller body's bounding radius: 0.09 mm for a cube of 1 m.
const SLOP: f64 = 1e-4;
/// The share of the overlap beyond that which one step takes out.
const CORRECTION: f64 = 0.2;
/// Sweeps end early in most steps. Where they are cut short, what is lifted is tilted a little, and tilted bodies are
/// pushed aside: ten cubes, 1 cm in each other, end 0.7 mm beside their line after 20 sweeps a step, and on it, to 3e-8 m
/// (2e-10 m with a tolerance of 1e-8), after 200. Falling balls overlap more, and sweeping them is half of a step at 1e-8.
const SWEEPS: Settings = Settings {
    tolerance: 1e-4,
    max_sweeps: 200,
    time_limit: None,
    relaxation: 1.0,
    acceleration: true,
    threads: 1,
};

/// The velocities, for this step's poses only, that take out overlap after a step that moves the bodies at `velocities`;
/// None where no contact overlaps by more than is left alone. `effort` is what the core takes the step with.
pub fn position_shift(
    bodies: &Bodies,
    contacts: &[Contact],
    stack: &Stack,
    poses: &[Pose],
    velocities: &[Twist],
    time_step: f64,
    effort: Option<&Effort>,
) -> Option<Vec<Twist>> {
    let ends = contacts.iter().map(|contact| {
        let closing = relative_velocity(bodies, contact, poses, velocities).dot(contact.frame[0]);
        let slop = SLOP * bodies.size(contact.bodies);
        (contact.gap + time_step * closing, slop)
    });
    if ends.clone().all(|(gap, slop)| gap >= -slop) {
        return None;
    }
    let rows = stack.layout.rows;
    let mut asked = vec![0.0; stack.b.len()];
    for ((gap, slop), row) in ends.zip(asked.chunks_exact_mut(rows)) {
        row[0] = if gap < -slop {
            CORRECTION * (-gap - slop) / time_step
        } else {
            -gap.max(0.0) / time_step
        };
    }
    let program = &Program::Normal;
    let system = stack.system_with(&asked);
    // By as many threads as the step itself takes.
    let threads = effort.map_or(SWEEPS.threads, |effort| effort.threads);
    let settings = Settings { threads, ..SWEEPS };
    let answer = sweep(system, program, &settings, None, &|| false, None)?;
    let mut shift = Vec::new();
    stack.velocity_change(&answer.impulse, &mut shift);
    Some(shift)
}
