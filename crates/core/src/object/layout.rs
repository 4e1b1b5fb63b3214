//! Where each parameter stands in the normal equations.

use super::model::Scope;
use crate::solve::envelope::reverse_cuthill_mckee;
use crate::template::Template;

/// Where each parameter stands in the normal equations: free-form first, in an order that keeps neighbours together, then pose, modes, velocity.
pub(super) struct Layout {
    pub position: Vec<usize>,
    pub first: Vec<usize>,
    pub free_form: usize,
    pub dense: usize,
}

impl Layout {
    pub fn new(template: &Template, scope: Scope) -> Self {
        let dense = 6 + if scope.modes { template.mode_count } else { 0 } + if scope.velocity { 3 } else { 0 };
        if !scope.free_form {
            return Self { position: Vec::new(), first: vec![0; dense], free_form: 0, dense };
        }
        let symmetry = &template.symmetry;
        let (mut coupled, in_contact) = (coupled_blocks(template), contact_blocks(template));
        let mut order = reverse_cuthill_mckee(&coupled);
        order.sort_by_key(|block| in_contact.contains(block)); // stable: wheels touch each other through the ground, so they come last
        in_contact.iter().for_each(|&block| coupled[block as usize].extend(&in_contact));
        let mut position = vec![0; symmetry.dimension()];
        let mut block_start = vec![0; coupled.len()];
        let mut next = 0;
        for block in order {
            let block = block as usize;
            block_start[block] = next;
            for at in &mut position[symmetry.offset[block]..symmetry.offset[block + 1]] {
                *at = next;
                next += 1;
            }
        }
        let mut first = vec![0; next + dense];
        for (block, others) in coupled.iter().enumerate() {
            let earliest = others.iter().map(|&b| block_start[b as usize]).fold(block_start[block], usize::min);
            for dof in symmetry.offset[block]..symmetry.offset[block + 1] {
                first[position[dof]] = earliest;
            }
        }
        Self { position, first, free_form: next, dense }
    }

    /// Where the velocity stands among the dense parameters.
    pub fn velocity_start(&self) -> usize {
        self.dense - 3
    }

    /// Free-form parameters in the order of the normal equations.
    pub fn ordered(&self, d: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.free_form];
        for (dof, value) in d.iter().enumerate() {
            out[self.position[dof]] = *value;
        }
        out
    }
}

/// Free-form blocks of the vertices that touch the ground.
fn contact_blocks(template: &Template) -> Vec<u32> {
    let vertices = template.contacts.iter().flat_map(|contact| &contact.weights);
    let mut blocks: Vec<u32> = vertices.map(|&(v, _)| template.symmetry.block_of[v as usize]).collect();
    blocks.sort_unstable();
    blocks.dedup();
    blocks
}

/// Free-form blocks that share a row: a vertex's neighbours through the Laplacian, a key point's vertices.
fn coupled_blocks(template: &Template) -> Vec<Vec<u32>> {
    let symmetry = &template.symmetry;
    let mut coupled = vec![Vec::new(); symmetry.representative.len()];
    let around = template.laplacian.iter().enumerate().map(|(block, row)| (Some(block as u32), row));
    let keypoints = template.keypoints.iter().map(|association| (None, association));
    for (block, row) in around.chain(keypoints) {
        let members: Vec<u32> = row.iter().map(|&(v, _)| symmetry.block_of[v as usize]).chain(block).collect();
        for &a in &members {
            coupled[a as usize].extend(members.iter().copied().filter(|&b| b != a));
        }
    }
    for list in &mut coupled {
        list.sort_unstable();
        list.dedup();
    }
    coupled
}
