//! Sparse matrices of small dense blocks, one row of blocks per contact, and products with them.

use std::ops::Range;

/// What is wrong with the arrays that describe a matrix.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ShapeError {
    #[error("{name} has length {found}: {needed} is needed")]
    Length {
        name: &'static str,
        found: usize,
        needed: usize,
    },
    #[error("{name}[{index}] is {found}: it must be below {limit}")]
    Index {
        name: &'static str,
        index: usize,
        found: usize,
        limit: usize,
    },
    #[error(
        "starts[{index}] is {found}: starts must not fall and must end at the number of blocks"
    )]
    Starts { index: usize, found: usize },
}

/// Blocks of `height` × `width` in CSR order; `values` holds them one after another, each row-major.
#[derive(Debug, Clone, Default)]
pub struct BlockMatrix {
    pub starts: Vec<usize>,
    pub columns: Vec<u32>,
    pub values: Vec<f64>,
    pub height: usize,
    pub width: usize,
    pub block_columns: usize,
}

impl BlockMatrix {
    /// Checks the arrays and makes the matrix.
    pub fn new(
        starts: Vec<usize>,
        columns: Vec<u32>,
        values: Vec<f64>,
        (height, width): (usize, usize),
        block_columns: usize,
    ) -> Result<Self, ShapeError> {
        if starts.first() != Some(&0) {
            return Err(ShapeError::Starts {
                index: 0,
                found: starts.first().copied().unwrap_or(0),
            });
        }
        for (index, pair) in starts.windows(2).enumerate() {
            if pair[0] > pair[1] {
                return Err(ShapeError::Starts {
                    index: index + 1,
                    found: pair[1],
                });
            }
        }
        let last = starts.len() - 1;
        if starts[last] != columns.len() {
            return Err(ShapeError::Starts {
                index: last,
                found: starts[last],
            });
        }
        let needed = columns.len() * height * width;
        if values.len() != needed {
            return Err(ShapeError::Length {
                name: "values",
                found: values.len(),
                needed,
            });
        }
        for (index, &column) in columns.iter().enumerate() {
            if column as usize >= block_columns {
                let found = column as usize;
                return Err(ShapeError::Index {
                    name: "columns",
                    index,
                    found,
                    limit: block_columns,
                });
            }
        }
        Ok(Self {
            starts,
            columns,
            values,
            height,
            width,
            block_columns,
        })
    }

    /// From a dense matrix of blocks of `size` rows and columns, row-major; blocks of zeros are left out.
    pub fn from_dense(values: &[f64], blocks: usize, size: usize) -> Self {
        let (length, mut result) = (blocks * size, Self::empty(size, size, blocks));
        for lines in values.chunks_exact((length * size).max(1)) {
            for j in 0..blocks {
                let block = || {
                    lines
                        .chunks_exact(length)
                        .map(|line| &line[j * size..][..size])
                };
                if block().flatten().any(|&value| value != 0.0) {
                    result.columns.push(j as u32);
                    block().for_each(|part| result.values.extend_from_slice(part));
                }
            }
            result.starts.push(result.columns.len());
        }
        result
    }

    /// A matrix of scalars by blocks of `size` rows and columns, which both numbers of scalars must be multiples of.
    pub fn in_blocks(&self, size: usize) -> Self {
        let mut result = Self::empty(size, size, self.block_columns / size);
        let mut place = vec![usize::MAX; result.block_columns];
        for scalars in (0..self.block_rows()).step_by(size) {
            let begin = result.columns.len();
            let range = self.starts[scalars]..self.starts[scalars + size];
            let columns = self.columns[range].iter();
            result.columns.extend(columns.map(|&j| j / size as u32));
            result.columns[begin..].sort_unstable();
            let mut kept = begin;
            for at in begin..result.columns.len() {
                let column = result.columns[at];
                if kept == begin || result.columns[kept - 1] != column {
                    result.columns[kept] = column;
                    place[column as usize] = kept;
                    kept += 1;
                }
            }
            result.columns.truncate(kept);
            result.values.resize(kept * size * size, 0.0);
            for line in 0..size {
                for (j, value) in self.row(scalars + line) {
                    let at = (place[j / size] * size + line) * size + j % size;
                    result.values[at] += value[0];
                }
            }
            result.starts.push(kept);
        }
        result
    }

    fn empty(height: usize, width: usize, block_columns: usize) -> Self {
        Self {
            starts: vec![0],
            columns: Vec::new(),
            values: Vec::new(),
            height,
            width,
            block_columns,
        }
    }

