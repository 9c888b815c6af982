//! Sparse LU of a matrix of dense blocks with a symmetric pattern and nonsymmetric values.
//!
//! Pivots are sought inside a front only (never across fronts), so that the symbolic part is made once for a pattern and
//! serves every Newton step. Too small a pivot is replaced, and counted; the caller refines the solution iteratively.

use super::super::small::largest;
use super::dense::partial_lu;
use super::symbolic::Symbolic;

/// The factorisation; `new` analyses a pattern, `factor` may be called any number of times with other values.
pub struct BlockLu {
    block: usize,
    symbolic: Symbolic,
    /// The pivot rows of each front, width × size, then the rows below, (size − width) × width; in scalars, row-major.
    factors: Vec<f64>,
    offsets: Vec<usize>,
    /// 1/pivot, by which a solve multiplies: one division would have to wait for the other.
    inverses: Vec<f64>,
    exchanges: Vec<u32>,
    front: Vec<f64>,
    /// Where nodes stand in the front.
    local: Vec<u32>,
    /// Schur complements that wait for their parents, a stack.
    stack: Vec<f64>,
    permuted: Vec<f64>,
    gathered: Vec<f64>,
}

impl BlockLu {
    /// Analyses a pattern of nodes in CSR form (structurally symmetric, every diagonal entry present) with `block` scalars
    /// per node.
    pub fn new(starts: &[usize], columns: &[u32], block: usize) -> Self {
        let symbolic = Symbolic::new(starts, columns, block);
        let mut offsets = vec![0];
        let mut largest = 0;
        for supernode in &symbolic.supernodes {
            let (width, size) = (supernode.width() * block, supernode.size() * block);
            offsets.push(offsets[offsets.len() - 1] + width * (2 * size - width));
            largest = largest.max(size);
        }
        let scalars = (starts.len() - 1) * block;
        Self {
            block,
            factors: vec![0.0; offsets[offsets.len() - 1]],
            offsets,
            inverses: vec![0.0; scalars],
            exchanges: vec![0; scalars],
            front: vec![0.0; largest * largest],
            local: vec![0; symbolic.position.len()],
            stack: Vec::new(),
            permuted: vec![0.0; scalars],
            gathered: vec![0.0; largest],
            symbolic,
        }
    }

    /// The number of values in the factors.
    pub fn fill(&self) -> usize {
        self.factors.len()
    }

    /// The multiplications of one factorisation, roughly.
    pub fn work(&self) -> f64 {
        let front = |supernode: &super::symbolic::Supernode| {
            let (width, size) = (
                supernode.width() * self.block,
                supernode.size() * self.block,
            );
            (width * size * size) as f64
        };
        self.symbolic.supernodes.iter().map(front).sum()
    }

    /// Factors the matrix whose blocks are given in the order of the pattern, each block row-major. Returns the number of
    /// pivots that had to be replaced.
    pub fn factor(&mut self, values: &[f64]) -> usize {
        // The same code each time, made for blocks of this size.
        match self.block {
            1 => self.factor_blocks(1, values),
            2 => self.factor_blocks(2, values),
            3 => self.factor_blocks(3, values),
            6 => self.factor_blocks(6, values),
            block => self.factor_blocks(block, values),
        }
    }

