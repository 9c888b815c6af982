//! Constant structure, recognised once: islands that are solved in closed form, kept for the next system of the same Ĵ.
//!
//! What stands still, or moves as one, has the same contacts in step after step, to the last bit of Ĵ, and only B is
//! another: a tower whose load changes, a column of balls. Where nothing that was asked of B has another answer, presolve
//! would find the same islands, groups, weights and chains again; `Remembered::again` asks just that. What is kept are
//! systems of collinear islands alone, as of them little is asked:
//!
//! * nothing slides before the impulses, and something closes in every island;
//! * no contact is out of reach, none redundant, and no island rests on the impulses that it starts from;
//! * the order of contacts between the same bodies is told by Ĵ;
//! * condition (c) of the theorem in this folder.
//!
//! Therefore a result never depends on what is remembered, not in its last bit.

use std::mem::take;

use crate::exact::Law;

use super::chain::Chain;
use super::inactive::{any_apart, nothing_closes};
use super::lift::{Model, Part};
use super::parts::{Reduced, Summary};
use super::{Form, Resting, Rests, Shaped, View, collinear, single};

/// An island that was solved in closed form.
pub struct Closed {
    pub part: Part,
    /// None where it is one contact.
    pub chain: Option<Chain>,
}

impl Closed {
    /// The impulses of a part, and what they were found by; None where it has no closed form.
    pub fn form_of(part: &Part, law: Law) -> Option<(Option<Chain>, Vec<f64>)> {
        if let Some(found) = single::solve(part, law) {
            return Some((None, found));
        }
        let chain = Chain::of(part)?;
        let found = chain.solve(&part.b)?;
        Some((Some(chain), found))
    }

    fn solve(&self, law: Law) -> Option<Vec<f64>> {
        match &self.chain {
            Some(chain) => chain.solve(&self.part.b),
            None => single::solve(&self.part, law),
        }
    }
}

/// A system that was solved in closed form, without its B.
#[derive(Default)]
pub struct Remembered {
    /// Rows, width and bodies.
    shape: [usize; 3],
    law: Option<Law>,
    swept: bool,
    starts: Vec<usize>,
    columns: Vec<u32>,
    whitened: Vec<f64>,
    friction: Vec<f64>,
    islands: Vec<Closed>,
    summary: Summary,
}

impl Remembered {
    /// Remember the islands that were solved in closed form, if they are all there is to the system.
    pub fn keep(&mut self, view: &View, reduced: &mut Reduced) {
        self.islands.clear();
        let islands = take(&mut reduced.closed);
        let contacts: usize = islands
            .iter()
            .map(|island| island.part.contacts.len())
            .sum();
        let collinear = islands
            .iter()
            .all(|island| island.part.model == Model::Collinear);
        let wanted = view.form == Form::Velocity
            && collinear
            && contacts == view.contacts()
            && reduced.resting.islands.is_empty()
            && nothing_is_apart(view)
            && told_apart(view, &islands);
        if !wanted {
            return;
        }
        (self.shape, self.law, self.swept) = (shape(view), Some(view.law), view.swept);
        view.starts.clone_into(&mut self.starts);
        view.columns.clone_into(&mut self.columns);
        view.whitened.clone_into(&mut self.whitened);
        view.friction.clone_into(&mut self.friction);
        self.summary.clone_from(&reduced.summary);
        self.islands = islands;
    }

    /// What presolve leaves of a system, where it is the one that is remembered but for its B.
    pub fn again(&mut self, view: &View, rests: Rests) -> Option<Reduced> {
        let known = !self.islands.is_empty()
            && self.shape == shape(view)
            && self.law == Some(view.law)
            && self.swept == view.swept
            && self.starts == view.starts
            && self.columns == view.columns
            && same_bits(&self.friction, view.friction)
            && same_bits(&self.whitened, view.whitened);
        if !known || !nothing_is_apart(view) {
            return None;
        }
        let several = self.islands.len() > 1;
        let mut impulse = vec![0.0; view.b.len()];
        for island in &mut self.islands {
            let part = &mut island.part;
            if collinear::slides(view, &part.contacts) || nothing_closes(view, &part.contacts) {
                return None;
            }
            if several {
                let mut rising = part.contacts.clone();
                rising.sort_unstable();
                if rests(&rising).is_some() {
                    return None;
                }
            }
            part.gather_targets(Shaped::<0, 0>(view))?;
            let found = island.solve(view.law)?;
            island.part.lift(view.rows, &found, &mut impulse);
        }
        Some(Reduced {
            impulse,
            resting: Resting::default(),
            parts: Vec::new(),
            summary: self.summary.clone(),
            closed: Vec::new(),
        })
    }
}

fn shape(view: &View) -> [usize; 3] {
    [view.rows, view.width, view.bodies]
}

/// Whether contacts out of reach are not looked for.
fn nothing_is_apart(view: &View) -> bool {
    view.swept || !any_apart(view.b, view.rows, view.largest)
}

/// Whether all contacts move a body, and those between the same bodies come in the order of their blocks, whatever B is, and
/// are not asked whether they are redundant.
fn told_apart(view: &View, islands: &[Closed]) -> bool {
    let described = view.described();
    islands.iter().all(|island| {
        view.by_pairs(&island.part.contacts).all(|run| {
            let rubs = |&contact: &u32| view.has_friction(contact);
            let stay = run.len() == 1 || (view.law == Law::Coulomb && run.iter().any(rubs));
            let apart = |pair: &[u32]| described.are_told_apart_by_blocks(pair[0], pair[1]);
            stay && !view.bodies_of(run[0]).is_empty() && run.windows(2).all(apart)
        })
    })
}

