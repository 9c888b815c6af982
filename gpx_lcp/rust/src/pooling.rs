//! Sweeps over the parts of a system, until together they leave no more than the whole may.
//!
//! Let e_k = (r_k ‖B_k‖)² bound what part k leaves of the squared residual of the whole. Solved is what satisfies
//! Σ e_k ≤ tol² ‖B‖²: a part that is slow may leave what the others do not. Parts of one shape are swept as one, a pool, with
//! all that they may leave together: contacts are swept eight abreast, no two of them on one body. Where most of a pool is
//! done, its sweeps end, and the rest of all pools is put together anew, to use what the others have left. Sweeps that end
//! lose their momentum, and must be laid out again: more often would cost more than it gains. Where a pool stalls, one of
//! its parts may have kept the others, and each goes on by itself.
//!
//! Islands that stay as they are need no parts to begin with: the whole is swept, and parts are made of them when most of
//! it is done.

use std::borrow::Cow;

use crate::exact::{BlockMatrix, Limits};
use crate::gauss_seidel::Stop;
use crate::presolve::{self, Form, Part};
use crate::solving::{Answer, Details, Effort, FINEST, Status, System, run, scale_of};
use crate::sweeping::Look;

/// Contacts of a pool, from which on no other part joins it. Pools are handed out to threads, and do not depend on their
/// number.
const TOGETHER: usize = 1024;
/// The part of its fair share with which a part is done, as long as there are others.
const DONE: f64 = 0.5;
/// The part of the contacts of a pool that must be left for its sweeps to go on.
const MOST: f64 = 0.5;

/// Sweep over all parts, from the impulses `start` of the whole; an answer for each, or None where the caller interrupts it.
/// Together they may leave `budget` of the squared residual. Where sweeps are `resumed`, some parts may be done.
pub fn swept(
    view: &presolve::View,
    parts: &[Part],
    effort: &Effort,
    limits: &Limits,
    start: Option<&[f64]>,
    (budget, resumed): (f64, bool),
) -> Option<Vec<Answer>> {
    let whole = presolve::size(view.b);
    let begin = |part| Swept::begin(part, view, limits.tolerance, whole, start);
    let mut all: Vec<Swept> = parts.iter().map(begin).collect();
    if resumed {
        all.iter_mut().for_each(|part| part.resume(effort));
    }
    while all.iter().any(|part| part.waits) {
        let resting = all.iter().filter(|part| !part.waits);
        let used: f64 = resting.map(|part| part.leaves).sum();
        let pools = pools(&all);
        let sweep_pool = |pool: &Pool, threads: usize| {
            let allowed = match pools.len() {
                1 => pool.allowed.max(budget - used),
                _ => DONE * pool.allowed,
            };
            let mut own = *limits;
            own.iterations -= pool.done;
            own.tolerance = (allowed / pool.weight).sqrt().max(FINEST);
            let look = |impulse: &[f64]| pool.is_mostly_unfinished(&all, impulse, effort);
            let look: Option<Look> = (pool.members.len() > 1).then_some(&look);
            run(
                pool.system(),
                effort,
                &own,
                Some(&pool.start),
                threads,
                look,
            )
        };
        let size = |pool: &Pool| pool.friction.len();
        let found = presolve::each(&pools, size, effort.threads, true, &sweep_pool);
        let members = pools.into_iter().map(|pool| (pool.members, pool.done));
        let members: Vec<(Vec<usize>, usize)> = members.collect();
        for ((members, before), answer) in members.iter().zip(found) {
            let answer = answer?;
            let mut rest = answer.impulse.as_slice();
            for &k in members {
                let own = rest.split_off(..all[k].part.b.len());
                let own = own.expect("impulses of all members");
                let alone = (members.len() == 1).then_some(answer.residual);
                all[k].receive(own, alone, &answer, effort, *before);
                all[k].waits = all[k].goes_on(limits);
            }
        }
        if all.iter().map(|part| part.leaves).sum::<f64>() <= budget {
            for part in &mut all {
                part.answer.status = Status::Solved;
            }
            break;
        }
        if all.iter().any(Swept::is_out_of_time) {
            break;
        }
    }
    Some(all.into_iter().map(|part| part.answer).collect())
}

