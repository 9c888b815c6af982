//! What the impulses of a stacked system are held to, and how far they are from it: the residuals of
//! `formulations.RESIDUALS`, evaluated on Ĵ, B and p alone, whoever found the impulses.

use std::array::from_fn;
use std::ops::Range;

use crate::contact::Law;
use crate::exact::{self, largest};
use crate::friction_cone::{ConvexCone, Coulomb, project};
use crate::polygon::Polygon;
use crate::presolve::size;
use crate::small_matrix::{Vector, dot};
use crate::solving::System;

/// Contacts whose natural maps are worked out together.
const PIECE: usize = 16;

/// Which impulses are allowed, and when. With one row per contact all of them are the same.
#[derive(Clone, Debug, PartialEq)]
pub enum Program {
    /// Without friction.
    Normal,
    Cone,
    Coulomb,
    /// Friction within a polygon, with these corners for a coefficient of one.
    Polygon(Vec<[f64; 2]>),
}

impl Program {
    /// The law of the polygon's corners.
    pub fn polygon<const R: usize>(corners: &[[f64; 2]]) -> Polygon<R> {
        let vector = |corner: &[f64; 2]| from_fn(|r| if r == 0 { 0.0 } else { corner[r - 1] });
        Polygon::new(corners.iter().map(vector).collect())
    }

    /// The law in which all tangents are alike, None for polygons: presolve and the exact methods know no other.
    pub fn isotropic(&self) -> Option<exact::Law> {
        match self {
            Program::Normal => Some(exact::Law::Normal),
            Program::Cone => Some(exact::Law::Cone),
            Program::Coulomb => Some(exact::Law::Coulomb),
            Program::Polygon(_) => None,
        }
    }

    /// ‖natural map‖/‖B‖ of impulses with 1 to 3 rows per contact, None where it is more than `most`. `velocity` puts
    /// u = A p − B of these contacts, whose B it is given, into its last argument.
    pub fn relative_map(
        &self,
        system: System,
        impulse: &[f64],
        velocity: impl Fn(Range<usize>, &[f64], &mut [f64]),
        most: f64,
    ) -> Option<f64> {
        self.bounded_map(system, |at: Range<usize>| &impulse[at], velocity, most)
    }

    /// The same of no impulses at all, None where it is more than `most`: as a rule few contacts tell.
    pub fn without(&self, system: System, most: f64) -> Option<f64> {
        let none = [0.0; 3 * PIECE];
        let falling = |_, b: &[f64], velocity: &mut [f64]| {
            velocity.iter_mut().zip(b).for_each(|(u, b)| *u = -b);
        };
        self.bounded_map(system, |at| &none[..at.len()], falling, most)
    }

    /// ‖natural map‖/‖B‖, None where it is more than `most`.
    fn bounded_map<'a>(
        &self,
        system: System,
        impulse: impl Fn(Range<usize>) -> &'a [f64],
        velocity: impl Fn(Range<usize>, &[f64], &mut [f64]),
        most: f64,
    ) -> Option<f64> {
        let System {
            b, friction, scale, ..
        } = system;
        let (rows, size) = (b.len() / friction.len().max(1), size(b));
        let mut square = 0.0;
        let mut relative = 0.0;
        let mut velocities = [0.0; 3 * PIECE];
        for begin in (0..friction.len()).step_by(PIECE) {
            let contacts = begin..friction.len().min(begin + PIECE);
            let at = rows * contacts.start..rows * contacts.end;
            let velocities = &mut velocities[..at.len()];
            velocity(contacts.clone(), &b[at.clone()], velocities);
            square += self.squared_map(
                rows,
                &Contacts {
                    friction: &friction[contacts.clone()],
                    scale: &scale[contacts],
                    impulse: impulse(at),
                    velocity: velocities,
                },
            );
            // B is zero where there is nothing to do.
            if square != 0.0 {
                relative = square.sqrt() / size;
            }
            if relative > most {
                return None;
            }
        }
        Some(relative)
    }

    /// ‖natural map‖² of contact k, from its own impulse and u = A p − B, 1 to 3 rows.
    pub fn squared_map_of(
        &self,
        system: System,
        k: usize,
        impulse: &[f64],
        velocity: &[f64],
    ) -> f64 {
        let System {
            friction, scale, ..
        } = system;
        let contact = Contacts {
            friction: &friction[k..=k],
            scale: &scale[k..=k],
            impulse,
            velocity,
        };
        self.squared_map(impulse.len(), &contact)
    }

    /// Σ ‖natural map‖² over contacts of 1 to 3 rows.
    fn squared_map(&self, rows: usize, contacts: &Contacts) -> f64 {
        match rows {
            3 => self.squared_map_sized::<3>(contacts),
            2 => self.squared_map_sized::<2>(contacts),
            _ => contacts.sum::<1>(|_, d, p, u| normal_map(d, p, u)),
        }
    }

    fn squared_map_sized<const R: usize>(&self, contacts: &Contacts) -> f64 {
        match self {
            Program::Normal => contacts.sum::<R>(|_, d, p, u| normal_map(d, p, u)),
            Program::Cone => contacts.lawful::<R>(&ConvexCone),
            Program::Coulomb => contacts.lawful::<R>(&Coulomb),
            Program::Polygon(corners) => contacts.lawful::<R>(&Self::polygon(corners)),
        }
    }

    /// Bring start impulses into the cones of the program, to the nearest point of each. Returns how far they moved,
    /// relative to the largest entry.
    pub fn admit(&self, friction: &[f64], impulse: &mut [f64], rows: usize) -> f64 {
        let (mut size, mut moved): (Option<f64>, f64) = (None, 0.0);
        for k in 0..friction.len() {
            let p = &impulse[rows * k..rows * (k + 1)];
            if rows == 1 && p[0] >= 0.0 {
                // On the half-line that all programs have in common.
                continue;
            }
            let mut given = [0.0; 3];
            given[..rows].copy_from_slice(p);
            let inside = match self {
                Program::Normal => project(0.0, &given),
                Program::Cone | Program::Coulomb => project(friction[k], &given),
                Program::Polygon(_) if rows == 1 => project(0.0, &given),
                Program::Polygon(corners) => project_pyramid(friction[k], corners, &given),
            };
            if inside != given {
                // All before were left as they are.
                size.get_or_insert_with(|| largest(impulse));
                moved = moved.max(largest(&from_fn::<_, 3, _>(|r| inside[r] - given[r])));
                impulse[rows * k..rows * (k + 1)].copy_from_slice(&inside[..rows]);
            }
        }
        match size {
            Some(size) if size > 0.0 => moved / size,
            _ => 0.0,
        }
    }
}

