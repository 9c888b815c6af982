//! The two faces of the friction cone that the exact solvers use: its projection with a generalised derivative, and the
//! Jordan algebra of the Lorentz cone with Nesterov-Todd scaling.
//!
//! A contact without friction is the half-line p_n ≥ 0. In the algebra it is a Lorentz vector whose tangents stay zero; in
//! the projection it is the case μ = 0.
//!
//! Source: F. Alizadeh, D. Goldfarb, *Second-order cone programming*, Math. Program. 95 (2003), for the algebra and the
//! scaling; V. Acary, M. Brémond, O. Huber, INRIA RR-9118 (2018), for the projection and its derivative.

use super::small::{IDENTITY, Matrix, Vector, ZERO, tangent_norm};

/// P_K(x) onto {‖p_t‖ ≤ μ p_n}, and an element of its generalised derivative. Without friction the tangents go to zero.
pub fn project(x: &Vector, friction: f64, derivative: &mut Matrix) -> Vector {
    let tangent = tangent_norm(x);
    if friction == 0.0 {
        *derivative = [ZERO; 3];
        derivative[0][0] = f64::from(x[0] > 0.0);
        return [x[0].max(0.0), 0.0, 0.0];
    }
    if tangent <= friction * x[0] {
        *derivative = IDENTITY;
        return *x;
    }
    if friction * tangent <= -x[0] {
        *derivative = [ZERO; 3];
        return ZERO;
    }
    let share = 1.0 / (1.0 + friction * friction);
    let normal = (x[0] + friction * tangent) * share;
    let direction = [x[1] / tangent, x[2] / tangent];
    let turn = friction * normal / tangent;
    *derivative = [[share, 0.0, 0.0], ZERO, ZERO];
    for i in 0..2 {
        derivative[0][i + 1] = share * friction * direction[i];
        derivative[i + 1][0] = derivative[0][i + 1];
        for j in 0..2 {
            let along = direction[i] * direction[j];
            derivative[i + 1][j + 1] =
                share * friction * friction * along + turn * (f64::from(i == j) - along);
        }
    }
    [
        normal,
        friction * normal * direction[0],
        friction * normal * direction[1],
    ]
}

/// x₀² − ‖x_t‖², positive inside the Lorentz cone.
pub fn determinant(x: &Vector) -> f64 {
    let tangent = tangent_norm(x);
    (x[0] - tangent) * (x[0] + tangent)
}

/// a ∘ b.
pub fn jordan(a: &Vector, b: &Vector) -> Vector {
    [
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
        a[0] * b[1] + b[0] * a[1],
        a[0] * b[2] + b[0] * a[2],
    ]
}

/// x with λ ∘ x = c, for λ inside the cone.
pub fn jordan_divide(lambda: &Vector, c: &Vector) -> Vector {
    let first = (lambda[0] * c[0] - lambda[1] * c[1] - lambda[2] * c[2]) / determinant(lambda);
    [
        first,
        (c[1] - first * lambda[1]) / lambda[0],
        (c[2] - first * lambda[2]) / lambda[0],
    ]
}

/// The symmetric W with W z = W⁻¹ r = λ, for r and z inside the cone.
#[derive(Debug, Clone, Copy)]
pub struct Scaling {
    pub w: Matrix,
    pub inverse: Matrix,
}

