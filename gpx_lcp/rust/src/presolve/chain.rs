//! Collinear chains, each body between at most two others: solved directly in O(n), the founding paper's formula for two
//! bodies carried to any number of them.
//!
//! Let contact k lie between bodies k − 1 and k, and x_b be what the impulses add to the velocity of body b along the chain,
//! so that M_b x_b = p_k − p_{k+1} and u_k = x_k − x_{k−1} − B_k. With z_b = x_b − Σ_{j ≤ b} B_j, u_k = z_k − z_{k−1}, and the
//! frictionless law, 0 ≤ p ⟂ u ≥ 0, is the optimality condition of
//!
//! ```text
//! min Σ_b ½ M_b (z_b − ζ_b)²   over z_0 ≤ z_1 ≤ … ≤ z_n,    ζ_b = −Σ_{j ≤ b} B_j,
//! ```
//!
//! with the impulses for multipliers: isotonic regression, solved to rounding by pooling adjacent violators. Bodies that
//! stay together move with the velocity of their common centre of mass, as two do after a plastic collision, (1.2). A body
//! that cannot move, the ground under a column, is one of infinite mass. *Proof* that pooling is exact: Ayer et al., Best
//! and Chakravarti.
//!
//! Rows of a reduced system may come with factors: entries ±g of both contacts of a body are made equal by scaling rows
//! along the chain, which scales impulses back, and M_b = 1/g².
//!
//! Source: M. Ayer, H. D. Brunk, G. M. Ewing, W. T. Reid, E. Silverman, *An empirical distribution function for sampling
//! with incomplete information*, Ann. Math. Stat. 26 (1955); M. J. Best, N. Chakravarti, *Active set algorithms for
//! isotonic regression*, Math. Program. 47 (1990).

use super::Form;
use super::lift::Part;

/// The contacts of a part from one end of a chain to the other, which depend on its matrix alone.
pub struct Chain {
    links: Vec<Link>,
    /// Of the bodies along the chain.
    masses: Vec<f64>,
}

impl Chain {
    /// None where the part is no chain.
    pub fn of(part: &Part) -> Option<Self> {
        if part.form != Form::Velocity || part.rows != 1 || part.matrix.width != 1 {
            return None;
        }
        ordered(part)
    }

    /// The impulses, where the contacts are to cancel b; None where bodies are crushed between two that cannot move.
    pub fn solve(&self, b: &[f64]) -> Option<Vec<f64>> {
        let Self { links, masses } = self;
        let (mut shift, mut sum) = (Vec::with_capacity(masses.len()), 0.0);
        shift.push(0.0);
        for link in links {
            sum += link.scale * b[link.contact];
            shift.push(-sum);
        }
        let pools = pooled(masses, &shift)?;
        let mut impulse = vec![0.0; b.len()];
        for pool in &pools {
            let bodies = pool.begin..pool.end;
            // From the end that is free, inwards: the impulse on a body of infinite mass is what is left.
            if masses[pool.begin].is_finite() {
                let mut push = 0.0;
                for body in bodies.start..bodies.end - 1 {
                    push -= masses[body] * (pool.value - shift[body]);
                    links[body].set(&mut impulse, push);
                }
            } else {
                let mut push = 0.0;
                for body in (bodies.start + 1..bodies.end).rev() {
                    push += masses[body] * (pool.value - shift[body]);
                    links[body - 1].set(&mut impulse, push);
                }
            }
        }
        Some(impulse)
    }
}

/// A contact of the chain.
struct Link {
    contact: usize,
    /// Of the row of this contact.
    scale: f64,
}

impl Link {
    fn set(&self, impulse: &mut [f64], push: f64) {
        impulse[self.contact] = self.scale * push.max(0.0);
    }
}

const NONE: usize = usize::MAX;