fn same_bits(one: &[f64], other: &[f64]) -> bool {
    // Eight at a time, rather than one look after the other.
    let differ = |(x, y): (&f64, &f64)| x.to_bits() ^ y.to_bits();
    let same = |(ones, others): (&[f64], &[f64])| {
        ones.iter()
            .zip(others)
            .map(differ)
            .fold(0, |all, bits| all | bits)
            == 0
    };
    one.len() == other.len() && one.chunks(8).zip(other.chunks(8)).all(same)
}

#[cfg(test)]
mod tests {
    use super::super::{Found, reduce, size};
    use super::*;

    /// Three balls of 1 kg above each other that another one stands beside, and the contacts that hold them.
    struct Balls {
        whitened: Vec<f64>,
        b: Vec<f64>,
        friction: Vec<f64>,
    }

    const STARTS: [usize; 5] = [0, 1, 3, 5, 6];
    const COLUMNS: [u32; 6] = [0, 0, 1, 1, 2, 3];

    impl Balls {
        fn new() -> Self {
            let block = |sign: f64| {
                let line = |r: usize| (0..3).map(move |d| f64::from(u8::from(r == d)) * sign);
                (0..3).flat_map(line).collect::<Vec<f64>>()
            };
            let signs = [1.0, -1.0, 1.0, -1.0, 1.0, 1.0];
            Self {
                whitened: signs.into_iter().flat_map(block).collect(),
                b: [
                    [3.0, 0.0, 0.0],
                    [1.0, 0.0, 0.0],
                    [2.0, 0.0, 0.0],
                    [5.0, 0.0, 0.0],
                ]
                .concat(),
                friction: vec![0.5; 4],
            }
        }

        fn view(&self) -> View<'_> {
            View {
                form: Form::Velocity,
                rows: 3,
                width: 3,
                bodies: 4,
                starts: &STARTS,
                columns: &COLUMNS,
                whitened: &self.whitened,
                jacobian: None,
                free: None,
                b: &self.b,
                largest: crate::exact::largest(&self.b),
                friction: &self.friction,
                law: Law::Coulomb,
                swept: false,
            }
        }

        fn impulse(&self, remembered: Option<&mut Remembered>) -> Vec<f64> {
            match reduce(&self.view(), 1, &|_| None, remembered) {
                Found::Reduced(reduced) if reduced.parts.is_empty() => reduced.impulse,
                _ => panic!("columns have a closed form"),
            }
        }
    }

    fn again(balls: &Balls, remembered: &mut Remembered) -> Option<Vec<f64>> {
        let reduced = remembered.again(&balls.view(), &|_| None)?;
        Some(reduced.impulse)
    }

    #[test]
    fn another_load_has_the_impulses_that_it_would_have_without_memory() {
        let (mut balls, mut remembered) = (Balls::new(), Remembered::default());
        assert_eq!(again(&balls, &mut remembered), None);
        let first = balls.impulse(Some(&mut remembered));
        assert_eq!(again(&balls, &mut remembered), Some(first));
        for load in [0.1, 7.0, -1e-3] {
            balls.b[3] += load;
            let fresh = balls.impulse(None);
            assert!(size(&fresh) > 0.0);
            assert_eq!(again(&balls, &mut remembered), Some(fresh));
        }
    }

    #[test]
    fn what_presolve_would_see_otherwise_is_not_remembered() {
        let change: [fn(&mut Balls); 6] = [
            |balls| balls.whitened[0] = 1.0 + f64::EPSILON,
            |balls| balls.friction[2] = 0.25,
            // It slides.
            |balls| balls.b[4] = 1e-3,
            // It is apart.
            |balls| balls.b[6] = -1.0,
            // Nothing closes in the second island.
            |balls| balls.b[9] = 0.0,
            // No number.
            |balls| balls.b[3] = f64::NAN,
        ];
        for change in change {
            let (mut balls, mut remembered) = (Balls::new(), Remembered::default());
            balls.impulse(Some(&mut remembered));
            change(&mut balls);
            assert_eq!(again(&balls, &mut remembered), None);
        }
        let (balls, mut remembered) = (Balls::new(), Remembered::default());
        balls.impulse(Some(&mut remembered));
        let rests = |island: &[u32]| (island == [3]).then_some(0.0);
        assert!(remembered.again(&balls.view(), &rests).is_none());
        assert!(remembered.again(&balls.view(), &|_| None).is_some());
    }

    #[test]
    fn contacts_in_the_order_of_their_b_are_not_remembered() {
        let (mut balls, mut remembered) = (Balls::new(), Remembered::default());
        // The fourth contact is the third once more.
        balls.whitened = [
            &balls.whitened[..27],
            &balls.whitened[27..45],
            &balls.whitened[27..45],
        ]
        .concat();
        let (starts, columns) = ([0, 1, 3, 5, 7], [0, 0, 1, 1, 2, 1, 2]);
        balls.b[9] = 2.0;
        let view = View {
            starts: &starts,
            columns: &columns,
            ..balls.view()
        };
        assert!(matches!(
            reduce(&view, 1, &|_| None, Some(&mut remembered)),
            Found::Reduced(_)
        ));
        assert!(remembered.again(&view, &|_| None).is_none());
    }
}
