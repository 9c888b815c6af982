//! Parts of a system given by A alone: the blocks of an island, without friction their normal rows.
//!
//! Both are exact as they are for Ĵ: A is block-diagonal over islands, and without friction no law says anything about
//! tangents, so that their rows are asked nothing and, without impulse, their columns do nothing.

use crate::exact::BlockMatrix;

use super::lift::{Growth, Model, Part, Share};
use super::local_bodies::LocalBodies;
use super::{Form, View};

impl Part {
    /// The blocks of A between these contacts, without friction their normal rows alone.
    pub fn of_delassus(view: &View, contacts: &[u32], local: &mut LocalBodies) -> Self {
        let frictionless = !contacts.iter().any(|&contact| view.has_friction(contact));
        let (model, rows) = if frictionless && view.rows > 1 {
            (Model::Frictionless, 1)
        } else {
            (Model::Spatial, view.rows)
        };
        local.renumber_to(contacts);
        let mut matrix = BlockMatrix {
            starts: vec![0],
            height: rows,
            width: rows,
            block_columns: contacts.len(),
            ..BlockMatrix::default()
        };
        let mut b = Vec::with_capacity(contacts.len() * rows);
        let mut factor = 1.0_f64;
        for &contact in contacts {
            for (place, &other) in view.places(contact).zip(view.bodies_of(contact)) {
                let Some(column) = local.known(other) else {
                    continue;
                };
                if other == contact {
                    let most = (0..view.rows)
                        .map(|r| view.row(place, r)[r])
                        .fold(0.0, f64::max);
                    let kept = (0..rows).map(|r| view.row(place, r)[r]).fold(0.0, f64::max);
                    if kept > 0.0 {
                        factor = factor.max(most / kept);
                    }
                }
                matrix.columns.push(column);
                (0..rows)
                    .for_each(|r| matrix.values.extend_from_slice(&view.row(place, r)[..rows]));
            }
            matrix.starts.push(matrix.columns.len());
            b.extend_from_slice(&view.target(contact)[..rows]);
        }
        let friction = contacts
            .iter()
            .map(|&contact| view.friction[contact as usize]);
        Self {
            form: Form::Impulse,
            model,
            contacts: contacts.to_vec(),
            shares: (0..contacts.len() as u32).map(Share::whole).collect(),
            rows,
            matrix,
            b,
            friction: friction.collect(),
            growth: Growth::of_rows(factor),
        }
    }
}