    /// The same block rows in another order: row i is what row order[i] was.
    pub fn with_rows(&self, order: &[u32]) -> Self {
        let area = self.height * self.width;
        let mut result = Self::empty(self.height, self.width, self.block_columns);
        result.columns.reserve_exact(self.columns.len());
        result.values.reserve_exact(self.values.len());
        for &row in order {
            let range = self.starts[row as usize]..self.starts[row as usize + 1];
            let values = &self.values[range.start * area..range.end * area];
            result.columns.extend_from_slice(&self.columns[range]);
            result.values.extend_from_slice(values);
            result.starts.push(result.columns.len());
        }
        result
    }

    /// The same square matrix with rows and columns in another order; columns ascend.
    pub fn with_rows_and_columns(&self, order: &[u32]) -> Self {
        let area = self.height * self.width;
        let mut place = vec![0; order.len()];
        for (to, &from) in order.iter().enumerate() {
            place[from as usize] = to as u32;
        }
        let mut result = self.with_rows(order);
        let mut blocks: Vec<(u32, usize)> = Vec::new();
        for row in result.starts.windows(2) {
            blocks.clear();
            let columns = result.columns[row[0]..row[1]].iter();
            blocks.extend(columns.map(|&j| place[j as usize]).zip(row[0]..));
            blocks.sort_unstable();
            let values: Vec<f64> = blocks
                .iter()
                .flat_map(|&(_, at)| &result.values[at * area..][..area])
                .copied()
                .collect();
            result.values[row[0] * area..row[1] * area].copy_from_slice(&values);
            for (column, &(j, _)) in result.columns[row[0]..row[1]].iter_mut().zip(&blocks) {
                *column = j;
            }
        }
        result
    }

    /// Takes another matrix of blocks of the same size in, below and beside this one.
    pub fn append(&mut self, other: &Self) {
        self.extend(other, self.block_columns);
    }

    /// Takes another matrix of blocks of the same size in, below this one and so many block columns to the right.
    pub fn extend(&mut self, other: &Self, columns: usize) {
        let blocks = self.columns.len();
        self.block_columns = self.block_columns.max(columns + other.block_columns);
        let starts = other.starts[1..].iter();
        self.starts.extend(starts.map(|start| start + blocks));
        let moved = other.columns.iter();
        self.columns
            .extend(moved.map(|column| column + columns as u32));
        self.values.extend_from_slice(&other.values);
    }

