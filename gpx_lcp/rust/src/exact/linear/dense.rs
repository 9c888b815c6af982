//! Dense kernels on row-major storage: the partial LU factorisation of a front, and the triangular solves with it.
//!
//! Nearly all of the time of a Newton step is spent in `subtract_product`, so that this one function is also compiled for
//! processors with 256-bit fused multiply-add and chosen at run time.

/// Panel width of the right-looking factorisation; small enough that a panel of a large front stays in cache.
const PANEL: usize = 24;

/// Factors the first `pivots` columns of the `size` × `size` row-major matrix in place, F = P L U on these columns, and leaves
/// the Schur complement in the trailing block. Rows are exchanged among the first `pivots` rows only, since the others
/// are not yet assembled. `exchanges[k]` is the row exchanged with row k. A pivot below `floor` is replaced by ±`floor`;
/// returns how many were.
pub fn partial_lu(
    front: &mut [f64],
    size: usize,
    pivots: usize,
    floor: f64,
    exchanges: &mut [u32],
) -> usize {
    match size {
        1 => partial_lu_small::<1>(front, pivots, floor, exchanges),
        2 => partial_lu_small::<2>(front, pivots, floor, exchanges),
        3 => partial_lu_small::<3>(front, pivots, floor, exchanges),
        4 => partial_lu_small::<4>(front, pivots, floor, exchanges),
        6 => partial_lu_small::<6>(front, pivots, floor, exchanges),
        9 => partial_lu_small::<9>(front, pivots, floor, exchanges),
        12 => partial_lu_small::<12>(front, pivots, floor, exchanges),
        15 => partial_lu_small::<15>(front, pivots, floor, exchanges),
        18 => partial_lu_small::<18>(front, pivots, floor, exchanges),
        _ => partial_lu_in_panels(front, size, pivots, floor, exchanges),
    }
}

/// The same for a front so small that it is best updated row by row.
fn partial_lu_small<const N: usize>(
    front: &mut [f64],
    pivots: usize,
    floor: f64,
    exchanges: &mut [u32],
) -> usize {
    let rows = front.as_chunks_mut::<N>().0;
    let mut replaced = 0;
    for column in 0..pivots {
        let mut best = column;
        for row in column + 1..pivots {
            if rows[row][column].abs() > rows[best][column].abs() {
                best = row;
            }
        }
        exchanges[column] = best as u32;
        rows.swap(column, best);
        let pivot = &mut rows[column][column];
        if pivot.abs() < floor {
            *pivot = if *pivot < 0.0 { -floor } else { floor };
            replaced += 1;
        }
        let inverse = 1.0 / *pivot;
        // Zeros to the left leave what is known of L, so that whole rows can be updated.
        let mut above = rows[column];
        above[..=column].fill(0.0);
        for row in &mut rows[column + 1..] {
            let factor = row[column] * inverse;
            for (value, above) in row.iter_mut().zip(&above) {
                *value -= factor * above;
            }
            row[column] = factor;
        }
    }
    replaced
}

fn partial_lu_in_panels(
    front: &mut [f64],
    size: usize,
    pivots: usize,
    floor: f64,
    exchanges: &mut [u32],
) -> usize {
    let mut replaced = 0;
    let mut begin = 0;
    while begin < pivots {
        let end = (begin + PANEL).min(pivots);
        for column in begin..end {
            let mut best = column;
            let mut largest = front[column * size + column].abs();
            for row in column + 1..pivots {
                let value = front[row * size + column].abs();
                if value > largest {
                    (best, largest) = (row, value);
                }
            }
            exchanges[column] = best as u32;
            if best != column {
                let (upper, lower) = front.split_at_mut(best * size);
                upper[column * size..(column + 1) * size].swap_with_slice(&mut lower[..size]);
            }
            if largest < floor {
                let pivot = &mut front[column * size + column];
                *pivot = if *pivot < 0.0 { -floor } else { floor };
                replaced += 1;
            }
            let (upper, lower) = front.split_at_mut((column + 1) * size);
            let pivot_row = &upper[column * size..];
            let inverse = 1.0 / pivot_row[column];
            for row in lower.chunks_exact_mut(size) {
                let factor = row[column] * inverse;
                row[column] = factor;
                if factor != 0.0 {
                    for (value, &above) in row[column + 1..end]
                        .iter_mut()
                        .zip(&pivot_row[column + 1..end])
                    {
                        *value -= factor * above;
                    }
                }
            }
        }
        if end < size {
            // Rows begin..end, columns to the right of the panel: the unit lower triangle of the panel.
            for row in begin + 1..end {
                let (upper, lower) = front.split_at_mut(row * size);
                let (left, right) = lower[..size].split_at_mut(end);
                for k in begin..row {
                    let factor = left[k];
                    if factor != 0.0 {
                        for (value, &above) in
                            right.iter_mut().zip(&upper[k * size + end..(k + 1) * size])
                        {
                            *value -= factor * above;
                        }
                    }
                }
            }
            let (upper, lower) = front.split_at_mut(end * size);
            subtract_product(lower, &upper[begin * size..], size, begin, end);
        }
        begin = end;
    }
    replaced
}

