//! A proposal put to the conditions that make it exact, and the reduced system with its way back if it stands.

use std::ops::Range;

use crate::exact::BlockMatrix;
use crate::team::Team;

use super::local_bodies::LocalBodies;
use super::{Form, ROUNDING, Shaped, Size, View};

/// What a part of the system was taken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Every contact with all its rows, every body with all its velocities.
    Spatial,
    /// One row for a contact, all velocities.
    Frictionless,
    /// Bodies without rotation.
    Translational,
    Planar,
    Collinear,
}

/// The largest number of velocities that a reduced body has.
pub const WIDEST: usize = 3;
/// The largest number of velocities of a body that is reduced.
pub const LARGEST: usize = 6;

/// A unit vector of a body's whitened velocities; what is beyond their number is zero.
pub type Direction = [f64; LARGEST];

/// Which velocities the bodies keep.
pub enum Columns {
    All,
    /// So many, in orthonormal directions, body by body.
    Some(usize, Vec<Direction>),
}

/// What becomes of one contact: its group, its weight in it, and its in-plane tangent, (cos, sin) in its own tangents.
#[derive(Clone, Copy)]
pub struct Share {
    pub group: u32,
    pub weight: f64,
    pub tangent: [f64; 2],
}

impl Share {
    /// A contact that stays as it is.
    pub fn whole(group: u32) -> Self {
        Self {
            group,
            weight: 1.0,
            tangent: [1.0, 0.0],
        }
    }
}

/// Groups, frames and subspaces for the contacts of an island.
pub struct Proposal {
    pub model: Model,
    /// Rows of a reduced contact.
    pub rows: usize,
    pub pieces: Vec<Piece>,
    pub columns: Columns,
}

impl Proposal {
    /// Contacts after the reduction.
    pub fn len(&self) -> usize {
        self.pieces.iter().map(|piece| piece.groups.len()).sum()
    }
}

/// What becomes of a stretch of an island's contacts, which has all of each of its groups: one thread works it out.
///
/// Where the stretches begin and end depends on the contacts alone.
pub struct Piece {
    pub contacts: Range<usize>,
    /// Of contacts counted from the first of the stretch.
    pub groups: Groups,
    /// In the order of the contacts; those of a group share their bodies.
    pub shares: Vec<Share>,
}

/// A reduced system, and where its contacts come from.
pub struct Part {
    pub form: Form,
    pub model: Model,
    pub contacts: Vec<u32>,
    pub shares: Vec<Share>,
    pub rows: usize,
    pub matrix: BlockMatrix,
    pub b: Vec<f64>,
    pub friction: Vec<f64>,
    pub(super) growth: Growth,
}

impl Part {
    /// The reduced system of an island, or None where the proposal is not exact; the team takes part.
    pub fn new<const R: usize, const D: usize>(
        view: Shaped<R, D>,
        contacts: &[u32],
        proposal: Proposal,
        local: &LocalBodies,
        team: &Team,
    ) -> Option<Self> {
        if proposal.model == Model::Spatial && proposal.len() == contacts.len() {
            return Some(Self::untouched(&view, contacts, local));
        }
        let Proposal {
            model,
            rows,
            pieces,
            columns,
        } = proposal;
        let of = |piece: Piece| {
            let contacts = &contacts[piece.contacts];
            let (groups, shares) = (&piece.groups, piece.shares);
            Self::of_piece(
                view,
                (model, rows),
                contacts,
                groups,
                shares,
                &columns,
                local,
            )
        };
        let mut work: Vec<_> = pieces
            .into_iter()
            .map(|piece| (Some(piece), None))
            .collect();
        team.each(&mut work, |(piece, part)| *part = piece.take().and_then(of));
        let mut parts = work.into_iter().map(|(_, part)| part);
        let mut part = parts.next()??;
        for other in parts {
            part.take_in(other?, 0);
        }
        Some(part)
    }

