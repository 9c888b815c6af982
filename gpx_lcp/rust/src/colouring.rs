//! Which contacts can be visited at the same time: those that share no body.
//!
//! Contacts of the same two bodies form a group, whose contacts are visited one after the other. Groups get colours, each
//! the first that neither of its bodies has yet, so that the groups of one colour share no body; the order of groups is
//! that of their first contacts, so that the colours depend on the system alone. A body that never moves is in no column
//! of Ĵ and keeps nobody apart. Groups of one colour go eight abreast, long ones with long ones, and batches in the order of
//! their bodies: threads that share each colour then have much the same bodies in all of them.

use smallvec::{SmallVec, smallvec};

use crate::lanes::LANES;

/// Stands for no body in a pair, and for no contact in a lane.
pub const NONE: u32 = u32::MAX;

/// Eight groups of one colour, contact by contact.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// The two bodies of each lane.
    pub bodies: [[u32; LANES]; 2],
    /// The contact in each lane, visit by visit.
    pub contacts: Vec<[u32; LANES]>,
}

/// Arrange contacts, given by the bodies that they touch, in colours of batches.
pub fn coloured(pairs: &[[u32; 2]]) -> Vec<Vec<Batch>> {
    let mut order: Vec<u32> = (0..pairs.len() as u32).collect();
    order.sort_by_key(|&contact| pairs[contact as usize]);
    let mut groups: Vec<&[u32]> = order
        .chunk_by(|&x, &y| pairs[x as usize] == pairs[y as usize])
        .collect();
    groups.sort_unstable_by_key(|group| group[0]);

    let bodies = pairs.iter().flatten().filter(|&&body| body != NONE).max();
    // The colours that each body has, a bit for each.
    let mut taken: Vec<SmallVec<[u64; 2]>> =
        vec![smallvec![0]; bodies.map_or(0, |&last| last as usize + 1)];
    let mut colours: Vec<Vec<&[u32]>> = Vec::new();
    for group in groups {
        let own = pairs[group[0] as usize];
        let own = own.iter().filter(|&&body| body != NONE);
        let word_of = |body: u32, word: usize| taken[body as usize].get(word).copied().unwrap_or(0);
        let (mut word, mut free) = (0, 0);
        while free == 0 {
            free = !own.clone().fold(0, |all, &body| all | word_of(body, word));
            word += 1;
        }
        let (word, bit) = (word - 1, free.trailing_zeros() as usize);
        for &body in own {
            let words = &mut taken[body as usize];
            if words.len() <= word {
                words.resize(word + 1, 0);
            }
            words[word] |= 1 << bit;
        }
        let colour = 64 * word + bit;
        if colours.len() <= colour {
            colours.resize(colour + 1, Vec::new());
        }
        colours[colour].push(group);
    }
    colours
        .into_iter()
        .map(|mut groups| {
            groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
            let batches = groups.chunks(LANES).map(|abreast| batch(abreast, pairs));
            let mut batches: Vec<Batch> = batches.collect();
            batches.sort_by_key(|batch| batch.bodies.iter().flatten().copied().min());
            batches
        })
        .collect()
}

/// At most eight groups abreast, the longest first.
fn batch(groups: &[&[u32]], pairs: &[[u32; 2]]) -> Batch {
    let mut batch = Batch {
        bodies: [[NONE; LANES]; 2],
        contacts: vec![[NONE; LANES]; groups[0].len()],
    };
    for (lane, group) in groups.iter().enumerate() {
        let pair = pairs[group[0] as usize];
        for side in 0..2 {
            batch.bodies[side][lane] = pair[side];
        }
        for (visit, &contact) in batch.contacts.iter_mut().zip(*group) {
            visit[lane] = contact;
        }
    }
    batch
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bodies_of(batch: &Batch) -> impl Iterator<Item = u32> {
        let bodies = batch.bodies.iter().flatten().copied();
        bodies.filter(|&body| body != NONE)
    }

    fn assert_apart(pairs: &[[u32; 2]]) {
        let mut seen = vec![0; pairs.len()];
        for colour in coloured(pairs) {
            let mut bodies: Vec<u32> = colour.iter().flat_map(bodies_of).collect();
            let count = bodies.len();
            bodies.sort_unstable();
            bodies.dedup();
            assert_eq!(bodies.len(), count, "a body twice in one colour");
            for batch in colour {
                for lane in 0..LANES {
                    for contact in batch.contacts.iter().map(|visit| visit[lane]) {
                        if contact != NONE {
                            seen[contact as usize] += 1;
                            assert_eq!(pairs[contact as usize][0], batch.bodies[0][lane]);
                            assert_eq!(pairs[contact as usize][1], batch.bodies[1][lane]);
                        }
                    }
                }
            }
        }
        assert!(seen.iter().all(|&times| times == 1), "{seen:?}");
    }

    #[test]
    fn every_contact_is_visited_once_and_no_colour_has_a_body_twice() {
        let mut state = 1u64;
        let mut draw = |below: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
            ((state >> 33) % below) as u32
        };
        for bodies in [2, 5, 40] {
            let pairs: Vec<[u32; 2]> = (0..300)
                .map(|_| {
                    let first = draw(bodies);
                    let second = (first + 1 + draw(bodies - 1)) % bodies as u32;
                    [
                        first.min(second),
                        if draw(5) == 0 {
                            NONE
                        } else {
                            first.max(second)
                        },
                    ]
                })
                .collect();
            assert_apart(&pairs);
        }
    }

    #[test]
    fn tower_has_two_colours_whatever_stands_on_the_ground() {
        let pairs: Vec<[u32; 2]> = (0..40)
            .map(|k: u32| [if k < 4 { NONE } else { k / 4 - 1 }, k / 4])
            .collect();
        let colours = coloured(&pairs);
        assert_eq!(colours.len(), 2);
        assert!(
            colours
                .iter()
                .flatten()
                .all(|batch| batch.contacts.len() == 4)
        );
    }

    #[test]
    fn body_with_a_hundred_neighbours_has_a_hundred_colours() {
        let pairs: Vec<[u32; 2]> = (1..=100).map(|k| [0, k]).collect();
        assert_apart(&pairs);
        assert_eq!(coloured(&pairs).len(), 100);
    }
}
