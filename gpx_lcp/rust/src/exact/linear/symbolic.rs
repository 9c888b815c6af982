//! What a factorisation can know before it sees a number: order, elimination tree, supernodes and where each block goes.
//!
//! Source: J. Liu, *The multifrontal method for sparse matrix solution*, SIAM Review 34 (1992). A supernode is a run of
//! columns with the same structure below; small ones are merged with their parent (relaxed amalgamation), which trades a
//! few stored zeros for dense kernels of a useful size.

use super::ordering::minimum_degree;

/// Columns first..last (in elimination order) with the rows below them.
pub struct Supernode {
    pub first: usize,
    pub last: usize,
    /// The rows below the pivots, in elimination order, ascending.
    pub below: Vec<u32>,
    pub parent: Option<usize>,
    /// Blocks of the matrix that are assembled here: (index in the pattern, front row, front column), in nodes.
    pub entries: Vec<(u32, u32, u32)>,
}

impl Supernode {
    pub fn width(&self) -> usize {
        self.last - self.first
    }

    pub fn size(&self) -> usize {
        self.width() + self.below.len()
    }
}

pub struct Symbolic {
    /// position[node]: where the node stands in the elimination order.
    pub position: Vec<u32>,
    /// In elimination order; children come before their parents, and a parent's children are the last fronts unassembled.
    pub supernodes: Vec<Supernode>,
}

impl Symbolic {
    /// Analyses the pattern rows/columns (CSR over nodes, structurally symmetric, diagonal present); `block` is the number of
    /// scalars per node.
    pub fn new(starts: &[usize], columns: &[u32], block: usize) -> Self {
        let count = starts.len() - 1;
        let neighbours = |node: usize| {
            columns[starts[node]..starts[node + 1]]
                .iter()
                .filter(move |&&j| j as usize != node)
        };
        let order = minimum_degree(
            (0..count)
                .map(|i| neighbours(i).copied().collect())
                .collect(),
        );
        let mut position = vec![0_u32; count];
        order
            .iter()
            .enumerate()
            .for_each(|(at, &node)| position[node as usize] = at as u32);

        let rise = |order: &[u32], position: &[u32]| elimination_tree(order, position, &neighbours);
        let after = postorder(&rise(&order, &position));
        let order: Vec<u32> = after.iter().map(|&at| order[at as usize]).collect();
        order
            .iter()
            .enumerate()
            .for_each(|(at, &node)| position[node as usize] = at as u32);
        let parent = rise(&order, &position);

        let structure = column_structure(&order, &position, &parent, &neighbours);
        let mut supernodes = amalgamate(structure, block);
        let mut owner = vec![0_usize; count];
        for (index, supernode) in supernodes.iter().enumerate() {
            owner[supernode.first..supernode.last].fill(index);
        }
        for supernode in &mut supernodes {
            supernode.parent = supernode.below.first().map(|&row| owner[row as usize]);
        }
        let mut local = vec![0_u32; count];
        for supernode in &mut supernodes {
            let (first, last) = (supernode.first, supernode.last);
            (first..last).for_each(|at| local[at] = (at - first) as u32);
            supernode
                .below
                .iter()
                .enumerate()
                .for_each(|(k, &row)| local[row as usize] = (last - first + k) as u32);
            for at in first..last {
                let node = order[at] as usize;
                for entry in starts[node]..starts[node + 1] {
                    let other = position[columns[entry] as usize] as usize;
                    // An entry belongs to the front in which the earlier of its two nodes is a pivot.
                    if other >= first {
                        supernode
                            .entries
                            .push((entry as u32, local[at], local[other]));
                    }
                }
            }
            for &row in &supernode.below {
                let node = order[row as usize] as usize;
                for entry in starts[node]..starts[node + 1] {
                    let other = position[columns[entry] as usize] as usize;
                    if (first..last).contains(&other) {
                        supernode
                            .entries
                            .push((entry as u32, local[row as usize], local[other]));
                    }
                }
            }
        }
        Self {
            position,
            supernodes,
        }
    }
}

