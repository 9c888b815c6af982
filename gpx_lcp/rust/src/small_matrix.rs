//! The few operations on 1 × 1 to 3 × 3 matrices that one contact needs, on arrays of rows.

use crate::lanes::Lanes;

pub type Vector<const N: usize> = [f64; N];
pub type Matrix<const N: usize> = [[f64; N]; N];

#[inline(always)]
pub fn dot<const N: usize>(x: &Vector<N>, y: &Vector<N>) -> f64 {
    let mut sum = x[0] * y[0];
    for k in 1..N {
        sum += x[k] * y[k];
    }
    sum
}

/// x × y
#[inline(always)]
pub fn cross<V: Lanes>(x: &[V; 3], y: &[V; 3]) -> [V; 3] {
    [
        (x[1] * y[2]).minus_product(x[2], y[1]),
        (x[2] * y[0]).minus_product(x[0], y[2]),
        (x[0] * y[1]).minus_product(x[1], y[0]),
    ]
}

/// Product of a symmetric matrix with a vector, column by column so that it vectorises.
#[inline(always)]
pub fn times<const N: usize>(symmetric: &Matrix<N>, x: &Vector<N>) -> Vector<N> {
    let mut sum = symmetric[0].map(|value| value * x[0]);
    for k in 1..N {
        for (entry, value) in sum.iter_mut().zip(&symmetric[k]) {
            *entry += value * x[k];
        }
    }
    sum
}

pub fn transposed<const N: usize>(matrix: &Matrix<N>) -> Matrix<N> {
    std::array::from_fn(|r| std::array::from_fn(|c| matrix[c][r]))
}

/// Length of the entries after the first: the tangential part of a contact vector.
#[inline(always)]
pub fn tangent_length<V: Lanes, const N: usize>(x: &[V; N]) -> V {
    let zero = V::splat(0.0);
    match N {
        1 => zero,
        2 => (-x[1]).replaced(x[1].at_least(zero), x[1]),
        _ => {
            let mut square = x[1] * x[1];
            for r in 2..N {
                square = square + x[r] * x[r];
            }
            square.sqrt()
        }
    }
}

/// Lower Cholesky factor; None where a pivot falls below `least`.
pub fn cholesky<const N: usize>(matrix: &Matrix<N>, least: f64) -> Option<Matrix<N>> {
    let mut lower = [[0.0; N]; N];
    for c in 0..N {
        let pivot = matrix[c][c] - (0..c).map(|k| lower[c][k] * lower[c][k]).sum::<f64>();
        if pivot.is_nan() || pivot < least {
            return None;
        }
        lower[c][c] = pivot.sqrt();
        for r in c + 1..N {
            let inner: f64 = (0..c).map(|k| lower[r][k] * lower[c][k]).sum();
            lower[r][c] = (matrix[r][c] - inner) / lower[c][c];
        }
    }
    Some(lower)
}

/// Inverse of a lower triangular matrix with a positive diagonal.
pub fn lower_inverse<const N: usize>(lower: &Matrix<N>) -> Matrix<N> {
    let mut inverse = [[0.0; N]; N];
    for c in 0..N {
        inverse[c][c] = 1.0 / lower[c][c];
        for r in c + 1..N {
            let inner: f64 = (c..r).map(|k| lower[r][k] * inverse[k][c]).sum();
            inverse[r][c] = -inner / lower[r][r];
        }
    }
    inverse
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix by Jacobi's rotations.
pub fn symmetric_eigen<const N: usize>(matrix: &Matrix<N>) -> (Vector<N>, Matrix<N>) {
    let mut a = *matrix;
    let mut vectors = [[0.0; N]; N];
    for k in 0..N {
        vectors[k][k] = 1.0;
    }
    // Convergence is quadratic: three rounds are usual at this size, the limit only guards the loop.
    for _ in 0..30 {
        let mut rotated = false;
        for p in 0..N {
            for q in p + 1..N {
                if a[p][q].abs() <= 1e-17 * (a[p][p].abs() + a[q][q].abs()) {
                    continue;
                }
                rotated = true;
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                for k in 0..N {
                    (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                }
                for row in &mut vectors {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                (a[p][q], a[q][p]) = (0.0, 0.0);
            }
        }
        if !rotated {
            break;
        }
    }
    (std::array::from_fn(|k| a[k][k]), vectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLE: Matrix<3> = [[4.0, 1.0, -0.5], [1.0, 3.0, 0.25], [-0.5, 0.25, 2.0]];

    fn product(x: &Matrix<3>, y: &Matrix<3>) -> Matrix<3> {
        std::array::from_fn(|r| std::array::from_fn(|c| dot(&x[r], &transposed(y)[c])))
    }

    fn assert_close(x: &Matrix<3>, y: &Matrix<3>) {
        for (r, s) in x.iter().flatten().zip(y.iter().flatten()) {
            assert!((r - s).abs() < 1e-14, "{x:?} is not {y:?}");
        }
    }

    #[test]
    fn cholesky_factor_multiplies_back() {
        let lower = cholesky(&SAMPLE, 0.0).unwrap();
        assert_close(&product(&lower, &transposed(&lower)), &SAMPLE);
        let identity = product(&lower, &lower_inverse(&lower));
        assert_close(
            &identity,
            &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        );
    }

    #[test]
    fn cholesky_refuses_an_indefinite_matrix() {
        assert!(cholesky(&[[1.0, 2.0], [2.0, 1.0]], 0.0).is_none());
    }

    #[test]
    fn eigenvectors_diagonalise() {
        let (values, vectors) = symmetric_eigen(&SAMPLE);
        let diagonal =
            std::array::from_fn(|r| std::array::from_fn(|c| if r == c { values[r] } else { 0.0 }));
        assert_close(
            &product(&product(&vectors, &diagonal), &transposed(&vectors)),
            &SAMPLE,
        );
    }
}
