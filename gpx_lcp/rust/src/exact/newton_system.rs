//! The operator p ↦ A p of a contact problem, and the linear systems of the Newton methods on it.
//!
//! Every Newton step of this folder is (I + E A) x = g with one small block E_i per contact: E = W² T in the interior
//! point, E = σ P' T in the proximal Newton method. It is solved
//!
//! * in impulse space as it stands, on the graph of contacts, where A is all there is;
//! * in velocity space, with A = Ĵ Ĵᵀ, as (I + Ĵᵀ E Ĵ) w = Ĵᵀ g, x = g − E Ĵ w, on the graph of bodies: smaller, and regular
//!   also where redundant contacts make A singular.
//!
//! Both are factored in blocks with the pivots kept inside fronts; iterative refinement on the original system repairs
//! what that costs. The pattern is analysed once per problem.

use std::time::{Duration, Instant};

use super::block_matrix::BlockMatrix;
use super::linear::BlockLu;
use super::order::{Contacts, Described};
use super::small::{Matrix, Vector, ZERO, largest, times};

/// A, as itself or as Ĵ with A = Ĵ Ĵᵀ.
#[derive(Clone)]
pub enum Operator {
    Impulse(BlockMatrix),
    Velocity(BlockMatrix),
}

impl Operator {
    pub fn contacts(&self) -> usize {
        self.matrix().block_rows()
    }

    pub fn rows(&self) -> usize {
        self.matrix().height
    }

    /// The same contacts in another order: contact i is what contact order[i] was.
    pub fn in_order(&self, order: &[u32]) -> Self {
        match self {
            Self::Impulse(a) => Self::Impulse(a.with_rows_and_columns(order)),
            Self::Velocity(factor) => Self::Velocity(factor.with_rows(order)),
        }
    }

    /// The contacts with their B and μ, to be compared.
    pub fn described<'a>(&'a self, b: &'a [f64], friction: &'a [f64]) -> Contacts<'a> {
        let matrix = self.matrix();
        Contacts::new(Described {
            starts: &matrix.starts,
            columns: &matrix.columns,
            values: &matrix.values,
            area: matrix.height * matrix.width,
            of_bodies: matches!(self, Self::Velocity(_)),
            b,
            friction,
        })
    }

    fn matrix(&self) -> &BlockMatrix {
        let (Self::Impulse(matrix) | Self::Velocity(matrix)) = self;
        matrix
    }

    /// The diagonal of A, contact by contact.
    pub fn diagonal(&self) -> Vec<Vector> {
        match self {
            Self::Impulse(a) => a.diagonal(),
            Self::Velocity(factor) => factor.squares_of_rows(),
        }
    }

    /// Multiplies A by a number.
    pub fn scale(&mut self, factor: f64) {
        let (matrix, factor) = match self {
            Self::Impulse(matrix) => (matrix, factor),
            Self::Velocity(matrix) => (matrix, factor.sqrt()),
        };
        matrix.values.iter_mut().for_each(|value| *value *= factor);
    }

    /// y = A p.
    pub fn apply(&self, p: &[Vector], y: &mut [Vector], scratch: &mut Vec<f64>) {
        match self {
            Self::Impulse(a) => {
                scratch.clear();
                p.iter()
                    .for_each(|part| scratch.extend_from_slice(&part[..a.height]));
                a.times(scratch, y);
            }
            Self::Velocity(factor) => {
                scratch.resize(factor.block_columns * factor.width, 0.0);
                factor.transpose_times(p, scratch);
                factor.times(scratch, y);
            }
        }
    }
}

/// The system (I + E A) x = g for one operator and changing E.
pub struct NewtonSystem<'a> {
    operator: &'a Operator,
    lu: BlockLu,
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
    /// Velocity space: for each contact, for each pair of its bodies, the index of their block in the pattern.
    targets: Vec<u32>,
    blocks: Vec<Matrix>,
    row_scale: Vec<f64>,
    vector: Vec<f64>,
    product: Vec<Vector>,
    residual: Vec<Vector>,
    scratch: Vec<f64>,
    pub factorisations: usize,
    /// What they took, with the assembly of their blocks.
    pub factor_time: Duration,
}

impl<'a> NewtonSystem<'a> {
    /// Analyses the pattern. The operator in impulse space must have a symmetric pattern with its diagonal present.
    pub fn new(operator: &'a Operator) -> Self {
        let contacts = operator.contacts();
        let (starts, columns, targets) = match operator {
            Operator::Impulse(a) => (a.starts.clone(), a.columns.clone(), Vec::new()),
            Operator::Velocity(factor) => body_graph(factor),
        };
        let block = operator.matrix().width;
        Self {
            operator,
            lu: BlockLu::new(&starts, &columns, block),
            values: vec![0.0; columns.len() * block * block],
            vector: vec![0.0; (starts.len() - 1) * block],
            starts,
            columns,
            targets,
            blocks: vec![[ZERO; 3]; contacts],
            row_scale: vec![1.0; contacts],
            product: vec![ZERO; contacts],
            residual: vec![ZERO; contacts],
            scratch: Vec::new(),
            factorisations: 0,
            factor_time: Duration::ZERO,
        }
    }