    /// The same of one piece.
    fn of_piece<const R: usize, const D: usize>(
        view: Shaped<R, D>,
        (model, rows): (Model, usize),
        contacts: &[u32],
        groups: &Groups,
        shares: Vec<Share>,
        columns: &Columns,
        local: &LocalBodies,
    ) -> Option<Self> {
        let width = match *columns {
            Columns::All => view.width(),
            Columns::Some(width, _) => width,
        };
        let count = groups.len();
        let mut starts = Vec::with_capacity(count + 1);
        starts.push(0);
        let mut part = Self {
            form: Form::Velocity,
            model,
            contacts: contacts.to_vec(),
            rows,
            matrix: BlockMatrix {
                starts,
                columns: Vec::with_capacity(2 * count),
                values: Vec::with_capacity(2 * count * rows * width),
                height: rows,
                width,
                block_columns: local.count(),
            },
            b: vec![0.0; count * rows],
            friction: vec![0.0; count],
            shares,
            growth: Growth::default(),
        };
        part.gather_targets(view)?;
        match columns {
            Columns::All => part.add_blocks(view, groups, local)?,
            Columns::Some(_, bases) => part.project_blocks(view, groups, bases, local)?,
        }
        part.growth = part.growth_of(view, groups);
        Some(part)
    }

    /// The contacts as they are, without those of other islands.
    pub fn untouched(view: &View, contacts: &[u32], local: &LocalBodies) -> Self {
        let area = view.rows * view.width;
        let mut matrix = BlockMatrix {
            starts: Vec::with_capacity(contacts.len() + 1),
            columns: Vec::with_capacity(2 * contacts.len()),
            values: Vec::with_capacity(2 * contacts.len() * area),
            height: view.rows,
            width: view.width,
            block_columns: local.count(),
        };
        matrix.starts.push(0);
        let mut b = Vec::with_capacity(contacts.len() * view.rows);
        for &contact in contacts {
            let places = view.places(contact);
            let bodies = view.bodies_of(contact).iter();
            matrix
                .columns
                .extend(bodies.map(|&body| local.number(body) as u32));
            matrix
                .values
                .extend_from_slice(&view.whitened[places.start * area..places.end * area]);
            matrix.starts.push(matrix.columns.len());
            b.extend_from_slice(view.target(contact));
        }
        let friction = contacts
            .iter()
            .map(|&contact| view.friction[contact as usize]);
        Self {
            form: Form::Velocity,
            model: Model::Spatial,
            contacts: contacts.to_vec(),
            rows: view.rows,
            matrix,
            b,
            friction: friction.collect(),
            shares: (0..contacts.len() as u32).map(Share::whole).collect(),
            growth: Growth::default(),
        }
    }

    /// How large it is; A alone says nothing of velocities.
    pub fn size(&self) -> Size {
        Size {
            contacts: self.friction.len(),
            rows: self.b.len(),
            velocities: match self.form {
                Form::Velocity => self.matrix.block_columns * self.matrix.width,
                Form::Impulse => 0,
            },
        }
    }

    /// Takes into account contacts left out that are kept open by those of this part, at most so many by one of them.
    ///
    /// Such a contact misses Signorini's condition, or the cone, by no more than the worst of those that keep it open.
    pub fn keeps_open(&mut self, most: usize) {
        self.growth.factor *= (1.0 + most as f64).sqrt();
    }

    /// Σ_i w_i C_iᵀ B_i, and condition (c).
    #[inline(always)]
    pub fn gather_targets<const R: usize, const D: usize>(
        &mut self,
        view: Shaped<R, D>,
    ) -> Option<()> {
        let rows = self.rows;
        self.b.fill(0.0);
        for (&contact, share) in self.contacts.iter().zip(&self.shares) {
            let seen = share.seen(rows, view.target(contact).iter().copied());
            let sum = &mut self.b[share.group as usize * rows..][..rows];
            for (sum, value) in sum.iter_mut().zip(seen) {
                *sum += share.weight * value;
            }
            self.friction[share.group as usize] = view.friction[contact as usize];
        }
        let bound = ROUNDING * view.largest;
        for (&contact, share) in self.contacts.iter().zip(&self.shares) {
            let target = view.target(contact);
            let group = &self.b[share.group as usize * rows..][..rows];
            let seen = share.seen(rows, target.iter().copied());
            let mut misses = seen.iter().zip(group).map(|(value, wanted)| value - wanted);
            let same = misses.all(|miss| within(miss.abs(), bound));
            let shown = !view.has_friction(contact) || within(share.hidden(rows, target), bound);
            let friction = view.friction[contact as usize];
            if !(same && shown && friction == self.friction[share.group as usize]) {
                return None;
            }
        }
        Some(())
    }

