//! Islands that keep the impulses they start from, as these are a solution to the tolerance.
//!
//! *Proof*: the squared residual of the whole, ‖natural map‖², is the sum of those of its islands, and so is what all of
//! them may leave of it (see `fair_share`): an island that leaves no more than its share may be left as it is. ∎
//!
//! A wall that rests costs no more than that, whatever goes on beside it.

use super::View;
use super::parts::is_nearly_all;

/// What an island leaves of the squared residual with the impulses that it starts from, (m/s)²; None where it does not rest.
pub type Rests<'a> = &'a dyn Fn(&[u32]) -> Option<f64>;

/// Islands that keep the impulses they start from, and what these leave of the squared residual, (m/s)².
#[derive(Default)]
pub struct Resting {
    pub islands: Vec<Vec<u32>>,
    pub leaves: f64,
}

/// Take the islands that rest out of these; none where they are hardly worth it.
pub fn leave_out(view: &View, islands: &mut Vec<Vec<u32>>, rests: Rests) -> Resting {
    if islands.len() == 1 {
        // It would have been left alone before.
        return Resting::default();
    }
    let leaves: Vec<Option<f64>> = islands.iter().map(|island| rests(island)).collect();
    let resting = islands
        .iter()
        .zip(&leaves)
        .filter(|(_, leaves)| leaves.is_some());
    let contacts: usize = resting.map(|(island, _)| island.len()).sum();
    if is_nearly_all(view, view.contacts() - contacts) {
        return Resting::default();
    }
    let total = leaves.iter().flatten().sum();
    let mut leaves = leaves.into_iter();
    let kept = islands.extract_if(.., |_| leaves.next().flatten().is_some());
    Resting {
        islands: kept.collect(),
        leaves: total,
    }
}