    /// How many sweeps of Gauss-Seidel cost as much as one Newton step, roughly.
    ///
    /// A factorisation does some four multiplications a nanosecond, a sweep one, and a contact takes 50 ns of its own.
    pub fn sweeps_per_step(&self) -> f64 {
        let matrix = self.operator.matrix();
        let passes = match self.operator {
            Operator::Impulse(_) => 1.0,
            Operator::Velocity(_) => 2.0,
        };
        let sweep = passes * matrix.values.len() as f64 + 50.0 * self.operator.contacts() as f64;
        let step = self.lu.work() / 4.0
            + 8.0 * self.values.len() as f64
            + 500.0 * self.operator.contacts() as f64;
        step / sweep
    }

    /// The sign of det(I + E A) as factored last, the same in both spaces: 1 or −1.
    pub fn determinant_sign(&self) -> f64 {
        self.lu.determinant_sign()
    }

    pub fn fill(&self) -> usize {
        self.lu.fill()
    }

    /// Whether I + E A with these blocks is what was factored last.
    pub fn is_factored(&self, blocks: &[Matrix]) -> bool {
        self.factorisations > 0 && self.blocks == blocks
    }

    /// Factors I + E A; `weight[i]` is the size of A_ii, used to balance the rows.
    ///
    /// The same blocks as the last time cost nothing.
    pub fn factor(&mut self, blocks: &[Matrix], weight: &[f64]) {
        if self.is_factored(blocks) {
            return;
        }
        let began = Instant::now();
        self.blocks.copy_from_slice(blocks);
        for ((scale, block), weight) in self.row_scale.iter_mut().zip(blocks).zip(weight) {
            *scale = 1.0 / (1.0 + largest(block.as_flattened()) * weight);
        }
        match self.operator {
            Operator::Impulse(a) => self.assemble_impulse(a),
            Operator::Velocity(factor) => self.assemble_velocity(factor),
        }
        self.lu.factor(&self.values);
        self.factorisations += 1;
        self.factor_time += began.elapsed();
    }

    fn assemble_impulse(&mut self, a: &BlockMatrix) {
        let rows = a.height;
        let area = rows * rows;
        for i in 0..a.block_rows() {
            let (e, scale) = (&self.blocks[i], self.row_scale[i]);
            for entry in self.starts[i]..self.starts[i + 1] {
                let source = &a.values[entry * area..][..area];
                let target = &mut self.values[entry * area..][..area];
                for (k, line) in target.chunks_exact_mut(rows).enumerate() {
                    for (l, value) in line.iter_mut().enumerate() {
                        *value = scale
                            * (0..rows)
                                .map(|m| e[k][m] * source[m * rows + l])
                                .sum::<f64>();
                    }
                }
                if self.columns[entry] as usize == i {
                    (0..rows).for_each(|k| target[k * (rows + 1)] += scale);
                }
            }
        }
    }

    fn assemble_velocity(&mut self, factor: &BlockMatrix) {
        match (factor.height, factor.width) {
            (3, 6) => self.assemble_sized::<3, 6>(factor),
            (2, 3) => self.assemble_sized::<2, 3>(factor),
            (3, 3) => self.assemble_sized::<3, 3>(factor),
            (2, 2) => self.assemble_sized::<2, 2>(factor),
            (1, 1) => self.assemble_sized::<1, 1>(factor),
            (1, 2) => self.assemble_sized::<1, 2>(factor),
            (1, 3) => self.assemble_sized::<1, 3>(factor),
            (1, 6) => self.assemble_sized::<1, 6>(factor),
            _ => self.assemble_any(factor),
        }
    }

    fn start_velocity(&mut self, width: usize) {
        self.values.fill(0.0);
        for node in 0..self.starts.len() - 1 {
            for entry in self.starts[node]..self.starts[node + 1] {
                if self.columns[entry] as usize == node {
                    (0..width)
                        .for_each(|k| self.values[entry * width * width + k * (width + 1)] = 1.0);
                }
            }
        }
    }

    fn assemble_sized<const R: usize, const D: usize>(&mut self, factor: &BlockMatrix) {
        self.start_velocity(D);
        let lines = factor.values.as_chunks::<D>().0;
        let values = self.values.as_chunks_mut::<D>().0;
        let mut target = self.targets.iter();
        for (range, e) in factor.starts.windows(2).zip(&self.blocks) {
            let blocks = lines[R * range[0]..R * range[1]].as_chunks::<R>().0;
            for left in blocks {
                // Ĵᵀ E of this body, D × R.
                let mut weighted = [[0.0; R]; D];
                for (d, line) in weighted.iter_mut().enumerate() {
                    for (r, value) in line.iter_mut().enumerate() {
                        *value = (0..R).map(|m| left[m][d] * e[m][r]).sum();
                    }
                }
                for right in blocks {
                    let at = *target.next().expect("one target for each pair") as usize * D;
                    for (sums, line) in values[at..at + D].iter_mut().zip(&weighted) {
                        for (value, right) in line.iter().zip(right) {
                            for c in 0..D {
                                sums[c] += value * right[c];
                            }
                        }
                    }
                }
            }
        }
    }

