//! What is left of a system when all reductions are done: its parts, and threads to solve them on.

use std::ops::Range;

use crate::exact::{Law, by_bodies};
use crate::team::Team;

use super::inactive::Reach;
use super::lift::{LARGEST, Model, Part};
use super::local_bodies::LocalBodies;
use super::remembered::{Closed, Remembered};
use super::{
    Form, Resting, Rests, Shaped, View, collinear, inactive, islands, planar, redundant, resting,
    spatial, translational,
};

/// Contacts, from which on a thread is started: it takes some 30 µs, as long as so many take to be solved.
const WORTH_A_THREAD: usize = 64;
/// The same where they are reduced, to something smaller that is solved later.
const WORTH_REDUCING: usize = 1024;
/// A system is taken apart for this part of its contacts, one in so many.
const WORTH_TAKING: usize = 20;
/// Where nothing slides, something can be taken as a rule, and more contacts than that are not looked at twice.
const FEW: usize = 64;
/// Pairs of bodies: what fails as a rule fails at one of so few.
const TELLING: usize = 8;
/// Parts of fewer contacts are solved together,
const SMALL: usize = 32;
/// until so many have come together.
const POOL: usize = 128;

/// How much of a system there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Size {
    pub contacts: usize,
    pub rows: usize,
    pub velocities: usize,
}

impl Size {
    fn add(&mut self, other: Self) {
        self.contacts += other.contacts;
        self.rows += other.rows;
        self.velocities += other.velocities;
    }

    fn less(self, other: Self) -> Self {
        Self {
            contacts: self.contacts - other.contacts,
            rows: self.rows - other.rows,
            velocities: self.velocities - other.velocities,
        }
    }
}

/// What presolve did: the size of the system before and after, and what each reduction took away.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    pub islands: usize,
    pub before: Size,
    pub after: Size,
    /// (reduction, islands, what it removed).
    pub reductions: Vec<(&'static str, usize, Size)>,
}

impl Summary {
    fn count(&mut self, name: &'static str, islands: usize, removed: Size) {
        if removed == Size::default() {
            return;
        }
        match self.reductions.iter_mut().find(|entry| entry.0 == name) {
            Some(entry) => {
                entry.1 += islands;
                entry.2.add(removed);
            }
            None => self.reductions.push((name, islands, removed)),
        }
    }
}

/// What is left of a system: impulses known already, and parts to be solved.
pub struct Reduced {
    pub impulse: Vec<f64>,
    pub resting: Resting,
    pub parts: Vec<Part>,
    pub summary: Summary,
    /// The islands whose impulses were found in closed form.
    pub(super) closed: Vec<Closed>,
}

/// What presolve finds.
pub enum Found {
    /// Nothing can be taken from the system.
    Nothing,
    /// Islands that stay as they are, and hardly anything beside them: sweeps over the whole are sweeps over each.
    Islands(Vec<Vec<u32>>),
    Reduced(Reduced),
}

/// What presolve would do, without solving anything.
pub fn summary(view: &View) -> Summary {
    match reduce(view, 1, &|_| None, None) {
        Found::Reduced(reduced) => reduced.summary,
        Found::Islands(islands) => unreduced(view, islands.len()),
        Found::Nothing => unreduced(view, islands::all_islands(view).len()),
    }
}

/// The summary of a system of so many islands that keep their size.
pub fn unreduced(view: &View, islands: usize) -> Summary {
    let whole = whole_size(view);
    Summary {
        islands,
        before: whole,
        after: whole,
        reductions: Vec::new(),
    }
}

/// The islands of a system, each as it is, small ones together.
pub fn as_they_are(view: &View, islands: &[Vec<u32>]) -> Reduced {
    let mut local = LocalBodies::new(view.bodies);
    let part = |island: &Vec<u32>| as_it_is(view, island, &mut local);
    Reduced {
        impulse: vec![0.0; view.b.len()],
        resting: Resting::default(),
        parts: gathered(islands.iter().map(part).collect(), SMALL, POOL),
        summary: unreduced(view, islands.len()),
        closed: Vec::new(),
    }
}