/// The nearest point of {x_t ∈ μ x_n P} for the convex polygon P: x itself, or the nearest of the points on the facets
/// between neighbouring generators (1, μ corner), on the generators, and the apex.
fn project_pyramid(friction: f64, corners: &[[f64; 2]], x: &[f64; 3]) -> [f64; 3] {
    let count = corners.len();
    let outside = |k: usize| {
        let ([ax, ay], [bx, by]) = (corners[k], corners[(k + 1) % count]);
        let outward = [by - ay, ax - bx];
        let support = outward[0] * ax + outward[1] * ay;
        x[1] * outward[0] + x[2] * outward[1] > friction * x[0] * support
    };
    if x[0] >= 0.0 && !(0..count).any(outside) {
        return *x;
    }
    let generator = |k: usize| [1.0, friction * corners[k][0], friction * corners[k][1]];
    let on_generator = |k: usize| {
        let g = generator(k);
        let along = (dot(&g, x) / dot(&g, &g)).max(0.0);
        g.map(|value| along * value)
    };
    let on_facet = |k: usize| {
        let (g, h) = (generator(k), generator((k + 1) % count));
        let (gg, hh, gh, gx, hx) = (
            dot(&g, &g),
            dot(&h, &h),
            dot(&g, &h),
            dot(&g, x),
            dot(&h, x),
        );
        let determinant = gg * hh - gh * gh;
        let (a, b) = (
            (hh * gx - gh * hx) / determinant,
            (gg * hx - gh * gx) / determinant,
        );
        let admissible = determinant > 1e-14 * gg * hh && a >= 0.0 && b >= 0.0;
        admissible.then(|| std::array::from_fn(|r| a * g[r] + b * h[r]))
    };
    let distance = |y: &[f64; 3]| (0..3).map(|r| (x[r] - y[r]) * (x[r] - y[r])).sum::<f64>();
    let candidates = (0..count)
        .map(on_generator)
        .chain((0..count).filter_map(on_facet));
    candidates
        .min_by(|one, other| distance(one).total_cmp(&distance(other)))
        .unwrap_or([0.0; 3])
}

/// What the natural maps of all contacts are worked out from.
struct Contacts<'a> {
    friction: &'a [f64],
    scale: &'a [f64],
    impulse: &'a [f64],
    velocity: &'a [f64],
}

impl Contacts<'_> {
    /// Σ ‖map‖² over the contacts.
    fn sum<const R: usize>(
        &self,
        map: impl Fn(f64, f64, &Vector<R>, &Vector<R>) -> Vector<R>,
    ) -> f64 {
        let (impulses, velocities) = (
            self.impulse.as_chunks::<R>().0,
            self.velocity.as_chunks::<R>().0,
        );
        let measures = self.friction.iter().zip(self.scale);
        let contacts = impulses.iter().zip(velocities).zip(measures);
        contacts
            .map(|((p, u), (&friction, &d))| {
                let map = map(friction, d, p, u);
                dot(&map, &map)
            })
            .sum()
    }

    /// Σ ‖map‖² of the law's own natural map.
    fn lawful<const R: usize>(&self, law: &impl Law<R>) -> f64 {
        self.sum(|friction, d, p, u| law.natural_map(friction, d, p, u))
    }
}

/// The natural map of the normal's half-line; tangential impulses should not be.
fn normal_map<const R: usize>(d: f64, p: &Vector<R>, u: &Vector<R>) -> Vector<R> {
    let mut map = p.map(|value| d * value);
    map[0] = u[0] + (map[0] - u[0]).min(0.0);
    map
}
