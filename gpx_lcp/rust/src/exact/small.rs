//! Vectors and matrices of one contact: normal first, then the tangents; missing rows are zero.

pub type Vector = [f64; 3];
pub type Matrix = [[f64; 3]; 3];

pub const ZERO: Vector = [0.0; 3];
pub const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

pub fn dot(a: &Vector, b: &Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// ‖a_t‖, the length of the tangential part.
pub fn tangent_norm(a: &Vector) -> f64 {
    (a[1] * a[1] + a[2] * a[2]).sqrt()
}

pub fn times(m: &Matrix, a: &Vector) -> Vector {
    [dot(&m[0], a), dot(&m[1], a), dot(&m[2], a)]
}

pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let mut result = [ZERO; 3];
    for (line, row) in result.iter_mut().zip(a) {
        for (j, value) in line.iter_mut().enumerate() {
            *value = row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j];
        }
    }
    result
}

/// The largest size of an entry; what is no number does not count.
pub fn largest(values: &[f64]) -> f64 {
    // Four at a time, rather than each waiting for the one before.
    let (fours, rest) = values.as_chunks::<4>();
    let mut most = [0.0_f64; 4];
    for four in fours {
        for k in 0..4 {
            let value = four[k].abs();
            most[k] = if value > most[k] { value } else { most[k] };
        }
    }
    let all = most.iter().chain(rest);
    all.fold(0.0, |most, value| most.max(value.abs()))
}

/// The 2-norm of a whole field of contact vectors.
pub fn norm(field: &[Vector]) -> f64 {
    field.iter().map(|a| dot(a, a)).sum::<f64>().sqrt()
}