    /// J' where bodies keep all velocities: (a) holds, and (b) where the blocks of a group are the same.
    #[inline(always)]
    fn add_blocks<const R: usize, const D: usize>(
        &mut self,
        view: Shaped<R, D>,
        groups: &Groups,
        local: &LocalBodies,
    ) -> Option<()> {
        let rows = self.rows;
        let mut sum = vec![0.0; rows * view.width()];
        for members in groups.iter() {
            let first = self.contacts[members[0] as usize];
            for (slot, &body) in view.bodies_of(first).iter().enumerate() {
                sum.fill(0.0);
                for &member in members {
                    self.add_member(view, member, slot, sum.chunks_exact_mut(view.width()));
                }
                let alike = |&member: &u32| {
                    let place = view.places(self.contacts[member as usize]).start + slot;
                    sum.chunks_exact(view.width())
                        .enumerate()
                        .all(|(r, wanted)| {
                            let mut line = [0.0; LARGEST];
                            self.shares[member as usize].add_seen(view, place, r, 1.0, &mut line);
                            let bound = ROUNDING * size(view.row(place, 0)).max(size(wanted));
                            let misses = line.iter().zip(wanted).map(|(x, y)| (x - y).abs());
                            within(misses.fold(0.0, f64::max), bound)
                        })
                };
                if members.len() > 1 && !members.iter().all(alike) {
                    return None;
                }
                if sum.iter().any(|&value| value != 0.0) {
                    self.matrix.columns.push(local.number(body) as u32);
                    self.matrix.values.extend_from_slice(&sum);
                }
            }
            self.matrix.starts.push(self.matrix.columns.len());
        }
        Some(())
    }

