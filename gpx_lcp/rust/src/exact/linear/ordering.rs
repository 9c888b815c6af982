//! Fill-reducing order of the nodes of a graph: approximate minimum degree on the quotient graph.
//!
//! Source: P. Amestoy, T. Davis, I. Duff, *An approximate minimum degree ordering algorithm*, SIAM J. Matrix Anal. Appl. 17
//! (1996). Kept from it: elements and their absorption, the approximate external degree, merging of indistinguishable nodes.
//! Left out: aggressive absorption and dense-row treatment; contact graphs have no dense rows that matter.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Returns the nodes in elimination order. `adjacency[i]` lists the neighbours of node i, without i itself; it is symmetric.
pub fn minimum_degree(mut adjacency: Vec<Vec<u32>>) -> Vec<u32> {
    let count = adjacency.len();
    let mut elements_of: Vec<Vec<u32>> = vec![Vec::new(); count];
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); count]; // of the element that node i became
    let mut absorbed: Vec<Vec<u32>> = vec![Vec::new(); count]; // nodes merged into node i
    let mut weight = vec![1_usize; count]; // nodes represented; 0 once merged or eliminated
    let mut element_lives = vec![false; count];
    let mut degree: Vec<usize> = adjacency.iter().map(Vec::len).collect();
    let mut queue: BinaryHeap<Reverse<(usize, u32)>> =
        (0..count).map(|i| Reverse((degree[i], i as u32))).collect();
    let mut mark = vec![usize::MAX; count];
    let mut outside = vec![0_usize; count]; // weight of an element outside the new one
    let mut outside_stamp = vec![usize::MAX; count];
    let mut alike: Vec<(u64, u32)> = Vec::new(); // what a node sees, hashed, and the node
    let mut order = Vec::with_capacity(count);
    let mut left = count;

    while let Some(Reverse((key, pivot))) = queue.pop() {
        let pivot = pivot as usize;
        if weight[pivot] == 0 || key != degree[pivot] {
            continue;
        }
        // The new element: everything the pivot touches, directly or through elements, which it absorbs.
        let stamp = order.len();
        mark[pivot] = stamp;
        let mut element: Vec<u32> = Vec::new();
        let mut collect = |nodes: &[u32], weight: &[usize]| {
            for &node in nodes {
                if weight[node as usize] > 0 && mark[node as usize] != stamp {
                    mark[node as usize] = stamp;
                    element.push(node);
                }
            }
        };
        collect(&std::mem::take(&mut adjacency[pivot]), &weight);
        for old in std::mem::take(&mut elements_of[pivot]) {
            if std::mem::take(&mut element_lives[old as usize]) {
                collect(&std::mem::take(&mut members[old as usize]), &weight);
            }
        }
        emit(pivot as u32, &absorbed, &mut order);
        left -= weight[pivot];
        weight[pivot] = 0;
        let total: usize = element.iter().map(|&i| weight[i as usize]).sum();

        for &node in &element {
            let node = node as usize;
            elements_of[node].retain(|&e| element_lives[e as usize]);
            for &e in &elements_of[node] {
                let e = e as usize;
                if outside_stamp[e] != stamp {
                    outside_stamp[e] = stamp;
                    outside[e] = members[e].iter().map(|&i| weight[i as usize]).sum();
                }
                outside[e] -= weight[node];
            }
        }
        alike.clear();
        for &node in &element {
            let i = node as usize;
            adjacency[i].retain(|&j| weight[j as usize] > 0 && mark[j as usize] != stamp);
            let direct: usize = adjacency[i].iter().map(|&j| weight[j as usize]).sum();
            let through: usize = elements_of[i].iter().map(|&e| outside[e as usize]).sum();
            degree[i] = (total - weight[i] + direct + through).min(left - weight[i]);
            elements_of[i].push(pivot as u32);
            let hash = adjacency[i]
                .iter()
                .chain(&elements_of[i])
                .fold(0_u64, |sum, &j| {
                    sum.wrapping_add(
                        u64::from(j)
                            .wrapping_add(1)
                            .wrapping_mul(0x9e37_79b9_7f4a_7c15)
                            .rotate_left(29),
                    )
                });
            alike.push((hash, node));
        }
        element_lives[pivot] = true;
        // Nodes that see the same nodes and elements stay alike for ever: one is kept, with the weight of all.
        alike.sort_by_key(|&(hash, _)| hash);
        let groups = alike.chunk_by(|one, other| one.0 == other.0);
        for group in groups.filter(|group| group.len() > 1) {
            for &(_, node) in group {
                adjacency[node as usize].sort_unstable();
                elements_of[node as usize].sort_unstable();
            }
            for first in 0..group.len() {
                let keeper = group[first].1 as usize;
                if weight[keeper] == 0 {
                    continue;
                }
                for &(_, node) in &group[first + 1..] {
                    let other = node as usize;
                    let same = adjacency[other] == adjacency[keeper]
                        && elements_of[other] == elements_of[keeper];
                    if weight[other] > 0 && same {
                        degree[keeper] = degree[keeper].saturating_sub(weight[other]);
                        weight[keeper] += std::mem::take(&mut weight[other]);
                        absorbed[keeper].push(node);
                        adjacency[other].clear();
                        elements_of[other].clear();
                    }
                }
            }
        }
        element.retain(|&i| weight[i as usize] > 0);
        for &node in &element {
            queue.push(Reverse((degree[node as usize], node)));
        }
        members[pivot] = element;
    }
    order
}

/// Appends the node and everything merged into it, depth first.
fn emit(node: u32, absorbed: &[Vec<u32>], order: &mut Vec<u32>) {
    let mut pending = vec![node];
    while let Some(next) = pending.pop() {
        order.push(next);
        pending.extend(&absorbed[next as usize]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_node_is_eliminated_once() {
        let grid = |i: u32, j: u32| 9 * i + j;
        let mut adjacency = vec![Vec::new(); 81];
        for i in 0..9 {
            for j in 0..9 {
                for (a, b) in [(i + 1, j), (i, j + 1)] {
                    if a < 9 && b < 9 {
                        adjacency[grid(i, j) as usize].push(grid(a, b));
                        adjacency[grid(a, b) as usize].push(grid(i, j));
                    }
                }
            }
        }
        let mut order = minimum_degree(adjacency);
        order.sort_unstable();
        assert_eq!(order, (0..81).collect::<Vec<u32>>());
    }

    #[test]
    fn the_hub_of_a_star_goes_last() {
        let mut adjacency = vec![vec![0]; 6];
        adjacency[0] = (1..6).collect();
        let order = minimum_degree(adjacency);
        assert!(order[..4].iter().all(|&node| node != 0));
    }
}