/// Parts of the same shape as one.
pub fn together(parts: Vec<Part>) -> Vec<Part> {
    gathered(parts, usize::MAX, usize::MAX)
}

fn as_it_is(view: &View, island: &[u32], local: &mut LocalBodies) -> Part {
    local.renumber(view, island);
    Part::untouched(view, island, local)
}

/// Runs one task for each item, with the number of threads that it may use `within`, if it uses any, and returns the
/// results in the order of the items.
///
/// An item of a size that is more than one thread's share of all gets all threads within; the others are handed out, the
/// largest first.
pub fn each<Item: Sync, T: Send>(
    items: &[Item],
    size: impl Fn(&Item) -> usize,
    threads: usize,
    within: bool,
    task: &(impl Fn(&Item, usize) -> T + Sync),
) -> Vec<T> {
    let total: usize = items.iter().map(&size).sum();
    let mut results: Vec<Option<T>> = items.iter().map(|_| None).collect();
    let mut order: Vec<_> = items.iter().zip(&mut results).collect();
    order.sort_by_key(|(item, _)| std::cmp::Reverse(size(item)));
    let alone = |(item, _): &(&Item, _)| within && threads * size(item) > total;
    let (alone, mut others): (Vec<_>, Vec<_>) = order.into_iter().partition(alone);
    for (item, result) in alone {
        *result = Some(task(item, threads));
    }
    let left: usize = others.iter().map(|(item, _)| size(item)).sum();
    let helpers = (threads.min(others.len()).max(1) - 1).min(left / WORTH_A_THREAD);
    Team::with(helpers + 1, |team| {
        team.each(&mut others, |(item, result)| {
            **result = Some(task(item, 1));
        });
    });
    let done = |result: Option<T>| result.expect("every item was visited");
    results.into_iter().map(done).collect()
}

/// What is left of a system; on threads where it is large. `rests` is asked of islands. What is remembered, where there will
/// be a next system, saves time, and changes no result.
pub fn reduce(
    view: &View,
    threads: usize,
    rests: Rests,
    mut remembered: Option<&mut Remembered>,
) -> Found {
    if let Some(remembered) = &mut remembered
        && let Some(reduced) = remembered.again(view, rests)
    {
        return Found::Reduced(reduced);
    }
    let threads = Team::worth(threads, view.contacts(), WORTH_REDUCING);
    let mut found = Team::with(threads, |team| found(view, rests, team));
    if let (Found::Reduced(reduced), Some(remembered)) = (&mut found, remembered) {
        remembered.keep(view, reduced);
    }
    found
}

fn found(view: &View, rests: Rests, team: &Team) -> Found {
    let mut summary = Summary {
        before: whole_size(view),
        ..Summary::default()
    };
    let mut local = LocalBodies::new(view.bodies);
    // Sweeps find a contact out of reach open at once, in less time than it takes to prove it.
    let reach = if view.swept { None } else { Reach::of(view) };
    let mut islands = islands::all_islands(view);
    summary.islands = islands.len();
    let resting = resting::leave_out(view, &mut islands, rests);
    for island in &resting.islands {
        local.renumber(view, island);
        summary.count("resting", 1, part_size(view, island, &local));
    }
    let mut pieces = Vec::with_capacity(islands.len());
    for island in islands {
        match &reach {
            Some(reach) => within_reach(view, reach, island, &mut local, &mut pieces, &mut summary),
            None => pieces.push(island),
        }
    }
    let mut parts = Vec::new();
    if let Some(largest) = pieces.iter().max_by_key(|piece| piece.len())
        && stays_as_it_is(view, largest, &mut local)
    {
        if is_nearly_all(view, largest.len()) {
            return Found::Nothing;
        }
        // Others like it are as soon done with.
        let mut stays = |piece: &Vec<u32>| {
            !inactive::nothing_closes(view, piece) && stays_as_it_is(view, piece, &mut local)
        };
        let stay: Vec<bool> = pieces.iter().map(&mut stays).collect();
        let staying = pieces.iter().zip(&stay).filter(|(_, stays)| **stays);
        let contacts = staying.clone().map(|(piece, _)| piece.len()).sum();
        if view.swept && is_nearly_all(view, contacts) {
            return Found::Islands(pieces);
        }
        for (piece, _) in staying {
            let part = as_it_is(view, piece, &mut local);
            summary.after.add(part.size());
            parts.push(part);
        }
        let mut stay = stay.into_iter();
        pieces.retain(|_| !stay.next().expect("one of each piece"));
    }
    let reduced = reduced(view, pieces, resting, parts, summary, &mut local, team);
    reduced.map_or(Found::Nothing, Found::Reduced)
}