    /// Adds w_i C_iᵀ Ĵ_i of one contact and one of its bodies, row by row; returns the place of the block.
    #[inline(always)]
    fn add_member<'l, const R: usize, const D: usize>(
        &self,
        view: Shaped<R, D>,
        member: u32,
        slot: usize,
        lines: impl Iterator<Item = &'l mut [f64]>,
    ) -> usize {
        let share = &self.shares[member as usize];
        let place = view.places(self.contacts[member as usize]).start + slot;
        for (r, line) in lines.enumerate() {
            share.add_seen(view, place, r, share.weight, line);
        }
        place
    }

    /// J' where bodies keep the velocities of a basis, and conditions (a) and (b).
    #[inline(always)]
    fn project_blocks<const R: usize, const D: usize>(
        &mut self,
        view: Shaped<R, D>,
        groups: &Groups,
        bases: &[Direction],
        local: &LocalBodies,
    ) -> Option<()> {
        // The same code each time, made for blocks of this size.
        match (self.rows, self.matrix.width) {
            (1, 1) => self.project_sized::<R, D, 1, 1>(view, groups, bases, local),
            (1, 2) => self.project_sized::<R, D, 1, 2>(view, groups, bases, local),
            (1, 3) => self.project_sized::<R, D, 1, 3>(view, groups, bases, local),
            (2, 2) => self.project_sized::<R, D, 2, 2>(view, groups, bases, local),
            (2, 3) => self.project_sized::<R, D, 2, 3>(view, groups, bases, local),
            (3, 3) => self.project_sized::<R, D, 3, 3>(view, groups, bases, local),
            (rows, width) => unreachable!("no model has {rows} rows and {width} velocities"),
        }
    }

    #[inline(always)]
    fn project_sized<const R: usize, const D: usize, const ROWS: usize, const WIDTH: usize>(
        &mut self,
        view: Shaped<R, D>,
        groups: &Groups,
        bases: &[Direction],
        local: &LocalBodies,
    ) -> Option<()> {
        let bases = bases.as_chunks::<WIDTH>().0;
        for members in groups.iter() {
            let first = self.contacts[members[0] as usize];
            for (slot, &body) in view.bodies_of(first).iter().enumerate() {
                let mut sum = [[0.0; LARGEST]; ROWS];
                let mut longest = 0.0_f64;
                for &member in members {
                    let lines = sum.iter_mut().map(|line| &mut line[..view.width()]);
                    let place = self.add_member(view, member, slot, lines);
                    let normal = view.row(place, 0);
                    longest = longest.max(dot(normal, normal));
                }
                if longest == 0.0 && sum.as_flattened().iter().all(|&value| value == 0.0) {
                    continue;
                }
                let body = local.number(body);
                self.matrix.columns.push(body as u32);
                let basis = &bases[body];
                let mut block = [[0.0; WIDTH]; ROWS];
                for (line, entries) in sum.iter().zip(&mut block) {
                    let mut rest = *line;
                    for (entry, vector) in entries.iter_mut().zip(basis) {
                        *entry = dot(&line[..view.width()], &vector[..view.width()]);
                        for (value, direction) in rest[..view.width()].iter_mut().zip(vector) {
                            *value -= *entry * direction;
                        }
                    }
                    // (a), in squares.
                    let line = &line[..view.width()];
                    let bound = ROUNDING * ROUNDING * longest.max(dot(line, line));
                    if !within(dot(&rest[..view.width()], &rest[..view.width()]), bound) {
                        return None;
                    }
                }
                self.matrix.values.extend_from_slice(block.as_flattened());
                self.same_from_all(view, members, slot, basis, &block, longest.sqrt())?;
            }
            self.matrix.starts.push(self.matrix.columns.len());
        }
        Some(())
    }

    /// (b): velocities within the basis look the same from each contact of a group.
    #[inline(always)]
    fn same_from_all<const R: usize, const D: usize, const ROWS: usize, const WIDTH: usize>(
        &self,
        view: Shaped<R, D>,
        members: &[u32],
        slot: usize,
        basis: &[Direction; WIDTH],
        block: &[[f64; WIDTH]; ROWS],
        length: f64,
    ) -> Option<()> {
        for &member in members {
            let contact = self.contacts[member as usize];
            let share = &self.shares[member as usize];
            let hides = ROWS < view.rows() && view.has_friction(contact);
            if members.len() == 1 && !hides {
                // It is the group.
                continue;
            }
            let place = view.places(contact).start + slot;
            let bound = ROUNDING * length;
            for (k, vector) in basis.iter().enumerate() {
                let mut seen = [0.0; 3];
                for (r, value) in seen[..view.rows()].iter_mut().enumerate() {
                    *value = dot(view.row(place, r), &vector[..view.width()]);
                }
                let found = share.seen(ROWS, seen[..view.rows()].iter().copied());
                let same = (0..ROWS).all(|r| within((found[r] - block[r][k]).abs(), bound));
                let shown = !hides || within(share.hidden(ROWS, &seen[..view.rows()]), bound);
                if !(same && shown) {
                    return None;
                }
            }
        }
        Some(())
    }

    #[inline(always)]
    fn growth_of<const R: usize, const D: usize>(
        &self,
        view: Shaped<R, D>,
        groups: &Groups,
    ) -> Growth {
        let (mut factor, mut least, mut most) = (1.0_f64, usize::MAX, 1);
        let area = self.rows * self.matrix.width;
        for (members, range) in groups.iter().zip(self.matrix.starts.windows(2)) {
            (least, most) = (least.min(members.len()), most.max(members.len()));
            if members.len() == 1 && self.rows == view.rows() {
                // C_i turns all rows, and by (a) none gets shorter.
                continue;
            }
            let mut diagonal = [0.0; 3];
            let values = &self.matrix.values[range[0] * area..range[1] * area];
            for (at, line) in values.chunks_exact(self.matrix.width).enumerate() {
                diagonal[at % self.rows] += dot(line, line);
            }
            let reduced = diagonal.into_iter().fold(0.0, f64::max);
            if reduced == 0.0 {
                continue;
            }
            for &member in members {
                let mut diagonal = [0.0; 3];
                for place in view.places(self.contacts[member as usize]) {
                    for (r, sum) in diagonal[..view.rows()].iter_mut().enumerate() {
                        let row = view.row(place, r);
                        *sum += dot(row, row);
                    }
                }
                let full = diagonal.into_iter().fold(0.0, f64::max);
                factor = factor.max(self.shares[member as usize].weight * full / reduced);
            }
        }
        Growth {
            factor,
            least: least.min(most) as f64,
            most: most as f64,
        }
    }

    /// What a residual of one relative to the part's own B is at most of the whole system's, squared, m²/s².
    pub fn weight(&self, view: &View) -> f64 {
        self.growth.bound().powi(2) * asked(view, &self.contacts)
    }

    /// Takes another part of the same shape in, with bodies of its own.
    pub fn append(&mut self, other: Self) {
        let bodies = self.matrix.block_columns;
        self.take_in(other, bodies);
    }

    /// Takes another part in, whose bodies are counted from `bodies`.
    fn take_in(&mut self, other: Self, bodies: usize) {
        let groups = self.friction.len() as u32;
        self.contacts.extend(other.contacts);
        self.shares
            .extend(other.shares.into_iter().map(|share| Share {
                group: share.group + groups,
                ..share
            }));
        self.matrix.extend(&other.matrix, bodies);
        self.b.extend(other.b);
        self.friction.extend(other.friction);
        self.growth.join(other.growth);
    }

    /// p_i = w_i C_i q_g into the impulses of the whole system.
    pub fn lift(&self, rows: usize, reduced: &[f64], whole: &mut [f64]) {
        for (&contact, share) in self.contacts.iter().zip(&self.shares) {
            let q = &reduced[share.group as usize * self.rows..][..self.rows];
            let p = &mut whole[contact as usize * rows..][..rows];
            p.fill(0.0);
            p[0] = share.weight * q[0];
            match self.rows {
                1 => {}
                2 => {
                    for (value, direction) in p[1..].iter_mut().zip(share.tangent) {
                        *value = share.weight * direction * q[1];
                    }
                }
                _ => (1..rows).for_each(|r| p[r] = share.weight * q[r]),
            }
        }
    }

    /// Σ_i C_iᵀ p_i, what lifting would give p: the reduced impulses to start from.
    pub fn restrict(&self, rows: usize, whole: &[f64]) -> Vec<f64> {
        let mut reduced = vec![0.0; self.b.len()];
        for (&contact, share) in self.contacts.iter().zip(&self.shares) {
            let p = whole[contact as usize * rows..][..rows].iter().copied();
            let q = &mut reduced[share.group as usize * self.rows..][..self.rows];
            for (sum, value) in q.iter_mut().zip(share.seen(self.rows, p)) {
                *sum += value;
            }
        }
        reduced
    }
}