impl Scaling {
    pub fn new(r: &Vector, z: &Vector) -> Self {
        let (det_r, det_z) = (determinant(r).sqrt(), determinant(z).sqrt());
        let r_bar = r.map(|value| value / det_r);
        let z_bar = z.map(|value| value / det_z);
        let gamma =
            (0.5 * (1.0 + r_bar[0] * z_bar[0] + r_bar[1] * z_bar[1] + r_bar[2] * z_bar[2])).sqrt();
        let point = [
            (r_bar[0] + z_bar[0]) / (2.0 * gamma),
            (r_bar[1] - z_bar[1]) / (2.0 * gamma),
            (r_bar[2] - z_bar[2]) / (2.0 * gamma),
        ];
        let eta = (det_r / det_z).sqrt();
        let mut w = [point, [point[1], 1.0, 0.0], [point[2], 0.0, 1.0]];
        for i in 1..3 {
            for j in 1..3 {
                w[i][j] += point[i] * point[j] / (1.0 + point[0]);
            }
        }
        let mut inverse = w;
        for i in 1..3 {
            inverse[0][i] = -inverse[0][i];
            inverse[i][0] = -inverse[i][0];
        }
        w.iter_mut().flatten().for_each(|value| *value *= eta);
        inverse.iter_mut().flatten().for_each(|value| *value /= eta);
        Self { w, inverse }
    }
}

/// The largest t with x + t d in the Lorentz cone, for x inside it; infinite when the ray never leaves.
pub fn step_to_boundary(x: &Vector, d: &Vector) -> f64 {
    let (a, c) = (determinant(d), determinant(x));
    let b = x[0] * d[0] - x[1] * d[1] - x[2] * d[2];
    // The first positive root of a t² + 2 b t + c, and of the straight line x₀ + t d₀.
    let mut step = if d[0] < 0.0 {
        -x[0] / d[0]
    } else {
        f64::INFINITY
    };
    let discriminant = b * b - a * c;
    if discriminant >= 0.0 {
        let q = -(b + discriminant.sqrt().copysign(b));
        for root in [q / a, c / q] {
            if root > 0.0 && root < step {
                step = root;
            }
        }
    }
    step
}

#[cfg(test)]
mod tests {
    use super::super::small::times;
    use super::*;

    const R: Vector = [2.0, 1.0, -0.5];
    const Z: Vector = [1.0, -0.3, 0.9];

    #[test]
    fn scaling_maps_both_to_one_point() {
        let scaling = Scaling::new(&R, &Z);
        let (left, right) = (times(&scaling.w, &Z), times(&scaling.inverse, &R));
        for k in 0..3 {
            assert!((left[k] - right[k]).abs() < 1e-14);
        }
        let back = times(&scaling.inverse, &left);
        assert!((back[1] - Z[1]).abs() < 1e-14);
    }

    #[test]
    fn jordan_division_undoes_the_product() {
        let x = jordan_divide(&R, &jordan(&R, &Z));
        for k in 0..3 {
            assert!((x[k] - Z[k]).abs() < 1e-14);
        }
    }

    #[test]
    fn step_ends_on_the_boundary() {
        for d in [
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 1.0],
            [-1.0, 3.0, 0.2],
            [1.0, -4.0, 0.0],
        ] {
            let t = step_to_boundary(&R, &d);
            let end = [R[0] + t * d[0], R[1] + t * d[1], R[2] + t * d[2]];
            assert!(determinant(&end).abs() < 1e-12 && end[0] >= 0.0, "{d:?}");
        }
        assert_eq!(step_to_boundary(&R, &[1.0, 0.5, 0.0]), f64::INFINITY);
    }

    #[test]
    fn projection_derivative_matches_differences() {
        for x in [
            [1.0, 0.1, 0.2],
            [0.3, 1.0, -0.7],
            [-2.0, 0.3, 0.1],
            [-0.2, 1.0, 0.4],
        ] {
            let (mut derivative, mut unused) = (IDENTITY, IDENTITY);
            project(&x, 0.6, &mut derivative);
            for j in 0..3 {
                let (mut up, mut down) = (x, x);
                up[j] += 1e-6;
                down[j] -= 1e-6;
                let (up, down) = (
                    project(&up, 0.6, &mut unused),
                    project(&down, 0.6, &mut unused),
                );
                for i in 0..3 {
                    assert!((derivative[i][j] - (up[i] - down[i]) / 2e-6).abs() < 1e-8);
                }
            }
        }
    }
}