/// What is left of these islands, beside those that rest and the parts that stay as they are; None where that is the whole
/// system.
fn reduced(
    view: &View,
    islands: Vec<Vec<u32>>,
    resting: Resting,
    mut parts: Vec<Part>,
    mut summary: Summary,
    local: &mut LocalBodies,
    team: &Team,
) -> Option<Reduced> {
    let mut impulse = vec![0.0; view.b.len()];
    let mut closed = Vec::new();
    for mut contacts in in_order(view, islands) {
        local.renumber(view, &contacts);
        let mut whole = part_size(view, &contacts, local);
        if inactive::nothing_closes(view, &contacts) {
            summary.count("inactive", 1, whole);
            continue;
        }
        let part = match view.form {
            Form::Impulse => {
                let part = Part::of_delassus(view, &contacts, local);
                if part.model == Model::Spatial
                    && contacts.len() == view.contacts()
                    && contacts.len() > 1
                {
                    return None;
                }
                part
            }
            Form::Velocity => {
                let kept_open = redundant::leave_out(view, &mut contacts);
                let less = part_size(view, &contacts, local);
                summary.count("redundant", 1, whole.less(less));
                whole = less;
                let mut part = smallest(view, &contacts, local, team)?;
                part.keeps_open(kept_open);
                part
            }
        };
        let left = part.size();
        summary.count(name(&part), 1, whole.less(left));
        match Closed::form_of(&part, view.law) {
            Some((chain, found)) => {
                part.lift(view.rows, &found, &mut impulse);
                summary.count("closed form", 1, left);
                closed.push(Closed { part, chain });
            }
            None => {
                summary.after.add(left);
                parts.push(part);
            }
        }
    }
    let stays =
        |part: &Part| part.model == Model::Spatial && is_nearly_all(view, part.size().contacts);
    if view.swept && parts.iter().any(stays) {
        // A sweep over it takes as long as one over the whole, and the way to it has taken as long as some more.
        return None;
    }
    let parts = gathered(parts, SMALL, POOL);
    if parts.len() == 1
        && summary.after.contacts == view.contacts()
        && parts[0].model == Model::Spatial
    {
        // Small islands, all of them put together again.
        return None;
    }
    let mut free = vec![view.form == Form::Velocity; view.bodies];
    let touched = view.columns.iter();
    touched.for_each(|&body| free[body as usize] = false);
    let removed = Size {
        velocities: view.width * free.into_iter().filter(|free| *free).count(),
        ..Size::default()
    };
    summary.count("free bodies", 0, removed);
    Some(Reduced {
        impulse,
        resting,
        parts,
        summary,
        closed,
    })
}

/// Whether so few contacts are beside these that taking them away is not worth what it costs.
pub fn is_nearly_all(view: &View, contacts: usize) -> bool {
    WORTH_TAKING * (view.contacts() - contacts) < view.contacts()
}

/// Whether no proposal for these contacts stands, as is soon seen of most that do not lie in a plane, before they are put in
/// order.
fn stays_as_it_is(view: &View, contacts: &[u32], local: &mut LocalBodies) -> bool {
    // The same code each time, made for blocks of this size.
    match (view.rows, view.width) {
        (3, 6) => stays_sized::<3, 6>(Shaped(view), contacts, local),
        _ => stays_sized::<0, 0>(Shaped(view), contacts, local),
    }
}

