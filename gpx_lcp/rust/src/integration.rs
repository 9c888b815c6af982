//! Motion between contacts: semi-implicit Euler, velocities first, then poses with the velocities after contact.

use parry3d_f64::math::{Matrix, Pose, Rotation, Vector};

use crate::bodies::{Bodies, State, Twist};

const GYROSCOPIC_ITERATIONS: usize = 50;

/// Velocities after one step of gravity, forces, torques and gyroscopic moments, without contact.
///
/// Torque changes the angular momentum L. In the body's frame l = Rᵀ L the free motion is l' = -Ω × l with Ω = I⁻¹ l,
/// a rotation of l; the step takes
///
/// ```text
/// l⁺ = exp(-dt I⁻¹ l⁺) l
/// ```
///
/// solved by fixed-point iteration. Each iterate has the length of l, so that |ω| ≤ |l| / (smallest inertia) holds
/// whatever the step: nothing blows up. Where the iteration converges, and no contact intervenes, turning the body by
/// exp(dt ω) afterwards gives back the very same L in the world frame.
pub fn free_velocities(
    bodies: &Bodies,
    state: &State,
    forces: &[Twist],
    gravity: Vector,
    time_step: f64,
    result: &mut Vec<Twist>,
) {
    let State { poses, velocities } = state;
    let bodies_in_motion = poses.iter().zip(velocities).zip(forces).enumerate();
    result.clear();
    result.extend(bodies_in_motion.map(|(body, ((pose, velocity), force))| {
        let acceleration = gravity + force.linear / bodies.masses[body];
        let inverse = &bodies.inverse_inertias[body];
        Twist {
            linear: velocity.linear + acceleration * time_step,
            angular: if *inverse == Matrix::ZERO {
                velocity.angular
            } else {
                let angular = velocity.angular;
                let torque = force.angular;
                free_spin(bodies, body, &pose.rotation, angular, torque, time_step)
            },
        }
    }));
}

/// The angular velocity of a body after one step without contact, world frame.
fn free_spin(
    bodies: &Bodies,
    body: usize,
    rotation: &Rotation,
    angular: Vector,
    torque: Vector,
    time_step: f64,
) -> Vector {
    if angular == Vector::ZERO && torque == Vector::ZERO {
        return angular;
    }
    let (inertia, inverse) = (&bodies.inertias[body], &bodies.inverse_inertias[body]);
    let to_body = rotation.inverse();
    let gain = *inverse * (to_body * torque) * time_step;
    let pushed = angular + *rotation * gain;
    let momentum = *inertia * (to_body * angular + gain);
    // Balls and cubes, I = i 1: the momentum does not turn.
    let mean = (inertia.x_axis.x + inertia.y_axis.y + inertia.z_axis.z) / 3.0;
    let isotropic = inertia.abs_diff_eq(Matrix::from_diagonal(Vector::splat(mean)), 1e-14 * mean);
    if isotropic || momentum == Vector::ZERO {
        return pushed;
    }
    let mut after = momentum;
    for _ in 0..GYROSCOPIC_ITERATIONS {
        let next = rotation_of(*inverse * after * -time_step) * momentum;
        let change = next.distance(after);
        after = next;
        if change <= 1e-15 * momentum.length() {
            break;
        }
    }
    *rotation * (*inverse * after)
}

/// Poses after `time_step` at constant velocities: x + dt v, and exp(dt ω) q, of unit length again.
pub fn advance(poses: &[Pose], velocities: &[Twist], time_step: f64, result: &mut Vec<Pose>) {
    let moving = poses.iter().zip(velocities);
    result.clear();
    result.extend(moving.map(|(pose, velocity)| {
        let turn = velocity.angular * time_step;
        let rotation = if turn == Vector::ZERO {
            pose.rotation // Normalising would move the last bit of a body at rest.
        } else {
            (rotation_of(turn) * pose.rotation).normalize()
        };
        Pose::from_parts(pose.translation + velocity.linear * time_step, rotation)
    }));
}

/// The rotation by the angle |turn| about its direction.
fn rotation_of(turn: Vector) -> Rotation {
    let angle = turn.length();
    // sin(x/2)/x, whose series is exact to rounding where the quotient is not.
    let ratio = if angle < 1e-4 {
        0.5 - angle * angle / 48.0
    } else {
        (0.5 * angle).sin() / angle
    };
    let axis = turn * ratio;
    Rotation::from_xyzw(axis.x, axis.y, axis.z, (0.5 * angle).cos())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_by_small_and_large_angles_agree_with_the_exact_ones() {
        for angle in [1e-9, 9.9e-5, 1.01e-4, 0.5, 3.0, 7.0] {
            let turned = rotation_of(Vector::Y * angle) * Vector::X;
            let exact = Vector::new(angle.cos(), 0.0, -angle.sin());
            assert!((turned - exact).length() < 1e-14);
        }
    }

    #[test]
    fn a_body_at_rest_keeps_every_bit_of_its_pose() {
        let pose = Pose::from_parts(
            Vector::new(0.1, 0.2, 0.3),
            Rotation::from_xyzw(0.1, 0.7, 0.1, 0.7).normalize(),
        );
        let mut after = Vec::new();
        advance(&[pose], &[Twist::default()], 0.1, &mut after);
        assert_eq!(after[0].translation, pose.translation);
        assert_eq!(after[0].rotation, pose.rotation);
    }
}
