//! Independent islands: contacts that no chain of moving bodies joins are solved apart.
//!
//! *Proof*: order contacts and bodies by islands. A block Ĵ_ib that is not zero joins contact i and body b, so that Ĵ and
//! with it A = Ĵ Ĵᵀ are block-diagonal over islands; laws and B speak of single contacts. ∎
//!
//! A body that nothing can move has no block, or a block of zeros, and joins nothing.
//!
//! Where A is all there is, contacts are joined by its blocks that are not zero, which says the same.

use super::{Form, View};

/// All contacts of a system by islands.
pub fn all_islands(view: &View) -> Vec<Vec<u32>> {
    let contacts: Vec<u32> = (0..view.contacts() as u32).collect();
    islands(view, &contacts)
}

/// These contacts, which rise, by islands, in rising order; islands in the order of their first contact.
pub fn islands(view: &View, contacts: &[u32]) -> Vec<Vec<u32>> {
    let mut parent: Vec<u32> = (0..view.bodies as u32).collect();
    // The columns of A are contacts, and those left out join nothing.
    let inside = match view.form {
        Form::Impulse if contacts.len() < view.contacts() => {
            let mut inside = vec![false; view.bodies];
            contacts
                .iter()
                .for_each(|&contact| inside[contact as usize] = true);
            inside
        }
        _ => Vec::new(),
    };
    let counts = |body: &u32| inside.is_empty() || inside[*body as usize];
    // A body of each contact, if any.
    let mut of_contact = Vec::with_capacity(contacts.len());
    for &contact in contacts {
        let mut first = None;
        for body in moved_bodies(view, contact).filter(counts) {
            let root = find(&mut parent, body);
            match first {
                None => first = Some(root),
                Some(other) => parent[root.max(other) as usize] = root.min(other),
            }
            first = first.map(|other| other.min(root));
        }
        of_contact.push(first);
    }
    let mut island_of = vec![u32::MAX; view.bodies];
    let mut islands: Vec<Vec<u32>> = Vec::new();
    for (&contact, body) in contacts.iter().zip(of_contact) {
        let Some(body) = body else {
            islands.push(vec![contact]);
            continue;
        };
        let root = find(&mut parent, body) as usize;
        if island_of[root] == u32::MAX {
            island_of[root] = islands.len() as u32;
            // As a rule the first one has most of them.
            let all = if islands.is_empty() {
                contacts.len()
            } else {
                0
            };
            islands.push(Vec::with_capacity(all));
        }
        islands[island_of[root] as usize].push(contact);
    }
    islands
}

/// The bodies that the impulses of a contact move.
fn moved_bodies<'a>(view: &View<'a>, contact: u32) -> impl Iterator<Item = u32> {
    let size = view.rows * view.width;
    let view = *view;
    view.places(contact)
        .filter(move |&place| {
            view.whitened[place * size..][..size]
                .iter()
                .any(|&value| value != 0.0)
        })
        .map(move |place| view.columns[place])
}

fn find(parent: &mut [u32], mut node: u32) -> u32 {
    while parent[node as usize] != node {
        let above = parent[parent[node as usize] as usize];
        parent[node as usize] = above;
        node = above;
    }
    node
}