/// How much larger the residual of the lifted impulses can be than that of the reduced ones, both relative to B.
///
/// The natural map N(d) = ‖d p − P(d p − û)‖ rises with d, and N(d)/d falls. A lifted contact has d_i w_i in the place
/// of the reduced d'_g, hence N_i ≤ max(1, d_i w_i / d'_g) N'_g, and each ‖B_i‖ is ‖B'_g‖ where there is friction, at
/// least that where there is none: the sums over contacts differ by at most the sizes m_g of the groups.
#[derive(Clone, Copy)]
pub(super) struct Growth {
    factor: f64,
    /// The smallest and the largest m_g.
    least: f64,
    most: f64,
}

impl Default for Growth {
    fn default() -> Self {
        Self {
            factor: 1.0,
            least: 1.0,
            most: 1.0,
        }
    }
}

impl Growth {
    /// Where a row that is left has a part `factor` smaller of the diagonal than the largest row of its contact.
    pub(super) fn of_rows(factor: f64) -> Self {
        Self {
            factor,
            ..Self::default()
        }
    }

    fn join(&mut self, other: Self) {
        self.factor = self.factor.max(other.factor);
        self.least = self.least.min(other.least);
        self.most = self.most.max(other.most);
    }

    fn bound(&self) -> f64 {
        self.factor * (self.most / self.least).sqrt()
    }
}

impl Share {
    /// C_iᵀ x for a vector x of the contact.
    #[inline(always)]
    fn seen(&self, rows: usize, x: impl Iterator<Item = f64>) -> [f64; 3] {
        let mut full = [0.0; 3];
        full.iter_mut().zip(x).for_each(|(out, value)| *out = value);
        if rows == 2 {
            let [cos, sin] = self.tangent;
            full[1] = cos * full[1] + sin * full[2];
        }
        full
    }