fn stays_sized<const R: usize, const D: usize>(
    view: Shaped<R, D>,
    contacts: &[u32],
    local: &mut LocalBodies,
) -> bool {
    let by_bodies =
        |one: &u32, other: &u32| by_bodies(view.bodies_of(*one), view.bodies_of(*other));
    let normals = view.swept && view.law == Law::Normal;
    let has_friction = |&contact: &u32| view.has_friction(contact);
    let all_rows = || view.law == Law::Coulomb && contacts.iter().all(has_friction);
    let may_stay = contacts.len() > 1
        && view.form == Form::Velocity
        && (normals || all_rows())
        && view.width <= LARGEST
        && contacts.is_sorted_by(|one, other| by_bodies(one, other).is_le());
    if !may_stay {
        return false;
    }
    let slides = !normals && collinear::slides(&view, contacts);
    if !slides && !normals && contacts.len() > FEW {
        return false;
    }
    // What is no model of some pairs of bodies is none of all; one that stands on what never moves tells little.
    let moves_two = |run: &Range<usize>| view.bodies_of(contacts[run.start]).len() > 1;
    let begin = runs(&view, contacts).find(moves_two);
    let begin = begin.map_or(0, |run| run.start);
    let first: Vec<_> = runs(&view, &contacts[begin..]).take(TELLING).collect();
    let telling = &contacts[begin..][..first.last().map_or(0, |run| run.end)];
    if planar::may_be(view, contacts, telling, &first) {
        return false;
    }
    let mut is_collinear = |contacts: &[u32], runs: &[Range<usize>]| {
        local.renumber(&view, contacts);
        collinear::propose(view, contacts, runs, local).is_some()
    };
    if !slides && is_collinear(telling, &first) {
        let all: Vec<_> = runs(&view, contacts).collect();
        if is_collinear(contacts, &all) {
            return false;
        }
    }
    if normals {
        // Sweeps leave tangents out by themselves, and bodies that do not turn cost them little more than points. Of three
        // contacts, none is within the hull of the others, unless they lie in line.
        view.by_pairs(contacts).all(|run| run.len() <= 3) && !spatial::has_twins(view, contacts, 1)
    } else {
        !translational::may_be(view, contacts, view.rows())
            && !spatial::has_twins(view, contacts, view.rows())
    }
}

/// Where contacts that are sorted by bodies have those of the same bodies.
fn runs(view: &View, contacts: &[u32]) -> impl Iterator<Item = Range<usize>> {
    view.by_pairs(contacts).scan(0, |end, run| {
        let begin = *end;
        *end += run.len();
        Some(begin..*end)
    })
}

/// Islands, and the contacts of each, in an order that does not depend on the order they came in, by bodies first.
///
/// Contacts of A stay as they came, as its columns do; the solvers order them.
fn in_order(view: &View, islands: Vec<Vec<u32>>) -> Vec<Vec<u32>> {
    let described = view.described();
    let ascend = |one: &u32, other: &u32| described.compare(*one, *other);
    let mut led: Vec<(u32, Vec<u32>)> = islands
        .into_iter()
        .map(|mut contacts| {
            if view.form == Form::Impulse {
                let first = contacts.iter().copied().min_by(ascend);
                return (first.expect("an island has a contact"), contacts);
            }
            let bodies = |contact: &u32| view.bodies_of(*contact);
            if contacts.is_sorted_by(|one, other| by_bodies(bodies(one), bodies(other)).is_le()) {
                // So they come from a scene. Few contacts at a time are sorted in no time.
                let pairs = contacts.chunk_by_mut(|one, other| bodies(one) == bodies(other));
                pairs.for_each(|pair| pair.sort_by(ascend));
            } else {
                contacts.sort_by(ascend);
            }
            (contacts[0], contacts)
        })
        .collect();
    led.sort_by(|one, other| ascend(&one.0, &other.0));
    led.into_iter().map(|(_, contacts)| contacts).collect()
}