/// The contacts from one end of the chain to the other, with the masses before and behind them; None where they form
/// anything else.
fn ordered(part: &Part) -> Option<Chain> {
    let matrix = &part.matrix;
    let mut contacts_of = vec![[NONE; 2]; matrix.block_columns];
    // The places of the one or two entries of each contact that are not zero.
    let mut ends_of = Vec::with_capacity(matrix.block_rows());
    for (contact, range) in matrix.starts.windows(2).enumerate() {
        let mut ends = [NONE; 2];
        for place in (range[0]..range[1]).filter(|&place| matrix.values[place] != 0.0) {
            take_free(&mut ends, place)?;
            take_free(&mut contacts_of[matrix.columns[place] as usize], contact)?;
        }
        if ends[0] == NONE {
            return None;
        }
        ends_of.push(ends);
    }
    let alone = |place: usize| contacts_of[matrix.columns[place] as usize][1] == NONE;
    // An end: a contact with a fixed body, or with one that has no other contact.
    let begins = |ends: &[usize; 2]| ends[1] == NONE || ends.iter().any(|&place| alone(place));
    let mut contact = ends_of.iter().position(begins)?;
    let mut before = match ends_of[contact] {
        [_, NONE] => NONE,
        [one, other] => {
            if alone(one) {
                one
            } else {
                other
            }
        }
    };
    let mut links = Vec::with_capacity(ends_of.len());
    let mut masses = Vec::with_capacity(ends_of.len() + 1);
    let mut scale = 1.0;
    loop {
        let [one, other] = ends_of[contact];
        let after = if one == before { other } else { one };
        let mass = |place: usize| {
            if place == NONE {
                return f64::INFINITY;
            }
            let entry = scale * matrix.values[place];
            1.0 / (entry * entry)
        };
        if masses.is_empty() {
            masses.push(mass(before));
        }
        masses.push(mass(after));
        links.push(Link { contact, scale });
        if after == NONE {
            break;
        }
        let body = matrix.columns[after];
        let [one, other] = contacts_of[body as usize];
        let next = if one == contact { other } else { one };
        if next == NONE {
            break;
        }
        let [one, other] = ends_of[next];
        let entry = if matrix.columns[one] == body {
            one
        } else {
            other
        };
        let ratio = matrix.values[after] / matrix.values[entry];
        // Pushed from both sides, or it is no chain.
        if ratio >= 0.0 {
            return None;
        }
        scale *= -ratio;
        contact = next;
        before = entry;
    }
    (links.len() == ends_of.len()).then_some(Chain { links, masses })
}

/// Puts a number in the first place that is free, if one is.
fn take_free(places: &mut [usize; 2], number: usize) -> Option<()> {
    let free = places.iter_mut().find(|place| **place == NONE)?;
    *free = number;
    Some(())
}

/// Bodies that move together, with their common z.
struct Pool {
    begin: usize,
    end: usize,
    mass: f64,
    value: f64,
}

/// Pools adjacent violators; None where one would hold two bodies of infinite mass.
fn pooled(masses: &[f64], shift: &[f64]) -> Option<Vec<Pool>> {
    let mut pools: Vec<Pool> = Vec::with_capacity(masses.len());
    for (body, (&mass, &value)) in masses.iter().zip(shift).enumerate() {
        let mut pool = Pool {
            begin: body,
            end: body + 1,
            mass,
            value,
        };
        while let Some(last) = pools.last()
            && last.value > pool.value
        {
            pool.value = match (last.mass.is_finite(), pool.mass.is_finite()) {
                (true, true) => {
                    last.value + (pool.value - last.value) * (pool.mass / (last.mass + pool.mass))
                }
                (false, true) => last.value,
                (true, false) => pool.value,
                (false, false) => return None,
            };
            pool.mass += last.mass;
            pool.begin = last.begin;
            pools.pop();
        }
        pools.push(pool);
    }
    Some(pools)
}

#[cfg(test)]
mod tests {
    use super::*;

    const INFINITE: f64 = f64::INFINITY;

    fn values(masses: &[f64], shift: &[f64]) -> Option<Vec<f64>> {
        let pools = pooled(masses, shift)?;
        let values = pools
            .iter()
            .flat_map(|pool| vec![pool.value; pool.end - pool.begin]);
        Some(values.collect())
    }

    #[test]
    fn what_rises_stays_apart() {
        assert_eq!(
            values(&[1.0, 2.0, 3.0], &[0.0, 1.0, 1.0]),
            Some(vec![0.0, 1.0, 1.0])
        );
    }

    #[test]
    fn what_falls_has_the_velocity_of_its_centre_of_mass() {
        assert_eq!(
            values(&[3.0, 1.0, 2.0], &[6.0, 0.0, 1.5]),
            Some(vec![3.5, 3.5, 3.5])
        );
    }

    #[test]
    fn ground_holds_what_falls_on_it() {
        assert_eq!(
            values(&[INFINITE, 1.0, 1.0], &[0.0, -1.0, 4.0]),
            Some(vec![0.0, 0.0, 4.0])
        );
        assert_eq!(
            values(&[1.0, 1.0, INFINITE], &[1.0, 3.0, 2.0]),
            Some(vec![1.0, 2.0, 2.0])
        );
    }

    #[test]
    fn nothing_fits_between_closing_walls() {
        assert_eq!(values(&[INFINITE, 1.0, INFINITE], &[0.0, 0.0, -1.0]), None);
    }
}
