//! Numbers for the bodies of an island.

use super::View;

/// The bodies of one island, numbered from zero.
pub struct LocalBodies {
    number: Vec<u32>,
    seen: Vec<u32>,
}

impl LocalBodies {
    pub fn new(bodies: usize) -> Self {
        Self {
            number: vec![u32::MAX; bodies],
            seen: Vec::new(),
        }
    }

    /// Forgets the bodies before, and numbers those of these contacts.
    pub fn renumber(&mut self, view: &View, contacts: &[u32]) {
        for body in self.seen.drain(..) {
            self.number[body as usize] = u32::MAX;
        }
        for &contact in contacts {
            for &body in view.bodies_of(contact) {
                let number = &mut self.number[body as usize];
                if *number == u32::MAX {
                    *number = self.seen.len() as u32;
                    self.seen.push(body);
                }
            }
        }
    }

    /// Forgets the bodies before, and numbers these in their order.
    pub fn renumber_to(&mut self, bodies: &[u32]) {
        for body in self.seen.drain(..) {
            self.number[body as usize] = u32::MAX;
        }
        for (number, &body) in bodies.iter().enumerate() {
            self.number[body as usize] = number as u32;
        }
        self.seen.extend_from_slice(bodies);
    }

    pub fn bodies(&self) -> &[u32] {
        &self.seen
    }

    /// The number of a body, None where it has none.
    pub fn known(&self, body: u32) -> Option<u32> {
        let number = self.number[body as usize];
        (number != u32::MAX).then_some(number)
    }

    pub fn number(&self, body: u32) -> usize {
        self.number[body as usize] as usize
    }

    pub fn count(&self) -> usize {
        self.seen.len()
    }
}