/// Whether sweeps over a system have come so far with these impulses that they had better go on with some of its islands
/// alone.
pub fn are_mostly_done(
    system: System,
    view: &presolve::View,
    islands: &[Vec<u32>],
    effort: &Effort,
    limits: &Limits,
    impulse: &[f64],
) -> bool {
    let whole = presolve::size(view.b);
    let mut states = Vec::new();
    system.matrix.gather(impulse, &mut states);
    let is_done = |island: &&Vec<u32>| {
        let allowed = limits.tolerance.powi(2) * presolve::fair_share(view, island, whole);
        let left = system.left_by(&effort.program, island, impulse, &states, DONE * allowed);
        left.is_some()
    };
    let done: usize = islands.iter().filter(is_done).map(Vec::len).sum();
    done as f64 >= (1.0 - MOST) * view.contacts() as f64
}

/// A part, and how far it has come.
struct Swept<'a> {
    part: &'a Part,
    scale: Vec<f64>,
    /// e of a relative residual of one, (m/s)².
    weight: f64,
    /// Its fair share of all that may be left, and what it leaves, (m/s)².
    allowed: f64,
    leaves: f64,
    waits: bool,
    /// Whether it is swept by itself, because a pool has failed with it in it.
    apart: bool,
    answer: Answer,
}

impl<'a> Swept<'a> {
    fn begin(
        part: &'a Part,
        view: &presolve::View,
        tolerance: f64,
        whole: f64,
        start: Option<&[f64]>,
    ) -> Self {
        let impulse = match start {
            Some(start) => part.restrict(view.rows, start),
            None => vec![0.0; part.b.len()],
        };
        Self {
            part,
            scale: scale_of(part.form, &part.matrix),
            weight: part.weight(view),
            allowed: tolerance * tolerance * presolve::fair_share(view, &part.contacts, whole),
            leaves: f64::INFINITY,
            waits: true,
            apart: false,
            answer: Answer {
                impulse,
                ..Answer::default()
            },
        }
    }

    /// Find out whether its start makes it done.
    fn resume(&mut self, effort: &Effort) {
        self.answer.residual = self.residual(&self.answer.impulse, effort);
        self.leaves = self.left(self.answer.residual);
        self.waits = !self.is_done(self.leaves);
    }

    /// Take over what was found by further sweeps, of the pool if not `alone`, which then has the residual of this part.
    fn receive(
        &mut self,
        impulse: &[f64],
        alone: Option<f64>,
        found: &Answer,
        effort: &Effort,
        before: usize,
    ) {
        let residual = alone.unwrap_or_else(|| self.residual(impulse, effort));
        let history = &mut self.answer.history;
        history.extend(found.history.iter().map(|&(k, r)| (before + k, r)));
        self.answer.impulse.copy_from_slice(impulse);
        self.answer.residual = residual;
        self.answer.iterations = before + found.iterations;
        self.answer.status = found.status;
        self.answer.details = found.details.clone();
        self.leaves = self.left(residual);
        if alone.is_none() && matches!(found.status, Status::Stalled | Status::NumericalError) {
            (self.apart, self.answer.status) = (true, Status::MaxIterations);
        }
    }

    fn goes_on(&self, limits: &Limits) -> bool {
        let Answer {
            status, iterations, ..
        } = self.answer;
        let may = status == Status::MaxIterations && iterations < limits.iterations;
        may && !self.is_done(self.leaves)
    }

    fn is_done(&self, leaves: f64) -> bool {
        leaves <= DONE * self.allowed
    }

    fn residual(&self, impulse: &[f64], effort: &Effort) -> f64 {
        System::of(self.part, &self.scale).residual(&effort.program, impulse)
    }