    #[inline(always)]
    fn factor_blocks(&mut self, block: usize, values: &[f64]) -> usize {
        let area = block * block;
        let floor = (1e-15 * largest(values)).max(f64::MIN_POSITIVE.sqrt());
        let mut replaced = 0;
        self.stack.clear();
        let supernodes = &self.symbolic.supernodes;
        // (supernode, start in the stack) of the Schur complements not yet assembled.
        let mut waiting: Vec<(usize, usize)> = Vec::new();
        let local = &mut self.local;
        for (index, supernode) in supernodes.iter().enumerate() {
            let (width, size) = (supernode.width() * block, supernode.size() * block);
            let front = &mut self.front[..size * size];
            front.fill(0.0);
            for &(entry, row, column) in &supernode.entries {
                let source = &values[entry as usize * area..][..area];
                for (k, line) in source.chunks_exact(block).enumerate() {
                    front[(row as usize * block + k) * size + column as usize * block..][..block]
                        .copy_from_slice(line);
                }
            }
            (supernode.first..supernode.last)
                .for_each(|at| local[at] = (at - supernode.first) as u32);
            for (k, &row) in supernode.below.iter().enumerate() {
                local[row as usize] = (supernode.width() + k) as u32;
            }
            while let Some(&(child, start)) = waiting.last() {
                if supernodes[child].parent != Some(index) {
                    break;
                }
                let below = &supernodes[child].below;
                let child_size = below.len() * block;
                for (i, &row) in below.iter().enumerate() {
                    for k in 0..block {
                        let target = (local[row as usize] as usize * block + k) * size;
                        let source = start + (i * block + k) * child_size;
                        for (j, &column) in below.iter().enumerate() {
                            let to = target + local[column as usize] as usize * block;
                            let from = source + j * block;
                            for (value, &add) in front[to..to + block]
                                .iter_mut()
                                .zip(&self.stack[from..from + block])
                            {
                                *value += add;
                            }
                        }
                    }
                }
                self.stack.truncate(start);
                waiting.pop();
            }
            let exchanges = &mut self.exchanges[supernode.first * block..supernode.last * block];
            replaced += partial_lu(front, size, width, floor, exchanges);
            let stored = &mut self.factors[self.offsets[index]..self.offsets[index + 1]];
            let (upper, lower) = stored.split_at_mut(width * size);
            upper.copy_from_slice(&front[..width * size]);
            let inverses = self.inverses[supernode.first * block..].iter_mut();
            for (k, inverse) in inverses.take(width).enumerate() {
                *inverse = 1.0 / upper[k * (size + 1)];
            }
            if size > width {
                waiting.push((index, self.stack.len()));
                for (row, line) in front.chunks_exact(size).skip(width).enumerate() {
                    lower[row * width..(row + 1) * width].copy_from_slice(&line[..width]);
                    self.stack.extend_from_slice(&line[width..]);
                }
            }
        }
        replaced
    }

    /// The sign of the determinant of the matrix factored last, 1 or −1.
    pub fn determinant_sign(&self) -> f64 {
        let mut negative = false;
        for (index, supernode) in self.symbolic.supernodes.iter().enumerate() {
            let (width, size) = (
                supernode.width() * self.block,
                supernode.size() * self.block,
            );
            let first = supernode.first * self.block;
            for k in 0..width {
                negative ^= self.factors[self.offsets[index] + k * (size + 1)] < 0.0;
                negative ^= self.exchanges[first + k] as usize != k;
            }
        }
        if negative { -1.0 } else { 1.0 }
    }

    /// Solves with the last factorisation, in place; `vector` is in the caller's order of nodes.
    pub fn solve(&mut self, vector: &mut [f64]) {
        // Blocks of known size are held in registers; of any other size, they are taken for ones of a single scalar.
        match self.block {
            2 => self.solve_blocks::<2>(vector),
            3 => self.solve_blocks::<3>(vector),
            6 => self.solve_blocks::<6>(vector),
            _ => self.solve_blocks::<1>(vector),
        }
    }

    fn solve_blocks<const B: usize>(&mut self, vector: &mut [f64]) {
        // Blocks of B to a node.
        let each = self.block / B;
        let Symbolic {
            position,
            supernodes,
        } = &self.symbolic;
        let permuted = self.permuted.as_chunks_mut::<B>().0;
        let factors = self.factors.as_chunks::<B>().0;
        let inverses = self.inverses.as_chunks::<B>().0;
        let vector = vector.as_chunks_mut::<B>().0;
        for (&at, values) in position.iter().zip(vector.chunks_exact(each)) {
            permuted[at as usize * each..][..each].copy_from_slice(values);
        }
        for (supernode, range) in supernodes.iter().zip(self.offsets.windows(2)) {
            let (width, size, first) = (
                supernode.width() * each,
                supernode.size() * each,
                supernode.first * each,
            );
            let (upper, lower) = factors[range[0] / B..range[1] / B].split_at(width * B * size);
            let (_, tail) = permuted.split_at_mut(first);
            let (pivots, rest) = tail.split_at_mut(width);
            let exchanges = &self.exchanges[first * B..][..width * B];
            for (k, &other) in exchanges.iter().enumerate() {
                // Seldom, and what was stored last would be waited for.
                if other as usize != k {
                    pivots.as_flattened_mut().swap(k, other as usize);
                }
            }
            for j in 0..width {
                let mut own = pivots[j];
                let lines = &upper[j * B * size..][..B * size];
                for k in 0..B {
                    let line = &lines[k * size..][..size];
                    for (factors, known) in line.iter().zip(&pivots[..j]) {
                        own[k] -= dot(factors, known);
                    }
                    for l in 0..k {
                        own[k] -= line[j][l] * own[l];
                    }
                }
                pivots[j] = own;
            }
            let mut lines = lower.chunks_exact(width);
            for &row in &supernode.below {
                for values in &mut rest[row as usize * each - first - width..][..each] {
                    for (value, line) in values.iter_mut().zip(&mut lines) {
                        for (factors, known) in line.iter().zip(&*pivots) {
                            *value -= dot(factors, known);
                        }
                    }
                }
            }
        }
        for (supernode, &offset) in supernodes.iter().zip(&self.offsets).rev() {
            let (width, size, first) = (
                supernode.width() * each,
                supernode.size() * each,
                supernode.first * each,
            );
            let upper = &factors[offset / B..][..width * B * size];
            let gathered = self.gathered.as_chunks_mut::<B>().0;
            let gathered = &mut gathered[..size - width];
            for (&row, values) in supernode.below.iter().zip(gathered.chunks_exact_mut(each)) {
                values.copy_from_slice(&permuted[row as usize * each..][..each]);
            }
            let pivots = &mut permuted[first..first + width];
            for j in (0..width).rev() {
                let mut own = pivots[j];
                let lines = &upper[j * B * size..][..B * size];
                for k in (0..B).rev() {
                    let line = &lines[k * size..][..size];
                    let (line, beyond) = line.split_at(width);
                    for (factors, known) in beyond.iter().zip(&*gathered) {
                        own[k] -= dot(factors, known);
                    }
                    for (factors, known) in line[j + 1..].iter().zip(&pivots[j + 1..]) {
                        own[k] -= dot(factors, known);
                    }
                    for l in k + 1..B {
                        own[k] -= line[j][l] * own[l];
                    }
                    own[k] *= inverses[first + j][k];
                }
                pivots[j] = own;
            }
        }
        for (&at, values) in position.iter().zip(vector.chunks_exact_mut(each)) {
            values.copy_from_slice(&permuted[at as usize * each..][..each]);
        }
    }
}

