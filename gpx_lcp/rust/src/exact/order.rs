//! An order of contacts that depends on nothing but the contacts.
//!
//! Coulomb's law can have several exact solutions, and rounding decides which of them a method ends at. The sums of a
//! method are rounded in the order of the contacts, so that the order would decide, if contacts were not sorted first. Two
//! contacts that compare as equal are the same contact twice, and exchanging them exchanges nothing.
//!
//! Numbers are first compared without their last digits, so that rounding puts no two like contacts of a regular scene in
//! different orders.
//!
//! Where A is all there is, its rows cannot be compared without an order of the contacts. There B, μ and the contact's own
//! block decide, and contacts that share all three, as in a symmetric scene, stay as they came.

use std::cell::Cell;
use std::cmp::Ordering;

use super::small::largest;

/// Contacts by the bodies they join and the blocks of Ĵ, by B and μ.
pub struct Contacts<'a> {
    described: Described<'a>,
    /// Of the blocks and of B of each contact, what is rounding, see `grid`, once somebody has asked.
    grids: Vec<Cell<Option<[f64; 2]>>>,
}

/// What contacts are compared by.
#[derive(Clone, Copy)]
pub struct Described<'a> {
    pub starts: &'a [usize],
    pub columns: &'a [u32],
    pub values: &'a [f64],
    /// Values in a block.
    pub area: usize,
    /// Whether the columns are bodies, and not the contacts themselves.
    pub of_bodies: bool,
    pub b: &'a [f64],
    pub friction: &'a [f64],
}

impl<'a> Contacts<'a> {
    pub fn new(described: Described<'a>) -> Self {
        Self {
            described,
            grids: vec![Cell::new(None); described.friction.len()],
        }
    }

    fn grids(&self, contact: u32) -> [f64; 2] {
        let known = &self.grids[contact as usize];
        known.get().unwrap_or_else(|| {
            let described = &self.described;
            let grids = [described.blocks(contact), described.target(contact)].map(grid);
            known.set(Some(grids));
            grids
        })
    }

    /// Bodies first, so that contacts of the same pair stay together; then Ĵ, B and μ.
    pub fn compare(&self, one: u32, other: u32) -> Ordering {
        let described = &self.described;
        let bodies = if described.of_bodies {
            by_bodies(described.bodies(one), described.bodies(other))
        } else {
            Ordering::Equal
        };
        bodies.then_with(|| {
            let [blocks, targets] = [Described::blocks, Described::target]
                .map(|of| [of(described, one), of(described, other)]);
            let [ones, others] = [one, other].map(|contact| self.grids(contact));
            let mu = |contact: u32| described.friction[contact as usize];
            in_rough_order(blocks, [ones[0], others[0]])
                .then_with(|| in_rough_order(targets, [ones[1], others[1]]))
                .then_with(|| in_order(blocks[0], blocks[1]))
                .then_with(|| in_order(targets[0], targets[1]))
                .then_with(|| mu(one).total_cmp(&mu(other)))
        })
    }

    /// Whether the order of two contacts is the same whatever B and μ are.
    pub fn are_told_apart_by_blocks(&self, one: u32, other: u32) -> bool {
        let described = &self.described;
        let [ones, others] = [one, other].map(|contact| self.grids(contact)[0]);
        let blocks = [described.blocks(one), described.blocks(other)];
        described.bodies(one) != described.bodies(other)
            || in_rough_order(blocks, [ones, others]).is_ne()
    }

    /// The contacts in order; None where they are already.
    pub fn sorted(&self) -> Option<Vec<u32>> {
        let mut order: Vec<u32> = (0..self.grids.len() as u32).collect();
        let ascend = |one: &u32, other: &u32| self.compare(*one, *other);
        if order.is_sorted_by(|one, other| ascend(one, other).is_le()) {
            return None;
        }
        order.sort_by(ascend);
        Some(order)
    }
}