/// Leave out the contacts of an island that are out of reach, and see what it falls into.
fn within_reach(
    view: &View,
    reach: &Reach<'_>,
    island: Vec<u32>,
    local: &mut LocalBodies,
    pieces: &mut Vec<Vec<u32>>,
    summary: &mut Summary,
) {
    local.renumber(view, &island);
    let whole = part_size(view, &island, local);
    let mut left = Size::default();
    let (mut waiting, mut numbered) = (vec![island], true);
    while let Some(mut contacts) = waiting.pop() {
        if !numbered {
            local.renumber(view, &contacts);
        }
        numbered = false;
        let before = contacts.len();
        reach.leave_out(&mut contacts, local);
        if contacts.len() == before {
            left.add(part_size(view, &contacts, local));
            pieces.push(contacts);
        } else {
            // The last one waits on top.
            waiting.extend(islands::islands(view, &contacts).into_iter().rev());
        }
    }
    summary.count("inactive", 1, whole.less(left));
}

/// Parts of fewer than `small` contacts go together with those of the same shape, as one of some more than `pool`: each by
/// itself takes longer to begin than to solve.
fn gathered(parts: Vec<Part>, small: usize, pool: usize) -> Vec<Part> {
    let mut result: Vec<Part> = Vec::with_capacity(parts.len());
    let mut open: Vec<usize> = Vec::new();
    for part in parts {
        if part.friction.len() >= small {
            result.push(part);
            continue;
        }
        let fits = |&place: &usize| {
            let other = &result[place];
            (other.form, other.rows, other.matrix.width)
                == (part.form, part.rows, part.matrix.width)
        };
        match open.iter().position(fits) {
            Some(at) => {
                let joined = &mut result[open[at]];
                joined.append(part);
                if joined.friction.len() >= pool {
                    open.swap_remove(at);
                }
            }
            None => {
                open.push(result.len());
                result.push(part);
            }
        }
    }
    result
}

/// The smallest exact model of an island; None where it is the whole system, and stays as it is.
fn smallest(view: &View, contacts: &[u32], local: &LocalBodies, team: &Team) -> Option<Part> {
    // The same code each time, made for blocks of this size.
    match (view.rows, view.width) {
        (1, 3) => smallest_sized::<1, 3>(Shaped(view), contacts, local, team),
        (1, 6) => smallest_sized::<1, 6>(Shaped(view), contacts, local, team),
        (3, 3) => smallest_sized::<3, 3>(Shaped(view), contacts, local, team),
        (3, 6) => smallest_sized::<3, 6>(Shaped(view), contacts, local, team),
        _ => smallest_sized::<0, 0>(Shaped(view), contacts, local, team),
    }
}

fn smallest_sized<const R: usize, const D: usize>(
    view: Shaped<R, D>,
    contacts: &[u32],
    local: &LocalBodies,
    team: &Team,
) -> Option<Part> {
    let alone = contacts.len() == view.contacts();
    let runs: Vec<_> = runs(&view, contacts).collect();
    let stands = |proposal| Part::new(view, contacts, proposal, local, team);
    if view.width <= LARGEST {
        let collinear = collinear::propose(view, contacts, &runs, local).and_then(stands);
        let planar = || planar::propose(view, contacts, &runs, local, team).find_map(stands);
        let found = collinear.or_else(planar);
        if let Some(part) = found {
            return Some(part);
        }
    }
    let all = spatial::propose(view, contacts, &runs);
    let proposal = translational::propose(view, contacts, local, all);
    if alone
        && proposal.model == Model::Spatial
        && proposal.len() == contacts.len()
        && contacts.len() > 1
    {
        return None;
    }
    Some(stands(proposal).expect("equal rows and rows of zeros are exact"))
}

fn whole_size(view: &View) -> Size {
    Size {
        contacts: view.contacts(),
        rows: view.b.len(),
        velocities: match view.form {
            Form::Velocity => view.bodies * view.width,
            Form::Impulse => 0,
        },
    }
}

/// Of some contacts with their bodies.
fn part_size(view: &View, contacts: &[u32], local: &LocalBodies) -> Size {
    Size {
        contacts: contacts.len(),
        rows: contacts.len() * view.rows,
        velocities: match view.form {
            Form::Velocity => local.count() * view.width,
            Form::Impulse => 0,
        },
    }
}

fn name(part: &Part) -> &'static str {
    match part.model {
        Model::Spatial => "duplicates",
        Model::Frictionless => "frictionless",
        Model::Translational => "translational",
        Model::Planar => "planar",
        Model::Collinear => "collinear",
    }
}