/// parent[k] of each column of the factor, or u32::MAX at a root (Liu's algorithm with path compression).
fn elimination_tree<'a, I: Iterator<Item = &'a u32>>(
    order: &[u32],
    position: &[u32],
    neighbours: &impl Fn(usize) -> I,
) -> Vec<u32> {
    let mut parent = vec![u32::MAX; order.len()];
    let mut ancestor = vec![u32::MAX; order.len()];
    for (at, &node) in order.iter().enumerate() {
        for &other in neighbours(node as usize) {
            let mut below = position[other as usize] as usize;
            while below < at {
                let next = std::mem::replace(&mut ancestor[below], at as u32);
                if next == u32::MAX {
                    parent[below] = at as u32;
                    break;
                }
                below = next as usize;
            }
        }
    }
    parent
}

fn postorder(parent: &[u32]) -> Vec<u32> {
    let mut children: Vec<Vec<u32>> = vec![Vec::new(); parent.len()];
    let mut pending = Vec::new();
    for (at, &above) in parent.iter().enumerate().rev() {
        match above {
            u32::MAX => pending.push((at as u32, false)),
            _ => children[above as usize].push(at as u32),
        }
    }
    let mut order = Vec::with_capacity(parent.len());
    while let Some((at, visited)) = pending.pop() {
        if visited {
            order.push(at);
        } else {
            pending.push((at, true));
            pending.extend(children[at as usize].iter().map(|&child| (child, false)));
        }
    }
    order
}

/// The rows below the diagonal of each column of the factor, ascending.
fn column_structure<'a, I: Iterator<Item = &'a u32>>(
    order: &[u32],
    position: &[u32],
    parent: &[u32],
    neighbours: &impl Fn(usize) -> I,
) -> Vec<Vec<u32>> {
    let count = order.len();
    let mut structure: Vec<Vec<u32>> = vec![Vec::new(); count];
    let mut mark = vec![usize::MAX; count];
    let mut children: Vec<Vec<u32>> = vec![Vec::new(); count];
    for at in 0..count {
        let mut rows: Vec<u32> = Vec::new();
        let own = neighbours(order[at] as usize).map(|&other| position[other as usize]);
        let inherited = children[at]
            .iter()
            .flat_map(|&child| structure[child as usize].iter().copied());
        for row in own.chain(inherited) {
            if row as usize > at && mark[row as usize] != at {
                mark[row as usize] = at;
                rows.push(row);
            }
        }
        rows.sort_unstable();
        structure[at] = rows;
        if parent[at] != u32::MAX {
            children[parent[at] as usize].push(at as u32);
        }
    }
    structure
}

/// Gathers columns into supernodes, from left to right, merging each with the one just before while that pays.
fn amalgamate(structure: Vec<Vec<u32>>, block: usize) -> Vec<Supernode> {
    let mut supernodes: Vec<Supernode> = Vec::new();
    // Blocks of each supernode that are stored but zero.
    let mut zeros: Vec<usize> = Vec::new();
    for (at, below) in structure.into_iter().enumerate() {
        let (mut first, mut padding) = (at, 0);
        while let Some(previous) = supernodes.last() {
            let is_child = previous
                .below
                .first()
                .is_some_and(|&row| (first..=at).contains(&(row as usize)));
            if !is_child {
                break;
            }
            let added = (at + 1 - first + below.len() - previous.below.len()) * previous.width();
            let merged = padding + added + zeros[zeros.len() - 1];
            let (width, size) = (
                at + 1 - previous.first,
                at + 1 - previous.first + below.len(),
            );
            let small = width * block <= 6 && size * block <= 60;
            if added > 0 && !small && 8 * merged > width * size {
                break;
            }
            (first, padding) = (previous.first, merged);
            supernodes.pop();
            zeros.pop();
        }
        supernodes.push(Supernode {
            first,
            last: at + 1,
            below,
            parent: None,
            entries: Vec::new(),
        });
        zeros.push(padding);
    }
    supernodes
}