    fn assemble_any(&mut self, factor: &BlockMatrix) {
        let (rows, width) = (factor.height, factor.width);
        self.start_velocity(width);
        let mut target = self.targets.iter();
        for (i, e) in self.blocks.iter().enumerate() {
            for (_, left) in factor.row(i) {
                for (_, right) in factor.row(i) {
                    let at =
                        *target.next().expect("one target for each pair") as usize * width * width;
                    for d in 0..width {
                        for r in 0..rows {
                            let value: f64 = (0..rows).map(|m| left[m * width + d] * e[m][r]).sum();
                            for c in 0..width {
                                self.values[at + d * width + c] += value * right[r * width + c];
                            }
                        }
                    }
                }
            }
        }
    }

    /// x with (I + E A) x = g, refined until the residual no longer falls or is at rounding.
    pub fn solve(&mut self, g: &[Vector], x: &mut [Vector]) {
        self.refined(g, x);
    }

    /// The same with A x, which the last look at the residual has worked out.
    pub fn solve_with_image(&mut self, g: &[Vector], x: &mut [Vector]) -> &[Vector] {
        if !self.refined(g, x) {
            self.operator.apply(x, &mut self.product, &mut self.scratch);
        }
        &self.product
    }

    /// Returns whether `product` is A x.
    fn refined(&mut self, g: &[Vector], x: &mut [Vector]) -> bool {
        const REFINEMENTS: usize = 3;
        self.solve_once(g, x);
        let size = self.scaled_norm(g);
        let mut last = f64::INFINITY;
        for _ in 0..REFINEMENTS {
            self.operator.apply(x, &mut self.product, &mut self.scratch);
            let terms = self.blocks.iter().zip(&self.product).zip(g.iter().zip(&*x));
            for (residual, ((e, product), (g, x))) in self.residual.iter_mut().zip(terms) {
                let change = times(e, product);
                *residual = std::array::from_fn(|k| g[k] - x[k] - change[k]);
            }
            let left = self.scaled_norm(&self.residual);
            if !(left > 1e-13 * size && left < 0.5 * last) {
                return true;
            }
            last = left;
            let residual = std::mem::take(&mut self.residual);
            let mut correction = std::mem::take(&mut self.product);
            self.solve_once(&residual, &mut correction);
            for (value, change) in x.iter_mut().flatten().zip(correction.iter().flatten()) {
                *value += change;
            }
            self.residual = residual;
            self.product = correction;
        }
        false
    }

    fn scaled_norm(&self, field: &[Vector]) -> f64 {
        let sum =
            |(a, s): (&Vector, &f64)| s * s * a.iter().map(|value| value * value).sum::<f64>();
        field
            .iter()
            .zip(&self.row_scale)
            .map(sum)
            .sum::<f64>()
            .sqrt()
    }

    fn solve_once(&mut self, g: &[Vector], x: &mut [Vector]) {
        match self.operator {
            Operator::Impulse(a) => {
                for ((part, values), scale) in self
                    .vector
                    .chunks_exact_mut(a.height)
                    .zip(g)
                    .zip(&self.row_scale)
                {
                    part.iter_mut()
                        .zip(values)
                        .for_each(|(out, value)| *out = scale * value);
                }
                self.lu.solve(&mut self.vector);
                for (part, values) in self.vector.chunks_exact(a.height).zip(x) {
                    values[..a.height].copy_from_slice(part);
                }
            }
            Operator::Velocity(factor) => {
                factor.transpose_times(g, &mut self.vector);
                self.lu.solve(&mut self.vector);
                factor.times(&self.vector, x);
                for ((values, e), g) in x.iter_mut().zip(&self.blocks).zip(g) {
                    let change = times(e, values);
                    *values = [g[0] - change[0], g[1] - change[1], g[2] - change[2]];
                }
            }
        }
    }
}

/// The pattern of Ĵᵀ E Ĵ, and for each contact and pair of its bodies the place of their block in it.
fn body_graph(factor: &BlockMatrix) -> (Vec<usize>, Vec<u32>, Vec<u32>) {
    let mut rows: Vec<Vec<u32>> = (0..factor.block_columns).map(|i| vec![i as u32]).collect();
    for i in 0..factor.block_rows() {
        let bodies = &factor.columns[factor.starts[i]..factor.starts[i + 1]];
        for &a in bodies {
            rows[a as usize].extend(bodies);
        }
    }
    let mut starts = vec![0];
    let mut columns = Vec::new();
    for row in &mut rows {
        row.sort_unstable();
        row.dedup();
        columns.extend_from_slice(row);
        starts.push(columns.len());
    }
    let mut targets = Vec::new();
    for i in 0..factor.block_rows() {
        let bodies = &factor.columns[factor.starts[i]..factor.starts[i + 1]];
        for &a in bodies {
            for b in bodies {
                let place = rows[a as usize]
                    .binary_search(b)
                    .expect("the pattern holds every pair");
                targets.push((starts[a as usize] + place) as u32);
            }
        }
    }
    (starts, columns, targets)
}