impl<'a> Described<'a> {
    fn bodies(&self, contact: u32) -> &'a [u32] {
        &self.columns[self.starts[contact as usize]..self.starts[contact as usize + 1]]
    }

    fn target(&self, contact: u32) -> &'a [f64] {
        let rows = self.b.len() / self.friction.len();
        &self.b[contact as usize * rows..][..rows]
    }

    /// Of a matrix over bodies all blocks, else the contact's own.
    fn blocks(&self, contact: u32) -> &'a [f64] {
        let (begin, end) = (
            self.starts[contact as usize],
            self.starts[contact as usize + 1],
        );
        if self.of_bodies {
            return &self.values[begin * self.area..end * self.area];
        }
        let own = self.columns[begin..end]
            .iter()
            .position(|&column| column == contact);
        own.map_or(&[], |at| {
            &self.values[(begin + at) * self.area..][..self.area]
        })
    }
}

/// The last body first, and what stands still behind all bodies: that is how contacts of a scene come.
#[inline]
pub fn by_bodies(one: &[u32], other: &[u32]) -> Ordering {
    if let ([a, b], [c, d]) = (one, other) {
        // Nearly all contacts are between two.
        return b.cmp(d).then(a.cmp(c));
    }
    let bodies = one.iter().rev().zip(other.iter().rev());
    bodies
        .map(|(one, other)| one.cmp(other))
        .find(|order| order.is_ne())
        .unwrap_or_else(|| other.len().cmp(&one.len()))
}

fn in_order(one: &[f64], other: &[f64]) -> Ordering {
    one.iter()
        .zip(other)
        .map(|(x, y)| x.total_cmp(y))
        .find(|order| order.is_ne())
        .unwrap_or(Ordering::Equal)
}

/// The same without what is below the grid of each.
fn in_rough_order([one, other]: [&[f64]; 2], grids: [f64; 2]) -> Ordering {
    let rough = |value: f64, grid: f64| (value / grid).round() * grid + 0.0;
    let compare = |(a, b): (&f64, &f64)| {
        if a == b && grids[0] == grids[1] {
            return Ordering::Equal;
        }
        // Further apart than rounding moves them.
        if (a - b).abs() > grids[0] + grids[1] {
            return a.total_cmp(b);
        }
        rough(*a, grids[0]).total_cmp(&rough(*b, grids[1]))
    };
    one.iter()
        .zip(other)
        .map(compare)
        .find(|order| order.is_ne())
        .unwrap_or(Ordering::Equal)
}

/// A power of two, some millionth of the largest number.
fn grid(values: &[f64]) -> f64 {
    let exponent = f64::from_bits(largest(values).to_bits() & (0x7ff << 52));
    (exponent * 2.0_f64.powi(-20)).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(b: &[f64], values: &[f64]) -> Vec<u32> {
        let count = b.len();
        let starts: Vec<usize> = (0..=count).collect();
        let described = Described {
            starts: &starts,
            columns: &vec![0; count],
            values,
            area: 1,
            of_bodies: true,
            b,
            friction: &vec![0.5; count],
        };
        Contacts::new(described)
            .sorted()
            .unwrap_or_else(|| (0..count as u32).collect())
    }

    #[test]
    fn contacts_of_a_scene_come_in_order() {
        let scene: [&[u32]; 6] = [&[0], &[0, 1], &[1], &[0, 2], &[1, 2], &[2]];
        assert!(scene.is_sorted_by(|one, other| by_bodies(one, other).is_lt()));
    }

    #[test]
    fn rounding_in_what_comes_first_does_not_decide() {
        let noise = 1.0 + 1e-15;
        assert_eq!(order(&[2.0, 1.0], &[1.0, noise]), [1, 0]);
        assert_eq!(order(&[2.0, 1.0], &[1.0, 2.0]), [0, 1]);
    }

    #[test]
    fn what_is_alike_but_for_rounding_has_an_order_all_the_same() {
        let noise = 1.0 + 1e-15;
        assert_eq!(order(&[1.0, 1.0], &[noise, 1.0]), [1, 0]);
        assert_eq!(order(&[1.0, noise], &[1.0, 1.0]), [0, 1]);
        assert_eq!(order(&[0.0, 0.0], &[0.0, 0.0]), [0, 1]);
    }
}