    /// How much of the tangential part of x is not among the rows kept.
    #[inline(always)]
    fn hidden(&self, rows: usize, x: &[f64]) -> f64 {
        match (rows, x) {
            (1, [_, tangents @ ..]) => tangents.iter().fold(0.0, |most, x| most.max(x.abs())),
            (2, [_, first, second]) => (self.tangent[0] * second - self.tangent[1] * first).abs(),
            _ => 0.0,
        }
    }

    /// line += weight × row r of C_iᵀ Ĵ_i for one block.
    #[inline(always)]
    pub fn add_seen<const R: usize, const D: usize>(
        &self,
        view: Shaped<R, D>,
        place: usize,
        r: usize,
        weight: f64,
        line: &mut [f64],
    ) {
        let mut add = |row: usize, weight: f64| {
            let row = view.row(place, row);
            for (sum, value) in line[..view.width()].iter_mut().zip(row) {
                *sum += weight * value;
            }
        };
        if r == 1 && self.tangent != [1.0, 0.0] {
            add(1, weight * self.tangent[0]);
            add(2, weight * self.tangent[1]);
        } else {
            add(r, weight);
        }
    }
}

/// The share of an island, or of the contacts that a part stands for, in what all may leave of ‖B‖² = `whole`².
///
/// Islands with r_k² ≤ tol² (‖B_k‖² + ‖B‖² n_k/n)/2 add up to r ≤ tol ‖B‖: an island in which hardly anything moves need
/// not be solved to its own last digit.
pub fn fair_share(view: &View, contacts: &[u32], whole: f64) -> f64 {
    let share = contacts.len() as f64 / view.contacts() as f64;
    0.5 * (asked(view, contacts) + whole * whole * share)
}

/// ‖B_k‖² of these contacts.
fn asked(view: &View, contacts: &[u32]) -> f64 {
    let square = |&contact: &u32| dot(view.target(contact), view.target(contact));
    contacts.iter().map(square).sum()
}

/// The contacts of an island by their groups.
#[derive(Default)]
pub struct Groups {
    /// Indices of contacts, group by group.
    order: Vec<u32>,
    /// Where each group ends.
    ends: Vec<u32>,
}

impl Groups {
    pub fn with_capacity(contacts: usize) -> Self {
        Self {
            order: Vec::with_capacity(contacts),
            ends: Vec::with_capacity(contacts),
        }
    }

    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Adds a contact to the group that is not ended yet.
    #[inline(always)]
    pub fn push(&mut self, index: usize) {
        self.order.push(index as u32);
    }

    /// Ends a group, and returns its members.
    #[inline(always)]
    pub fn end(&mut self) -> &[u32] {
        let begin = self.ends.last().map_or(0, |&end| end as usize);
        self.ends.push(self.order.len() as u32);
        &self.order[begin..]
    }

    /// The indices of the contacts of each group.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = &[u32]> {
        let mut begin = 0;
        self.ends.iter().map(move |&end| {
            let members = &self.order[begin..end as usize];
            begin = end as usize;
            members
        })
    }
}

#[inline(always)]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Two sums, side by side in a register: nearly all of the work of this folder is dots of three and six numbers.
    let (pairs, last) = a.as_chunks::<2>();
    let (others, other) = b.as_chunks::<2>();
    let mut sums = [0.0; 2];
    for (x, y) in pairs.iter().zip(others) {
        (0..2).for_each(|k| sums[k] += x[k] * y[k]);
    }
    sums[0] + sums[1] + last.iter().zip(other).map(|(x, y)| x * y).sum::<f64>()
}

/// ‖x‖
pub fn size(x: &[f64]) -> f64 {
    // Four sums at a time, rather than each waiting for the one before.
    let (fours, rest) = x.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for four in fours {
        for (sum, x) in sums.iter_mut().zip(four) {
            *sum += x * x;
        }
    }
    let rest = rest.iter().map(|x| x * x);
    sums.into_iter().chain(rest).sum::<f64>().sqrt()
}

/// Whether a value is at most so large; one that is no number is not.
pub fn within(value: f64, bound: f64) -> bool {
    value <= bound
}