/// C −= L U with all three inside one front: `lower` holds the rows below, whose columns begin..end are L and whose columns
/// from `end` on are C; `upper` holds the rows of U.
fn subtract_product(lower: &mut [f64], upper: &[f64], size: usize, begin: usize, end: usize) {
    #[cfg(target_arch = "x86_64")]
    if size - end >= 8
        && std::is_x86_feature_detected!("avx2")
        && std::is_x86_feature_detected!("fma")
    {
        // SAFETY: the processor has just been asked for both features.
        unsafe { subtract_product_fused(lower, upper, size, begin, end) };
        return;
    }
    subtract_product_with(lower, upper, size, begin, end, |a, b, c| c - a * b);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn subtract_product_fused(lower: &mut [f64], upper: &[f64], size: usize, begin: usize, end: usize) {
    subtract_product_with(lower, upper, size, begin, end, |a, b, c| (-a).mul_add(b, c));
}

#[inline(always)]
fn subtract_product_with(
    lower: &mut [f64],
    upper: &[f64],
    size: usize,
    begin: usize,
    end: usize,
    fused: impl Fn(f64, f64, f64) -> f64 + Copy,
) {
    const ROWS: usize = 4;
    const COLUMNS: usize = 8;
    let depth = end - begin;
    let mut quads = lower.chunks_exact_mut(ROWS * size);
    for rows in &mut quads {
        let mut factors = [[0.0; ROWS]; PANEL];
        for (k, factor) in factors[..depth].iter_mut().enumerate() {
            for (i, value) in factor.iter_mut().enumerate() {
                *value = rows[i * size + begin + k];
            }
        }
        let mut column = end;
        while column + COLUMNS <= size {
            let mut sums = [[0.0; COLUMNS]; ROWS];
            for (i, sum) in sums.iter_mut().enumerate() {
                sum.copy_from_slice(&rows[i * size + column..][..COLUMNS]);
            }
            for (factor, above) in factors[..depth].iter().zip(upper.chunks_exact(size)) {
                let above: &[f64; COLUMNS] = above[column..][..COLUMNS]
                    .try_into()
                    .expect("eight columns");
                for i in 0..ROWS {
                    for j in 0..COLUMNS {
                        sums[i][j] = fused(factor[i], above[j], sums[i][j]);
                    }
                }
            }
            for (i, sum) in sums.iter().enumerate() {
                rows[i * size + column..][..COLUMNS].copy_from_slice(sum);
            }
            column += COLUMNS;
        }
        for (i, row) in rows.chunks_exact_mut(size).enumerate() {
            for (factor, above) in factors[..depth].iter().zip(upper.chunks_exact(size)) {
                for (value, &other) in row[column..].iter_mut().zip(&above[column..size]) {
                    *value = fused(factor[i], other, *value);
                }
            }
        }
    }
    for row in quads.into_remainder().chunks_exact_mut(size) {
        let (left, right) = row.split_at_mut(end);
        for (&factor, above) in left[begin..].iter().zip(upper.chunks_exact(size)) {
            for (value, &other) in right.iter_mut().zip(&above[end..size]) {
                *value = fused(factor, other, *value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fixed, well-mixed sequence in [-1, 1].
    fn noise(count: usize) -> Vec<f64> {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        (0..count)
            .map(|_| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
            })
            .collect()
    }

    #[test]
    fn partial_lu_reproduces_the_front() {
        let small = [
            (1, 1),
            (2, 2),
            (3, 1),
            (4, 2),
            (6, 3),
            (9, 9),
            (12, 6),
            (15, 12),
            (18, 6),
        ];
        let large = [(7, 3), (40, 40), (61, 30), (75, 52)];
        for (size, pivots) in small.into_iter().chain(large) {
            let original = noise(size * size);
            let mut front = original.clone();
            let mut exchanges = vec![0; pivots];
            assert_eq!(
                partial_lu(&mut front, size, pivots, 1e-14, &mut exchanges),
                0
            );
            let mut expected = original;
            for (row, &other) in exchanges.iter().enumerate() {
                for column in 0..size {
                    expected.swap(row * size + column, other as usize * size + column);
                }
            }
            for i in 0..size {
                for j in 0..size {
                    // L U on the eliminated part, plus the Schur complement on the rest.
                    let depth = i.min(j + 1).min(pivots);
                    let mut value: f64 = (0..depth)
                        .map(|k| front[i * size + k] * front[k * size + j])
                        .sum();
                    if i <= j && i < pivots || i >= pivots && j >= pivots {
                        value += front[i * size + j];
                    }
                    assert!(
                        (value - expected[i * size + j]).abs() < 1e-11 * size as f64,
                        "{size} {pivots} {i} {j}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_vanishing_pivot_is_replaced_and_counted() {
        for size in [2, 5] {
            let mut front = vec![0.0; size * size];
            front[1..].fill(1.0);
            assert_eq!(partial_lu(&mut front, size, 1, 1e-8, &mut [0]), 1);
            assert!(front.iter().all(|value| value.is_finite()));
        }
    }
}