    pub fn block_rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// The blocks of one row: (column, values).
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, &[f64])> {
        let range = self.starts[row]..self.starts[row + 1];
        let area = self.height * self.width;
        let values = self.values[range.start * area..range.end * area].chunks_exact(area);
        self.columns[range]
            .iter()
            .map(|&column| column as usize)
            .zip(values)
    }

    /// The diagonal of a square matrix, by block rows.
    pub fn diagonal(&self) -> Vec<[f64; 3]> {
        let mut diagonal = vec![[0.0; 3]; self.block_rows()];
        for (i, entries) in diagonal.iter_mut().enumerate() {
            for (_, block) in self.row(i).filter(|&(j, _)| j == i) {
                (0..self.height).for_each(|k| entries[k] += block[k * self.width + k]);
            }
        }
        diagonal
    }

    /// The diagonal of H Hᵀ, by block rows.
    pub fn squares_of_rows(&self) -> Vec<[f64; 3]> {
        let mut squares = vec![[0.0; 3]; self.block_rows()];
        for (i, entries) in squares.iter_mut().enumerate() {
            for (_, block) in self.row(i) {
                for (entry, line) in entries.iter_mut().zip(block.chunks_exact(self.width)) {
                    *entry += line.iter().map(|value| value * value).sum::<f64>();
                }
            }
        }
        squares
    }

    /// H Hᵀ; columns ascend.
    pub fn times_its_transpose(&self) -> Self {
        let (rows, width) = (self.height, self.width);
        let area = rows * width;
        let mut users: Vec<Vec<(u32, usize)>> = vec![Vec::new(); self.block_columns];
        for i in 0..self.block_rows() {
            for place in self.starts[i]..self.starts[i + 1] {
                users[self.columns[place] as usize].push((i as u32, place));
            }
        }
        let mut result = Self::empty(rows, rows, self.block_rows());
        for i in 0..self.block_rows() {
            let own = self.starts[i]..self.starts[i + 1];
            let seen = self.columns[own.clone()].iter();
            let mut others: Vec<u32> = seen
                .flat_map(|&body| users[body as usize].iter().map(|user| user.0))
                .collect();
            others.sort_unstable();
            others.dedup();
            let begin = result.columns.len();
            result
                .values
                .resize((begin + others.len()) * rows * rows, 0.0);
            for place in own {
                let lines = self.values[place * area..][..area].chunks_exact(width);
                for &(j, other) in &users[self.columns[place] as usize] {
                    let at = begin + others.partition_point(|&column| column < j);
                    let entries = &mut result.values[at * rows * rows..][..rows * rows];
                    for (entries, line) in entries.chunks_exact_mut(rows).zip(lines.clone()) {
                        let against = self.values[other * area..][..area].chunks_exact(width);
                        for (entry, other) in entries.iter_mut().zip(against) {
                            *entry += line.iter().zip(other).map(|(x, y)| x * y).sum::<f64>();
                        }
                    }
                }
            }
            result.columns.extend(others);
            result.starts.push(result.columns.len());
        }
        result
    }

    /// The same matrix with columns of zeros at the end of each block, `width` of them in all.
    pub fn widened(&self, width: usize) -> Self {
        let mut result = Self {
            width,
            values: vec![0.0; self.columns.len() * self.height * width],
            ..self.clone()
        };
        let lines = self.values.chunks_exact(self.width);
        for (wide, line) in result.values.chunks_exact_mut(width).zip(lines) {
            wide[..self.width].copy_from_slice(line);
        }
        result
    }

    /// The same square matrix with the pattern made symmetric and every diagonal block present; columns ascend.
    pub fn with_symmetric_pattern(self) -> Self {
        let count = self.block_rows();
        let mut rows: Vec<Vec<u32>> = (0..count).map(|i| vec![i as u32]).collect();
        for i in 0..count {
            for &j in &self.columns[self.starts[i]..self.starts[i + 1]] {
                rows[i].push(j);
                rows[j as usize].push(i as u32);
            }
        }
        let area = self.height * self.width;
        let mut result = Self::empty(self.height, self.width, self.block_columns);
        for (i, mut row) in rows.into_iter().enumerate() {
            row.sort_unstable();
            row.dedup();
            let begin = result.columns.len();
            result.values.resize((begin + row.len()) * area, 0.0);
            for (j, block) in self.row(i) {
                let at = begin
                    + row
                        .binary_search(&(j as u32))
                        .expect("the union holds every block");
                for (sum, value) in result.values[at * area..][..area].iter_mut().zip(block) {
                    *sum += value;
                }
            }
            result.columns.extend(row);
            result.starts.push(result.columns.len());
        }
        result
    }

    /// w = Hᵀ p for p with `height` scalars per block row; w has `width` per block column.
    pub fn gather(&self, p: &[f64], w: &mut Vec<f64>) {
        w.clear();
        w.resize(self.block_columns * self.width, 0.0);
        match (self.height, self.width) {
            (3, 6) => self.gather_sized::<3, 6>(p, w),
            (1, 6) => self.gather_sized::<1, 6>(p, w),
            (3, 3) => self.gather_sized::<3, 3>(p, w),
            (1, 3) => self.gather_sized::<1, 3>(p, w),
            (height, width) => {
                for (i, values) in p.chunks_exact(height).enumerate() {
                    for (j, block) in self.row(i) {
                        let state = &mut w[j * width..][..width];
                        for (value, line) in values.iter().zip(block.chunks_exact(width)) {
                            for (sum, entry) in state.iter_mut().zip(line) {
                                *sum += value * entry;
                            }
                        }
                    }
                }
            }
        }
    }

    fn gather_sized<const R: usize, const D: usize>(&self, p: &[f64], w: &mut [f64]) {
        let (lines, states) = (self.values.as_chunks::<D>().0, w.as_chunks_mut::<D>().0);
        for (i, values) in p.as_chunks::<R>().0.iter().enumerate() {
            for block in self.starts[i]..self.starts[i + 1] {
                let lines = &lines[block * R..][..R];
                let state = &mut states[self.columns[block] as usize];
                // Added up first: the state may still be on its way from the row before.
                for d in 0..D {
                    let mut sum = values[0] * lines[0][d];
                    for r in 1..R {
                        sum += values[r] * lines[r][d];
                    }
                    state[d] += sum;
                }
            }
        }
    }

    /// The same, and what each sum loses to rounding is added in the end: terms that cancel in pairs leave nothing, whatever
    /// order they come in. So impulses that mirror each other cancel to the last bit, and what moves in a plane stays in it:
    /// presolve, which solves in that plane, looks for it again in every step.
    ///
    /// Source: T. Ogita, S. M. Rump, S. Oishi, *Accurate sum and dot product*, SIAM J. Sci. Comput. 26 (2005), algorithm
    /// Sum2, of rounded products.
    pub fn gather_compensated(&self, p: &[f64], w: &mut Vec<f64>) {
        w.clear();
        w.resize(self.block_columns * self.width, 0.0);
        let mut lost = vec![0.0; w.len()];
        // The same code each time, made for blocks of this size.
        match (self.height, self.width) {
            (3, 6) => self.add_compensated(3, 6, p, w, &mut lost),
            (1, 6) => self.add_compensated(1, 6, p, w, &mut lost),
            (1, 3) => self.add_compensated(1, 3, p, w, &mut lost),
            (height, width) => self.add_compensated(height, width, p, w, &mut lost),
        }
        w.iter_mut().zip(lost).for_each(|(sum, lost)| *sum += lost);
    }

    #[inline(always)]
    fn add_compensated(
        &self,
        height: usize,
        width: usize,
        p: &[f64],
        w: &mut [f64],
        lost: &mut [f64],
    ) {
        for (i, values) in p.chunks_exact(height).enumerate() {
            for (j, block) in self.row(i) {
                let sums = &mut w[j * width..][..width];
                let lost = &mut lost[j * width..][..width];
                for (value, line) in values.iter().zip(block.chunks_exact(width)) {
                    for d in 0..width {
                        let (before, term) = (sums[d], value * line[d]);
                        let sum = before + term;
                        let added = sum - before;
                        lost[d] += (before - (sum - added)) + (term - added);
                        sums[d] = sum;
                    }
                }
            }
        }
    }

    /// u = H w - b of these block rows, `height` scalars each.
    pub fn spread(&self, rows: Range<usize>, w: &[f64], b: &[f64], u: &mut [f64]) {
        for (value, b) in u.iter_mut().zip(b) {
            *value = -b;
        }
        match (self.height, self.width) {
            (3, 6) => self.spread_sized::<3, 6>(rows, w, u),
            (1, 6) => self.spread_sized::<1, 6>(rows, w, u),
            (3, 3) => self.spread_sized::<3, 3>(rows, w, u),
            (1, 3) => self.spread_sized::<1, 3>(rows, w, u),
            (height, width) => {
                for (i, sums) in rows.zip(u.chunks_exact_mut(height)) {
                    for (j, block) in self.row(i) {
                        let state = &w[j * width..][..width];
                        for (sum, line) in sums.iter_mut().zip(block.chunks_exact(width)) {
                            *sum += line.iter().zip(state).map(|(x, y)| x * y).sum::<f64>();
                        }
                    }
                }
            }
        }
    }

    fn spread_sized<const R: usize, const D: usize>(
        &self,
        rows: Range<usize>,
        w: &[f64],
        u: &mut [f64],
    ) {
        let (lines, states) = (self.values.as_chunks::<D>().0, w.as_chunks::<D>().0);
        for (i, sums) in rows.zip(u.as_chunks_mut::<R>().0) {
            for block in self.starts[i]..self.starts[i + 1] {
                let state = &states[self.columns[block] as usize];
                for (sum, line) in sums.iter_mut().zip(&lines[block * R..][..R]) {
                    // Two sums side by side, rather than one that waits for itself.
                    let mut two = [0.0; 2];
                    for d in 0..D {
                        two[d % 2] += line[d] * state[d];
                    }
                    *sum += two[0] + two[1];
                }
            }
        }
    }

    /// y = H x for x with `width` scalars per block column; y has three per block row, the missing ones zero.
    pub fn times(&self, x: &[f64], y: &mut [[f64; 3]]) {
        match (self.height, self.width) {
            (3, 3) => self.times_sized::<3, 3>(x, y),
            (3, 6) => self.times_sized::<3, 6>(x, y),
            (2, 2) => self.times_sized::<2, 2>(x, y),
            (2, 3) => self.times_sized::<2, 3>(x, y),
            (1, 1) => self.times_sized::<1, 1>(x, y),
            (1, 2) => self.times_sized::<1, 2>(x, y),
            (1, 3) => self.times_sized::<1, 3>(x, y),
            (1, 6) => self.times_sized::<1, 6>(x, y),
            _ => {
                for (i, out) in y.iter_mut().enumerate() {
                    *out = [0.0; 3];
                    for (j, block) in self.row(i) {
                        for (value, line) in out.iter_mut().zip(block.chunks_exact(self.width)) {
                            *value += line
                                .iter()
                                .zip(&x[j * self.width..])
                                .map(|(a, b)| a * b)
                                .sum::<f64>();
                        }
                    }
                }
            }
        }
    }

    fn times_sized<const R: usize, const D: usize>(&self, x: &[f64], y: &mut [[f64; 3]]) {
        let (lines, parts) = (self.values.as_chunks::<D>().0, x.as_chunks::<D>().0);
        for (range, out) in self.starts.windows(2).zip(y) {
            let mut sums = [0.0; 3];
            for block in range[0]..range[1] {
                let part = &parts[self.columns[block] as usize];
                for (sum, line) in sums.iter_mut().zip(&lines[block * R..][..R]) {
                    *sum += (0..D).map(|d| line[d] * part[d]).sum::<f64>();
                }
            }
            *out = sums;
        }
    }

    /// x = Hᵀ y.
    pub fn transpose_times(&self, y: &[[f64; 3]], x: &mut [f64]) {
        x.fill(0.0);
        match (self.height, self.width) {
            (3, 3) => self.transpose_times_sized::<3, 3>(y, x),
            (3, 6) => self.transpose_times_sized::<3, 6>(y, x),
            (2, 2) => self.transpose_times_sized::<2, 2>(y, x),
            (2, 3) => self.transpose_times_sized::<2, 3>(y, x),
            (1, 1) => self.transpose_times_sized::<1, 1>(y, x),
            (1, 2) => self.transpose_times_sized::<1, 2>(y, x),
            (1, 3) => self.transpose_times_sized::<1, 3>(y, x),
            (1, 6) => self.transpose_times_sized::<1, 6>(y, x),
            _ => {
                for (i, values) in y.iter().enumerate() {
                    for (j, block) in self.row(i) {
                        for (value, line) in values.iter().zip(block.chunks_exact(self.width)) {
                            for (sum, entry) in x[j * self.width..].iter_mut().zip(line) {
                                *sum += value * entry;
                            }
                        }
                    }
                }
            }
        }
    }

    fn transpose_times_sized<const R: usize, const D: usize>(&self, y: &[[f64; 3]], x: &mut [f64]) {
        let (lines, sums) = (self.values.as_chunks::<D>().0, x.as_chunks_mut::<D>().0);
        for (range, values) in self.starts.windows(2).zip(y) {
            for block in range[0]..range[1] {
                let sum = &mut sums[self.columns[block] as usize];
                for (value, line) in values.iter().zip(&lines[block * R..][..R]) {
                    for d in 0..D {
                        sum[d] += value * line[d];
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_index_names_itself() {
        let error = BlockMatrix::new(vec![0, 1], vec![4], vec![0.0; 9], (3, 3), 2).unwrap_err();
        assert_eq!(error.to_string(), "columns[0] is 4: it must be below 2");
        let error = BlockMatrix::new(vec![0, 1], vec![1], vec![0.0; 8], (3, 3), 2).unwrap_err();
        assert_eq!(error.to_string(), "values has length 8: 9 is needed");
        let error = BlockMatrix::new(vec![0, 2], vec![1], vec![0.0; 9], (3, 3), 2).unwrap_err();
        assert!(error.to_string().contains("starts[1] is 2"));
    }

    #[test]
    fn symmetric_pattern_keeps_the_values() {
        let matrix = BlockMatrix::new(vec![0, 1, 1], vec![1], vec![2.0], (1, 1), 2)
            .unwrap()
            .with_symmetric_pattern();
        assert_eq!(matrix.columns, [0, 1, 0, 1]);
        assert_eq!(matrix.values, [0.0, 2.0, 0.0, 0.0]);
    }

    #[test]
    fn a_matrix_times_its_transpose_is_what_two_products_give() {
        let (starts, columns) = (vec![0, 3, 4, 6], vec![0, 1, 2, 1, 2, 0]);
        let values: Vec<f64> = (0..24).map(|k| (k % 7) as f64 - 3.0).collect();
        let h = BlockMatrix::new(starts, columns, values, (2, 2), 3).unwrap();
        let a = h.times_its_transpose();
        assert_eq!(a.starts, [0, 3, 5, 7]);
        assert_eq!(a.columns, [0, 1, 2, 0, 1, 0, 2]);
        let p = [1.0, -2.0, 0.5, 3.0, -1.0, 4.0];
        let (mut w, mut u, mut product) = (Vec::new(), [0.0; 6], vec![[0.0; 3]; 3]);
        h.gather(&p, &mut w);
        h.spread(0..h.block_rows(), &w, &[0.0; 6], &mut u);
        a.times(&p, &mut product);
        let product: Vec<f64> = product.iter().flat_map(|u| &u[..2]).copied().collect();
        assert_eq!(product, u);
        assert_eq!(a.diagonal(), h.squares_of_rows());
        assert_eq!(h.widened(5).times_its_transpose().values, a.values);
    }

    #[test]
    fn blocks_of_scalars_and_of_a_dense_matrix_are_the_same() {
        let mut dense = [0.0; 36];
        for (at, value) in [
            (0, 1.0),
            (7, 2.0),
            (5, 3.0),
            (23, 4.0),
            (28, 5.0),
            (32, 6.0),
        ] {
            dense[at] = value;
        }
        let filled = |row: usize| (0..6).filter(move |column| dense[6 * row + column] != 0.0);
        let (mut starts, mut columns, mut values) = (vec![0], vec![], vec![]);
        for row in 0..6 {
            columns.extend(filled(row).map(|column| column as u32));
            values.extend(filled(row).map(|column| dense[6 * row + column]));
            starts.push(columns.len());
        }
        let scalars = BlockMatrix::new(starts, columns, values, (1, 1), 6).unwrap();
        let (one, other) = (scalars.in_blocks(3), BlockMatrix::from_dense(&dense, 2, 3));
        assert_eq!(one.starts, other.starts);
        assert_eq!(one.columns, other.columns);
        assert_eq!(one.values, other.values);
        assert_eq!(one.columns, [0, 1, 0, 1]);
    }

    #[test]
    fn terms_that_cancel_leave_nothing_in_a_compensated_product() {
        // Moments of four mirrored impulses, in an order in which a plain sum leaves 2⁻⁵⁵.
        let values = vec![0.1, 0.2, -0.1, -0.2];
        let h = BlockMatrix::new(vec![0, 1, 2, 3, 4], vec![0; 4], values, (1, 1), 1).unwrap();
        let (mut plain, mut compensated) = (Vec::new(), Vec::new());
        h.gather(&[1.0; 4], &mut plain);
        h.gather_compensated(&[1.0; 4], &mut compensated);
        assert!(plain[0] != 0.0);
        assert_eq!(compensated, [0.0]);
        h.gather_compensated(&[1.0, 2.0, 3.0, 4.0], &mut compensated);
        assert!((compensated[0] + 0.6).abs() < 1e-15);
    }

    #[test]
    fn products_agree_with_each_other() {
        let shapes = [
            (1, 1),
            (1, 2),
            (1, 3),
            (1, 6),
            (2, 2),
            (2, 3),
            (3, 3),
            (3, 6),
        ];
        // The last one has no code of its own.
        for (height, width) in shapes.into_iter().chain([(2, 5)]) {
            let area = height * width;
            let values: Vec<f64> = (0..3 * area).map(|k| (k % 7) as f64 - 3.0).collect();
            let (starts, columns) = (vec![0, 1, 3], vec![1, 0, 1]);
            let matrix = BlockMatrix::new(starts, columns, values, (height, width), 2).unwrap();
            let x: Vec<f64> = (0..2 * width).map(|k| k as f64).collect();
            let mut y = [[1.0, -2.0, 0.5], [0.0, 3.0, 1.0]];
            y.iter_mut().for_each(|part| part[height..].fill(0.0));
            let (mut forward, mut back) = ([[7.0; 3]; 2], vec![7.0; 2 * width]);
            matrix.times(&x, &mut forward);
            matrix.transpose_times(&y, &mut back);
            let (forward, y) = (forward.as_flattened(), y.as_flattened());
            let left: f64 = forward.iter().zip(y).map(|(a, b)| a * b).sum();
            let right: f64 = back.iter().zip(&x).map(|(a, b)| a * b).sum();
            assert!((left - right).abs() < 1e-12, "{height} {width}");
        }
    }
}