    /// e of impulses with this residual.
    fn left(&self, residual: f64) -> f64 {
        residual * residual * self.weight
    }

    fn is_out_of_time(&self) -> bool {
        matches!(self.answer.details, Details::Sweeps(Stop::TimeLimit))
    }
}

/// Parts of one shape that are swept as one.
struct Pool<'a> {
    members: Vec<usize>,
    /// Sweeps done before, the most of any member.
    done: usize,
    apart: bool,
    form: Form,
    matrix: Cow<'a, BlockMatrix>,
    b: Cow<'a, [f64]>,
    friction: Cow<'a, [f64]>,
    scale: Cow<'a, [f64]>,
    start: Cow<'a, [f64]>,
    allowed: f64,
    /// e of a relative residual of one, at most.
    weight: f64,
}

impl<'a> Pool<'a> {
    fn of(k: usize, swept: &'a Swept<'a>) -> Self {
        let part = swept.part;
        Self {
            members: vec![k],
            done: swept.answer.iterations,
            apart: swept.apart,
            form: part.form,
            matrix: Cow::Borrowed(&part.matrix),
            b: Cow::Borrowed(&part.b),
            friction: Cow::Borrowed(&part.friction),
            scale: Cow::Borrowed(&swept.scale),
            start: Cow::Borrowed(&swept.answer.impulse),
            allowed: swept.allowed,
            weight: swept.weight,
        }
    }

    fn has_room_for(&self, other: &Swept) -> bool {
        let shape = |form, matrix: &BlockMatrix| (form, matrix.height, matrix.width);
        let part = other.part;
        !self.apart
            && !other.apart
            && self.friction.len().max(part.friction.len()) < TOGETHER
            && shape(self.form, &self.matrix) == shape(part.form, &part.matrix)
    }

    fn add(&mut self, other: Self) {
        // Relative residuals of both are made relative to B of the pool.
        let squares = [&self.b, &other.b].map(|b| b.iter().map(|b| b * b).sum::<f64>());
        let worst = (self.weight / squares[0]).max(other.weight / squares[1]);
        self.weight = worst * (squares[0] + squares[1]);
        self.allowed += other.allowed;
        self.members.extend(other.members);
        self.done = self.done.max(other.done);
        self.matrix.to_mut().append(&other.matrix);
        self.b.to_mut().extend_from_slice(&other.b);
        self.friction.to_mut().extend_from_slice(&other.friction);
        self.scale.to_mut().extend_from_slice(&other.scale);
        self.start.to_mut().extend_from_slice(&other.start);
    }

    /// Whether most of its contacts are in parts that these impulses do not make done.
    fn is_mostly_unfinished(&self, all: &[Swept], impulse: &[f64], effort: &Effort) -> bool {
        let (mut rest, mut left) = (impulse, 0);
        for one in self.members.iter().map(|&k| &all[k]) {
            let own = rest.split_off(..one.part.b.len());
            let residual = one.residual(own.expect("impulses of all members"), effort);
            if !one.is_done(one.left(residual)) {
                left += one.part.friction.len();
            }
        }
        left as f64 > MOST * self.friction.len() as f64
    }

    fn system(&self) -> System<'_> {
        System {
            form: self.form,
            matrix: &self.matrix,
            b: &self.b,
            friction: &self.friction,
            scale: &self.scale,
            rigid: None,
        }
    }
}

/// The parts that wait, in their order, in pools.
fn pools<'a>(all: &'a [Swept<'a>]) -> Vec<Pool<'a>> {
    let mut pools: Vec<Pool> = Vec::new();
    for (k, one) in all.iter().enumerate().filter(|(_, one)| one.waits) {
        let pool = Pool::of(k, one);
        match pools.iter_mut().find(|pool| pool.has_room_for(one)) {
            Some(room) => room.add(pool),
            None => pools.push(pool),
        }
    }
    pools
}