#[inline(always)]
fn dot<const B: usize>(a: &[f64; B], b: &[f64; B]) -> f64 {
    (0..B).map(|k| a[k] * b[k]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring of nodes with chords, diagonally dominant blocks, values that are not symmetric.
    fn example(nodes: usize, block: usize) -> (Vec<usize>, Vec<u32>, Vec<f64>) {
        let mut starts = vec![0];
        let mut columns = Vec::new();
        let mut values = Vec::new();
        for i in 0..nodes {
            let mut row: Vec<usize> =
                vec![i, (i + 1) % nodes, (i + nodes - 1) % nodes, nodes - 1 - i];
            row.sort_unstable();
            row.dedup();
            for &j in &row {
                columns.push(j as u32);
                for k in 0..block * block {
                    let noise = ((i * 31 + j * 17 + k * 7) % 23) as f64 / 23.0 - 0.4;
                    values.push(if i == j && k % (block + 1) == 0 {
                        4.0 * block as f64
                    } else {
                        noise
                    });
                }
            }
            starts.push(columns.len());
        }
        (starts, columns, values)
    }

    #[test]
    fn solves_to_machine_precision_and_twice_with_one_analysis() {
        for (nodes, block) in [(1, 3), (5, 6), (60, 3), (40, 1), (150, 2), (30, 4)] {
            let (starts, columns, mut values) = example(nodes, block);
            let mut lu = BlockLu::new(&starts, &columns, block);
            for _ in 0..2 {
                assert_eq!(lu.factor(&values), 0);
                let solution: Vec<f64> = (0..nodes * block).map(|i| (i as f64).sin()).collect();
                let mut vector = vec![0.0; nodes * block];
                for i in 0..nodes {
                    for entry in starts[i]..starts[i + 1] {
                        for k in 0..block * block {
                            let (row, column) = (
                                i * block + k / block,
                                columns[entry] as usize * block + k % block,
                            );
                            vector[row] += values[entry * block * block + k] * solution[column];
                        }
                    }
                }
                lu.solve(&mut vector);
                let error = vector
                    .iter()
                    .zip(&solution)
                    .fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
                assert!(error < 1e-12, "{nodes} {block}: {error}");
                values.iter_mut().for_each(|value| *value *= 1.5);
            }
        }
    }

    #[test]
    fn a_chain_has_fill_proportional_to_its_length() {
        let chain = |nodes: u32| {
            let mut starts = vec![0];
            let mut columns = Vec::new();
            for i in 0..nodes {
                columns.extend(i.saturating_sub(1)..(i + 2).min(nodes));
                starts.push(columns.len());
            }
            BlockLu::new(&starts, &columns, 6).fill()
        };
        assert!(chain(1000) < 11 * chain(100));
    }
}
